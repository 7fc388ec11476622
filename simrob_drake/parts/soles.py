r"""Weights of the points of feet, by which a standing robot is taken to stand more on the lower ones.

No sensor reports which points of the feet touch the ground. So each point gets a weight that decreases with its height
h above the lowest point:

.. math:: w = e^{-h / h_0}, \qquad h_0 = 3\,\mathrm{mm} .

The weights are a smooth function of the posture: an estimate made of them does not jump when a foot is lifted. The
balance loop and the odometry of legs share this function, so that they agree on which foot stands.
"""

import numpy as np

from simrob_drake.base.frames import Vector

# Height h_0 at which a weight is 1/e [m]. Servos and contacts give way by about as much while a point stands.
_HEIGHT_SCALE = 0.003


def shares_by_height(heights: Vector, lowest: float) -> Vector:
    """Compute the weight of each point of the feet, by the equation of the module.

    Args:
        heights: heights of the points, shape (k,) [m].
        lowest: height at which the weight is 1 [m]: that of the lowest point of all feet or, where forces tell which
            feet stand, of the points' own foot.

    Returns:
        The weights, shape (k,): 1 at the lowest height, nearly 0 for points of a lifted foot.
    """
    # w = exp(-h / h_0), with h = height - lowest
    return np.asarray(np.exp((lowest - heights) / _HEIGHT_SCALE))
