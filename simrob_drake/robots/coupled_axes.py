r"""Linear equations between the positions of axes, and which axes give way to fulfil them.

A gear, and a joint that mimics another one, is an equation of the positions :math:`q_i`:

.. math:: \sum_i r_i q_i = c

of ratios :math:`r_i` and a total :math:`c`. A user names values for some axes only. The equations are solved for those
that were named least, so that asking for one axis of a pair moves the other one, too.
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
    """Firmness with which a user asks an axis for a value. The axes that are asked least give way first."""

    PASSIVE = 0
    """No motor drives the axis, so that it goes where the others take it."""
    UNNAMED = 1
    """The axis is not named, and stays where it is unless a coupling moves it."""
    LEADING = 2
    """One value stands for all axes, and no other axis leads this one."""
    NAMED = 3
    """The user gives the value of this axis."""


def asked_by(
    values: float | Sequence[float] | Mapping[str, float] | None, count: int, index_of: Callable[[str], int]
) -> list[Asked]:
    """Firmness with which a user's values ask each axis: a number stands for all axes, a mapping names some.

    Args:
        values: a number, a list of one for each axis, a mapping by axis, or None where nothing is asked.
        count: of the axes.
        index_of: index of an axis by its name.
    """
    if isinstance(values, Mapping):
        named = {index_of(axis) for axis in values}
        return [Asked.NAMED if place in named else Asked.UNNAMED for place in range(count)]
    if values is None:
        return [Asked.UNNAMED] * count
    return [Asked.NAMED if isinstance(values, Sequence) else Asked.LEADING] * count


class Equation:
    """One equation between positions of axes.

    Attributes:
        label: the key of the coupling in a station, such as ``couplings.mesh``, or another name for messages.
        ratios: by axis, in the order in which the coupling names them: the first axis follows the others.
        total: sum of positions times ratios [rad or m], or None for the sum in the posture at the start.
    """

    def __init__(self, label: str, ratios: Mapping[str, float], total: float | None) -> None:
        self.label = label
        self.ratios = dict(ratios)
        self.total = total


@dataclass(frozen=True)
class Condition:
    """An equation between axes that all are asked for a value.

    Attributes:
        ratios: of the n axes, shape (n,).
        total: what the sum of positions times ratios must be [rad or m].
        labels: the couplings that it follows from.
    """

    ratios: Vector
    total: float
    labels: tuple[str, ...]


@dataclass(frozen=True)
class Dependence:
    """Positions ``matrix @ q + offset``, in which the axes that give way follow from the other ones.

    Attributes:
        matrix: shape (n, n); rows of axes that do not give way are those of the identity.
        offset: shape (n,) [rad or m].
        moved: indices of the axes that give way.
        undecided: by such an axis, the axes of the same equation that could give way as well.
        conditions: equations that remain between axes that are asked for a value.
    """

    matrix: Vector
    offset: Vector
    moved: tuple[int, ...]
    undecided: Mapping[int, tuple[int, ...]]
    conditions: tuple[Condition, ...]


@dataclass(frozen=True)
class CoupledAxes:
    """The equations between n axes.

    Attributes:
        names: of the axes, in order.
        equations: between them.
    """

    names: Sequence[str]
    equations: Sequence[Equation]

    def __bool__(self) -> bool:
        """Whether any axes are coupled."""
        return bool(self.equations)

    @cached_property
    def ratios(self) -> Vector:
        """Ratios of every equation, shape (k, n)."""
        index = {name: place for place, name in enumerate(self.names)}
        ratios = np.zeros((len(self.equations), len(self.names)))
        for row, equation in enumerate(self.equations):
            for name, ratio in equation.ratios.items():
                if name in index:
                    ratios[row, index[name]] = ratio
        return ratios

    def totals(self, start: Vector) -> Vector:
        """Totals of every equation, shape (k,), with those that are not given taken at a start (n,) [rad or m]."""
        at_start = self.ratios @ start
        given = [equation.total for equation in self.equations]
        return np.array([own if total is None else total for own, total in zip(at_start, given, strict=True)])

    @cached_property
    def _follows(self) -> npt.NDArray[np.bool_]:
        """Whether each axis is the first one that some coupling names, shape (n,)."""
        first = {next(iter(equation.ratios)) for equation in self.equations if equation.ratios}
        return np.array([name in first for name in self.names], dtype=bool)

    def solve(self, asked: Sequence[Asked], totals: Vector) -> Dependence:
        """Solve the equations for the axes that are asked least.

        Gauss-Jordan elimination with pivots in the order in which axes give way. This choice of pivots is the best one:
        no other set of axes that fulfils the equations is asked less.

        Args:
            asked: how firmly each of the n axes is asked for a value.
            totals: right-hand sides, shape (k,).
        """
        count = len(self.names)
        size = np.abs(self.ratios).max(axis=1, initial=0.0, keepdims=True)
        size[size == 0] = 1.0
        # Columns: ratios, total, and which equations the row was made of.
        rows = np.hstack([self.ratios / size, totals[:, np.newaxis] / size, np.eye(len(totals))])

        order = sorted(range(count), key=lambda axis: (asked[axis], not self._follows[axis], axis))
        pivots: dict[int, int] = {}
        for axis in order:
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

        matrix, offset = np.eye(count), np.zeros(count)
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

    def _condition(self, row: Vector) -> Condition:
        """Read a condition off a reduced row of ratios, total and the equations that it was made of."""
        count = len(self.names)
        made_of = np.flatnonzero(np.abs(row[count + 1 :]) > _ZERO).tolist()
        labels = tuple(self.equations[equation].label for equation in made_of)
        return Condition(row[:count], float(row[count]), labels)

    def find_violation(self, condition: Condition, positions: Vector, bounds: Vector) -> tuple[int, int, float] | None:
        """Find where positions (m, n) break a condition.

        Args:
            condition: between the axes.
            positions: of the axes, shape (m, n) [rad or m].
            bounds: deviations that are allowed, shape (n,) [rad or m].

        Returns:
            the sample with the largest deviation, the axis that would have to be elsewhere, and where [rad or m]; or
            None if all deviations are within the bounds.
        """
        axes = np.flatnonzero(np.abs(condition.ratios) > _ZERO)
        misses = positions @ condition.ratios - condition.total
        sample = int(np.argmax(np.abs(misses)))
        if not len(axes):
            return None
        follower = min(axes, key=lambda axis: (not self._follows[axis], axis))
        shift = -misses[sample] / condition.ratios[follower]
        if abs(shift) <= bounds[follower]:
            return None
        return sample, int(follower), float(positions[sample, follower] + shift)
