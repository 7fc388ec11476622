"""Values in force of keys that a station leaves out: they come from the files of its robots, motors and pieces.

A key is *dotted*: ``servo.kp`` is the key ``kp`` in the section ``servo``. Values have the units of their keys.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.parts.resolved import ResolvedPiece, ResolvedRobot
from simrob_drake.robots.motors import Motor
from simrob_drake.robots.pieces import FORMS
from simrob_drake.stations.config import ServoConfig, StationConfig
from simrob_drake.stations.piece_config import PieceConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.resolved_pieces import piece_of_file

Origin = Literal["robot", "motor", "piece", "shapes", "station", "default"]
"""Origin of a value: the file of the robot, the data of the motor, the file of the piece, the shapes of the piece, from
which its mass is computed, another key of the station, or the default, if no file has the value."""

_GAINS = "kp", "ki", "kd"
_LIMITS = "torque_limit", "integral_limit", "speed_limit"
_MASS_KEYS = "mass", "com", "inertia"
_PIECE_KEYS = (*_MASS_KEYS, "tcp", "colour")
_DIGITS = 6  # significant digits of the values: more are noise of the arithmetic


@dataclass(frozen=True)
class ValueInForce:
    """Value of a key that a station leaves out.

    Attributes:
        value: the value, as a user would write it in the station's file: a number, a text, a list, or a mapping of
            axes to numbers.
        origin: where the value comes from.
    """

    value: Any
    origin: Origin


def values_in_force(config: StationConfig) -> dict[str, ValueInForce]:
    """Find the values of keys that a station leaves out and that its robots, motors and pieces give.

    Keys of a section that several robots share, such as ``servo.kp``, are only contained if all of these robots have
    the same value.

    Returns:
        the values by dotted key, such as ``servo.kp`` or ``pieces.gripper.mass``, with the unit of the key.

    Raises:
        SimrobError: the station has a defect.
    """
    station = resolve(config)
    found = dict[str, ValueInForce]()
    differing = set[str]()
    for name, robot in station.robots.items():
        for key, entry in _robot_values(config, name, robot):
            # Two robots share the key but not the value, so that no single value is in force.
            if found.setdefault(key, entry) != entry:
                differing.add(key)
    for name, section in config.pieces.items():
        for key, entry in _piece_values(name, section, station.pieces[name]):
            found[f"pieces.{name}.{key}"] = entry
    return {key: entry for key, entry in found.items() if key not in differing}


def _robot_values(
    config: StationConfig, name: str, robot: ResolvedRobot
) -> Iterator[tuple[str, ValueInForce]]:
    """Yield dotted keys and values of a robot that the station leaves out: its tool, its feet, its servos and motors.

    A kinematic station has no servos: there only the tool and the feet are yielded.

    Args:
        config: configuration of the station.
        name: name of the robot.
        robot: the robot with the values of its files.
    """
    section = config.robots[name]
    top = config.robot_key(name)
    if section.tcp is None and robot.tcp:
        # The tool in use is one of the robot's own, or a piece of the station that the robot carries.
        yield (
            f"{top}.tcp",
            ValueInForce(robot.tcp, "robot" if robot.tcp in robot.model.tools else "station"),
        )
    if section.feet is None and robot.model.feet is not None:
        yield f"{top}.feet", ValueInForce(robot.model.feet.default, "robot")
    if not config.engine.moves_by_forces:
        return
    servo = config.servo_of(name)
    servo_key = "servo" if section.servo is None else f"{top}.servo"
    for key in (*_GAINS, *_LIMITS):
        values = getattr(robot.gains, key)
        # A servo that is no cascade has no speed limit.
        if getattr(servo, key) is not None or values is None:
            continue
        value = _as_written(robot, values)
        if value is not None:
            yield f"{servo_key}.{key}", ValueInForce(value, _servo_origin(servo, robot, key))
    # A section for the motor, neither a name nor motors by axis: its other keys have the values of the motor it names.
    if isinstance(servo.motor, Motor):
        yield from _motor_values(f"{servo_key}.motor", servo.motor, robot)


def _servo_origin(servo: ServoConfig, robot: ResolvedRobot, key: str) -> Origin:
    """Find the origin of a gain or a limit that the section ``servo`` of a robot leaves out."""
    if key in _GAINS:
        return "default" if getattr(robot.model.servo, key, None) is None else "robot"
    # The integral part may reach the torque limit, unless it has its own limit.
    if key == "integral_limit" and servo.torque_limit is not None:
        return "station"
    # The largest speed of a cascade is that of the URDF, a file of the robot, whatever motors the axes have.
    if key == "speed_limit":
        return "robot"
    return "motor" if any(robot.motors) else "robot"


def _as_written(robot: ResolvedRobot, values: Vector) -> Any:
    """Write values of axes, shape (n,), as in a station's file: one number if all axes have it, otherwise by axis.

    Passive axes are left out, since they have no servo. Returns None if all axes are passive.
    """
    by_axis = {
        axis: _round_value(value)
        for axis, value, is_passive in zip(robot.axes, values, robot.gains.passive, strict=True)
        if not is_passive
    }
    distinct = set(by_axis.values())
    if len(distinct) <= 1:
        return next(iter(distinct), None)
    return by_axis


def _motor_values(
    key: str, stated: Motor, robot: ResolvedRobot
) -> Iterator[tuple[str, ValueInForce]]:
    """Yield dotted keys and values of the robot's motors that the section of the motor in the station leaves out.

    They come from the known motor that the section names by ``model``. Torques are those behind the losses of the gear,
    so the gear efficiency is 1. This efficiency is yielded even if the section names no motor.

    Args:
        key: dotted key of the motor's section, such as ``servo.motor``.
        stated: the section as the station gives it.
        robot: the robot, with the complete motor of each axis. Nothing is yielded if these motors are not all equal.
    """
    motors = [motor for motor in robot.motors if motor is not None]
    # Motors of URDF efforts differ from axis to axis. Then no value is that of the section.
    if not motors or any(motor != motors[0] for motor in motors):
        return
    for name, value in motors[0].model_dump(exclude_unset=True, exclude_none=True).items():
        if name not in stated.model_fields_set:
            yield f"{key}.{name}", ValueInForce(value, "motor")


def _piece_values(
    name: str, section: PieceConfig, piece: ResolvedPiece
) -> Iterator[tuple[str, ValueInForce]]:
    """Yield keys and values of a piece that the station leaves out.

    With shapes or a density of the station, mass, inertia and centre of mass are computed from the shapes. With another
    mass alone, those of them are computed that the file does not state, unless it states the inertia. Otherwise all
    values are those of the file.

    Args:
        name: name of the piece in the station.
        section: section of the piece in the station.
        piece: the piece with the values of its file, or computed from its shapes.
    """
    has_own_shapes = (
        section.mesh is not None or section.shapes or section.model_fields_set & set(FORMS)
    )
    from_shapes: Collection[str] = ()
    if has_own_shapes or section.density is not None:
        from_shapes = _MASS_KEYS
    elif section.mass is not None:
        # With another mass, a stated inertia of the piece's file stays, and nothing is computed. Otherwise the shapes
        # give what the file does not state.
        stated = piece_of_file(section.model or name).model_fields_set
        if "inertia" not in stated:
            from_shapes = set(_MASS_KEYS) - stated
    for key in _PIECE_KEYS:
        if getattr(section, key) is not None:
            continue
        value = getattr(piece.model, key)
        if isinstance(value, tuple):
            value = [_round_value(entry) for entry in value]
        elif isinstance(value, float):
            value = _round_value(value)
        if key in from_shapes:
            yield key, ValueInForce(value, "shapes")
        elif not has_own_shapes:  # a piece of the station's own shapes has no file
            yield key, ValueInForce(value, "piece")


def _round_value(value: float) -> float:
    """Round a value to the digits that a user reads."""
    return float(np.format_float_positional(value, _DIGITS, fractional=False))
