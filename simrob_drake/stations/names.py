"""The robots and pieces behind the names of a configuration, and whether every name in it stands for something."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.robots.catalog import AxisValues, RobotModel, load_robot, load_robot_file
from simrob_drake.robots.pieces import TCP, PieceModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.piece_sources import piece_of
from simrob_drake.yaml_files import YAML_SUFFIXES

WORLD = "world"


def named(name: str | None, known: Sequence[str], *, kind: str = "robot", key: str = "robot") -> str:
    """Return a name that stands for one of ``known``; the only one need not be named.

    Raises:
        UnknownName: no such one.
        InvalidParameter: none named, and there is not just one.
    """
    if name is None:
        if len(known) != 1:
            raise InvalidParameter(key, None, f"one of {', '.join(known)}" if known else f"a {kind}, and there is none")
        return known[0]
    if name not in known:
        raise UnknownName(kind, name, known)
    return name


def robot_model(config: StationConfig, robot: str) -> RobotModel:
    """Return the model of one of the station's robots."""
    entry = config.robots[robot]
    if entry.urdf is not None:
        from simrob_drake.importer.cache import robot_from_file  # few stations need the importer

        return robot_from_file(entry.urdf, entry.import_options)
    model = str(entry.model)
    return load_robot_file(Path(model)) if model.endswith(YAML_SUFFIXES) else load_robot(model)


def piece_model(config: StationConfig, piece: str) -> PieceModel:
    """Return the model of one of the station's pieces, with the figures that the station changes."""
    return piece_of(config.pieces[piece], piece)


def piece_parent(config: StationConfig, piece: str) -> str:
    """Return what a piece hangs on: ``world``, a robot's name or another piece's name."""
    entry = config.pieces[piece]
    parent = WORLD if entry.free or not config.robots else config.only_robot
    parent = entry.parent or parent
    if parent is None:
        raise InvalidParameter(f"pieces.{piece}.parent", None, f"one of world, {', '.join(config.robots)}, or a piece")
    return parent


def parent_frame(config: StationConfig, piece: str) -> str:
    """Return the name of the frame of another piece that a piece hangs on, as the plant names it."""
    parent, frame = piece_parent(config, piece), config.pieces[piece].frame
    return f"{parent}_{frame or TCP}"


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
    position = model.user_units * model.axis_vector(config.robots[robot].initial_deg, f"robots.{robot}.initial_deg")
    lower, upper = model.axis_limits
    for index, axis in enumerate(model.axes):
        if not lower[index] <= position[index] <= upper[index]:
            low, high, value = np.array([lower[index], upper[index], position[index]]) / model.user_units[index]
            limits = f"within {low:.5g} to {high:.5g} {model.unit_names[index]}"
            raise InvalidParameter(f"initial_deg of {axis}", f"{value:.5g}", limits)
    return position


def check_movers(config: StationConfig) -> None:
    """Check that something in the station moves, and by means that its mode has.

    Raises:
        InvalidParameter: names the key.
    """
    free = config.free_pieces
    if not (config.robots or free):
        expected = "given as robot: {model: ...}, or a piece have free: true: a station needs something that moves"
        raise InvalidParameter("robots", "empty", expected)
    if free and config.mode == "kinematic":
        raise InvalidParameter(f"pieces.{free[0]}.free", True, "false in a kinematic station, which moves robots only")
    if config.external_force is not None and (config.mode == "kinematic" or not config.robots):
        raise InvalidParameter("external_force", "given", "left out in a kinematic station and without robots")
    for piece in free:
        model = piece_model(config, piece)
        if not (model.mass > 0 and min(model.inertia) > 0):
            expected = "a piece with mass and inertia: gravity and contact move it"
            raise InvalidParameter(f"pieces.{piece}.free", True, expected)


def check_names(config: StationConfig) -> None:
    """Check that every robot, piece, axis and tool that a configuration names exists.

    Raises:
        SimrobError: the first that does not, with the nearest known name.
    """
    check_movers(config)
    pieces = pieces_outward(config)  # before the others, so that nothing follows a circle of pieces
    for robot in config.robots:
        model = robot_model(config, robot)
        initial_position(config, robot, model)
        _check_axes(config, robot, model)
        _check_feet(config, robot, model)
    models = {piece: piece_model(config, piece) for piece in pieces}
    for piece in pieces:
        _check_frame(config, piece, models)
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


def _check_frame(config: StationConfig, piece: str, models: dict[str, PieceModel]) -> None:
    frame, parent = config.pieces[piece].frame, piece_parent(config, piece)
    if frame is None:
        return
    if parent in config.robots:
        tools = robot_model(config, parent).tools
        if frame not in tools:
            raise UnknownName(f"tool of {parent} for pieces.{piece}.frame", frame, tools)
        return
    if parent not in models:
        raise InvalidParameter(f"pieces.{piece}.frame", frame, "left out: it hangs on the world, which has no frames")
    if frame not in models[parent].frame_poses:
        raise UnknownName(f"frame of {parent}", frame, models[parent].frame_poses)


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
