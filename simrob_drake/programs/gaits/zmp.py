r"""The zero-moment point of a whole robot in motion, and the motion of the centre of mass that has a desired one.

The zero-moment point (ZMP) is the point of the floor about which the ground's forces have no level moment. As long as
it is inside the area that the standing feet span, these feet stay flat. For mass points :math:`m_i` at
:math:`(x_i, y_i, z_i)` over a floor at :math:`z = 0`, with gravity :math:`(g_x, g_y, -g)` in the frame of the floor, it
is (Vukobratović 1972)

.. math::
    p_x = \frac{\sum m_i \left[(\ddot z_i + g)\, x_i - (\ddot x_i - g_x)\, z_i\right]}{\sum m_i (\ddot z_i + g)} ,

and the same for y.

The linear inverted pendulum replaces the robot by its centre of mass :math:`c` at a constant height :math:`z`. Its
zero-moment point is (Kajita 2003)

.. math::
    p = c - \frac{z}{g}\,\ddot c .

For a given :math:`p(t)` this equation has only one solution :math:`c(t)` that stays bounded. It looks ahead by about
:math:`\sqrt{z/g}`. It is found as a boundary value problem: at rest over :math:`p` at the start and at the end.
"""

import numpy as np
from scipy.linalg import solve_banded

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.kinematics.skeleton import Skeleton

LEVEL = np.array([0.0, 0.0, -STANDARD_GRAVITY])
"""Gravity over a level floor, shape (3,) [m/s²]."""

_CHUNK = 1000  # count of postures that are computed at once; more would need much memory


def whole_body_zmp(
    skeleton: Skeleton,
    root: Vector,
    angles: Vector,
    step: float,
    gravity: Vector = LEVEL,
) -> Vector:
    """Compute the zero-moment point of a motion from all masses of the robot.

    The robot is taken to rest at both ends of the motion.

    Args:
        skeleton: links, joints and masses of the robot.
        root: poses of the root link, shape (m, 4, 4). The z axis of their frame is the normal of the floor, which is at
            z = 0.
        angles: angles of all n axes, shape (m, n) [rad].
        step: time between two postures [s].
        gravity: gravity in the frame of the poses, shape (3,) [m/s²].

    Returns:
        Zero-moment point at each posture in the frame of the poses, shape (m, 2) [m].
    """
    count = len(angles)
    result = np.empty((count, 2))
    # A part of the postures at a time, because positions of all mass points would need much memory.
    for start in range(0, count, _CHUNK):
        # One more posture on each side, because the acceleration is a central difference.
        end = min(start + _CHUNK, count)
        first = max(start - 1, 0)
        last = min(start + _CHUNK + 1, count)
        frames = skeleton.frames(angles[first:last], root[first:last])
        points = skeleton.mass_points(frames)
        zmp = _zmp_of_points(points, skeleton.point_masses, step, gravity)
        result[start:end] = zmp[start - first : end - first]
    return result


def _zmp_of_points(points: Vector, masses: Vector, step: float, gravity: Vector) -> Vector:
    """Compute the zero-moment point of moving mass points, by the first equation of the module.

    At the first and the last time the points are taken to have no acceleration.

    Args:
        points: positions of k mass points at m times, shape (m, k, 3) [m].
        masses: masses of the points, shape (k,) [kg].
        step: time between two positions [s].
        gravity: gravity, shape (3,) [m/s²].

    Returns:
        Zero-moment point, shape (m, 2) [m].
    """
    # Acceleration: the central difference, and zero at both ends, where the robot rests. Gravity is then subtracted.
    acceleration = np.zeros_like(points)
    acceleration[1:-1] = (points[2:] - 2.0 * points[1:-1] + points[:-2]) / step**2
    acceleration -= gravity
    vertical_forces = masses * acceleration[..., 2]  # m (z'' + g), shape (m, k) [N]
    heights = masses * points[..., 2]  # m z, shape (m, k) [kg m]
    # The two sums of the numerator, for x and y, shape (m, 2) [N m].
    upright_moment = np.einsum("mk,mkx->mx", vertical_forces, points[..., :2])
    tilting_moment = np.einsum("mk,mkx->mx", heights, acceleration[..., :2])
    moment = upright_moment - tilting_moment
    return np.asarray(moment / vertical_forces.sum(axis=1, keepdims=True))


def com_from_zmp(
    zmp: Vector, *, step: float, height: float, gravity: float = STANDARD_GRAVITY
) -> Vector:
    r"""Compute the bounded motion of the centre of mass c whose zero-moment point is p.

    The second derivative of :math:`p = c - (z/g)\,\ddot c` is replaced by the central difference, with an error of the
    order of ``step**2``. At both ends c is p.

    Args:
        zmp: zero-moment point p, shape (m, k) [m], with m > 2.
        step: time between two samples [s].
        height: height z of the centre of mass [m].
        gravity: g [m/s²].

    Returns:
        Centre of mass c, shape (m, k) [m].

    Raises:
        InvalidParameter: `zmp` has another count of dimensions or fewer than three samples, or the step, the height or
            gravity is no positive finite number.
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
    # -a c[i-1] + (1 + 2a) c[i] - a c[i+1] = p[i], with a = z / (g step²): a tridiagonal system.
    # The rows of `bands` are the diagonals above, on and below the main one, as solve_banded expects them.
    off_diagonal = -height / gravity / step**2
    bands = np.zeros((3, len(zmp)))
    bands[0, 2:] = off_diagonal
    bands[1] = 1.0 - 2.0 * off_diagonal
    bands[2, :-2] = off_diagonal
    bands[1, [0, -1]] = 1.0  # c = p at both ends
    return np.asarray(solve_banded((1, 1), bands, zmp))
