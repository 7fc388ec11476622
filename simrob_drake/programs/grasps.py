"""What a robot can take, and what becomes of what it lets go: how far a grasp may be, and what can fall."""

from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import Frame

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.parts.resolved import WORLD
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import own_name
from simrob_drake.programs.model import StationModel, reparented
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

REACH = 0.03  # how far from a piece the tool that takes it may be, or the link that it is put on [m]
_THIN = 1e-9  # half of the sides of a point [m]
_Box = tuple[RigidTransform, Vector]  # pose in the world, and half of the sides (3,) [m]


def taken(model: StationModel, piece: str, parent: str, *, frame: str | None = None) -> StationConfig:
    """Return a station with a piece on something else, see :func:`reparented`; raises InvalidParameter: too far."""
    changed = reparented(model, piece, parent, frame=frame)
    links = model.links(parent) if parent in model.robots else ()
    carrier = model.resolved.pieces[parent].carrier if parent in model.resolved.pieces else parent
    if carrier in model.robots:
        mount = model.mount(parent, frame)
        own, uses = model.robots[carrier], model.tool_in_use(carrier)
        at_tool = frame is None and (parent in (carrier, uses)) and bool(own.tcp)
        tip = [_point(model.pose(own.tools[own.tcp]))] if at_tool else []
        holders = [_point(model.pose(mount)), *tip, *(_boxes_on(model, mount) if frame in links else ())]
        distance = min(_gap(a, b) for a, b in product(holders, _boxes_of(model, piece)))
        if distance > REACH:
            where = message(
                "programs.away_from_frame",
                "{distance:.0f} mm away from {frame}",
                distance=1e3 * distance,
                frame=frame or parent,
            )
            remedy = message(
                "programs.within_reach",
                "within {reach:g} mm: move there first, or give its pose there, to which it then jumps",
                reach=1e3 * REACH,
            )
            raise InvalidParameter(
                message("programs.piece_to_take", "{piece}, to be taken,", piece=piece), where, remedy
            )
    return changed


def let_go(
    model: StationModel, piece: str, parent: str = WORLD, *, frame: str | None = None, fixed: bool = False
) -> StationConfig:
    """Return a station in which a piece is let go: in the world of a dynamic one it is free, unless it is ``fixed``.

    Raises InvalidParameter: it would fall for ever, or cannot be moved by gravity; tells why; SimrobError: as
    :func:`reparented`.
    """
    if piece in model.config.pieces and model.resolved.pieces[piece].parent == WORLD:
        raise InvalidParameter(
            message("programs.piece_to_release", "{piece}, to be let go,", piece=piece),
            message("programs.held_by_nothing", "held by nothing"),
            message("programs.piece_that_hangs", "a piece that hangs on a robot or a piece"),
        )
    changed = reparented(model, piece, parent, frame=frame)
    if fixed or parent != WORLD or not changed.engine.moves_by_forces:
        return changed
    free = changed.pieces[piece].model_copy(update={"free": True})
    piece_model, missing = model.resolved.pieces[piece].model, ""
    if changed.contact is None:
        missing = message("programs.station_without_contact", "in a station without contact")
    elif not any(shape.collides for shape in piece_model.shapes):
        missing = message("programs.without_shape", "without a shape that collides")
    elif not (piece_model.mass > 0 and min(piece_model.inertia[:3]) > 0):
        missing = message("programs.without_inertia", "without mass and inertia")
    if missing:
        expected = message(
            "programs.piece_that_can_fall",
            "a piece that can fall and come to rest; with fixed it stays in the air, where it is",
        )
        raise InvalidParameter(
            message("programs.piece_to_release", "{piece}, to be let go,", piece=piece), missing, expected
        )
    changed = changed.model_copy(update={"pieces": {**changed.pieces, piece: free}})
    middles = np.array([box.translation() for box, _ in _boxes_of(model, piece)])
    ground = resolve(changed).ground
    if not any(ground.carries(middle[np.newaxis], np.inf) for middle in middles):
        expected = message(
            "programs.over_a_floor",
            "over a floor or a fixed box, where it comes to rest; with fixed it stays where it is",
        )
        raise InvalidParameter(
            message("programs.piece_to_release", "{piece}, to be let go,", piece=piece),
            message("programs.over_nothing", "over nothing"),
            expected,
        )
    return changed


def _point(pose: RigidTransform) -> _Box:
    return pose, np.full(3, _THIN)


def _boxes_of(model: StationModel, piece: str) -> Iterator[_Box]:
    """Yield boxes around the shapes of a piece, and its origin and tool centre point."""
    yield _point(model.pose(model.piece_origin(piece)))
    yield _point(model.pose(model.piece_frame(piece)))
    shapes = {f"{piece}_{number}" for number in range(len(model.resolved.pieces[piece].model.shapes))}
    yield from _boxes_on(model, model.piece_origin(piece), shapes)


def _boxes_on(model: StationModel, frame: Frame, names: set[str] | None = None) -> Iterator[_Box]:
    """Yield boxes around the visible shapes of a frame's body: those of some names, or all."""
    body, inspector = frame.body(), model.station.scene_graph.model_inspector()
    for shape in model.plant.GetVisualGeometriesForBody(body):
        box = inspector.GetObbInGeometryFrame(shape)
        if box is not None and (names is None or own_name(inspector, shape) in names):
            pose = model.pose(body.body_frame()) @ inspector.GetPoseInFrame(shape) @ box.pose()
            yield pose, np.asarray(box.half_width()) + _THIN


def _gap(first: _Box, second: _Box) -> float:
    """Return the distance between two boxes [m]: of the nearest two points, by least squares within bounds."""
    from scipy.optimize import lsq_linear

    (one, half), (other, other_half) = first, second
    rows = np.hstack([one.rotation().matrix(), -other.rotation().matrix()])
    bounds = np.concatenate([half, other_half])
    found = lsq_linear(rows, other.translation() - one.translation(), bounds=(-bounds, bounds))
    return float(np.sqrt(2 * found.cost))


def with_efforts(config: StationConfig, robot: StationRobot, efforts: Mapping[str, float]) -> StationConfig:
    """Return a station in which motors of a robot give at most so much [N·m or N], by axis; the others as before."""
    own = dict(zip(robot.axes, robot.gains.torque_limit.tolist(), strict=True))
    driven = {axis: limit for axis, limit in own.items() if limit > 0}  # passive axes have no limit
    limits = {**driven, **efforts}
    servo = config.servo_of(robot.name).model_copy(update={"torque_limit": limits})
    entry = config.robots[robot.name].model_copy(update={"servo": servo})
    return config.model_copy(update={"robots": {**config.robots, robot.name: entry}})
