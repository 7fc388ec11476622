r"""The zero-moment point of a whole robot in motion, and the motion of the centre of mass that gives it.

For mass points :math:`m_i` at :math:`(x_i, y_i, z_i)` over a floor at :math:`z = 0` (Vukobratović 1972), with gravity
:math:`(g_x, g_y, -g)` in the frame of the floor,

.. math::
    p_x = \frac{\sum m_i \left[(\ddot z_i + g)\, x_i - (\ddot x_i - g_x)\, z_i\right]}{\sum m_i (\ddot z_i + g)} ,

and the same for y. Where it lies inside of the area that the feet span, the feet stay flat.

The linear inverted pendulum tells how the centre of mass moves so that this point is where it shall be. With the
centre of mass :math:`c` at constant height :math:`z` the zero-moment point is (Kajita 2003)

.. math::
    p = c - \frac{z}{g}\,\ddot c .

Read as an equation for :math:`c` it has one solution that stays bounded for a given :math:`p(t)`, which looks ahead by
some :math:`\sqrt{z/g}`. It is found as a boundary value problem: at rest over :math:`p` at the start and at the end.
"""

import numpy as np
from scipy.linalg import solve_banded

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.kinematics.skeleton import Skeleton

LEVEL = np.array([0.0, 0.0, -STANDARD_GRAVITY])  # gravity over a level floor [m/s²]
_CHUNK = 1000  # postures at a time, so that memory stays small


def whole_body_zmp(skeleton: Skeleton, root: Vector, angles: Vector, step: float, gravity: Vector = LEVEL) -> Vector:
    """Return a motion's zero-moment point (m, 2) [m]; at its ends, taken as rest, that is below the centre of mass.

    Poses of the root are (m, 4, 4), angles (m, n) [rad], ``step`` [s] apart; gravity (3,) [m/s²] is in the frame of the
    poses, whose z axis is the normal of the floor.
    """
    result = np.empty((len(angles), 2))
    for start in range(0, len(angles), _CHUNK):
        first, last = max(start - 1, 0), min(start + _CHUNK + 1, len(angles))
        frames = skeleton.frames(angles[first:last], root[first:last])
        inside = slice(start - first, start - first + min(_CHUNK, len(angles) - start))
        points = skeleton.mass_points(frames)
        result[start : start + _CHUNK] = _of_points(points, skeleton.point_masses, step, gravity)[inside]
    return result


def _of_points(points: Vector, masses: Vector, step: float, gravity: Vector) -> Vector:
    acceleration = np.zeros_like(points)
    acceleration[1:-1] = (points[2:] - 2.0 * points[1:-1] + points[:-2]) / step**2
    acceleration -= gravity
    lifting = masses * acceleration[..., 2]
    turning = masses * points[..., 2]
    moment = np.einsum("mk,mkx->mx", lifting, points[..., :2]) - np.einsum("mk,mkx->mx", turning, acceleration[..., :2])
    return np.asarray(moment / lifting.sum(axis=1, keepdims=True))


def com_from_zmp(zmp: Vector, *, step: float, height: float, gravity: float = STANDARD_GRAVITY) -> Vector:
    """Return the bounded motion c (m, k) [m] of the centre of mass under a zero-moment point p (m, k) [m], ends at p.

    The second derivative is the central difference, so the error is of the order of ``step**2`` [s²]; ``height`` is z
    [m], ``gravity`` g [m/s²]. Raises InvalidParameter: fewer than three samples, or a parameter that is not positive.
    """
    for name, value in (("step", step), ("height", height), ("gravity", gravity)):
        if not (np.isfinite(value) and value > 0):
            raise InvalidParameter(name, value, "positive")
    if zmp.ndim != 2 or len(zmp) < 3:
        raise InvalidParameter(
            "zmp",
            message("programs.of_shape", "of shape {shape}", shape=zmp.shape),
            message("programs.of_shape_m_k", "(m, k) with m > 2"),
        )
    off_diagonal = -height / gravity / step**2
    bands = np.zeros((3, len(zmp)))
    bands[0, 2:] = off_diagonal
    bands[1] = 1.0 - 2.0 * off_diagonal
    bands[2, :-2] = off_diagonal
    bands[1, [0, -1]] = 1.0
    return np.asarray(solve_banded((1, 1), bands, zmp))
