"""Whether a robot runs into something on its way: signed distances of Drake's scene graph."""

from __future__ import annotations

from collections.abc import Mapping

from pydrake.geometry import GeometryId, PenetrationAsPointPair, QueryObject

from simrob_drake.frames import Vector
from simrob_drake.parts.targets import own_name, piece_of_shape
from simrob_drake.programs.checks import Naming
from simrob_drake.programs.errors import PathCollision
from simrob_drake.programs.model import StationModel

TOUCH = 1e-3
"""How deep shapes may be in each other before it counts [m]: what stands, or is held, touches."""


def check_collisions(
    model: StationModel,
    robots: Mapping[str, Vector],
    times: Vector,
    named: Naming,
    *,
    touch: float = TOUCH,
) -> None:
    """Check that robots touch nothing on their way, and what they carry neither.

    A robot and what it carries count as one, and pass through each other; so does what already touched at the
    beginning, as a piece on its table. Meshes count as their convex hulls, so the holes of a half sphere are closed.

    Args:
        model: of the station, with collision shapes.
        robots: postures (k, n) by robot at the times; robots that are left out stay where they are.
        times: shape (k,) [s].
        named: how points are called.
        touch: how deep shapes may be in each other [m].

    Raises:
        PathCollision: names the first offending point, and what runs into what.
    """
    resting: set[frozenset[str]] = set()
    for row, time in enumerate(times):
        model.place_robots({name: postures[row] for name, postures in robots.items()})
        query = model.query()
        found = [pair for pair in query.ComputePointPairPenetration() if pair.depth > touch]
        if row == 0:
            resting = {frozenset(_names(model, query, pair)) for pair in found}
        for pair in sorted(found, key=lambda pair: float(pair.depth)):  # through thin shapes depths are too large
            names = _names(model, query, pair)
            if frozenset(names) not in resting:
                number, name = named(float(time))
                raise PathCollision(name, point=number, time=float(time), bodies=names, depth=float(pair.depth))


def _names(model: StationModel, query: QueryObject, pair: PenetrationAsPointPair) -> tuple[str, str]:
    """Return what two shapes belong to: pieces, links of robots, the floor."""
    return _owner(model, query, pair.id_A), _owner(model, query, pair.id_B)


def _owner(model: StationModel, query: QueryObject, geometry: GeometryId) -> str:
    inspector = query.inspector()
    piece = piece_of_shape(model.resolved, inspector, geometry)
    if piece is not None:
        return piece
    body = model.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
    for robot in model.robots.values():
        if body.model_instance() == robot.instance:
            return f"{robot.prefix}{body.name()}"
    return own_name(inspector, geometry)
