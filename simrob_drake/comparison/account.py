r"""What one engine tells of a run, and how sure it is.

Each engine runs twice: as it would, and r = 4 times finer. The error of the finer run is estimated as Roache's grid
convergence index does it for two runs and a method of first order, with his factor of safety 3:

.. math:: e = 3 \, \frac{\max_t |y_{fine} - y_{coarse}|}{r - 1} = \max_t |y_{fine} - y_{coarse}|.

It is one figure for a quantity and a run: of its largest component at its worst time. (P. J. Roache, Perspective: a
method for uniform reporting of grid refinement studies, J. Fluids Eng. 116 (1994).)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.results.result import SimulationResult

FINER = 4
"""How many times finer the second run is."""
_QUATERNION = 4
_NEXT_TO_NOTHING = 1e-3  # SI units; rounding does not end with what is zero
_IMPOSED = ("reference", "applied")  # what went in


@dataclass(frozen=True)
class Quantity:
    """Columns of a result that are told together: their name and their unit."""

    name: str
    unit: str


Values = Mapping[Quantity, Vector]
"""Quantities at times (m,), shape (m, k) each."""


@dataclass(frozen=True)
class Account:
    """What an engine tells of a run.

    Attributes:
        name: of the engine.
        times: of the samples, shape (m,) [s].
        values: of the finer run.
        errors: how far off they may be, by quantity.
        ended: how the finer run ended, in words.
    """

    name: str
    times: Vector
    values: Values
    errors: Mapping[Quantity, float] = field(default_factory=dict)
    ended: str = ""

    @classmethod
    def of(cls, name: str, fine: SimulationResult, coarse: SimulationResult) -> Account:
        """Return the account of two runs."""
        exact, rough = quantities(fine), quantities(coarse)
        common = together(fine.times, coarse.times)
        errors = {what: float(apart(exact[what][:common], rough[what][:common]).max()) for what in exact}
        return cls(name, fine.times, exact, errors, fine.message)


@dataclass(frozen=True)
class Difference:
    """How far two accounts are apart in a quantity.

    Attributes:
        quantity: which.
        account: whose, against the first account.
        largest: difference of any component at any time.
        at: when it is largest [s].
        error: the sum of both errors.
    """

    quantity: Quantity
    account: str
    largest: float
    at: float
    error: float

    @property
    def within(self) -> bool:
        """Whether the errors explain the difference."""
        return self.largest <= self.error


def quantities(result: SimulationResult) -> dict[Quantity, Vector]:
    """Return what a run tells: columns of one name before the last dot and one unit.

    What it was given is left out, and poses that never change, as of bases that are held.
    """
    columns: dict[Quantity, list[Vector]] = {}
    for signal in result.signals:
        held = signal.role == "pose" and not any(np.ptp(result[name]) for name in signal.names)
        for name, unit in zip(signal.names, signal.units, strict=True):
            if signal.role not in _IMPOSED and not held:
                columns.setdefault(Quantity(_stem(name), unit), []).append(result[name])
    return {what: np.column_stack(own) for what, own in columns.items()}


def differences(first: Account, others: list[Account], rounding: float = 1e-9) -> list[Difference]:
    """Return how far others are from the first account, in all that both tell, to the shorter one's end.

    Figures that differ by less than ``rounding`` of the quantity's size are equal; what is zero in both is left out.
    """
    found = []
    for other in others:
        common = together(first.times, other.times)
        for what in [what for what in first.values if what in other.values]:
            ours, theirs = first.values[what][:common], other.values[what][:common]
            if not (ours.any() or theirs.any()):
                continue
            distances = apart(ours, theirs)
            least = rounding * max(float(np.abs(ours).max()), _NEXT_TO_NOTHING)
            error = first.errors.get(what, 0.0) + other.errors.get(what, 0.0) + least
            worst = int(np.argmax(distances))
            found.append(Difference(what, other.name, float(distances[worst]), float(first.times[worst]), error))
    return found


def together(first: Vector, other: Vector) -> int:
    """Return how many samples two runs have at the same times: one that a monitor ended has its last one elsewhere."""
    common = min(len(first), len(other))
    return int(np.isclose(first[:common], other[:common], rtol=0, atol=1e-9).sum())


def apart(first: Vector, other: Vector) -> Vector:
    """Return by how much the rows of two arrays (m, k) differ at most, shape (m,).

    Four columns of unit length are quaternions, which mean the same with the other sign.
    """
    distances = np.abs(first - other).max(axis=1)
    if first.shape[1] == _QUATERNION and np.allclose(np.linalg.norm(first, axis=1), 1.0):
        distances = np.minimum(distances, np.abs(first + other).max(axis=1))
    return np.asarray(distances)


def _stem(column: str) -> str:
    """Return a column's name without its last part: ``q.joint_1`` is a ``q``, ``distance.gap`` itself."""
    kind = column.rpartition(".")[0]
    return column if kind in ("", "distance") else kind
