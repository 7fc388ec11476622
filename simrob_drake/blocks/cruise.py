r"""Time laws of motions that cruise: from rest to rest, with a constant speed in the middle.

A time law gives the distance along a path as a function of time. A trapezoid of speed accelerates evenly to the speed
v, goes on with it, and slows down evenly. An S-curve also limits the jerk: its acceleration a rises and falls evenly
with the jerk j. For a path of length L, the duration T and that of the ramp at each end, :math:`T_r`, are

.. math:: T = L / v + T_r, \qquad T_r = v / a + a / j .

A trapezoid has an infinite jerk, so its a / j is zero. On a path too short to reach a or v, lower values are used:
the speed is then the one for which :math:`v\,T_r = L`, without a part of constant speed.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polyder, polyval
from pydrake.polynomial import Polynomial
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.base.arguments import LONGEST, SHORTEST
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.renaming import former_names_of
from simrob_drake.blocks.references import BLEND, hold

# An S-curve without a given jerk has ramps of three equal parts: the acceleration rises, stays and falls [1].
_RAMP_PARTS = 3.0
LONGEST_RAMP = _RAMP_PARTS / (_RAMP_PARTS - 1)
"""Duration of the ramp of an S-curve without a given jerk, relative to that of a trapezoid with its acceleration."""
# Part of the whole duration that a ramp takes if only the duration is given [1].
_RAMP_SHARE = 0.25
# A shorter distance is no motion [rad or m].
_NO_DISTANCE = 1e-9
# Shortest duration of a ramp, and of the rise of its acceleration: shorter times would be lost in rounding [s].
_SHORTEST_RAMP = 1e-4
# Samples of each polynomial from which times are interpolated.
_SAMPLES_PER_PIECE = 500


@dataclass(frozen=True)
class TimeLaw:
    """Distance along a path as a function of time, as polynomials in sequence (its pieces).

    Attributes:
        breaks: times at which the k pieces meet, from 0 to the end, shape (k + 1,) [s].
        coefficients: coefficients of each piece in ascending powers of the time since the piece began, shape (k, m).
    """

    breaks: Vector
    coefficients: Vector

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return float(self.breaks[-1])

    def at(self, times: npt.ArrayLike, piece: int, order: int = 0) -> Vector:
        """Compute the distance by the polynomial of one piece, or its derivative of an order.

        Args:
            times: times since the motion began, shape (m,) [s]. Outside of the piece, its polynomial goes on.
            piece: index of the piece.
            order: order of the derivative; 0 for the distance itself.

        Returns:
            the values, shape (m,).
        """
        since_start_of_piece = np.asarray(times, dtype=float) - self.breaks[piece]
        return np.asarray(polyval(since_start_of_piece, polyder(self.coefficients[piece], order)))

    def times_of(self, parts: Vector) -> Vector:
        """Find the times [s] at which the motion has covered parts of the path, shape (m,), each 0 to 1.

        They are interpolated between samples of the pieces. Between its two ends the motion must not rest or go back,
        so that each part has one time.
        """
        # Sample times of each piece, and the distance at each of them.
        sample_times = [
            np.linspace(begin, end, _SAMPLES_PER_PIECE) for begin, end in pairwise(self.breaks)
        ]
        distances = np.concatenate(
            [self.at(times, piece) for piece, times in enumerate(sample_times)]
        )
        return np.asarray(np.interp(parts, distances / distances[-1], np.concatenate(sample_times)))

    def slower(self, factor: float) -> "TimeLaw":
        """Stretch the motion in time by a factor: the same distance in `factor` times the duration."""
        # With t' = factor t, the coefficient of the power p becomes c / factor^p.
        powers = factor ** -np.arange(self.coefficients.shape[1], dtype=float)
        return TimeLaw(breaks=self.breaks * factor, coefficients=self.coefficients * powers)


class _Phase(NamedTuple):
    """A time with constant jerk.

    Attributes:
        duration: [s].
        acceleration: acceleration at its start [1/s² of the distance].
        jerk: [1/s³ of the distance].
    """

    duration: float
    acceleration: float
    jerk: float


def smooth_law(duration: float) -> TimeLaw:
    """Time law of :func:`~simrob_drake.blocks.references.smooth` for a path of length 1 and a duration [s]."""
    coefficients = np.array([[0.0, 0.0, 0.0, *BLEND]])
    return TimeLaw(breaks=np.array([0.0, 1.0]), coefficients=coefficients).slower(duration)


def cruise(
    length: float,
    speed: float,
    acceleration: float,
    jerk: float | None = None,
) -> TimeLaw:
    """Compute the shortest time law for a path within limits.

    Its shape is that of the module: ramp, constant speed, ramp. The units are those of the length and of seconds.

    Args:
        length: length of the path, positive [rad or m, or 1 for parts of a path].
        speed: largest speed, positive [1/s].
        acceleration: largest acceleration, positive [1/s²].
        jerk: largest jerk, positive [1/s³]; infinite for a trapezoid. If it is None, the result is an S-curve whose
            acceleration rises for a third of the ramp.

    Raises:
        InvalidParameter: the limits are so low that the motion would last too long.
    """
    _check_limits(length, speed, acceleration, jerk)
    # Limits so high that times of the law would be lost in rounding are lowered.
    speed = min(speed, length / _SHORTEST_RAMP)
    acceleration = min(acceleration, speed / _SHORTEST_RAMP)
    if jerk is None:
        # A ramp of three equal parts reaches the speed v = (n - 1) a (a / j), with n = 3 parts, so j = (n - 1) a² / v.
        reached = min(speed, np.sqrt(acceleration * length / LONGEST_RAMP))
        jerk = (_RAMP_PARTS - 1) * acceleration**2 / reached
    elif np.isfinite(jerk):
        jerk = min(jerk, acceleration / _SHORTEST_RAMP)

    # The speed a² / j. The ramp to this speed reaches the acceleration for an instant only. Below it, the ramp has no
    # middle part, and its acceleration stays lower.
    speed_of_full_ramp = acceleration**2 / jerk
    # Speed v without a constant part. With a middle part, v (v / a + a / j) = L; without it, v (2 sqrt(v / j)) = L.
    speed_that_fits = (
        np.sqrt(speed_of_full_ramp**2 + 4 * acceleration * length) - speed_of_full_ramp
    ) / 2
    if speed_that_fits < speed_of_full_ramp:
        speed_that_fits = (length**2 * jerk / 4) ** (1 / 3)
    top_speed = min(speed, speed_that_fits)

    # Time in which the acceleration rises [s].
    rise = min(acceleration / jerk, np.sqrt(top_speed / jerk))
    # A trapezoid has no rise, and an infinite jerk, whose product with it would be no number.
    top_acceleration = acceleration if rise == 0 else jerk * rise
    # The acceleration rises, stays and falls; braking is the same with the other sign.
    ramp = [
        _Phase(duration=rise, acceleration=0.0, jerk=jerk),
        _Phase(
            duration=top_speed / top_acceleration - rise, acceleration=top_acceleration, jerk=0.0
        ),
        _Phase(duration=rise, acceleration=top_acceleration, jerk=-jerk),
    ]
    # T = L / v + T_r has two ramps of T_r, which leaves L / v - T_r between them.
    constant_time = length / top_speed - (rise + top_speed / top_acceleration)
    constant = _Phase(duration=constant_time, acceleration=0.0, jerk=0.0)
    braking = [_Phase(phase.duration, -phase.acceleration, -phase.jerk) for phase in ramp]
    return _law_of_phases([*ramp, constant, *braking], length)


def _check_limits(
    length: float,
    speed: float,
    acceleration: float,
    jerk: float | None,
) -> None:
    """Check that none of the limits alone makes a motion over a length last too long.

    Args:
        length: length of the path, positive [rad or m, or 1 for parts of a path].
        speed: largest speed [1/s].
        acceleration: largest acceleration [1/s²].
        jerk: largest jerk [1/s³], or None if it follows from the acceleration and needs no check.

    Raises:
        InvalidParameter: the motion would last longer than times may be.
    """
    # Times in which each limit alone would let the motion cover the length, but for factors near 1.
    time_by_jerk = 0.0 if jerk is None else np.cbrt(length / jerk)
    longest_time = max(length / speed, np.sqrt(length / acceleration), time_by_jerk)
    if not longest_time < LONGEST:
        expected = message(
            "blocks.shorter_than",
            "shorter than {longest:g} s; the limits of its speed, acceleration or jerk are too low",
            longest=LONGEST,
        )
        raise InvalidParameter(
            message("blocks.time_of_motion", "the time of the motion"),
            compound("{slowest:.2g} s", slowest=longest_time),
            expected,
        )


def cruise_in(duration: float, *, rounded: bool) -> TimeLaw:
    """Compute the time law of a path of length 1 for a duration, of which the ramp at each end takes a quarter.

    Args:
        duration: duration of the motion [s].
        rounded: whether the law is an S-curve; otherwise it is a trapezoid.
    """
    # In the duration 1 with ramps of r at each end, the length 1 is v (1 - r).
    speed = 1 / (1 - _RAMP_SHARE)
    # With the acceleration a, a trapezoid's ramp lasts v / a, and the ramp of an S-curve without a given jerk lasts
    # LONGEST_RAMP v / a. A ramp of the time r therefore needs a = v / r, or LONGEST_RAMP v / r.
    acceleration = speed / _RAMP_SHARE * (LONGEST_RAMP if rounded else 1.0)
    return cruise(1.0, speed, acceleration, None if rounded else np.inf).slower(duration)


def cruise_to(
    start: npt.ArrayLike,
    target: npt.ArrayLike,
    speeds: Vector,
    accelerations: Vector,
    jerks: Vector | None = None,
    *,
    start_time: float = 0.0,
) -> Trajectory:
    """Plan a straight motion of n axes that all start and arrive together, within limits.

    At any time, all axes have covered the same part of their distances. The largest speed, acceleration and jerk of
    this part each follow from the axis whose limit is lowest for its distance, which may be another axis for each.

    Args:
        start: positions at the start, shape (n,) [rad or m].
        target: positions at the end, shape (n,) [rad or m].
        speeds: largest speeds, shape (n,) [rad/s or m/s].
        accelerations: largest accelerations, shape (n,) [rad/s² or m/s²].
        jerks: largest jerks, shape (n,) [rad/s³ or m/s³]; infinite for a trapezoid. If they are None, those of
            :func:`cruise` are used.
        start_time: time at which the motion starts [s].

    Returns:
        the trajectory, shape (n, 1). It is a constant, at all times, if no axis has further to go than 1e-9.

    Raises:
        InvalidParameter: the limits are so low that the motion would last too long.
    """
    first = np.asarray(start, dtype=float)
    distances = np.asarray(target, dtype=float) - first
    is_moving = np.abs(distances) > _NO_DISTANCE
    if not is_moving.any():
        return hold(target)

    # One law gives the part of its distance that each axis has gone, from 0 to 1. A limit of an axis over its distance
    # is a limit of this part, and the lowest of all axes counts.
    lengths = np.abs(distances[is_moving])
    speed = float((speeds[is_moving] / lengths).min())
    acceleration = float((accelerations[is_moving] / lengths).min())
    jerk = None if jerks is None else float((jerks[is_moving] / lengths).min())
    law = cruise(1.0, speed, acceleration, jerk)

    pieces = []
    for coefficients in law.coefficients:
        polynomials = []
        for position, distance in zip(first, distances, strict=True):
            constant = position + distance * coefficients[0]
            polynomials.append([Polynomial([constant, *(distance * coefficients[1:])])])
        pieces.append(np.array(polynomials))
    return PiecewisePolynomial(pieces, start_time + law.breaks)


def _law_of_phases(phases: list[_Phase], length: float) -> TimeLaw:
    """Join phases to a time law from rest. Phases that are shorter than `SHORTEST` [s] are left out.

    Args:
        phases: the phases, in sequence. At least one of them is not shorter.
        length: distance at the end, to which the law is scaled: it removes the rounding of the phases.
    """
    breaks = [0.0]
    rows = list[list[float]]()
    distance = 0.0
    speed = 0.0
    for phase in phases:
        if phase.duration < SHORTEST:
            continue
        # Over a phase, s = s0 + v0 t + a t²/2 + j t³/6 and v = v0 + a t + j t²/2.
        row = [distance, speed, phase.acceleration / 2, phase.jerk / 6]
        rows.append(row)
        distance = float(polyval(phase.duration, row))
        speed += phase.acceleration * phase.duration + phase.jerk * phase.duration**2 / 2
        breaks.append(breaks[-1] + phase.duration)
    return TimeLaw(breaks=np.array(breaks), coefficients=np.array(rows) * length / distance)


if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"cruising": "cruise_to"})
