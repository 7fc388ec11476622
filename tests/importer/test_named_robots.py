"""One function reads the robots that users name: a station, `view`, `check` and Dynamics take the same files."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from simrob_drake import Dynamics, load_station, simulate
from simrob_drake.base.errors import InvalidConfig, InvalidModel, UnknownName
from simrob_drake.cli.app import run_command
from simrob_drake.importer.named_robots import read_robot
from simrob_drake.stations.load import bare_station

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="rod">
    <inertial>
      <origin xyz="0.2 0 0"/><mass value="2"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual><geometry><mesh filename="rod.stl"/></geometry></visual>
  </link>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="30" velocity="2"/>
  </joint>
</robot>
"""


@pytest.fixture
def described(tmp_path: Path) -> Path:
    """A robot.yaml of a URDF that the import repairs: its mesh is an STL file, and its joint has no transmission."""
    (tmp_path / "arm.urdf").write_text(URDF)
    trimesh.creation.box([0.4, 0.1, 0.1]).export(tmp_path / "rod.stl")
    file = tmp_path / "robot.yaml"
    file.write_text("urdf: arm.urdf\nroot: base\naxes: {turn: {joint: turn}}\n")
    return file


def test_what_a_station_takes_is_taken_everywhere(
    described: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Before, the station ran, and the others asked for a transmission."""
    monkeypatch.setattr("simrob_drake.results.animation.robot_view.RobotView.run", lambda *_: None)

    assert simulate(bare_station(str(described)), progress=False).ending == "completed"
    torque = Dynamics.of_robot(described).gravity([0.5])
    assert torque == pytest.approx([-2 * 9.80665 * 0.2 * np.cos(0.5)])
    for command in (["view"], ["check"], ["station", "--out", str(tmp_path / "first.yaml")]):
        assert run_command([command[0], str(described), *command[1:]]) == 0


def test_a_missing_description_is_a_missing_file(capsys: pytest.CaptureFixture[str]):
    """Before, `simrob view missing.yaml` listed the robots of the package."""
    assert run_command(["view", "missing.yaml"]) != 0
    assert "cannot be read (No such file or directory)" in capsys.readouterr().err
    with pytest.raises(InvalidConfig, match="cannot be read"):
        Dynamics.of_robot("missing.yaml")


def test_names_and_other_files(tmp_path: Path):
    assert read_robot("irb120").name == "irb120"
    assert read_robot(read_robot("ur5").urdf_path).name == "ur5"
    with pytest.raises(UnknownName, match="irb120"):
        read_robot("irb12")
    with pytest.raises(InvalidModel):
        read_robot(tmp_path / "missing.urdf")


def test_a_station_names_no_urdf_as_its_model(described: Path):
    """Files under `urdf` are checked against the folders that a station may read; names under `model` are not."""
    with pytest.raises(InvalidConfig, match=r"there is no robot '/"):
        load_station("irb120_kinematic", {"robot.model": str(described.with_name("arm.urdf"))})
