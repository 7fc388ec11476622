r"""Linear equations between the positions of axes, and which axes give way to fulfil them.

A gear, and a joint that mimics another one, is an equation of the positions :math:`q_i`:

.. math:: \sum_i r_i q_i = c

of ratios :math:`r_i` and a total :math:`c`. A user gives values for some axes only. The equations are solved for the
axes whose values count least (see :class:`Asked`), so that a value for one axis of a pair moves the other axis, too.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
import numpy.typing as npt

from simrob_drake.frames import Vector

# Entries of the reduced equations that are smaller count as zero. Ratios are scaled to 1 before.
_ZERO = 1e-9


class Asked(IntEnum):
    """Firmness with which a user asks an axis for a value. The axes with the lowest firmness give way first."""

    PASSIVE = 0
    """No motor drives the axis, so that it goes where the coupled axes take it."""
    UNNAMED = 1
    """The axis is not named, and stays where it is unless a coupling moves it."""
    LEADING = 2
    """One value stands for all axes, and no other axis leads this one."""
    NAMED = 3
    """The user gives the value of this axis."""


def asked_by(
    values: float | Sequence[float] | Mapping[str, float] | None, count: int, index_of: Callable[[str], int]
) -> list[Asked]:
    """Return for each axis the firmness with which a user's values ask this axis for a position.

    Args:
        values: one number for all axes, a list with a number for each axis, a mapping by axis, or None if the user
            gives no values.
        count: number of axes.
        index_of: returns the index of an axis by its name.
    """
    if isinstance(values, Mapping):
        named = {index_of(axis) for axis in values}
        return [Asked.NAMED if index in named else Asked.UNNAMED for index in range(count)]
    if values is None:
        return [Asked.UNNAMED] * count
    return [Asked.NAMED if isinstance(values, Sequence) else Asked.LEADING] * count


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
    """An equation between axes all of which have a value from the user: the values fulfil it, or there is an error.

    Attributes:
        ratios: ratios of the n axes, shape (n,).
        total: required sum of positions times ratios [rad or m].
        labels: labels of the couplings from which this condition follows.
    """

    ratios: Vector
    total: float
    labels: tuple[str, ...]


@dataclass(frozen=True)
class Dependence:
    """Positions ``matrix @ q + offset``, in which the axes that give way follow from the other axes.

    Attributes:
        matrix: shape (n, n); the rows of axes that do not give way are rows of the identity.
        offset: shape (n,) [rad or m].
        moved: indices of the axes that give way.
        undecided: for each unnamed axis that gives way, the other unnamed axes of the same equation, which could give
            way as well.
        conditions: the equations that remain between axes with a value from the user.
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
        """Matrix with the ratios of the k equations, shape (k, n); names that are no axes are left out."""
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
        at_start = self.ratios @ start
        totals = [equation.total for equation in self.equations]
        return np.array([initial if total is None else total for initial, total in zip(at_start, totals, strict=True)])

    @cached_property
    def _follows(self) -> npt.NDArray[np.bool_]:
        """Whether each axis is a follower, the first axis in the ratios of an equation, shape (n,)."""
        first = {next(iter(equation.ratios)) for equation in self.equations if equation.ratios}
        return np.array([name in first for name in self.names], dtype=bool)

    def solve(self, asked: Sequence[Asked], totals: Vector) -> Dependence:
        """Solve the equations for the axes that are asked with the lowest firmness.

        The method is Gauss-Jordan elimination, with pivots in the order in which axes give way. This choice of pivots
        is the best one: no other set of axes that fulfils the equations has lower firmness.

        Args:
            asked: firmness with which each of the n axes is asked for a value.
            totals: totals of the k equations, shape (k,) [rad or m].
        """
        count = len(self.names)
        # Scale the largest ratio of each equation to 1, so that one bound tells zero from rounding. An equation
        # without axes stays as it is.
        size = np.abs(self.ratios).max(axis=1, initial=0.0, keepdims=True)
        size[size == 0] = 1.0
        # Columns: n ratios, the total, and k factors with which the original equations make up the row.
        rows = np.hstack([self.ratios / size, totals[:, np.newaxis] / size, np.eye(len(totals))])

        order = sorted(range(count), key=lambda axis: (asked[axis], not self._follows[axis], axis))
        pivots: dict[int, int] = {}  # row that is solved for an axis, by the axis
        for axis in order:
            # Named axes come last in this order, and never give way.
            if asked[axis] == Asked.NAMED:
                break
            free = [row for row in range(len(rows)) if row not in pivots.values()]
            row = max(free, key=lambda one: abs(rows[one, axis]), default=None)
            if row is None or abs(rows[row, axis]) < _ZERO:
                continue
            rows[row] /= rows[row, axis]
            for other in range(len(rows)):
                if other != row:
                    rows[other] -= rows[other, axis] * rows[row]
            pivots[axis] = row

        # Solve each pivot's row for its axis.
        matrix = np.eye(count)
        offset = np.zeros(count)
        undecided = {}
        for axis, row in pivots.items():
            matrix[axis] = -rows[row, :count]
            matrix[axis, axis] = 0.0
            offset[axis] = rows[row, count]
            others = np.flatnonzero(np.abs(matrix[axis]) > _ZERO).tolist()
            if asked[axis] == Asked.UNNAMED:
                undecided[axis] = tuple(other for other in others if asked[other] == Asked.UNNAMED)
        left = [row for row in range(len(rows)) if row not in pivots.values()]
        conditions = tuple(self._condition(rows[row]) for row in left)
        return Dependence(matrix, offset, tuple(pivots), undecided, conditions)

    def _condition(self, row: Vector) -> AxisCondition:
        """Make a condition from a reduced row: n ratios, the total, and the factors of the original equations."""
        count = len(self.names)
        made_of = np.flatnonzero(np.abs(row[count + 1 :]) > _ZERO).tolist()
        labels = tuple(self.equations[equation].label for equation in made_of)
        return AxisCondition(row[:count], float(row[count]), labels)

    def find_violation(
        self, condition: AxisCondition, positions: Vector, bounds: Vector
    ) -> tuple[int, int, float] | None:
        """Find the sample at which positions break a condition most.

        Args:
            condition: a condition between the axes.
            positions: positions of the axes at m samples, shape (m, n) [rad or m].
            bounds: deviations of each axis that are allowed, shape (n,) [rad or m].

        Returns:
            index of the sample with the largest deviation, index of the axis that has the wrong position there, and
            the position that fulfils the condition [rad or m]. Returns None if the deviation is within the bound.
        """
        axes = np.flatnonzero(np.abs(condition.ratios) > _ZERO)
        misses = positions @ condition.ratios - condition.total
        sample = int(np.argmax(np.abs(misses)))
        # A condition without axes says nothing about positions.
        if not len(axes):
            return None
        # The follower's position counts as the wrong one; if no axis of the condition follows, the first axis' does.
        follower = min(axes, key=lambda axis: (not self._follows[axis], axis))
        shift = -misses[sample] / condition.ratios[follower]
        if abs(shift) <= bounds[follower]:
            return None
        return sample, int(follower), float(positions[sample, follower] + shift)
