"""Descriptions of robots that do not fit their URDF, or whose URDF has defects."""

from pathlib import Path

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.folders import CACHE_VARIABLE
from simrob_drake.importer.importing import examine_robot
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.resolve import resolve

MASS = '<inertial><mass value="{}"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
ARM = """<robot name="arm">
  <link name="base"/><link name="lidar"/><link name="up">{mass}</link>
  <joint name="eye" type="fixed"><parent link="base"/><child link="lidar"/><origin xyz="0.1 0 0.3"/></joint>
  <joint name="hinge" type="revolute">
    <parent link="base"/><child link="up"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="{effort}" velocity="2"/>
  </joint>{motor}
</robot>"""
MOTOR = """<transmission name="drive"><type>transmission_interface/SimpleTransmission</type>
  <joint name="hinge"/><actuator name="motor"/></transmission>"""
DESCRIPTION = "urdf: arm.urdf\nroot: {root}\naxes: {{shoulder: {{joint: hinge, sign: -1}}}}\ntools: {{lidar: lidar}}\n"


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))


def station(
    folder: Path,
    *,
    root: str = "base",
    motor: str = MOTOR,
    effort: float = 9,
    mass: float = 1,
    file: str = "robot.yaml",
) -> Path:
    """Write a station whose robot has a description beside its URDF; return its file."""
    (folder / "arm.urdf").write_text(ARM.format(mass=MASS.format(mass), effort=effort, motor=motor))
    (folder / file).write_text(DESCRIPTION.format(root=root))
    (folder / "station.yaml").write_text(f"robot: {{model: {file}}}\nservo: {{kp: 10, kd: 1}}\n")
    return folder / "station.yaml"


def test_a_tool_on_the_root_is_where_it_is(tmp_path: Path) -> None:
    robot = LeggedRobot(load_station(station(tmp_path)))
    np.testing.assert_allclose(robot.pose("lidar"), [0.1, 0, 0.3, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(
        robot.pose("lidar", [[0.1], [0.2]]), [[0.1, 0, 0.3, 0, 0, 0]] * 2, atol=1e-12
    )


@pytest.mark.parametrize("root", ["up", "nowhere"])
def test_a_root_that_is_not_the_urdfs_is_an_error(tmp_path: Path, root: str) -> None:
    with pytest.raises(
        SimrobError, match=rf"root is {root}; it must be base, the root link of .*arm\.urdf"
    ):
        load_station(station(tmp_path, root=root))


@pytest.mark.parametrize("file", ["robot.yaml", "own.yaml"])
def test_a_model_with_a_defective_urdf_is_imported_as_a_urdf_is(tmp_path: Path, file: str) -> None:
    robot = resolve(load_station(station(tmp_path, motor="", file=file))).robots["robot"]

    assert robot.axes == ["shoulder"]  # as described
    assert robot.model.signs.tolist() == [-1.0]
    assert robot.model.element.find("transmission") is not None  # which the import made
    with pytest.raises(SimrobError, match="root is up"):
        load_station(station(tmp_path, motor="", file=file, root="up"))


def test_the_row_of_a_table_that_is_wrong_is_told(tmp_path: Path) -> None:
    row = "    - {a: 0.3, effort: 50, limit_deg: "
    (tmp_path / "arm.yaml").write_text(
        f"dh:\n  convention: classical\n  rows:\n{row}[-1, 1]}}\n{row}[140, -140]}}\n"
    )

    (tmp_path / "station.yaml").write_text("robot: {model: arm.yaml}\n")

    with pytest.raises(
        SimrobError,
        match=r"arm\.yaml: dh\.rows\[1\]: limit_deg must be a lower limit and a higher limit",
    ):
        load_station(tmp_path / "station.yaml")


@pytest.mark.parametrize(
    ("effort", "mass", "doubted"), [(501, 4.9, True), (500, 4.9, False), (501, 5, False)]
)
def test_torques_that_light_links_do_not_have_are_doubted(
    tmp_path: Path, effort: float, mass: float, doubted: bool
) -> None:
    file = station(tmp_path, effort=effort, mass=mass)
    found = [one for one in check_station(load_station(file)) if one.subject == "efforts of robot"]

    assert [one.level for one in found] == ["warning"] * doubted

    report = examine_robot(tmp_path / "arm.urdf").report
    assert [entry.element for entry in report.of("open")] == ["joint 'hinge' <limit>"] * doubted

    own = load_station(file, {"servo.torque_limit": 40})
    assert not [one for one in check_station(own) if one.subject == "efforts of robot"]


def test_a_robot_without_inertias_is_not_said_to_be_refused(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM.format(mass="", effort=9, motor=MOTOR))
    report = examine_robot(tmp_path / "arm.urdf").report

    assert "1 open" in report.summary()
    assert "refused" not in report.summary()
