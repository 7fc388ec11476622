"""First stations for robots of which only the URDF is given: they run at once."""

import numpy as np
import pytest

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.files import models_root
from simrob_drake.base.folders import CACHE_VARIABLE
from simrob_drake.programs.whole_program import run_whole
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.simulation import simulate
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.load import load_station


@pytest.fixture(autouse=True)
def _cache(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))


def drafted(tmp_path, urdf, options=None):
    file = tmp_path / "first.yaml"
    file.write_text(draft_station(urdf, options, folder=tmp_path))
    return load_station(file)


def test_an_arm_follows_its_first_move(tmp_path):
    config = drafted(tmp_path, models_root() / "irb120" / "irb120.urdf")

    assert not [finding for finding in check_station(config) if finding.level == "warning"]

    result = simulate(config, progress=False)
    assert result.ending == "completed"

    moved = np.rad2deg(np.abs(result.axes("q")[-1] - result.axes("q")[0]))
    assert (moved > 15).all()
    assert np.rad2deg(np.abs(result.axes("q_ref")[-1] - result.axes("q")[-1])).max() < 0.01


@pytest.mark.long
def test_a_floating_robot_stands_on_the_floor(tmp_path):
    config = drafted(
        tmp_path, models_root() / "irb120" / "irb120.urdf", ImportOptions(base="floating")
    )

    assert config.contact is not None

    result = simulate(config, duration=1.0, progress=False)
    assert result.ending == "completed"

    base = result.pose("base")
    assert base[0, 2] == pytest.approx(0.0, abs=1e-6)  # the foot of the arm is at its origin
    assert base[-1, 2] == pytest.approx(0.0, abs=2e-3)


def test_a_robot_without_inertias_moves_kinematically(tmp_path, one_joint_urdf, write_urdf):
    start, end = (
        one_joint_urdf.index("<inertial>"),
        one_joint_urdf.index("</inertial>") + len("</inertial>"),
    )
    urdf = write_urdf(one_joint_urdf[:start] + one_joint_urdf[end:])

    config = drafted(tmp_path, urdf)

    assert config.mode == "kinematic"
    assert simulate(config, duration=0.5, progress=False).ending == "completed"
    assert "upper" in draft_station(urdf)  # the link is named in the comment

    estimated = drafted(tmp_path, urdf, ImportOptions(estimate_inertia=True))
    assert estimated.mode == "dynamic"
    assert simulate(estimated, duration=0.5, progress=False).ending == "completed"


def test_a_description_with_a_floating_base_needs_shapes(one_joint_urdf, write_urdf):
    """A floating robot of a YAML file is refused, with a remedy, if no link of it can stand on the floor."""
    collision_end = one_joint_urdf.index("</collision>") + len("</collision>")
    without_shapes = (
        one_joint_urdf[: one_joint_urdf.index("<collision>")] + one_joint_urdf[collision_end:]
    )
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    urdf = write_urdf(without_shapes.replace('<link name="base">', f'<link name="base">{inertial}'))
    description = urdf.with_name("floating.yaml")
    description.write_text(
        f"urdf: {urdf.name}\nroot: base\nbase: floating\naxes: [shoulder]\ntools: {{}}\n"
    )

    with pytest.raises(
        Unsuitable,
        match=r"floating\.yaml: base: the base is floating, but no link has a collision shape",
    ):
        draft_station(description)


def test_links_without_shapes_are_not_said_to_be_clear_of_the_ground(
    tmp_path, one_joint_urdf, write_urdf
):
    config = drafted(tmp_path, write_urdf(one_joint_urdf))  # whose base alone has one
    (finding,) = [one for one in check_station(config) if one.subject.startswith("floor and")]
    assert (finding.level, finding.text) == (
        "note",
        "not examined: no moving link has a collision shape",
    )


def test_an_axis_that_slides_moves_by_metres(tmp_path, one_joint_urdf, write_urdf):
    urdf = write_urdf(one_joint_urdf.replace("revolute", "prismatic"))
    config = drafted(tmp_path, urdf)

    result = simulate(config, progress=False)

    assert result["q.shoulder"][-1] == pytest.approx(0.05, abs=0.005)


