"""Values in force of keys that a station leaves out: from the files of the piece, the motor and the robot."""

from typing import Any

import pytest

from simrob_drake.base.files import models_root
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.robots.catalog import robot_files
from simrob_drake.robots.pieces import piece_file
from simrob_drake.stations.load import load_station
from simrob_drake.stations.values_in_force import ValueInForce, values_in_force


def found(station: str, settings: dict[str, Any] | None = None) -> dict[str, ValueInForce]:
    """Values in force of a station with changed keys."""
    return values_in_force(load_station(station, settings or {}))


def test_a_piece_has_the_mass_of_its_file() -> None:
    mass = read_yaml(piece_file("gripper"))["mass"]
    assert found("irb120_dynamic")["pieces.gripper.mass"] == ValueInForce(mass, "piece")


def test_a_mass_that_the_station_gives_is_not_repeated() -> None:
    assert "pieces.gripper.mass" not in found("irb120_dynamic", {"pieces.gripper.mass": 2})


def test_with_another_mass_the_inertia_of_the_piece_file_stays() -> None:
    """The file of the gripper states its inertia, which is not computed from its shapes."""
    assert "inertia" in read_yaml(piece_file("gripper"))

    values = found("irb120_dynamic", {"pieces.gripper.mass": 2})

    assert values["pieces.gripper.inertia"].origin == "piece"
    assert values["pieces.gripper.com"].origin == "piece"


def test_with_another_mass_nothing_is_computed_beside_a_stated_inertia(tmp_path) -> None:
    """The file states the inertia alone, so the centre of mass stays where the file has it by default."""
    piece = tmp_path / "part.yaml"
    piece.write_text("mass: 1\ninertia: [1, 1, 1, 0, 0, 0]\nshapes: [{box: [0.1, 0.1, 0.1]}]\n")
    content = {
        "robot": {"model": "irb120"},
        "pieces": {"part": {"model": str(piece), "mass": 2.0, "parent": "world"}},
    }

    values = values_in_force(load_station(content, mesh_path=[tmp_path]))

    assert values["pieces.part.com"].origin == "piece"


def test_with_another_mass_shapes_give_the_inertia_that_the_file_does_not_state() -> None:
    """The file of the cube states neither its centre of mass nor its inertia."""
    values = found("irb120_gripper", {"pieces.cube_1.mass": 2.0})

    assert values["pieces.cube_1.inertia"].origin == "shapes"
    # A cube with sides a has the moments m a² / 6.
    moment = 2.0 * 0.04**2 / 6
    assert values["pieces.cube_1.inertia"].value[:3] == pytest.approx([moment] * 3, rel=1e-5)


def test_a_density_gives_the_mass_of_the_shapes() -> None:
    """The cube of steel has 40 mm sides: its mass is the density times 6.4e-5 m³."""
    values = found("irb120_gripper", {"pieces.cube_1.density": 1000})
    assert values["pieces.cube_1.mass"].origin == "shapes"
    assert values["pieces.cube_1.mass"].value == pytest.approx(1000 * 0.04**3, rel=1e-5)


def test_a_motor_gives_the_torque_limit_and_its_own_values() -> None:
    motor = read_yaml(models_root() / "motors.yaml")["mx_28"]
    by_name = found("humanoid_balance", {"servo.motor": "mx_28"})

    assert by_name["servo.torque_limit"] == ValueInForce(motor["stall_torque"], "motor")

    by_section = found("humanoid_balance", {"servo.motor": {"model": "mx_28", "rated_torque": 0.5}})
    assert by_section["servo.motor.stall_torque"] == ValueInForce(motor["stall_torque"], "motor")
    assert "servo.motor.rated_torque" not in by_section


def test_gains_are_those_of_the_robots_file() -> None:
    kp = read_yaml(robot_files()["irb120"])["servo"]["kp"]
    assert found("irb120_dynamic", {"servo.kp": None})["servo.kp"] == ValueInForce(kp, "robot")


def test_limits_that_differ_are_given_by_axis() -> None:
    values = found("irb120_dynamic")

    assert values["servo.torque_limit"].value["joint_6"] == 15
    assert values["servo.torque_limit"].origin == "robot"

    # The integral part may reach the torque limit, which is then that of the station.
    limited = found("irb120_dynamic", {"servo.torque_limit": 40})
    assert "servo.torque_limit" not in limited
    assert limited["servo.integral_limit"] == ValueInForce(40, "station")


def test_the_speed_of_a_cascade_is_that_of_the_robot_even_with_motors() -> None:
    """Motors give torques to a servo; the largest speed that its position loop commands is that of the URDF."""
    cascade = {"servo.law": "cascade", "servo.motor": "urdf", "servo.feedforward": "none"}
    values = found("irb120_dynamic", cascade)
    assert values["servo.torque_limit"].origin == "motor"
    assert values["servo.speed_limit"].origin == "robot"


def test_robots_that_share_a_section_but_not_the_value_have_none() -> None:
    """The belt has a kp of 20000 N/m and the arm one of 1000 N·m/rad."""
    values = found("belt_pick", {"mode": "dynamic", "servo.kp": None})
    assert "servo.kp" not in values


def test_values_of_an_only_robot_are_under_the_key_of_its_section() -> None:
    """A robot with a name of its own is under `robots`, even if it is the only one."""
    for section in ("robot", "robots.left"):
        station = {"name": "only_one", f"{section}.model": "irb120", "mode": "dynamic"}
        own = {f"{section}.servo": {"realization": "implicit"}}
        values = values_in_force(load_station({"name": "only_one"}, station | own))
        assert f"{section}.servo.kp" in values
        assert not [key for key in values if key.startswith("robot") and section not in key]


def test_a_passive_axis_has_no_gains() -> None:
    """The pole of the cart has no motor; the cart's gains are the only ones."""
    values = found("cart_pole", {"servo.torque_limit": None})
    assert not isinstance(values["servo.torque_limit"].value, dict)


def test_a_kinematic_station_has_no_servos() -> None:
    assert not [key for key in found("irb120_kinematic") if key.startswith("servo.")]
