"""Limits of axes: one tolerance, one comparison and one wording for all positions that are checked against them.

Published limits are rounded (pi - 1e-5 rad stands for half a turn), and so are positions that are read back from a
run. A position up to the tolerance beyond a limit therefore counts as at the limit: it is clamped, and a warning says
so once.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simrob_drake.base.frames import Flags, Vector
from simrob_drake.base.messages import compound, message

ANGLE_TOLERANCE = 1e-4
"""Distance beyond a limit that counts as rounding [rad]; 0.1 mm at the end of an arm of one metre."""
LENGTH_TOLERANCE = 1e-5
"""Distance beyond a limit that counts as rounding [m]."""

_NEGLIGIBLE = 1e-9
"""Distance beyond a limit up to which arithmetic rounding is the cause, and no warning is needed [rad or m]."""
_FEWEST_DIGITS = 5
"""Smallest count of significant digits of positions in messages."""
_MOST_DIGITS = 17
"""Largest count of significant digits. Any two different doubles differ in 17 digits."""


class ClampedPosition(UserWarning):
    """Warning that a position was beyond a limit of an axis by less than the tolerance, and was moved to the limit."""


class Violation(NamedTuple):
    """A position beyond a limit of its axis, in words.

    Attributes:
        row: index of the posture.
        axis: index of the axis.
        value: the position, without its unit.
        limits: the range of the axis, such as "0 to 0.04 m".
        limit: the limit that the position exceeds, without its unit.
        excess: distance of the position beyond the limit, without its unit.
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
        names: names of the axes, as messages call them.
        lower: lower limits, shape (n,) [rad or m]; -inf for an axis without a lower limit.
        upper: upper limits, shape (n,) [rad or m]; inf for an axis without an upper limit.
        revolute: True for revolute axes, False for prismatic axes, shape (n,).
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
        """Select the limits of the axes with the given indices, in the given order."""
        chosen = list(axes)
        return AxisLimits(
            names=tuple(self.names[axis] for axis in chosen),
            lower=self.lower[chosen],
            upper=self.upper[chosen],
            revolute=self.revolute[chosen],
        )

    def excess(self, positions: Vector) -> Vector:
        """Compute how far positions (..., n) [rad or m] are beyond the limits of their axes.

        Returns:
            distances beyond the limits, shape (..., n) [rad or m]; 0 for a position that is within the limits or
            beyond a limit by no more than the tolerance. It is 0 for NaN, too.
        """
        # At most one of the two differences is positive. A comparison with NaN is false, hence the 0 for NaN.
        beyond = np.maximum(positions - self.upper, self.lower - positions)
        return np.where(beyond > self.tolerances, beyond, 0.0)

    def are_within(self, positions: Vector) -> bool:
        """Whether all positions (..., n) are finite and within the limits, up to the tolerance."""
        # NaN has no excess, so that it is looked for by itself.
        return bool(np.isfinite(positions).all() and not self.excess(positions).any())

    def find_violation(self, postures: Vector) -> Violation | None:
        """Find the first position beyond a limit of its axis, for an error message.

        Args:
            postures: positions of the n axes, shape (k, n) [rad or m]; the first posture is searched first.

        Returns:
            the position and the limit in words, in degrees or metres, or None if no position is beyond a limit by more
            than the tolerance. NaN is not beyond a limit.
        """
        outside = self.excess(postures) > 0.0
        if not outside.any():
            return None
        row, axis = np.argwhere(outside)[0].tolist()
        # Messages have the units in which users write positions.
        value = postures[row, axis]
        lower = self.lower[axis]
        upper = self.upper[axis]
        unit = "m"
        if self.revolute[axis]:
            value = np.rad2deg(value)
            lower = np.rad2deg(lower)
            upper = np.rad2deg(upper)
            unit = "deg"

        # The position and the limit that it passes get so many digits that they differ: a message such as "180 deg is
        # not within -180 to 180 deg" helps nobody. Five digits are enough for the other limit.
        is_below = value < lower
        limit = lower if is_below else upper
        value_text, limit_text = distinct_texts(float(value), float(limit))
        lower_text = limit_text if is_below else f"{lower:.5g}"
        upper_text = f"{upper:.5g}" if is_below else limit_text
        return Violation(
            row=row,
            axis=axis,
            value=value_text,
            limits=message(
                "robots.range_of",
                "{lower} to {upper} {unit}",
                lower=lower_text,
                upper=upper_text,
                unit=unit,
            ),
            limit=limit_text,
            excess=f"{abs(value - limit):.3g}",
            unit=unit,
        )

    def clamp(self, positions: Vector, what: str) -> Vector:
        """Copy positions, with those that are beyond a limit by rounding moved to that limit.

        Each axis with a position that is moved by more than arithmetic rounding gets a warning of class
        ``ClampedPosition``.

        Args:
            positions: positions of the n axes, shape (..., n) [rad or m]. The caller has checked that no position is
                beyond a limit by more than the tolerance.
            what: name of the positions for the warning, such as "the start".

        Returns:
            the positions within the limits, shape (..., n) [rad or m].
        """
        clamped = np.clip(positions, self.lower, self.upper)
        is_moved = np.abs(clamped - positions) > _NEGLIGIBLE
        by_posture = is_moved.reshape(-1, len(self.names))
        moved_axes = np.flatnonzero(by_posture.any(axis=0))
        for axis in moved_axes.tolist():
            # The warning states the tolerance and not the distance: its text is then the same for all samples of a run.
            tolerance = (
                compound("{angle_tolerance:g} rad", angle_tolerance=ANGLE_TOLERANCE)
                if self.revolute[axis]
                else compound("{length_tolerance:g} m", length_tolerance=LENGTH_TOLERANCE)
            )
            text = message(
                "robots.taken_to_limit",
                "{what}: {axis} is beyond its limit by less than {tolerance}, and is moved to the limit",
                what=what,
                axis=self.names[axis],
                tolerance=tolerance,
            )
            # No bookkeeping of earlier warnings is needed: Python shows the same text from the same line only once.
            warnings.warn(text, ClampedPosition, stacklevel=2)
        return np.asarray(clamped)


