"""Taking and releasing pieces: how far a tool may be from a piece that it takes, and which pieces can fall.

A piece that is taken gets a new parent, on which it is fixed, see :func:`~simrob_drake.programs.model.reparent_piece`.
The *carrier* of a piece is the robot on which it is fixed, perhaps by way of other pieces. The *tool in use* of a robot
is the frame to which its moves refer: a tool of its own, or a piece that it carries.
"""

from collections.abc import Iterator, Mapping
from itertools import product
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import Frame

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.parts.resolved import WORLD
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import own_name
from simrob_drake.programs.model import StationModel, reparent_piece
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

REACH = 0.03
"""Largest distance from a piece of the tool that takes it, or of the link on which it is fixed [m]."""

_THIN = 1e-9  # half the sides of a box that replaces a point [m]


class _Box(NamedTuple):
    """A box in the world.

    Attributes:
        pose: pose of its middle.
        half: half its sides, shape (3,) [m].
    """

    pose: RigidTransform
    half: Vector


def take_piece(
    model: StationModel, piece: str, parent: str, *, frame: str | None = None
) -> StationConfig:
    """Make a station in which a piece has another parent, if that is close enough; see :func:`reparent_piece`.

    Args:
        model: the station as it is now.
        piece: name of the piece, which stays where it is.
        parent: ``world``, a robot or another piece.
        frame: frame of the parent piece, or tool or link of the robot. If it is None, the tool centre point of the
            piece, or the first tool of the robot.

    Raises:
        InvalidParameter: a robot takes the piece, perhaps by another piece, from a larger distance than :data:`REACH`.
        SimrobError: see :func:`reparent_piece`.
    """
    changed = reparent_piece(model, piece, parent, frame=frame)
    is_piece = parent in model.resolved.pieces
    # Only robots have to be near: a piece that is put on another piece or into the world stays where it is.
    carrier = model.resolved.pieces[parent].carrier if is_piece else parent
    if carrier not in model.robots:
        return changed
    # Boxes of the robot, or of the parent piece, of which the nearest to the piece decides. First the frame on which
    # the piece is fixed, ...
    mount = model.mount(parent, frame)
    holders = [_point_box(model.pose(mount))]
    # ... then the tool centre point if the tool in use takes the piece, ...
    robot = model.robots[carrier]
    is_tool_in_use = frame is None and parent in (carrier, model.tool_in_use(carrier))
    if is_tool_in_use and robot.tcp:
        holders.append(_point_box(model.pose(robot.tools[robot.tcp])))
    # ... and the shapes of a link that is no tool, such as a trunk for a backpack.
    if parent in model.robots and frame in model.links(parent):
        holders += _boxes_on(model, mount)
    # Any point of the piece may be taken: its shapes count, and so do its origin and its tool centre point.
    distance = min(
        _distance(holder, box) for holder, box in product(holders, _boxes_of(model, piece))
    )
    if distance > REACH:
        problem = message(
            "programs.away_from_frame",
            "it is {distance:.0f} mm away from {frame}, which takes pieces within {reach:g} mm",
            distance=1e3 * distance,
            frame=frame or parent,
            reach=1e3 * REACH,
        )
        remedy = message(
            "programs.within_reach",
            "move there first, or set pose, the pose of the piece after it is attached",
        )
        raise Unsuitable(piece, problem, remedy)
    return changed


def release_piece(
    model: StationModel,
    piece: str,
    parent: str = WORLD,
    *,
    frame: str | None = None,
    fixed: bool = False,
) -> StationConfig:
    """Make a station in which a robot has released a piece.

    In the world of a dynamic station the piece is free: it falls. On another piece, and on a kinematic station, it is
    fixed where it is.

    Args:
        model: the station as it is now.
        piece: name of the piece.
        parent: ``world``, or another piece.
        frame: frame of the parent piece. If it is None, its tool centre point.
        fixed: whether the piece stays where it is in the world of a dynamic station, too, instead of falling.

    Raises:
        InvalidParameter: no robot or piece holds the piece; or it would fall forever, or cannot fall without mass and
            inertia.
        SimrobError: see :func:`reparent_piece`.
    """
    if piece in model.config.pieces and model.resolved.pieces[piece].parent == WORLD:
        raise Unsuitable(
            piece,
            message("programs.held_by_nothing", "it is attached to no robot and to no piece"),
            message("programs.piece_that_hangs", "release a piece that is attached"),
        )
    changed = reparent_piece(model, piece, parent, frame=frame)
    # A piece that does not fall needs neither mass nor ground.
    falls = parent == WORLD and not fixed and changed.engine.moves_by_forces
    if not falls:
        return changed
    remedy = message(
        "programs.piece_that_can_fall", "set fixed, with which the piece stays where it is"
    )
    missing = _missing_to_fall(model, changed, piece)
    if missing:
        raise Unsuitable(piece, missing, remedy)
    free = changed.pieces[piece].model_copy(update={"free": True})
    changed = changed.model_copy(update={"pieces": {**changed.pieces, piece: free}})
    # It comes to rest if there is ground, at any depth, below the middle of one of its boxes.
    middles = np.array([box.pose.translation() for box in _boxes_of(model, piece)])
    ground = resolve(changed).ground
    if not any(ground.carries(middle[np.newaxis], np.inf) for middle in middles):
        problem = message(
            "programs.over_nothing",
            "it would fall forever, because no floor and no fixed box is below it",
        )
        raise Unsuitable(piece, problem, remedy)
    return changed


