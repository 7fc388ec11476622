"""Where fingers grasp, against where the boxes that they are made of meet."""

import numpy as np
import pytest

from simrob_drake.importer.importing import import_robot, robot_from_file
from simrob_drake.robots.grasps import grasp_frame
from tests.robots.hands import box, finger, gantry, joint, link

TURNS = {"kind": "revolute", "axis": "1 0 0"}


def grasp(tmp_path, text):
    file = tmp_path / "robot.urdf"
    file.write_text(text)
    return grasp_frame(robot_from_file(file))


def test_pads_that_slide_meet_in_the_middle_of_their_faces(tmp_path):
    palm, pose = grasp(tmp_path, gantry())
    assert palm == "palm"
    np.testing.assert_allclose(
        pose.GetAsMatrix34(), [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.07]], atol=1e-6
    )


def test_long_faces_grasp_with_the_square_at_their_tips(tmp_path):
    sides = []
    for name, sign in (("left", 1), ("right", -1)):
        sides.append(
            link(name, box("0.02 0.01 0.08", f"0 {sign * 0.005} 0.04"), com=f"0 {sign * 0.01} 0.03")
        )
        sides.append(joint(name, "palm", name, axis=f"0 {sign} 0", low=0, high=0.04))

    _, pose = grasp(tmp_path, gantry(*sides))

    # within half a line of the grid
    np.testing.assert_allclose(pose.translation(), [0, 0, 0.07], atol=5e-4)


def test_a_hand_that_closes_along_another_axis_has_its_y_along_that(tmp_path):
    """The fingers of a hand whose palm looks along x and closes along z."""
    sides = []
    for name, sign in (("up", 1), ("down", -1)):
        shapes = box("0.02 0.02 0.01", f"0.065 0 {sign * 0.005}")
        sides.append(link(name, shapes, com=f"0.03 0 {sign * 0.01}"))
        sides.append(joint(name, "palm", name, axis=f"0 0 {sign}", low=0, high=0.03))
    _, pose = grasp(tmp_path, gantry(*sides))

    turn = pose.rotation().matrix()

    np.testing.assert_allclose(turn[:, 2], [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(np.abs(turn[:, 1]), [0, 0, 1], atol=1e-9)
    assert np.linalg.det(turn) == pytest.approx(1)
    np.testing.assert_allclose(pose.translation(), [0.065, 0, 0], atol=1e-6)


def test_fingers_that_turn_meet_at_their_tips_first(tmp_path):
    """Boxes of 80 x 10 mm on hinges 30 mm aside, inner faces 5 mm from these, meet where a corner is at y = 0.

    The corner of a finger that has turned inward by t from upright is at y = 0.03 - 0.005 cos t - 0.08 sin t.
    """
    sides = []
    for name, sign in (("left", 1), ("right", -1)):
        more = "" if sign > 0 else '<mimic joint="left" multiplier="-1"/>'
        ends = {"low": 0, "high": 0.8} if sign > 0 else {"low": -0.8, "high": 0}
        sides.append(link(name, box("0.02 0.01 0.08", "0 0 0.04"), com="0 0 0.04"))
        sides.append(joint(name, "palm", name, at=f"0 {sign * 0.03} 0", more=more, **TURNS, **ends))
    _, pose = grasp(tmp_path, gantry(*sides))
    turns = np.linspace(0, 0.8, 100_001)
    met = turns[np.argmin(np.abs(0.03 - 0.005 * np.cos(turns) - 0.08 * np.sin(turns)))]
    corner = 0.08 * np.cos(met) - 0.005 * np.sin(met)

    x, y, z = pose.translation()

    np.testing.assert_allclose([x, y], 0, atol=1e-6)
    assert corner - 0.004 < z < corner + 1e-6  # faces that are a millimetre farther apart meet, too


@pytest.mark.parametrize(
    "fingers",
    [
        (finger("left"),),
        (link("left", com="0 0.01 0"), joint("left", "palm", "left", axis="0 1 0", high=0.04, low=0),
         link("right", com="0 -0.01 0"), joint("right", "palm", "right", axis="0 -1 0", high=0.04, low=0)),
    ],
    ids=["one", "without shapes"],
)  # fmt: skip
def test_what_does_not_close_on_anything_has_no_grasp(tmp_path, fingers):
    assert grasp(tmp_path, gantry(*fingers)) is None


def test_an_import_makes_it_the_first_tool_and_says_so(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "robot.urdf").write_text(gantry())

    made = import_robot(tmp_path / "a" / "robot.urdf", tmp_path / "b")

    assert list(made.model.tools)[:2] == ["grasp", "palm"]
    assert made.model.home_deg == {"left_slide": 0.04, "right_slide": 0.04}

    told = [entry.text for entry in made.report.of("read") if entry.element == "frame 'grasp'"]
    assert told == [
        "added where the fingers meet, at [0 0 0.07] m in 'palm'. The fingers close along the y axis of the frame"
    ]


def test_a_place_that_the_file_names_stays_the_first_tool(tmp_path):
    own = link("hand_tcp", mass=1e-3) + joint(
        "tcp", "palm", "hand_tcp", kind="fixed", at="0 0 0.065"
    )
    file = tmp_path / "robot.urdf"

    file.write_text(gantry().replace("</robot>", f"{own}</robot>"))

    assert list(robot_from_file(file).tools)[:3] == ["hand_tcp", "grasp", "palm"]


def test_fingers_press_with_all_they_have_from_a_tenth_of_their_way(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(
        gantry(finger("left", effort=60), finger("right", effort=60, follows="left_slide"))
    )

    kp = robot_from_file(file).servo.kp

    assert kp["left_slide"] * 0.1 * 0.04 == pytest.approx(60, rel=0.01)


def test_axes_that_carry_fingers_give_all_they_have_30_deg_off(tmp_path):
    """A wrist that weighs next to nothing about its own axis: the hand will hold more than itself."""
    wrist = link("wrist", mass=0.01) + joint(
        "turn", "palm", "wrist", kind="revolute", axis="0 0 1", effort=9
    )
    text = gantry(finger("left"), finger("right", follows="left_slide")).replace(
        'parent link="palm"', 'parent link="wrist"'
    )
    (tmp_path / "robot.urdf").write_text(text.replace("</robot>", f"{wrist}</robot>"))

    robot = robot_from_file(tmp_path / "robot.urdf")

    assert list(robot.gripper.axes) == ["left_slide", "right_slide"]
    assert robot.servo.kp["turn"] * np.deg2rad(30) == pytest.approx(9, rel=0.05)
