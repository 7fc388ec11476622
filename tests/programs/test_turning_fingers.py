"""Fingers that turn: their width and force, against the closed form of a linkage, and what friction then holds."""

import numpy as np
import pytest

from simrob_drake import Arm, Workcell, load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.importer.importing import robot_from_file
from simrob_drake.robots.grasps import stroke_of
from simrob_drake.stations.draft import draft_station
from tests.robots.hands import CRANK, FACE, HINGE, gantry, joint, link, linkage

CUBE = {"pieces.cube": {"model": "cube", "mass": 1.0, "free": True, "pose": [0, 0, 0.02, 0, 0, 0]}}
SIDE = 0.04  # m, of the cube
AT_CUBE = np.arcsin(
    (HINGE - FACE - SIDE / 2) / CRANK
)  # rad: the crank, when the pads touch the cube
DOWN = (
    0.4 - (CRANK * np.cos(AT_CUBE) + 0.01) - SIDE / 2
)  # m: the middle of the pads is that of the cube


@pytest.fixture(scope="module")
def station(tmp_path_factory):
    folder = tmp_path_factory.mktemp("linkage")
    (folder / "gantry.urdf").write_text(gantry(*linkage()))
    (folder / "station.yaml").write_text(draft_station(folder / "gantry.urdf", folder=folder))
    return folder / "station.yaml"


def test_the_stroke_is_that_of_its_cranks(station):
    """Four axes that turn as one by q: 4 t dq = 2 F ds, where each face goes inward by ds = CRANK cos q dq."""
    robot = robot_from_file(station.parent / "gantry.urdf")

    stroke = stroke_of(robot)
    cranks = 0.6 * (1 - np.linspace(0, 1, len(stroke.gaps)))
    np.testing.assert_allclose(stroke.gaps, 2 * (HINGE - FACE - CRANK * np.sin(cranks)), atol=1e-5)
    assert stroke.fingers == 2
    assert stroke.effort(0.5) == pytest.approx(CRANK * np.cos(0.3) / 2, rel=1e-3)


def test_a_width_is_how_far_the_faces_are_apart(station):
    arm = Arm(
        load_station(
            station,
            {
                "mode": "kinematic",
                "contact": None,
                "couplings": {},
            },
        )
    )
    arm.open(width=SIDE)

    np.testing.assert_allclose(arm.position[2:], np.array([1, -1, -1, 1]) * AT_CUBE, atol=1e-4)
    with pytest.raises(
        SimrobError,
        match=r"width is 0\.06; it must be at most 0\.05 m, the largest opening of gantry",
    ):
        arm.open(width=0.06)


@pytest.mark.long
@pytest.mark.parametrize(("part", "holds"), [(1.05, True), (0.95, False)])
def test_a_force_is_that_of_each_finger_as_coulomb_says(station, part, holds):
    """m g = 2 mu N; what hangs on a leaning crank opens it: a pad presses less by its tangent times that weight."""
    hanging = 1.0 / 2 + 0.05 + 0.05 / 2  # kg on each crank: half of the cube, a pad, half of a bar
    critical = 9.80665 * (1.0 / (2 * 0.5) + hanging * np.tan(AT_CUBE))
    cell = Workcell(load_station(station, CUBE))
    arm = cell.arm()
    arm.move_abs_j([0, DOWN])

    gripped = arm.grip(force=part * critical)

    assert arm.position[2] == pytest.approx(AT_CUBE, abs=0.01)

    raised = arm.move_abs_j([0, DOWN - 0.03], duration=1.5)
    lifted = cell.frame("cube").translation()[2] - SIDE / 2

    assert gripped.ending == raised.ending == "completed"
    if holds:
        assert lifted == pytest.approx(0.03, abs=0.01)
        effort = part * critical * CRANK * np.cos(AT_CUBE) / 2
        np.testing.assert_allclose(np.abs(raised.axes("tau")[-1, 2:]), effort, rtol=0.01)
    else:
        assert lifted < 0.005


def test_what_their_motors_cannot_give_is_refused_in_newtons(station):
    arm = Workcell(load_station(station, CUBE)).arm()
    with pytest.raises(
        SimrobError, match=r"force is 10000\.0; it must be at most 3333 N, the largest force"
    ):
        arm.grip(force=1e4)


def test_an_empty_grip_of_fingers_that_meet_before_their_limit_is_told(station):
    """Their faces meet at asin(25/60) = 0.43 rad, and their limit is at 0.6."""
    arm = Arm(load_station(station, {"monitors": {"dropped": {"kind": "empty_grip"}}}))
    assert arm.grip().stopped_by == "dropped"


def test_a_joint_that_follows_may_go_where_that_takes_it(tmp_path):
    """Published hands have pads whose limits have the wrong sign for the factor by which they follow."""
    file = tmp_path / "gantry.urdf"
    file.write_text(gantry(*linkage(pad_limits=(0.0, 0.6))))

    robot = robot_from_file(file)

    places = [list(robot.axes).index(name) for name in ("left_pin", "right_pin")]
    np.testing.assert_allclose(
        np.transpose(robot.axis_limits)[places], [[-0.6, 0.6], [0, 0.6]], atol=1e-9
    )


def test_fingers_that_turn_and_have_no_shapes_are_refused_a_force_but_close(tmp_path):
    sides = []
    for name, sign in (("left", 1), ("right", -1)):
        more = "" if sign > 0 else '<mimic joint="left" multiplier="-1"/>'
        low, high = (0, 0.6) if sign > 0 else (-0.6, 0)
        sides.append(link(f"{name}_finger", com="0 0 0.05"))
        sides.append(joint(name, "palm", f"{name}_finger", kind="revolute", at=f"0 {sign * HINGE} 0", low=low,
                           high=high, more=more))  # fmt: skip
    (tmp_path / "gantry.urdf").write_text(gantry(*sides))
    (tmp_path / "station.yaml").write_text(draft_station(tmp_path / "gantry.urdf", folder=tmp_path))

    arm = Arm(load_station(tmp_path / "station.yaml"))

    with pytest.raises(
        SimrobError, match="the shapes of the fingers of gantry do not determine where they meet"
    ):
        arm.grip(force=10)

    arm.grip()
    assert arm.position[2] == pytest.approx(0.6, abs=0.02)
