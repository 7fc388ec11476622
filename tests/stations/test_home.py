"""A robot begins in its home posture unless its station gives initial positions."""

from pathlib import Path

import numpy as np
import pytest

from simrob_drake.base.errors import SimrobError
from simrob_drake.robots.catalog import load_robot, load_robot_file
from simrob_drake.stations.load import bare_station, load_station
from simrob_drake.stations.resolve import resolve

ARM = """
name: arm
dh:
  convention: modified
  rows:
    - {d: 0.3, limit_deg: [-100, 100], effort: 80, mass: 3}
    - {a: 0.3, alpha_deg: 90, limit_deg: [-170, -10], effort: 80, mass: 2}
"""

URDF = """
<robot name="elbow">
  <link name="base"/>
  <link name="arm">
    <inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="bend" type="revolute">
    <parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="-1" effort="10" velocity="1"/>
  </joint>
</robot>
"""


def start_of(robot: str | Path, **changes: object) -> np.ndarray:
    """The initial posture of a robot alone [deg]."""
    overrides = {key.replace("__", "."): value for key, value in changes.items()}
    return np.rad2deg(resolve(bare_station(str(robot), overrides)).robots["robot"].initial)


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    file = tmp_path / "elbow.urdf"
    file.write_text(URDF)
    return file


def described(folder: Path, home: str) -> Path:
    file = folder / "arm.yaml"
    file.write_text(ARM + home)
    return file


def test_the_puma_begins_in_its_nominal_posture() -> None:
    np.testing.assert_allclose(start_of("puma560"), [0, 45, -180, 0, -45, 0])


def test_home_of_a_table_is_the_start(tmp_path: Path) -> None:
    file = described(tmp_path, "home_deg: {joint_2: -90}\n")
    station = tmp_path / "station.yaml"

    station.write_text(f"mode: kinematic\nrobot: {{model: {file.name}}}\n")

    np.testing.assert_allclose(
        np.rad2deg(resolve(load_station(station)).robots["robot"].initial), [0, -90]
    )


@pytest.mark.parametrize("home", ["", "home_deg: 0\n", "home_deg: {joint_1: 20}\n"])
def test_an_axis_that_excludes_zero_begins_midway(tmp_path: Path, home: str) -> None:
    model = load_robot_file(described(tmp_path, home))

    first = 20 if "20" in home else 0
    np.testing.assert_allclose(np.rad2deg(model.home), [first, -90])
    np.testing.assert_array_equal(model.posture("home", np.ones(2)), model.home)


def test_another_robot_begins_at_its_own_home(urdf: Path) -> None:
    """The file of irb120_kinematic gives 0 for the axes of the irb120, which holds for no other robot."""
    changes = {
        "robot.urdf": str(urdf),
        "reference": {"kind": "hold"},
        "pieces.gripper": None,
        "pieces.load": None,
    }
    robot = resolve(load_station("irb120_kinematic", overrides=changes)).robots["robot"]
    np.testing.assert_allclose(robot.initial, [-2.0], atol=1e-5)


def test_a_start_goes_with_the_robot_that_it_is_given_for(urdf: Path) -> None:
    changes = {"robot.initial_deg": -60.0, "robot.urdf": str(urdf), "reference": {"kind": "hold"}}
    changes |= {"pieces.gripper": None, "pieces.load": None}

    robot = resolve(load_station("irb120_kinematic", overrides=changes)).robots["robot"]

    np.testing.assert_allclose(np.rad2deg(robot.initial), [-60])


def test_axes_that_a_mapping_leaves_out_are_at_zero_if_they_can(tmp_path: Path) -> None:
    np.testing.assert_allclose(
        start_of("irb120", robot__initial_deg={"joint_1": 30}), [30, 0, 0, 0, 0, 0]
    )

    station = tmp_path / "station.yaml"
    described(tmp_path, "home_deg: {joint_1: 10, joint_2: -45}\n")

    station.write_text("mode: kinematic\nrobot: {model: arm.yaml, initial_deg: {joint_1: 5}}\n")

    np.testing.assert_allclose(
        np.rad2deg(resolve(load_station(station)).robots["robot"].initial), [5, -45]
    )


def test_zero_that_is_asked_for_is_refused_where_it_cannot_be(urdf: Path) -> None:
    with pytest.raises(
        SimrobError, match=r"initial_deg of bend is 0; it must be within -171\.89 to -57\.296 deg"
    ):
        bare_station(str(urdf), {"robot.initial_deg": 0})


@pytest.mark.parametrize("name", ["irb120_dynamic", "irb120_kinematic", "two_irb120"])
def test_shipped_stations_keep_their_start(name: str) -> None:
    for robot in resolve(load_station(name)).robots.values():
        np.testing.assert_array_equal(robot.initial, np.zeros(6))


def test_a_robot_of_the_package_begins_at_home() -> None:
    np.testing.assert_array_equal(
        resolve(bare_station("irb120")).robots["robot"].initial, load_robot("irb120").home
    )