@pytest.mark.parametrize(
    "options", [None, ImportOptions(base="fixed")], ids=["as it is", "imported"]
)
@pytest.mark.parametrize(
    ("kind", "middle"), [("prismatic", 0.3), ("revolute", np.deg2rad(17.1887))]
)
def test_an_axis_that_cannot_be_at_zero_starts_midway(
    tmp_path, one_joint_urdf, write_urdf, kind, middle, options
):
    urdf = write_urdf(
        one_joint_urdf.replace("revolute", kind).replace(
            'lower="-1" upper="2"', 'lower="0.1" upper="0.5"'
        )
    )
    config = drafted(tmp_path, urdf, options)
    assert simulate(config, duration=0.1, progress=False)["q.shoulder"][0] == pytest.approx(
        middle, abs=1e-6
    )


def test_paths_are_relative_to_the_station_where_that_is_near(tmp_path, one_joint_urdf, write_urdf):
    urdf = write_urdf(one_joint_urdf)
    assert "urdf: robot/arm.urdf" in draft_station(urdf, folder=tmp_path)
    assert f"urdf: {urdf}" in draft_station(urdf, folder=tmp_path / "elsewhere")


def test_joints_of_any_name_become_couplings(tmp_path, one_joint_urdf, write_urdf):
    """Some published files put the robot's name and a colon before each joint's."""
    jaw = """
      <link name="jaw">
        <inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
      </link>
      <joint name="arm:2nd jaw" type="revolute">
        <parent link="base"/><child link="jaw"/><axis xyz="0 1 0"/><mimic joint="shoulder"/>
        <limit lower="-1" upper="2" effort="10" velocity="3"/>
      </joint>"""
    config = drafted(tmp_path, write_urdf(one_joint_urdf.replace("</robot>", f"{jaw}</robot>")))
    assert list(config.couplings) == ["arm_2nd_jaw_follows"]


SLIDE = """
<link name="{name}">
  <visual><geometry><box size="0.01 0.02 0.06"/></geometry></visual>
  <inertial><mass value="0.05"/><inertia ixx="2e-5" iyy="2e-5" izz="3e-6" ixy="0" ixz="0" iyz="0"/></inertial>
</link>
<joint name="{name}_joint" type="prismatic">
  <parent link="palm"/><child link="{name}"/><origin xyz="{x} 0 0.05"/><axis xyz="{axis} 0 0"/>
  <limit lower="0" upper="0.04" effort="20" velocity="0.1"/>
</joint>
"""


def gripper_alone(left, right):
    """URDF of two slides on a palm that nothing moves, with the names of their links."""
    palm = """<link name="palm"><visual><geometry><box size="0.1 0.06 0.04"/></geometry></visual><inertial>
    <mass value="0.6"/><inertia ixx="5e-4" iyy="8e-4" izz="9e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
    slides = SLIDE.format(name=left, x=0.005, axis=1) + SLIDE.format(name=right, x=-0.005, axis=-1)
    return f'<robot name="two">{palm}{slides}</robot>'


@pytest.mark.parametrize(
    ("names", "is_gripper"), [(("left_finger", "right_finger"), True), (("a", "b"), False)]
)
def test_a_gripper_without_an_arm_is_known_by_the_names_of_its_fingers(tmp_path, names, is_gripper):
    """The file has no joint that moves the palm. Two slides without telling names may belong to a machine."""
    urdf = tmp_path / "two.urdf"
    urdf.write_text(gripper_alone(*names))

    text = draft_station(urdf, folder=tmp_path)

    assert ("`grip: {force: 20}`" in text) == is_gripper


def test_slow_fingers_have_the_time_that_they_need(tmp_path):
    """Their moves took 1 s, which was refused as too fast: the first station did not run."""
    text = gripper_alone("left_finger", "right_finger").replace('velocity="0.1"', 'velocity="0.01"')
    (tmp_path / "slow.urdf").write_text(text)
    file = tmp_path / "first.yaml"
    file.write_text(draft_station(tmp_path / "slow.urdf", folder=tmp_path))

    result = run_whole(load_station(file))

    assert result.ending == "completed"
    assert not result.verdict.warnings


def test_a_gripper_closes_and_opens_its_fingers(tmp_path):
    """A first station shows what its fingers do, and names the moves that take a piece."""
    file = tmp_path / "first.yaml"
    file.write_text(
        draft_station(models_root() / "irb120_gripper" / "irb120_gripper.urdf", folder=tmp_path)
    )

    text = file.read_text()
    assert "`grip: {force: 20}`" in text
    assert "metres: left_finger, right_finger" in text

    result = run_whole(load_station(file))
    assert result.ending == "completed"
    assert not result.verdict.warnings
    finger = result["q.left_finger"]
    assert finger[0] == pytest.approx(finger[-1], abs=1e-4)  # open, and open again
    assert finger.min() < 0.3 * finger[0]  # closed in between
