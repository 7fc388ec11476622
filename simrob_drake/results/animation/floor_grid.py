"""The floor of a picture: as wide as a robot walks, with lines by which its way can be told."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Box, GeometryInstance, PerceptionProperties, Rgba, SceneGraph
from pydrake.math import RigidTransform

from simrob_drake.frames import Vector
from simrob_drake.stations.config import StationConfig

SPACING = 0.1
"""From one line to the next [m]."""

_COLOUR = Rgba(0.66, 0.69, 0.73, 1.0)
_AROUND = 1.5  # m of lines about the way
_WIDTH, _TOP = 0.004, 0.0005  # m


def with_floor_under(config: StationConfig, way: Vector) -> StationConfig:
    """Return a station whose floor, if it has one, reaches beyond a way (m, 3) [m] over it."""
    if config.floor is None:
        return config
    size = max(config.floor.size, 2 * (float(np.abs(way[:, :2]).max()) + _AROUND))
    return config.model_copy(update={"floor": config.floor.model_copy(update={"size": size})})


def floor_lines(around: Vector, *, size: float) -> Vector:
    """Return where lines of whole tenths of a metre on a floor begin and end, shape (n, 2, 3) [m].

    Args:
        around: places that they lie about, shape (m, 3) [m].
        size: side of the square floor [m].
    """
    low = np.maximum(around.min(axis=0) - _AROUND, -size / 2)
    high = np.minimum(around.max(axis=0) + _AROUND, size / 2)
    lines = []
    for along, across in ((0, 1), (1, 0)):
        for number in range(int(np.ceil(low[across] / SPACING)), int(np.floor(high[across] / SPACING)) + 1):
            line = np.full((2, 3), (0.0, 0.0, _TOP))
            line[:, along], line[:, across] = (low[along], high[along]), number * SPACING
            lines.append(line)
    return np.array(lines)


def add_floor_grid(scene_graph: SceneGraph, way: Vector, *, size: float) -> None:
    """Draw the lines on a floor of a size [m] about a way (m, 3) [m]; for rendered images only.

    Args:
        scene_graph: where to; not yet in a context.
        way: along which lines are drawn.
        size: side of the square floor.
    """
    source = scene_graph.RegisterSource("floor_grid")
    for number, (begin, end) in enumerate(floor_lines(way, size=size)):
        shape = Box(*np.maximum(end - begin, (_WIDTH, _WIDTH, 2 * _TOP)))
        line = GeometryInstance(RigidTransform((begin + end) / 2 - (0.0, 0.0, _TOP)), shape, f"line_{number}")
        looks = PerceptionProperties()
        looks.AddProperty("phong", "diffuse", _COLOUR)
        line.set_perception_properties(looks)
        scene_graph.RegisterAnchoredGeometry(source, line)
