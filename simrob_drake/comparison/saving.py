"""The differences between engines as a table of numbers and a picture."""

from __future__ import annotations

import csv
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from simrob_drake.arguments import as_path
from simrob_drake.comparison.account import Account, Difference, Quantity, apart, together
from simrob_drake.folders import filled_at_once
from simrob_drake.results.colours import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NUMBERS = "engines.csv"
"""The file that every folder of a comparison of engines holds."""
_SMALLEST = 1e-4
"""What a picture shows, as a part of the largest."""
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
    accounts: list[Account],
    found: list[Difference],
    folder: Path | str,
    *,
    station: str = "",
    force: bool = False,
) -> None:
    """Write ``engines.csv`` and ``engines.png``, in whose title the station's name stands.

    Raises:
        OutputError: the folder cannot be written, or is there and not to be replaced.
    """
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


def _draw(axes: Axes, first: Account, other: Account, what: Quantity, error: float, colour: str) -> None:
    common = together(first.times, other.times)
    distances = apart(first.values[what][:common], other.values[what][:common])
    least = max(error, float(distances.max())) * _SMALLEST  # a logarithm knows no zero
    axes.plot(first.times[:common], np.maximum(distances, least), color=colour, label=other.name, linewidth=1)
    axes.axhline(max(error, least), color=colour, linestyle="--", linewidth=1)
