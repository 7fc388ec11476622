"""The robots and pieces behind the names of a configuration, and whether every name in it stands for something."""

from __future__ import annotations

import numpy as np

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.robots.catalog import AxisValues, RobotModel, load_robot, load_robot_from_urdf
from simrob_drake.robots.pieces import PieceModel, load_piece
from simrob_drake.stations.config import StationConfig
from simrob_drake.yaml_files import validated

WORLD = "world"


def robot_model(config: StationConfig, robot: str) -> RobotModel:
    """Return the model of one of the station's robots."""
    entry = config.robots[robot]
    if entry.urdf is not None:
        return load_robot_from_urdf(entry.urdf)
    return load_robot(str(entry.model))


def piece_model(config: StationConfig, piece: str) -> PieceModel:
    """Return the model of one of the station's pieces, with the figures that the station changes."""
    entry = config.pieces[piece]
    model = load_piece(entry.model or piece)
    changed = entry.model_dump(include={"mass", "com", "inertia", "tcp", "colour"}, exclude_none=True)
    return validated(PieceModel, {**model.model_dump(), **changed}, f"pieces.{piece}")


def piece_parent(config: StationConfig, piece: str) -> str:
    """Return what a piece hangs on: ``world``, a robot's name or another piece's name."""
    parent = config.pieces[piece].parent or config.only_robot
    if parent is None:
        raise InvalidParameter(f"pieces.{piece}.parent", None, f"one of world, {', '.join(config.robots)}, or a piece")
    return parent


def pieces_outward(config: StationConfig) -> list[str]:
    """Return the names of the pieces, each after what it hangs on.

    Raises:
        UnknownName: a parent that is no robot, no piece and not the world.
        InvalidParameter: pieces that hang on each other in a circle.
    """
    parents = {piece: piece_parent(config, piece) for piece in config.pieces}
    for piece, parent in parents.items():
        if parent not in (WORLD, *config.robots, *config.pieces):
            known = [WORLD, *config.robots, *config.pieces]
            raise UnknownName(f"parent for pieces.{piece}", parent, [name for name in known if name != piece])
    ordered: list[str] = []
    while len(ordered) < len(parents):
        ready = [p for p in parents if p not in ordered and (parents[p] not in parents or parents[p] in ordered)]
        if not ready:
            rest = [piece for piece in parents if piece not in ordered]
            raise InvalidParameter(f"pieces.{rest[0]}.parent", parents[rest[0]], "no piece that hangs on this one")
        ordered += ready
    return ordered


def carrier(config: StationConfig, piece: str) -> str:
    """Return the robot that carries a piece, directly or through other pieces, or ``world``."""
    parent = piece_parent(config, piece)
    return carrier(config, parent) if parent in config.pieces else parent


def initial_position(config: StationConfig, robot: str, model: RobotModel) -> Vector:
    """Return where a robot's axes start, shape (n,) [rad].

    Raises:
        InvalidParameter: a start outside the joint limits.
    """
    position = np.deg2rad(model.axis_vector(config.robots[robot].initial_deg, f"robots.{robot}.initial_deg"))
    lower, upper = model.axis_limits
    for axis, value, low, high in zip(model.axes, position, lower, upper, strict=True):
        if not low <= value <= high:
            limits = f"within {np.rad2deg(low):.1f} to {np.rad2deg(high):.1f} deg"
            raise InvalidParameter(f"initial_deg of {axis}", float(np.rad2deg(value)), limits)
    return position


def check_names(config: StationConfig) -> None:
    """Check that every robot, piece, axis and tool that a configuration names exists.

    Raises:
        SimrobError: the first that does not, with the nearest known name.
    """
    pieces = pieces_outward(config)  # first, so that nothing follows a circle of pieces
    for robot in config.robots:
        model = robot_model(config, robot)
        initial_position(config, robot, model)
        _check_axes(config, robot, model)
        _check_feet(config, robot, model)
    for piece in pieces:
        piece_model(config, piece)
        if piece in config.robots or piece == WORLD:
            raise InvalidParameter(f"pieces.{piece}", piece, "a name that no robot of the station has, nor the world")
    for name, monitor in config.monitors.items():
        if monitor.robot is not None and monitor.robot not in config.robots:
            raise UnknownName(f"robot for monitors.{name}", monitor.robot, config.robots)


def _check_feet(config: StationConfig, robot: str, model: RobotModel) -> None:
    kind = config.robots[robot].feet
    if model.feet is not None:
        model.feet.kind(kind)
    elif kind is not None:
        raise InvalidParameter(f"robots.{robot}.feet", kind, f"left out: {model.name} has no feet")


def _check_axes(config: StationConfig, robot: str, model: RobotModel) -> None:
    servo, reference = config.servo_of(robot), config.reference_of(robot)
    values: dict[str, AxisValues | None] = {
        **{f"servo.{key}": getattr(servo, key) for key in ("kp", "ki", "kd", "torque_limit", "integral_limit")},
        **{f"reference.{key}": getattr(reference, key, None) for key in ("target_deg", "amplitude_deg", "phase_deg")},
    }
    for target in getattr(reference, "targets", ()):
        values[f"reference.targets at {target.time:g} s"] = target.target_deg
    for key, value in values.items():
        if value is not None:
            model.axis_vector(value, key)
    tools = [*model.tools, *(piece for piece in config.pieces if carrier(config, piece) == robot)]
    tcp = config.robots[robot].tcp
    if tcp is not None and tcp not in tools:
        raise UnknownName(f"tool of {robot}", tcp, tools)
