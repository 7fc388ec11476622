"""Hands with one moving jaw, as hobby arms have them: found by name, or told by the user."""

from pathlib import Path

import numpy as np
import pytest

from simrob_drake import Arm, SimrobError, load_station
from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.folders import CACHE_VARIABLE
from simrob_drake.importer.importing import import_robot, robot_from_file
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.load import bare_station

LINK = """
<link name="{name}">
  <inertial><origin xyz="{com}"/><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="{com}"/><geometry><box size="0.02 0.02 0.08"/></geometry></collision>
</link>"""
JOINT = """
<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="{origin}"/><axis xyz="{axis}"/>
  <limit lower="{lower}" upper="{upper}" effort="5" velocity="3"/></joint>"""


def arm_file(
    folder: Path, *, joint: str = "gripper", jaw: str = "moving_jaw", axis: str = "0 1 0"
) -> Path:
    """An arm of two joints whose hand has a fixed jaw at x = 0, and one beside it that turns about y.

    With the axis 0 1 0 a positive angle turns the jaw's end, which points up, away from the fixed one.
    """
    com = "0 0 0.04"
    parts = [LINK.format(name=name, com=com) for name in ("base", "upper", "palm", jaw)]
    parts += [
        JOINT.format(
            name="lift",
            parent="base",
            child="upper",
            origin="0 0 0.1",
            axis="0 1 0",
            lower=-2,
            upper=2,
        ),
        JOINT.format(
            name="wrist_roll",
            parent="upper",
            child="palm",
            origin="0 0 0.1",
            axis="0 0 1",
            lower=-2,
            upper=2,
        ),
        JOINT.format(
            name=joint,
            parent="palm",
            child=jaw,
            origin="0.03 0 0",
            axis=axis,
            lower=-0.1,
            upper=1.2,
        ),
    ]
    file = folder / "hobby.urdf"
    file.write_text(f'<robot name="hobby">{"".join(parts)}</robot>')
    return file


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))


@pytest.mark.parametrize(("axis", "ends"), [("0 1 0", (-0.1, 1.2)), ("0 -1 0", (1.2, -0.1))])
def test_the_moving_jaw_is_found_and_closes_towards_the_fixed_one(
    tmp_path: Path, axis: str, ends: tuple[float, float]
) -> None:
    """The jaw's end is 0.08 m from its axis: a turn towards the fixed jaw brings it nearer."""
    model = robot_from_file(arm_file(tmp_path, axis=axis))

    assert model.fingers == {2: pytest.approx(ends, abs=1e-5)}
    assert next(iter(model.tools.values())) == "palm"
    np.testing.assert_allclose(model.home, [0, 0, ends[1]], atol=1e-5)  # open at the start


@pytest.mark.parametrize(
    ("joint", "jaw"),
    [("joint_6", "claw"), ("jaw_joint", "link_6"), ("Finger", "part"), ("GRIPPER", "jaw_left")],
)
def test_names_of_jaws(tmp_path: Path, joint: str, jaw: str) -> None:
    assert list(robot_from_file(arm_file(tmp_path, joint=joint, jaw=jaw)).fingers) == [2]


@pytest.mark.parametrize(
    ("joint", "jaw"), [("joint_6", "link_6"), ("gripper_roll", "flange"), ("wrist_3", "tool")]
)
def test_other_last_joints_are_no_jaws(tmp_path: Path, joint: str, jaw: str) -> None:
    model = robot_from_file(arm_file(tmp_path, joint=joint, jaw=jaw))
    assert not model.fingers
    assert next(iter(model.tools.values())) == jaw


def test_the_user_names_the_jaw(tmp_path: Path) -> None:
    file = arm_file(tmp_path, joint="joint_6", jaw="link_6")
    made = import_robot(file, tmp_path / "made", ImportOptions(gripper="joint_6"), apart=False)

    assert list(made.model.fingers) == [2]
    assert next(iter(made.model.tools.values())) == "palm"
    assert any("moving jaw" in entry.text for entry in made.report.entries)
    with pytest.raises(UnknownName, match="joint_6"):
        import_robot(file, tmp_path / "other", ImportOptions(gripper="joint_7"), apart=False)


def test_a_first_station_grips(tmp_path: Path) -> None:
    file = arm_file(tmp_path)
    station = tmp_path / "station.yaml"
    station.write_text(draft_station(file, folder=tmp_path))
    arm = Arm(load_station(station, {"mode": "kinematic"}))

    arm.grip()

    np.testing.assert_allclose(arm.cell.position(arm.name)[2], -0.1, atol=1e-5)


def test_the_refusal_of_a_grip_says_what_to_write_into_the_station(tmp_path: Path) -> None:
    file = arm_file(tmp_path, joint="joint_6", jaw="link_6")

    with pytest.raises(InvalidParameter, match=r"or import with --gripper joint_6$") as refused:
        Arm(bare_station(str(file))).grip()
    assert "`import_options: {gripper: joint_6}` below urdf in the station" in str(refused.value)

    arm = Arm(bare_station(str(file), {"robot.import_options": {"gripper": "joint_6"}}))
    arm.grip()

    assert arm.cell.position(arm.name)[2] == pytest.approx(-0.1, abs=1e-4)


def test_what_the_refusal_says_to_write_works(tmp_path: Path) -> None:
    file = arm_file(tmp_path, joint="joint_6", jaw="link_6")
    made = import_robot(file, tmp_path / "made", apart=False)

    description = made.model.folder / "robot.yaml"
    with pytest.raises(SimrobError, match=r"into .*robot\.yaml") as refused:
        Arm(bare_station(str(description), {"robot.urdf": str(made.model.urdf_path)})).grip()

    line = str(refused.value).split("`")[1]
    description.write_text(description.read_text() + line + "\n")
    arm = Arm(bare_station(str(made.model.urdf_path)))

    arm.grip()

    assert arm.cell.position(arm.name)[2] == pytest.approx(np.deg2rad(-5.73), abs=1e-4)