def _missing_to_fall(model: StationModel, config: StationConfig, piece: str) -> str:
    """Explain why a piece cannot fall and come to rest: no contact, no shape that collides, or no mass or inertia.

    The explanation is empty if nothing is missing. Whether there is ground below is not checked here.

    Args:
        model: the station before, for the properties of the piece.
        config: the station in which the piece shall fall.
        piece: name of the piece.
    """
    piece_model = model.resolved.pieces[piece].model
    if config.contact is None:
        return message(
            "programs.station_without_contact",
            "it would fall forever, because the station has no contact",
        )
    if not any(shape.collides for shape in piece_model.shapes):
        return message(
            "programs.without_shape", "it would fall forever, because none of its shapes collides"
        )
    # The first three entries are the moments of inertia, the others the products.
    has_inertia = piece_model.mass > 0 and min(piece_model.inertia[:3]) > 0
    if not has_inertia:
        return message("programs.without_inertia", "it cannot fall without mass and inertia")
    return ""


def _point_box(pose: RigidTransform) -> _Box:
    """Box of almost no size around the origin of a frame."""
    return _Box(pose, np.full(3, _THIN))


def _boxes_of(model: StationModel, piece: str) -> Iterator[_Box]:
    """Yield boxes around the visible shapes of a piece, and tiny ones at its origin and its tool centre point."""
    yield _point_box(model.pose(model.piece_origin(piece)))
    yield _point_box(model.pose(model.piece_frame(piece)))
    # Shapes are named by their piece and a number. Without the names, shapes of pieces on the same body would count.
    shapes = {
        f"{piece}_{number}" for number in range(len(model.resolved.pieces[piece].model.shapes))
    }
    yield from _boxes_on(model, model.piece_origin(piece), shapes)


def _boxes_on(model: StationModel, frame: Frame, names: set[str] | None = None) -> Iterator[_Box]:
    """Yield boxes around the visible shapes of a body. Shapes without a bounding box, such as planes, are left out.

    Args:
        model: the station.
        frame: a frame of the body.
        names: names of the shapes. If it is None, all shapes: a body can have those of several pieces.
    """
    body = frame.body()
    inspector = model.station.scene_graph.model_inspector()
    for shape in model.plant.GetVisualGeometriesForBody(body):
        box = inspector.GetObbInGeometryFrame(shape)
        if box is not None and (names is None or own_name(inspector, shape) in names):
            pose = model.pose(body.body_frame()) @ inspector.GetPoseInFrame(shape) @ box.pose()
            yield _Box(pose, np.asarray(box.half_width()) + _THIN)


def _distance(first: _Box, second: _Box) -> float:
    """Compute the distance between two boxes [m]. It is 0, up to rounding, if they overlap.

    A point of the first box is p + R x, with its middle p, its rotation R and coordinates x within half its sides; a
    point of the second box is q + S y. The nearest two points minimise :math:`|p + R x - q - S y|^2`: a linear
    least-squares problem with bounds. The solver returns half of the minimum as its cost.
    """
    from scipy.optimize import lsq_linear

    matrix = np.hstack([first.pose.rotation().matrix(), -second.pose.rotation().matrix()])
    between = second.pose.translation() - first.pose.translation()
    bounds = np.concatenate([first.half, second.half])
    solution = lsq_linear(matrix, between, bounds=(-bounds, bounds))
    return float(np.sqrt(2 * solution.cost))


def with_efforts(
    config: StationConfig, robot: StationRobot, efforts: Mapping[str, float]
) -> StationConfig:
    """Make a station in which some motors of a robot have other torque limits.

    Args:
        config: the station.
        robot: the robot.
        efforts: largest torque or force of the motors, by the names of their axes [N·m or N]. The other motors keep
            their limits.
    """
    own_limits = dict(zip(robot.axes, robot.gains.torque_limit.tolist(), strict=True))
    # Passive axes have no motor, and so no limit.
    driven = {axis: limit for axis, limit in own_limits.items() if limit > 0}
    limits = {**driven, **efforts}
    servo = config.servo_of(robot.name).model_copy(update={"torque_limit": limits})
    entry = config.robots[robot.name].model_copy(update={"servo": servo})
    return config.model_copy(update={"robots": {**config.robots, robot.name: entry}})
