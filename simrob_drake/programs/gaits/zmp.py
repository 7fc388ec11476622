r"""The zero-moment point of a whole robot in motion.

For mass points :math:`m_i` at :math:`(x_i, y_i, z_i)` over a floor at :math:`z = 0` (Vukobratović 1972)

.. math::
    p_x = \frac{\sum m_i \left[(\ddot z_i + g)\, x_i - \ddot x_i\, z_i\right]}{\sum m_i (\ddot z_i + g)} ,

and the same for y. Where it lies inside of the area that the feet span, the feet stay flat.
"""

from __future__ import annotations

import numpy as np

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.frames import Vector
from simrob_drake.kinematics.skeleton import Skeleton

_CHUNK = 1000  # postures at a time, so that memory stays small


def whole_body_zmp(skeleton: Skeleton, root: Vector, angles: Vector, step: float) -> Vector:
    """Return the zero-moment point of a motion.

    Args:
        skeleton: of the robot.
        root: its poses, shape (m, 4, 4).
        angles: of all axes, shape (m, n) [rad].
        step: between the samples [s].

    Returns:
        shape (m, 2) [m]; at the ends of the motion, which count as rest, it is below the centre of mass.
    """
    result = np.empty((len(angles), 2))
    for start in range(0, len(angles), _CHUNK):
        first, last = max(start - 1, 0), min(start + _CHUNK + 1, len(angles))
        frames = skeleton.frames(angles[first:last], root[first:last])
        inside = slice(start - first, start - first + min(_CHUNK, len(angles) - start))
        result[start : start + _CHUNK] = _of_points(skeleton.mass_points(frames), skeleton.point_masses, step)[inside]
    return result


def _of_points(points: Vector, masses: Vector, step: float) -> Vector:
    acceleration = np.zeros_like(points)
    acceleration[1:-1] = (points[2:] - 2.0 * points[1:-1] + points[:-2]) / step**2
    lifting = masses * (acceleration[..., 2] + STANDARD_GRAVITY)
    turning = masses * points[..., 2]
    moment = np.einsum("mk,mkx->mx", lifting, points[..., :2]) - np.einsum("mk,mkx->mx", turning, acceleration[..., :2])
    return np.asarray(moment / lifting.sum(axis=1, keepdims=True))
