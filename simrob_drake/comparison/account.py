r"""What one engine tells of a run, and how sure it is.

Each engine runs twice: as it would, and r = 4 times finer. The error of the finer run is estimated as Roache's grid
convergence index does it for two runs and a method of first order, with his factor of safety 3:

.. math:: e = 3 \, \frac{\max_t |y_{fine} - y_{coarse}|}{r - 1} = \max_t |y_{fine} - y_{coarse}|.

It is one figure for a quantity and a run: of its largest component at its worst time. (P. J. Roache, Perspective: a
method for uniform reporting of grid refinement studies, J. Fluids Eng. 116 (1994).)
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from simrob_drake.arguments import as_path
from simrob_drake.folders import filled_at_once
from simrob_drake.frames import Vector
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.result import SimulationResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FINER = 4  # how many times finer the second run is
_QUATERNION = 4
_NEXT_TO_NOTHING = 1e-3  # SI units; rounding does not end with what is zero
_IMPOSED = ("reference", "applied")  # what went in


@dataclass(frozen=True)
class Quantity:
    """Columns of a result that are told together: their name and their unit."""

    name: str
    unit: str


Values = Mapping[Quantity, Vector]  # quantities at times (m,), shape (m, k) each


@dataclass(frozen=True)
class Account:
    """What an engine tells of a run."""

    name: str  # of the engine
    times: Vector  # of the samples, shape (m,) [s]
    values: Values  # of the finer run
    errors: Mapping[Quantity, float] = field(default_factory=dict)  # how far off they may be, by quantity
    ended: str = ""  # how the finer run ended, in words

    @classmethod
    def of(cls, name: str, fine: SimulationResult, coarse: SimulationResult) -> "Account":
        """Return the account of two runs."""
        exact, rough = quantities(fine), quantities(coarse)
        common = together(fine.times, coarse.times)
        errors = {what: float(apart(exact[what][:common], rough[what][:common]).max()) for what in exact}
        return cls(name, fine.times, exact, errors, fine.message)


@dataclass(frozen=True)
class Difference:
    """How far two accounts are apart in a quantity."""

    quantity: Quantity  # which
    account: str  # whose, against the first account
    largest: float  # difference of any component at any time
    at: float  # when it is largest [s]
    error: float  # the sum of both errors

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
    """Return how much rows of arrays (m, k) differ at most, (m,); four columns of unit length are quaternions."""
    distances = np.abs(first - other).max(axis=1)
    if first.shape[1] == _QUATERNION and np.allclose(np.linalg.norm(first, axis=1), 1.0):
        distances = np.minimum(distances, np.abs(first + other).max(axis=1))
    return np.asarray(distances)


def _stem(column: str) -> str:
    """Return a column's name without its last part: ``q.joint_1`` is a ``q``, ``distance.gap`` itself."""
    kind = column.rpartition(".")[0]
    return column if kind in ("", "distance") else kind


NUMBERS = "engines.csv"  # the file that every folder of a comparison of engines holds
_SMALLEST = 1e-4  # what a picture shows, as a part of the largest
_WORDS = {
    ("q", ""): "joint positions",
    ("v", ""): "joint speeds",
    ("tau", ""): "joint torques",
    ("tcp", "m"): "place of the tool",
    ("tcp", "1"): "orientation of the tool, quaternion",
}
"""What a referee calls quantities, by the ends of their names and their units; any unit where it is empty."""
_HEADINGS = ("engine", "quantity", "unit", "largest", "at", "error", "within")


def save_comparison(
    accounts: list[Account], found: list[Difference], folder: Path | str, *, station: str = "", force: bool = False
) -> None:
    """Write ``engines.csv`` and ``engines.png``, titled by the station; raises OutputError: not written."""
    with filled_at_once(as_path(folder, "folder"), marker=NUMBERS, force=force) as work:
        with (work / NUMBERS).open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(_HEADINGS)
            for one in found:
                numbers = f"{one.largest:.6g}", f"{one.at:.6g}", f"{one.error:.6g}", "yes" if one.within else "no"
                rows.writerow([one.account, one.quantity.name, one.quantity.unit, *numbers])
        if found:
            _save_picture(accounts, found, work / "engines.png", station)


def _save_picture(accounts: list[Account], found: list[Difference], file: Path, station: str) -> None:
    """Draw a panel for each quantity: over time how far each engine is from the first, and both errors as a line."""
    from simrob_drake.results.plots.own import panels, save_figure  # which load matplotlib

    first, *others = accounts
    shown = list(dict.fromkeys(one.quantity for one in found))
    titles = [_title(what) for what in shown]
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    head = f"{f'{station}: ' if station else ''}difference from {first.name}, the largest of all axes"
    figure, frames = panels(head, rows, columns, size=(5 * columns, 2.2 * rows + 0.8), titles=titles, sharex=True)
    errors = {(one.quantity, one.account): one.error for one in found}
    for axes, what in zip(frames.flat, shown, strict=False):
        axes.set_yscale("log")
        for other, colour in zip(others, cycle(COLOURS), strict=False):
            if what in other.values:
                _draw(axes, first, other, what, errors[what, other.name], colour)
    for axes in frames.flat[len(shown) :]:
        axes.set_visible(False)
    for axes in frames[-1]:
        axes.set_xlabel("time [s]")
    frames[0, 0].plot([], [], "--", color="0.35", linewidth=1, label="numerical errors of both: below they agree")
    save_figure(figure, file)


def _title(what: Quantity) -> str:
    """Return a quantity in words, with the robot's name where it has one."""
    whose, _, name = what.name.rpartition(".")
    words = _WORDS.get((name, what.unit)) or _WORDS.get((name, ""))
    if words is None:
        return f"{what.name} [{what.unit}]"
    return f"{f'{whose}: ' if whose else ''}{words} [{what.unit}]"


def _draw(axes: "Axes", first: Account, other: Account, what: Quantity, error: float, colour: str) -> None:
    common = together(first.times, other.times)
    distances = apart(first.values[what][:common], other.values[what][:common])
    least = max(error, float(distances.max())) * _SMALLEST  # a logarithm knows no zero
    axes.plot(first.times[:common], np.maximum(distances, least), color=colour, label=other.name, linewidth=1)
    axes.axhline(max(error, least), color=colour, linestyle="--", linewidth=1)
