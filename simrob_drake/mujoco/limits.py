"""What MJCF cannot say of a station: which part, why, and what would be right."""

from __future__ import annotations

from collections.abc import Mapping

from simrob_drake.blocks.servo import ServoGains
from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.forces import Drag
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.stations.config import StationConfig

_NO_MODEL = "MJCF's servos do not know the arm's model"


def check_sayable(config: StationConfig, robots: Mapping[str, ResolvedRobot], *, moved_by_torque: bool = True) -> None:
    """Check that MuJoCo moves a station as Drake does; what only measures is no hindrance.

    Args:
        config: the station.
        robots: its robots, by name.
        moved_by_torque: it is to be stepped; else its bodies are all that counts.

    Raises:
        InvalidParameter: names the key, and tells why and what would be right.
    """
    if not moved_by_torque:
        return
    if config.mode == "kinematic":
        raise InvalidParameter("mode", "kinematic", "dynamic: MJCF moves things by forces, not along a given motion")
    if config.controllers:
        expected = "left out: MJCF holds no loops that decide"
        raise InvalidParameter("controllers", ", ".join(config.controllers), expected)
    if config.contact is not None and config.contact.model != "point":
        expected = "point: MuJoCo knows no pressure over a surface"
        raise InvalidParameter("contact.model", config.contact.model, expected)
    if config.prescribed:
        raise InvalidParameter("prescribed", ", ".join(config.prescribed), "left out: MJCF moves all by forces")
    for name, force in config.forces.items():
        if isinstance(force, Drag):
            raise InvalidParameter(f"forces.{name}.kind", "drag", "push or sine: MJCF's forces know no target")
    for name, robot in robots.items():
        _check_servo(config, name, robot.gains)


def _check_servo(config: StationConfig, robot: str, gains: ServoGains) -> None:
    servo = config.servo_of(robot)
    key = "servo" if config.robots[robot].servo is None else f"robots.{robot}.servo"
    if servo.law != "pid":
        raise InvalidParameter(f"{key}.law", servo.law, "pid: MJCF's servos know no other law")
    if gains.line is not None:
        expected = "none: MJCF's servos have one limit at any speed; solver.kind mujoco has motors"
        raise InvalidParameter(f"{key}.motor", "given", expected)
    if servo.feedforward != "none":
        raise InvalidParameter(f"{key}.feedforward", servo.feedforward, f"none: {_NO_MODEL}")
    if servo.admittance_gain > 0:
        raise InvalidParameter(f"{key}.admittance_gain", servo.admittance_gain, f"0: {_NO_MODEL}")
    if "reference_velocity" in config.inputs:
        why = "with the input reference_velocity, which MJCF's servos have through kp alone"
        if gains.ki.any():
            raise InvalidParameter(f"{key}.ki", gains.ki.tolist(), f"0 {why}")
        if ((gains.kp == 0) & (gains.kd > 0)).any():
            raise InvalidParameter(f"{key}.kp", gains.kp.tolist(), f"positive {why}")
