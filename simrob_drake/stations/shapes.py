"""What the collision shapes of a station's plant belong to, told by their names: ``<owner>::<model>::<name>``.

A piece's shapes are called ``<piece>.<shape>``, and their owner is the piece, or the robot that carries it. The floor
has no owner.
"""

from __future__ import annotations

from pydrake.geometry import GeometryId, SceneGraphInspector

from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.names import carrier

FLOOR = "floor"
"""The whole name of the floor's shape."""


def own_name(inspector: SceneGraphInspector, shape: GeometryId) -> str:
    """Return the name that a shape has in its own file; those of pieces begin with the piece's name and a dot."""
    name: str = inspector.GetName(shape)
    return name.rsplit("::", 1)[-1]


def piece_of_shape(config: StationConfig, inspector: SceneGraphInspector, shape: GeometryId) -> str | None:
    """Return the piece that a shape belongs to; None for one of a robot's own, and the floor's."""
    owner = inspector.GetName(shape).partition("::")[0]
    piece, dot, _ = own_name(inspector, shape).partition(".")
    return piece if dot and piece in config.pieces and owner in (piece, carrier(config, piece)) else None
