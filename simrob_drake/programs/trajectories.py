r"""Smooth trajectories of joints: rest to rest, with continuous acceleration.

The part of the way at a part of the time is that of :func:`~simrob_drake.blocks.references.smooth`. What depends on it
smoothly is then interpolated by splines of degree five in time, which keep velocity and acceleration at both ends zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.math import BsplineBasis
from pydrake.trajectories import BsplineTrajectory, CompositeTrajectory, Trajectory
from scipy.interpolate import BSpline, make_interp_spline

from simrob_drake.frames import Vector

_DEGREE = 5


def spline(times: Vector, postures: Vector) -> BSpline:
    """Return the spline of degree five through postures (k, n) at times (k,) [s], at rest at both ends."""
    zero = np.zeros(postures.shape[1])
    at_rest: Any = [(1, zero), (2, zero)]  # the stubs know words only
    result: BSpline = make_interp_spline(times, postures, k=_DEGREE, bc_type=(at_rest, at_rest))
    return result


@dataclass(frozen=True)
class Stretch:
    """A motion from rest to rest: the spline through postures (k, n) [rad or m] at times (k,) [s]."""

    times: Vector
    postures: Vector

    def at(self, begin: float, factor: float = 1.0) -> Stretch:
        """Return the same motion later by ``begin`` [s], its times multiplied by ``factor``."""
        return Stretch(begin + factor * self.times, self.postures)


def rest(posture: Vector, begin: float, end: float) -> Stretch:
    """Return the motion that stays at a posture (n,) from one time to another [s]."""
    return Stretch(np.array([begin, end]), np.array([posture, posture]))


def trajectory(stretches: Sequence[Stretch]) -> Trajectory:
    """Return the trajectory of shape (n, 1) of motions that follow each other without a gap in time."""
    curves = []
    for stretch in stretches:
        fitted = spline(stretch.times, stretch.postures)
        basis = BsplineBasis(_DEGREE + 1, fitted.t.tolist())
        curves.append(BsplineTrajectory(basis, list(fitted.c[:, :, np.newaxis])))
    return curves[0] if len(curves) == 1 else CompositeTrajectory(curves)
