"""Lines on the floor, by which the way of a walking robot can be told from pictures that follow it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pydrake.geometry import Box, GeometryInstance, PerceptionProperties, Rgba, SceneGraph
from pydrake.math import RigidTransform

from simrob_drake.frames import Vector

SPACING = 0.1
"""From one line to the next [m]."""

_AROUND = 1.5  # m of lines about the way
_WIDTH, _TOP = 0.004, 0.0005  # m
_COLOUR = Rgba(0.66, 0.69, 0.73, 1.0)


def add_floor_grid(scene_graph: SceneGraph, way: Vector, *, size: float) -> None:
    """Draw lines of whole tenths of a metre on a floor of a size [m], about a way (m, 3) [m]; for rendered images only.

    Args:
        scene_graph: where to; not yet in a context.
        way: along which lines are drawn.
        size: side of the square floor.
    """
    source = scene_graph.RegisterSource("floor_grid")
    low = np.maximum(way.min(axis=0) - _AROUND, -size / 2)
    high = np.minimum(way.max(axis=0) + _AROUND, size / 2)
    for name, middle, length, along in _lines(low, high):
        shape = Box(*((length, _WIDTH) if along == 0 else (_WIDTH, length)), 2 * _TOP)
        line = GeometryInstance(RigidTransform(np.append(middle, 0.0)), shape, name)
        looks = PerceptionProperties()
        looks.AddProperty("phong", "diffuse", _COLOUR)
        line.set_perception_properties(looks)
        scene_graph.RegisterAnchoredGeometry(source, line)


def _lines(low: Vector, high: Vector) -> Iterator[tuple[str, Vector, float, int]]:
    """Yield name, middle (2,), length and direction (0 along x, 1 along y) of the lines in a rectangle."""
    middle, length = (low + high)[:2] / 2, (high - low)[:2]
    for along, across in ((0, 1), (1, 0)):
        for number in range(int(np.ceil(low[across] / SPACING)), int(np.floor(high[across] / SPACING)) + 1):
            place = middle.copy()
            place[across] = number * SPACING
            yield f"line_{'xy'[across]}_{number}", place, float(length[along]), along
