r"""Laws of time from rest to rest that cruise: trapezoids of speed, and S-curves, whose jerk is limited, too.

A way of length L is sped up, gone at an even speed v, and slowed down. With a ramp of duration :math:`T_r`,

.. math:: T = L / v + T_r, \qquad T_r = v / a + a / j,

where a trapezoid has no jerk time a / j. On a way too short for the acceleration a it is not reached; on one too short
for the speed, v is what fits: :math:`v\,T_r = L`.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polyder, polyval
from pydrake.polynomial import Polynomial
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.base.arguments import LONGEST, SHORTEST
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.blocks.references import BLEND, hold

_ROUNDING = 3.0
"""Parts of a ramp of an S-curve unless its jerk is told: in the first the acceleration rises, in the last it falls."""
LONGEST_RAMP = _ROUNDING / (_ROUNDING - 1)
"""How many times as long it takes as that of a trapezoid of the same speed and acceleration."""
_RAMP = 0.25  # part of the whole time that a ramp takes where only that time is told
_NO_WAY = 1e-9  # rad or m
_QUICKEST = 1e-4  # s: what a ramp takes at least, and its rise, so that they are times that can be told apart
_LOOKS = 500  # at each polynomial of a law


@dataclass(frozen=True)
class TimeLaw:
    """How far along its way a motion is over time: polynomials, one after the other.

    Attributes:
        breaks: where they meet, from 0 to the end, shape (k + 1,) [s].
        coefficients: of rising powers of the time since the polynomial began, shape (k, m).
    """

    breaks: Vector
    coefficients: Vector

    @property
    def duration(self) -> float:
        """Of the motion [s]."""
        return float(self.breaks[-1])

    def at(self, times: npt.ArrayLike, piece: int, order: int = 0) -> Vector:
        """Return a derivative at times (m,) [s] by one of the polynomials, shape (m,)."""
        since = np.asarray(times, dtype=float) - self.breaks[piece]
        return np.asarray(polyval(since, polyder(self.coefficients[piece], order)))

    def times_of(self, parts: Vector) -> Vector:
        """Return when the motion is at parts (m,) of its way, from 0 to 1, by straight lines between many looks [s]."""
        looks = [np.linspace(begin, end, _LOOKS) for begin, end in pairwise(self.breaks)]
        ways = np.concatenate([self.at(times, piece) for piece, times in enumerate(looks)])
        return np.asarray(np.interp(parts, ways / ways[-1], np.concatenate(looks)))

    def slower(self, factor: float) -> "TimeLaw":
        """Return the same motion in ``factor`` times the time."""
        powers = factor ** -np.arange(self.coefficients.shape[1], dtype=float)
        return TimeLaw(self.breaks * factor, self.coefficients * powers)


def smooth_law(duration: float) -> TimeLaw:
    """Return the law of :func:`~simrob_drake.blocks.references.smooth`, a way of 1 in a time [s]."""
    coefficients = np.array([[0.0, 0.0, 0.0, *BLEND]])
    return TimeLaw(np.array([0.0, 1.0]), coefficients).slower(duration)


def cruise(length: float, speed: float, acceleration: float, jerk: float | None = None) -> TimeLaw:
    """Return the shortest law along a way within a speed, an acceleration and a jerk, all positive.

    The jerk of a trapezoid is infinite. None gives an S-curve whose acceleration rises for a third of the ramp.

    Raises:
        InvalidParameter: limits so low that it would take for ever.
    """
    slowest = max(length / speed, np.sqrt(length / acceleration), 0.0 if jerk is None else np.cbrt(length / jerk))
    if not slowest < LONGEST:
        expected = message("blocks.shorter_than", "shorter than {longest:g} s: its limits are too low", longest=LONGEST)
        raise InvalidParameter(
            message("blocks.time_of_motion", "the time of the motion"),
            compound("{slowest:.2g} s", slowest=slowest),
            expected,
        )
    speed = min(speed, length / _QUICKEST)
    acceleration = min(acceleration, speed / _QUICKEST)
    if jerk is None:
        reached = min(speed, np.sqrt(acceleration * length / LONGEST_RAMP))
        jerk = (_ROUNDING - 1) * acceleration**2 / reached
    elif np.isfinite(jerk):
        jerk = min(jerk, acceleration / _QUICKEST)
    bend = acceleration**2 / jerk  # the speed at which a ramp just reaches the acceleration, and leaves it at once
    fits = (np.sqrt(bend**2 + 4 * acceleration * length) - bend) / 2
    if fits < bend:
        fits = (length**2 * jerk / 4) ** (1 / 3)
    top = min(speed, fits)
    rise = min(acceleration / jerk, np.sqrt(top / jerk))  # s
    steep = acceleration if rise == 0 else jerk * rise
    ramp = [(rise, 0.0, jerk), (top / steep - rise, steep, 0.0), (rise, steep, -jerk)]
    even = (length / top - (rise + top / steep), 0.0, 0.0)
    braking = [(time, -push, -change) for time, push, change in ramp]
    return _of_phases([*ramp, even, *braking], length)


def cruise_in(duration: float, *, rounded: bool) -> TimeLaw:
    """Return the law of a way of 1 that takes a time [s], a quarter of it to speed up: an S-curve, or a trapezoid."""
    speed = 1 / (1 - _RAMP)
    acceleration = speed / _RAMP * (LONGEST_RAMP if rounded else 1.0)
    return cruise(1.0, speed, acceleration, None if rounded else np.inf).slower(duration)


def cruising(
    start: npt.ArrayLike,
    target: npt.ArrayLike,
    speeds: Vector,
    accelerations: Vector,
    jerks: Vector | None = None,
    *,
    start_time: float = 0.0,
) -> Trajectory:
    """Go straight from ``start`` to ``target``, each (n,) [rad], all axes at the same time, within limits (n,).

    The axis that has furthest to go for its limits cruises at its speed [rad/s], or speeds up with its acceleration
    [rad/s²]; the others follow. Jerks [rad/s³] are infinite for a trapezoid; None are those of :func:`cruise`.
    """
    low, way = np.asarray(start, dtype=float), np.asarray(target, dtype=float) - np.asarray(start, dtype=float)
    moves = np.abs(way) > _NO_WAY
    if not moves.any():
        return hold(target)
    shares = np.abs(way[moves])
    speed, acceleration = (float((limits[moves] / shares).min()) for limits in (speeds, accelerations))
    law = cruise(1.0, speed, acceleration, None if jerks is None else float((jerks[moves] / shares).min()))
    pieces = [
        np.array([[Polynomial([q + d * powers[0], *(d * powers[1:])])] for q, d in zip(low, way, strict=True)])
        for powers in law.coefficients
    ]
    return PiecewisePolynomial(pieces, start_time + law.breaks)


def _of_phases(phases: list[tuple[float, float, float]], length: float) -> TimeLaw:
    """Join phases, each a duration, its first acceleration and its jerk; those that are no time drop out."""
    breaks, rows, place, speed = [0.0], [], 0.0, 0.0
    for time, push, change in phases:
        if time >= SHORTEST:
            rows.append([place, speed, push / 2, change / 6])
            place = float(polyval(time, rows[-1]))
            speed += push * time + change * time**2 / 2
            breaks.append(breaks[-1] + time)
    return TimeLaw(np.array(breaks), np.array(rows) * length / place)
