r"""Linear equations between the positions of axes, and which axes give way to fulfil them.

A gear, and a joint that mimics another one, is an equation of the positions :math:`q_i`:

.. math:: \sum_i r_i q_i = c

of ratios :math:`r_i` and a total :math:`c`. A user gives values for some axes only. The equations are solved for the
axes whose values count least (see :class:`Firmness`), so that a value for one axis of a pair moves the other axis, too.
An axis whose position follows from an equation is said to give way.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from simrob_drake.base.frames import Vector

_ZERO = 1e-9
"""Entries of the reduced equations that are smaller count as zero [1]. Ratios are scaled to 1 before."""


class Firmness(IntEnum):
    """Degree to which the position of an axis is given. The axes with the lowest firmness give way first."""

    PASSIVE = 0
    """No motor drives the axis, so that it goes where the coupled axes take it."""
    UNNAMED = 1
    """The user gives no value for this axis, which stays where it is unless a coupling moves it."""
    LEADING = 2
    """The user gives one value for all axes. Of coupled axes, the follower gives way, and its leader does not."""
    NAMED = 3
    """The user gives the value of this axis, in a mapping or a list, so that it never gives way."""


def firmness_of_values(
    values: float | Sequence[float] | Mapping[str, float] | None,
    count: int,
    index_of: Callable[[str], int],
) -> list[Firmness]:
    """Find how firmly the values that a user writes under one key give the position of each axis.

    Args:
        values: one number for all axes, a list with a number for each axis, a mapping by axis, or None if the user
            gives no values.
        count: number of axes.
        index_of: returns the index of an axis by its name.

    Returns:
        the firmness of each axis, in the order of the axes.
    """
    # Only a mapping distinguishes axes. A list names every axis, and None names none.
    if isinstance(values, Mapping):
        named = {index_of(axis) for axis in values}
        return [Firmness.NAMED if index in named else Firmness.UNNAMED for index in range(count)]
    if values is None:
        return [Firmness.UNNAMED] * count
    if isinstance(values, Sequence):
        return [Firmness.NAMED] * count
    return [Firmness.LEADING] * count


class Equation:
    """One equation between positions of axes.

    Attributes:
        label: the key of the coupling in a station, such as ``couplings.mesh``, or another name for messages.
        ratios: ratio of each axis by its name, in the order of the coupling: the first axis follows the others.
        total: sum of positions times ratios [rad or m]. If it is None, the sum stays that of the posture at the start.
    """

    def __init__(self, label: str, ratios: Mapping[str, float], total: float | None) -> None:
        self.label = label
        self.ratios = dict(ratios)
        self.total = total


@dataclass(frozen=True)
class AxisCondition:
    """An equation that is left after the others are solved: its axes all have the firmness NAMED and do not give way.

    It has no axes at all, with ratios of 0, if an equation repeats or contradicts other ones.

    Attributes:
        ratios: ratios of the n axes, shape (n,).
        total: required sum of positions times ratios [rad or m].
        labels: labels of the couplings from which this condition follows.
    """

    ratios: Vector
    total: float
    labels: tuple[str, ...]


class ConditionViolation(NamedTuple):
    """A position that breaks a condition.

    Attributes:
        sample: index of the sample at which the deviation is largest.
        axis: index of the axis that has the wrong position there.
        position: the position of this axis that would fulfil the condition [rad or m].
    """

    sample: int
    axis: int
    position: float


@dataclass(frozen=True)
class Dependence:
    """The solution of the equations: how the axes that give way depend on the other axes.

    If q are the given positions (n,), then ``matrix @ q + offset`` are positions that fulfil the equations, apart from
    the conditions.

    Attributes:
        matrix: shape (n, n); the rows of axes that do not give way are rows of the identity.
        offset: shape (n,) [rad or m].
        moved: indices of the axes that give way.
        undecided: for each UNNAMED axis that gives way, by index, the indices of the other UNNAMED axes of the same
            equation, which could give way in its place.
        conditions: the equations that are left for axes that never give way.
    """

    matrix: Vector
    offset: Vector
    moved: tuple[int, ...]
    undecided: Mapping[int, tuple[int, ...]]
    conditions: tuple[AxisCondition, ...]


@dataclass(frozen=True)
class CoupledAxes:
    """The equations between n axes.

    Attributes:
        names: names of the axes, in order.
        equations: equations between these axes.
    """

    names: Sequence[str]
    equations: Sequence[Equation]

    def __bool__(self) -> bool:
        """Whether any axes are coupled."""
        return bool(self.equations)

    @cached_property
    def ratios(self) -> Vector:
        """Matrix with the ratios of the k equations, shape (k, n).

        Names that are no axes are left out: the equations are solved while a station is read, and the station reports
        misspelt names later, with the key of the coupling.
        """
        index = {name: column for column, name in enumerate(self.names)}
        ratios = np.zeros((len(self.equations), len(self.names)))
        for row, equation in enumerate(self.equations):
            for name, ratio in equation.ratios.items():
                if name in index:
                    ratios[row, index[name]] = ratio
        return ratios

    def totals(self, start: Vector) -> Vector:
        """Compute the total of each of the k equations.

        Args:
            start: positions at the start, shape (n,) [rad or m]. They give the totals of equations without a total.

        Returns:
            totals, shape (k,) [rad or m].
        """
        totals = self.ratios @ start
        for index, equation in enumerate(self.equations):
            if equation.total is not None:
                totals[index] = equation.total
        return np.asarray(totals)

    @cached_property
    def _is_follower(self) -> npt.NDArray[np.bool_]:
        """Whether each axis is a follower, which is the first axis in the ratios of some equation, shape (n,)."""
        # A dict keeps the order in which the user, or the URDF, has written the axes.
        first = {next(iter(equation.ratios)) for equation in self.equations if equation.ratios}
        return np.array([name in first for name in self.names], dtype=bool)

    def solve(self, firmness: Sequence[Firmness], totals: Vector) -> Dependence:
        """Solve the equations for the axes whose positions are given with the lowest firmness.

        Args:
            firmness: firmness of each of the n axes.
            totals: totals of the k equations, shape (k,) [rad or m].

        Returns:
            how these axes depend on the others, and the conditions: equations in which no axis can give way.
        """
        count = len(self.names)
        rows = self._scaled_rows(totals)
        row_of = self._eliminate(rows, firmness)

        # A reduced row says: q_axis + sum of ratio_i q_i = total. Solve it for its axis.
        matrix = np.eye(count)
        offset = np.zeros(count)
        undecided = {}
        for axis, row in row_of.items():
            matrix[axis] = -rows[row, :count]
            matrix[axis, axis] = 0.0
            offset[axis] = rows[row, count]
            # Another UNNAMED axis of the row could give way as well: the caller may have to ask which one.
            if firmness[axis] == Firmness.UNNAMED:
                others = np.flatnonzero(np.abs(matrix[axis]) > _ZERO).tolist()
                undecided[axis] = tuple(
                    other for other in others if firmness[other] == Firmness.UNNAMED
                )
        # Rows without a pivot have only axes that never give way: the user's values must fulfil them. A row may also
        # have no axes at all, since elimination has removed them.
        unused = [row for row in range(len(rows)) if row not in row_of.values()]
        conditions = tuple(self._condition(rows[row]) for row in unused)
        return Dependence(matrix, offset, tuple(row_of), undecided, conditions)

    def _scaled_rows(self, totals: Vector) -> Vector:
        """Write the k equations as the rows of a matrix, shape (k, n + 1 + k).

        The columns are the n ratios, the total, and k factors with which the scaled equations make up the row. Ratios
        and total of an equation are divided by its largest absolute ratio, so that the same bound separates zero from
        rounding in all rows. An equation without axes stays as it is.
        """
        scale = np.abs(self.ratios).max(axis=1, initial=0.0, keepdims=True)
        scale[scale == 0] = 1.0
        # The factors begin as an identity, and change with the rows: they show later which equations a row comes from.
        return np.hstack([self.ratios / scale, totals[:, np.newaxis] / scale, np.eye(len(totals))])

    def _eliminate(self, rows: Vector, firmness: Sequence[Firmness]) -> dict[int, int]:
        """Change rows, in place, so that each axis that gives way is left in one row only, with the ratio 1.

        The method is Gauss-Jordan elimination, with pivots in the order in which axes give way. This choice of axes
        to solve for has the lowest firmness: if the values of this choice and of any other one are sorted, each value
        of this choice is at most the corresponding one of the other.

        Args:
            rows: the equations as in :meth:`_scaled_rows`; changed.
            firmness: firmness of each of the n axes.

        Returns:
            index of the row of each axis that gives way, by the index of the axis.
        """
        # Of axes with the same firmness, followers give way first, and then the axis with the lowest index.
        order = sorted(
            range(len(self.names)),
            key=lambda axis: (firmness[axis], not self._is_follower[axis], axis),
        )
        row_of: dict[int, int] = {}
        for axis in order:
            # Named axes come last in this order, and never give way.
            if firmness[axis] == Firmness.NAMED:
                break
            unused = [row for row in range(len(rows)) if row not in row_of.values()]
            if not unused:
                break
            # The row in which the axis has the largest entry gives the smallest rounding errors.
            pivot_row = max(unused, key=lambda row: abs(rows[row, axis]))
            if abs(rows[pivot_row, axis]) < _ZERO:
                continue  # no row that is left contains the axis
            # Solve the pivot row for the axis, and remove the axis from all other rows, also from those used before:
            # each row then gives its axis without back substitution.
            rows[pivot_row] /= rows[pivot_row, axis]
            for other in range(len(rows)):
                if other != pivot_row:
                    rows[other] -= rows[other, axis] * rows[pivot_row]
            row_of[axis] = pivot_row
        return row_of

    def _condition(self, row: Vector) -> AxisCondition:
        """Make a condition from a reduced row: n ratios, the total, and the factors of the original equations."""
        # A factor that is not zero belongs to an equation that contributes to the row.
        count = len(self.names)
        sources = np.flatnonzero(np.abs(row[count + 1 :]) > _ZERO).tolist()
        labels = tuple(self.equations[equation].label for equation in sources)
        return AxisCondition(row[:count], float(row[count]), labels)

    def find_violation(
        self, condition: AxisCondition, positions: Vector, bounds: Vector
    ) -> ConditionViolation | None:
        """Find the sample at which positions break a condition most.

        Args:
            condition: a condition between the axes.
            positions: positions of the axes at m samples, shape (m, n) [rad or m].
            bounds: distances by which each axis may miss its position, shape (n,) [rad or m].

        Returns:
            the violation: an axis that would have to move, alone, by more than its bound. None if it would have to move
            by no more than that, or if the condition has no axes.
        """
        axes = np.flatnonzero(np.abs(condition.ratios) > _ZERO)
        # A condition without axes, 0 = total, does not depend on positions.
        if not len(axes):
            return None
        deviations = positions @ condition.ratios - condition.total
        sample = int(np.argmax(np.abs(deviations)))
        # The position of the follower counts as the wrong one. If no axis follows another, that of the first axis does.
        wrong_axis = int(min(axes, key=lambda axis: (not self._is_follower[axis], axis)))
        # Σ r q - c = deviation, so that this axis alone would have to move by -deviation / r.
        shift = -deviations[sample] / condition.ratios[wrong_axis]
        if abs(shift) <= bounds[wrong_axis]:
            return None
        return ConditionViolation(sample, wrong_axis, float(positions[sample, wrong_axis] + shift))