def distinct_texts(value: float, limit: float) -> tuple[str, str]:
    """Format a position and a limit with the fewest digits with which the two texts differ, but at least five.

    Args:
        value: the position.
        limit: the limit, in the same unit.

    Returns:
        the text of the position and the text of the limit. Equal numbers have equal texts.
    """
    for digits in range(_FEWEST_DIGITS, _MOST_DIGITS):
        value_text = f"{value:.{digits}g}"
        limit_text = f"{limit:.{digits}g}"
        if value_text != limit_text:
            return value_text, limit_text
    return f"{value:.{_MOST_DIGITS}g}", f"{limit:.{_MOST_DIGITS}g}"


def middles(limits: AxisLimits, units: Vector) -> Vector:
    """Compute default positions of axes: zero, or the middle of a range that excludes zero.

    Args:
        limits: limits of the n axes.
        units: size of one of the user's units in SI for each axis, shape (n,): pi/180 for degrees, 1 for metres.

    Returns:
        positions in the user's units, shape (n,), rounded to six significant digits so that a station file can hold
        them.
    """
    # A range that misses zero by rounding, such as 1e-6 to 1, does not exclude it.
    excludes_zero = limits.excess(np.zeros(len(units))) > 0.0
    lower = limits.lower / units
    upper = limits.upper / units
    positions = np.zeros(len(units))
    # An axis without limits does not exclude zero, so that no middle between -inf and inf is computed.
    for axis in np.flatnonzero(excludes_zero):
        middle = (lower[axis] + upper[axis]) / 2
        positions[axis] = float(f"{middle:.6g}")
    return positions
