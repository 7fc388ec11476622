"""Limits of axes: one tolerance, one comparison and one wording for all positions that are checked against them.

Published limits are rounded (pi - 1e-5 rad stands for half a turn), and so are positions that are read back from a
run. A position up to the tolerance beyond a limit therefore counts as at the limit: it is clamped, and a warning says
so once.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.frames import Vector

Flags = np.ndarray[Any, np.dtype[np.bool_]]

ANGLE_TOLERANCE = 1e-4
"""Distance beyond a limit that counts as rounding [rad]; 0.1 mm at the end of an arm of one metre."""
LENGTH_TOLERANCE = 1e-5
"""Distance beyond a limit that counts as rounding [m]."""

_UNSAID = 1e-9  # rad or m: smaller distances beyond a limit are rounding of arithmetic, and no user needs to know
_FEWEST_DIGITS, _MOST_DIGITS = 5, 17  # significant digits of positions in messages; 17 tell any two doubles apart


class ClampedPosition(UserWarning):
    """A position lay beyond a limit of an axis by less than the tolerance, and was moved to the limit."""


class Violation(NamedTuple):
    """A position beyond a limit of its axis, in words.

    Attributes:
        row: index of the posture.
        axis: index of the axis.
        value: the position, without its unit.
        limits: the range of the axis, such as "0 to 0.04 m".
        limit: the limit that is passed, without its unit.
        excess: distance beyond it, without its unit.
        unit: ``deg`` or ``m``.
    """

    row: int
    axis: int
    value: str
    limits: str
    limit: str
    excess: str
    unit: str


@dataclass(frozen=True, eq=False)
class AxisLimits:
    """The ranges of n axes.

    Attributes:
        names: of the axes, as messages call them.
        lower: lower limits, shape (n,) [rad or m]; infinite where there is none.
        upper: upper limits, shape (n,) [rad or m].
        revolute: whether each axis is revolute, not prismatic, shape (n,).
    """

    names: tuple[str, ...]
    lower: Vector
    upper: Vector
    revolute: Flags

    @property
    def tolerances(self) -> Vector:
        """Distance beyond a limit that counts as rounding, shape (n,) [rad or m]."""
        return np.where(self.revolute, ANGLE_TOLERANCE, LENGTH_TOLERANCE)

    def of_axes(self, axes: Sequence[int]) -> "AxisLimits":
        """The ranges of some of the axes, by index, in the given order."""
        chosen = list(axes)
        return AxisLimits(
            names=tuple(self.names[axis] for axis in chosen),
            lower=self.lower[chosen],
            upper=self.upper[chosen],
            revolute=self.revolute[chosen],
        )

    def excess(self, positions: Vector) -> Vector:
        """Distance of positions (..., n) beyond their limits [rad or m]; 0 within the tolerance."""
        beyond = np.maximum(positions - self.upper, self.lower - positions)
        return np.where(beyond > self.tolerances, beyond, 0.0)

    def are_within(self, positions: Vector) -> bool:
        """Whether all positions (..., n) are finite and within the limits, up to the tolerance."""
        return bool(np.isfinite(positions).all() and not self.excess(positions).any())

    def find_violation(self, postures: Vector) -> Violation | None:
        """Find the first position of postures (k, n) beyond a limit. Returns None if there is none."""
        outside = self.excess(postures) > 0.0
        if not outside.any():
            return None
        row, axis = (int(index) for index in np.argwhere(outside)[0])
        value, lower, upper = postures[row, axis], self.lower[axis], self.upper[axis]
        if self.revolute[axis]:
            value, lower, upper = np.rad2deg([value, lower, upper])
        limit = lower if value < lower else upper
        value_text, limit_text = distinct_texts(float(value), float(limit))
        other_text = f"{upper if value < lower else lower:.5g}"
        lower_text, upper_text = (limit_text, other_text) if value < lower else (other_text, limit_text)
        unit = "deg" if self.revolute[axis] else "m"
        return Violation(
            row=row,
            axis=axis,
            value=value_text,
            limits=f"{lower_text} to {upper_text} {unit}",
            limit=limit_text,
            excess=f"{abs(value - limit):.3g}",
            unit=unit,
        )

    def clamp(self, positions: Vector, what: str) -> Vector:
        """Move positions (..., n) that the tolerance allows beyond a limit to that limit; a warning names them once.

        Args:
            positions: none further beyond a limit than the tolerance [rad or m].
            what: what the positions are, for the warning, such as "the start".
        """
        clamped = np.clip(positions, self.lower, self.upper)
        moved = np.abs(clamped - positions) > _UNSAID
        for axis in np.flatnonzero(moved.reshape(-1, len(self.names)).any(axis=0)).tolist():
            tolerance = f"{ANGLE_TOLERANCE:g} rad" if self.revolute[axis] else f"{LENGTH_TOLERANCE:g} m"
            text = f"{what}: {self.names[axis]} is beyond its limit by less than {tolerance}, and is taken to the limit"
            # Python shows the same text from the same line once.
            warnings.warn(text, ClampedPosition, stacklevel=2)
        return np.asarray(clamped)


def distinct_texts(value: float, limit: float) -> tuple[str, str]:
    """Write a position and a limit with as many digits as tell the two apart, five at least."""
    for digits in range(_FEWEST_DIGITS, _MOST_DIGITS):
        texts = f"{value:.{digits}g}", f"{limit:.{digits}g}"
        if texts[0] != texts[1]:
            return texts
    return f"{value:.{_MOST_DIGITS}g}", f"{limit:.{_MOST_DIGITS}g}"


def middles(limits: AxisLimits, units: Vector) -> Vector:
    """Middles of the ranges that exclude zero, with six digits, and 0 of other axes.

    Args:
        limits: of the n axes.
        units: SI size of one unit of a user's numbers, by axis, shape (n,).

    Returns:
        positions in the user's units, shape (n,).
    """
    is_excluded = limits.excess(np.zeros(len(units))) > 0.0
    centres = [
        (low + high) / 2 if excluded else 0.0
        for low, high, excluded in zip(limits.lower / units, limits.upper / units, is_excluded, strict=True)
    ]
    return np.array([float(f"{centre:.6g}") for centre in centres])
