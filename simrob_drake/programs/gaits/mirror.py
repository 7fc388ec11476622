"""Left and right exchanged."""

from __future__ import annotations

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.robots.catalog import RobotModel

_SIDES = {"left": "right", "right": "left"}


def mirrored(model: RobotModel, values: Vector) -> Vector:
    """Return per-axis values (n,) with left and right exchanged; turns to a side change their sense."""
    names = list(model.axes)
    result = np.empty_like(values)
    for place, name in enumerate(names):
        side, _, rest = name.partition("_")
        other = names.index(f"{_SIDES[side]}_{rest}") if side in _SIDES else place
        result[place] = -values[other] if name.endswith("yaw") else values[other]
    return result
