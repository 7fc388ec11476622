"""The points of feet on which a robot stands."""

import numpy as np

from simrob_drake.base.frames import Vector

_HEIGHT = 0.003
"""Height over the lowest point at which a point counts e times less [m]: servos and contacts give way by about that."""


def shares_by_height(heights: Vector, lowest: float) -> Vector:
    """How much each point of the feet counts as one that stands, by its height: the balance and the odometry agree.

    Args:
        heights: heights of the points, shape (k,) [m].
        lowest: height of the lowest point [m].

    Returns:
        shares, shape (k,): 1 for the lowest point.
    """
    return np.asarray(np.exp((lowest - heights) / _HEIGHT))
