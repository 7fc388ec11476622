r"""Trajectories of joints from rest to rest: splines of degree five, whose slopes at both ends are given, or zero.

The part of the way at a part of the time is that of :func:`~simrob_drake.blocks.references.smooth`, or of a law that
cruises; what depends on it smoothly is interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from pydrake.math import BsplineBasis
from pydrake.trajectories import BsplineTrajectory, CompositeTrajectory, Trajectory
from scipy.interpolate import BSpline, make_interp_spline

from simrob_drake.blocks.cruise import TimeLaw
from simrob_drake.frames import Vector

_DEGREE = 5
_LEAST_POINTS, _FINER = 6, 1.5  # of a motion: its points, and how many times as dense as those of its way


def free_spline(parts: Vector, postures: Vector) -> BSpline:
    """Return the spline of degree five through postures (k, n) at parts (k,), its ends as they come."""
    result: BSpline = make_interp_spline(parts, postures, k=_DEGREE)
    return result


Slopes = tuple[Vector, Vector]
"""First and second derivative at an end of a curve, each of shape (n,)."""


def spline(times: Vector, postures: Vector, ends: tuple[Slopes, Slopes] | None = None) -> BSpline:
    """Return the spline of degree five through postures (k, n) at times (k,) [s], at rest at both ends unless told."""
    rest = np.zeros(postures.shape[1])
    conditions: Any = [list(enumerate(slopes, 1)) for slopes in ends or ((rest, rest),) * 2]  # the stubs know words
    result: BSpline = make_interp_spline(times, postures, k=_DEGREE, bc_type=tuple(conditions))
    return result


@dataclass(frozen=True)
class Stretch:
    """A motion: the spline through postures (k, n) [rad or m] at times (k,) [s], with slopes at its ends.

    Without slopes it goes from rest to rest.
    """

    times: Vector
    postures: Vector
    ends: tuple[Slopes, Slopes] | None = None

    def at(self, begin: float, factor: float = 1.0) -> Stretch:
        """Return the same motion later by ``begin`` [s], its times multiplied by ``factor``."""
        ends = None
        if self.ends is not None:
            first, last = ((speed / factor, push / factor**2) for speed, push in self.ends)
            ends = first, last
        return Stretch(begin + factor * self.times, self.postures, ends)


def by_law(parts: Vector, postures: Vector, law: TimeLaw) -> tuple[Stretch, ...]:
    """Return the motions by which a way is gone that leads through postures (k, n) at its parts (k,), from 0 to 1.

    Each is that of one polynomial of the law: no spline smoothes the acceleration or jerk that jumps between two.
    """
    way = free_spline(parts, postures)
    slope, bend = way.derivative(1), way.derivative(2)
    motions = []
    for piece, (begin, end) in enumerate(pairwise(law.breaks)):
        share = float(np.ptp(law.at([begin, end], piece)))
        times = np.linspace(begin, end, _LEAST_POINTS + int(_FINER * share * len(parts)))
        gone, speed, push = (law.at(times, piece, order) for order in range(3))
        gone = np.clip(gone, 0.0, 1.0)
        ends = [(slope(gone[k]) * speed[k], bend(gone[k]) * speed[k] ** 2 + slope(gone[k]) * push[k]) for k in (0, -1)]
        motions.append(Stretch(times, way(gone), (ends[0], ends[1])))
    return tuple(motions)


def rest(posture: Vector, begin: float, end: float) -> Stretch:
    """Return the motion that stays at a posture (n,) from one time to another [s]."""
    return Stretch(np.array([begin, end]), np.array([posture, posture]))


def trajectory(stretches: Sequence[Stretch]) -> Trajectory:
    """Return the trajectory of shape (n, 1) of motions that follow each other without a gap in time."""
    curves = []
    for stretch in stretches:
        fitted = spline(stretch.times, stretch.postures, stretch.ends)
        basis = BsplineBasis(_DEGREE + 1, fitted.t.tolist())
        curves.append(BsplineTrajectory(basis, list(fitted.c[:, :, np.newaxis])))
    return curves[0] if len(curves) == 1 else CompositeTrajectory(curves)


def until(stretches: tuple[Stretch, ...], posture: Vector, end: float) -> tuple[Stretch, ...]:
    """Return motions with a rest behind them, so that they last until ``end`` [s]."""
    begin = float(stretches[-1].times[-1]) if stretches else 0.0
    if begin >= end:
        return stretches
    return (*stretches, rest(stretches[-1].postures[-1] if stretches else posture, begin, end))
