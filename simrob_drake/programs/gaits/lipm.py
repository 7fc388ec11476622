r"""The linear inverted pendulum: how the centre of mass moves so that the zero-moment point is where it shall be.

With the centre of mass :math:`c` at constant height :math:`z` the zero-moment point is (Kajita 2003)

.. math::
    p = c - \frac{z}{g}\,\ddot c .

Read as an equation for :math:`c` it has one solution that stays bounded for a given :math:`p(t)`, which looks ahead by
some :math:`\sqrt{z/g}`. It is found as a boundary value problem: at rest over :math:`p` at the start and at the end.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_banded

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector


def com_from_zmp(zmp: Vector, *, step: float, height: float, gravity: float = STANDARD_GRAVITY) -> Vector:
    """Return the bounded motion of the centre of mass under a zero-moment point.

    The second derivative is the central difference, so the error is of the order of ``step**2``.

    Args:
        zmp: p at equal steps of time, shape (m, k) [m].
        step: between the samples [s].
        height: z [m].
        gravity: g [m/s²].

    Returns:
        c, shape (m, k) [m]; at its ends it is p.

    Raises:
        InvalidParameter: fewer than three samples, or a figure that is not positive.
    """
    for name, value in (("step", step), ("height", height), ("gravity", gravity)):
        if not (np.isfinite(value) and value > 0):
            raise InvalidParameter(name, value, "positive")
    if zmp.ndim != 2 or len(zmp) < 3:
        raise InvalidParameter("zmp", f"of shape {zmp.shape}", "(m, k) with m > 2")
    beside = -height / gravity / step**2
    bands = np.zeros((3, len(zmp)))
    bands[0, 2:] = beside
    bands[1] = 1.0 - 2.0 * beside
    bands[2, :-2] = beside
    bands[1, [0, -1]] = 1.0
    return np.asarray(solve_banded((1, 1), bands, zmp))
