"""An SRDF beside a robot's file: named postures, home, hands, and links whose contacts are ignored."""

import time

import numpy as np
import pytest
from pydrake.geometry import Role

from simrob_drake import Arm, load_station
from simrob_drake.base.errors import InvalidModel
from simrob_drake.importer.importing import import_robot, robot_from_file
from simrob_drake.robots.imports import ImportOptions
from tests.robots.hands import box, gantry, joint, link

SRDF = """<robot name="gantry">
<group name="arm"><chain base_link="base" tip_link="palm"/></group>
<group name="hand"><link name="left"/><joint name="right_slide"/></group>
<group name="all"><group name="arm"/><group name="hand"/></group>
<group_state name="home" group="arm"><joint name="along" value="0"/><joint name="lift" value="0.1"/></group_state>
<group_state name="far" group="all"><joint name="along" value="0.25"/><joint name="left_slide" value="0.01"/>
<joint name="gone" value="1"/><joint name="floating" value="0 0 0"/></group_state>
<group_state name="Open" group="hand"><joint name="left_slide" value="{opened}"/></group_state>
<end_effector name="hand" parent_link="palm" group="hand"/>
<disable_collisions link1="base" link2="palm" reason="Never"/><disable_collisions link1="base" link2="nowhere"/>
</robot>"""


@pytest.fixture
def file(tmp_path):
    source = tmp_path / "robot" / "urdf" / "gantry.urdf"
    source.parent.mkdir(parents=True)
    source.write_text(gantry())
    return source


def beside(file, text=None, folder="../srdf"):
    place = file.parent / folder / "gantry.srdf"
    place.parent.mkdir(exist_ok=True)
    place.write_text(text or SRDF.format(opened=0.04))
    return place


@pytest.mark.parametrize("folder", [".", "../srdf", "../config"])
def test_states_are_postures_and_home_is_home(file, folder):
    assert robot_from_file(file).postures == {}

    beside(file, folder=folder)
    robot = robot_from_file(file)

    assert robot.postures == {
        "far": {"along": 0.25, "left_slide": 0.01},
        "Open": {"left_slide": 0.04},
    }
    np.testing.assert_allclose(robot.home, [0, 0.1, 0.04, 0.04])
    assert robot.gripper.axes == {"left_slide": (0, 0.04), "right_slide": (0, 0.04)}


def test_a_station_goes_to_them(file):
    beside(file)
    (file.parent / "own.yaml").write_text("robot: {urdf: gantry.urdf}\nmode: kinematic\n")
    arm = Arm(load_station(file.parent / "own.yaml", mesh_path=[file.parents[1]]))
    arm.move_abs_j("far")

    # The posture names one finger, and the other one follows it. The second axis stays at home, where it began.
    home = arm.cell.robot("robot").model.home[1]

    np.testing.assert_allclose(arm.reference, [0.25, home, 0.01, 0.01])
    assert home == pytest.approx(0.1)


def test_fingers_are_open_where_it_says_so(file, tmp_path):
    beside(file, SRDF.format(opened=0.002))
    made = import_robot(file, tmp_path / "made")

    assert made.model.gripper.axes == {"left_slide": (0.04, 0), "right_slide": (0.04, 0)}
    assert "open and closed positions of left_slide are exchanged, as the SRDF has them" in [
        entry.text for entry in made.report.of("repaired")
    ]


def test_what_the_robot_lacks_is_told(file, tmp_path):
    beside(file)
    report = import_robot(file, tmp_path / "made").report

    assert "the robot has no joint 'gone'" in [entry.text for entry in report.of("dropped")]

    read = next(entry for entry in report.of("read") if "SRDF" in entry.element)
    assert read.text == "postures home, far, Open; 1 pairs of links whose contacts are ignored"


def test_links_that_do_not_mind_each_other_never_collide(file):
    def met():
        cell = Arm(load_station(file.parent / "own.yaml", mesh_path=[file.parents[1]])).cell
        model = cell.free_space(["robot"]).model
        inspector, plant = model.query().inspector(), model.plant
        shapes = inspector.GetAllGeometryIds(Role.kProximity)
        of = {
            plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).name(): shape for shape in shapes
        }
        return inspector.CollisionFiltered(of["base"], of["palm"])

    (file.parent / "own.yaml").write_text("robot: {urdf: gantry.urdf}\nmode: kinematic\n")
    assert not met()
    beside(file)
    assert met()


def test_a_carrier_of_a_hand_is_the_first_tool(tmp_path):
    parts = [link("base"), link("arm", box("0.1 0.1 0.1")), link("flange"), link("camera")]
    joints = [
        joint("turn", "base", "arm"),
        joint("fix", "arm", "flange", kind="fixed"),
        joint("eye", "arm", "camera"),
    ]

    (tmp_path / "gantry.urdf").write_text(
        f'<robot name="gantry">{"".join([*parts, *joints])}</robot>'
    )

    assert next(iter(robot_from_file(tmp_path / "gantry.urdf").tools)) != "flange"

    end = '<end_effector name="e" parent_link="flange" group="h"/>'
    beside(tmp_path / "gantry.urdf", f'<robot name="gantry">{end}</robot>', ".")

    assert next(iter(robot_from_file(tmp_path / "gantry.urdf").tools)) == "flange"


def test_a_broken_one_is_left_out_unless_it_was_asked_for(file, tmp_path):
    broken = beside(file, "<robot")
    made = import_robot(file, tmp_path / "made")

    assert [entry.element for entry in made.report.of("dropped")] == ["SRDF gantry.srdf"]
    assert made.model.postures == {}
    with pytest.raises(InvalidModel, match=r"gantry\.srdf"):
        import_robot(file, tmp_path / "again", ImportOptions(srdf=broken))

    good = tmp_path / "other.srdf"
    good.write_text(SRDF.format(opened=0.04))

    assert import_robot(
        file, tmp_path / "third", ImportOptions(srdf=good)
    ).model.postures.keys() == {"far", "Open"}


def test_groups_in_a_circle_end(file):
    circle = '<group name="hand"><group name="all"/></group><group name="all"><group name="hand"/></group>'
    end = '<end_effector name="e" parent_link="palm" group="all"/>'

    beside(file, f'<robot name="gantry">{circle}{end}</robot>')

    assert robot_from_file(file).gripper is not None


def test_groups_that_name_others_twice_are_read_once(file):
    """Thirty levels of two names each: 2**30 groups, if each were read again."""
    levels = "".join(
        f'<group name="g{level}"><group name="g{level + 1}"/><group name="g{level + 1}"/></group>'
        for level in range(30)
    )
    end = '<group name="g30"><joint name="lift"/></group><end_effector name="e" parent_link="palm" group="g0"/>'
    beside(file, f'<robot name="gantry">{levels}{end}</robot>')
    began = time.process_time()

    robot = robot_from_file(file)

    assert time.process_time() - began < 5
    assert robot.tools["palm"] == "palm"
