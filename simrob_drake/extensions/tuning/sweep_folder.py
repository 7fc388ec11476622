"""The folder of a sweep: what was asked for, each run as it ends, and in the end all of them as table and plots."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from simrob_drake.base.arguments import as_path
from simrob_drake.base.distributions import Choice
from simrob_drake.base.folders import writing
from simrob_drake.base.frames import Vector
from simrob_drake.base.packages import Border
from simrob_drake.extensions.tuning.analysis import plots_there, save_sensitivity, sweep_in_optuna
from simrob_drake.extensions.tuning.journal import (
    COMPLETED,
    Row,
    TrialFolder,
    read_spec,
    write_rows,
)
from simrob_drake.extensions.tuning.rollout import UNITS, Case, measured
from simrob_drake.extensions.tuning.sweep import Sweep
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.grid import style
from simrob_drake.stations.file_paths import changes_with_absolute_paths

SWEEP, TABLE = "sweep.yaml", "sweep.csv"


class SweepFolder(TrialFolder[Case]):
    """A ``sweep`` and its runs, in a folder."""

    def __init__(
        self, folder: Path | str, sweep: Sweep, *, force: bool = False, allow_code: bool = False
    ) -> None:
        """Begin a sweep in a new folder, or go on with the same one.

        Args:
            folder: where to.
            sweep: what to run.
            force: replace another sweep that is there, or the same one.
            allow_code: whether the station may name Python code.

        Raises:
            SimrobError: a sweep that cannot be.
            OutputError: the folder holds something else, or cannot be written.
            InvalidConfig: its station has changed since it began.
        """
        self.sweep, cases = sweep, sweep.cases(allow_code=allow_code)
        super().__init__(folder, SWEEP, sweep, cases, cases[0].scene().digest, force=force)

    @classmethod
    def there(cls, folder: Path | str, *, allow_code: bool = False) -> "SweepFolder":
        """Return the sweep that stands in a folder.

        Raises:
            InvalidConfig: there is none, it is damaged, names files that may not be read, or its station has changed.
        """
        place = as_path(folder, "folder")
        sweep = read_spec(place, SWEEP, Sweep)
        changes = changes_with_absolute_paths(
            sweep.overrides, place.absolute(), Border(place / SWEEP)
        )
        return cls(place, sweep.model_copy(update={"overrides": changes}), allow_code=allow_code)

    def run(
        self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True
    ) -> list[Row]:
        """Make the runs that are not done yet, write the table and the plots of all, and return the rows.

        Args and errors are those of :meth:`made`.
        """
        rows = self.made(workers=workers, scheduler=scheduler, progress=progress)
        write_rows(self.folder / TABLE, rows)
        save_sweep_plots(self.sweep, rows, self.folder / "plots")
        if plots_there():
            found = sweep_in_optuna(self.sweep.station, self.sweep.vary, rows)
            save_sensitivity(self.folder / "plots/sensitivity.png", found)
        return rows


_DPI = 110
_WIDTH, _HEIGHT, _COLUMNS = 3.8, 2.7, 3  # inches of a frame, and frames in a row
_BINS = 20
_BLUE, _ORANGE, *_ = COLOURS


def save_sweep_plots(sweep: Sweep, rows: Sequence[Row], folder: Path) -> list[Path]:
    """Write ``over_<key>.png`` for each key of several values, ``map.png`` for two, ``spread.png``; return them.

    Curves are medians over all runs with one value, in a band from the least to the largest; maps are medians. The
    measures that no run has are left out. Raises OutputError: the disk does not take them.
    """
    listed = {
        key: one
        for key, one in sweep.vary.items()
        if isinstance(one, Choice) and len(one.values) > 1
    }
    figures = {
        f"over_{key}": _figure(rows, f"over {key}", partial(_curve, key, one))
        for key, one in listed.items()
    }
    if len(listed) > 1:
        first, second, *_ = listed.items()
        figures["map"] = _figure(
            rows, f"over {first[0]} and {second[0]}", partial(_map, first, second)
        )
    figures["spread"] = _figure(rows, "all runs", _spread)
    written = []
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            figure.suptitle(
                f"{sweep.station}: {figure.get_suptitle()}", x=0.01, ha="left", fontweight="bold"
            )
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1], dpi=_DPI)
    return written


_Axis = tuple[str, Choice]
Draw = Callable[[Axes, Sequence[Row], str], None]


def _figure(rows: Sequence[Row], title: str, draw: Draw) -> Figure:
    """Draw a frame for each measure that a run has, and, unless all did, which part of the runs went to their ends."""
    shown = [{**row, COMPLETED: float(row["ended"] == COMPLETED)} for row in rows]
    names = list(measured(rows))
    if not names or any(not row[COMPLETED] for row in shown):
        names.append(COMPLETED)
    columns = min(_COLUMNS, len(names))
    lines = -(-len(names) // columns)
    figure = Figure(figsize=(_WIDTH * columns, _HEIGHT * lines + 0.4), layout="constrained")
    figure.suptitle(title)
    for place, name in enumerate(names, start=1):
        axes = figure.add_subplot(lines, columns, place)
        unit = UNITS.get(name.rpartition(".")[2], "part of the runs")
        style(axes, f"{name} [{unit}]")
        draw(axes, shown, name)
    return figure


def _curve(key: str, choice: Choice, axes: Axes, rows: Sequence[Row], name: str) -> None:
    found = [
        _numbers([row for row in rows if row.get(key) == value], name) for value in choice.values
    ]
    places = _axis(axes, choice)
    there = [place for place, values in enumerate(found) if values.size]
    at = places[there]
    axes.fill_between(
        at,
        [found[p].min() for p in there],
        [found[p].max() for p in there],
        color=_BLUE,
        alpha=0.2,
        linewidth=0,
    )
    axes.plot(at, [np.median(found[place]) for place in there], "o-", color=_BLUE, markersize=3)
    axes.set_xlabel(key)


def _map(across: _Axis, up: _Axis, axes: Axes, rows: Sequence[Row], name: str) -> None:
    (first, wide), (second, high) = across, up
    cells = np.full((len(high.values), len(wide.values)), np.nan)
    for line, up_value in enumerate(high.values):
        for column, across_value in enumerate(wide.values):
            values = _numbers(
                [
                    row
                    for row in rows
                    if row.get(first) == across_value and row.get(second) == up_value
                ],
                name,
            )
            cells[line, column] = np.median(values) if values.size else np.nan
    image = axes.imshow(cells, origin="lower", aspect="auto", cmap="viridis")
    axes.grid(visible=False)
    axes.set_xticks(
        range(len(wide.values)), [_short(value) for value in wide.values], rotation=45, ha="right"
    )
    axes.set_yticks(range(len(high.values)), [_short(value) for value in high.values])
    axes.set_xlabel(first)
    axes.set_ylabel(second)
    axes.figure.colorbar(image, ax=axes, label=axes.get_title(loc="left"))


def _spread(axes: Axes, rows: Sequence[Row], name: str) -> None:
    values = _numbers(rows, name)
    if values.size:
        axes.hist(values, bins=min(_BINS, max(len(values), 1)), color=_BLUE)
        axes.axvline(float(np.median(values)), color=_ORANGE, label="median")
        axes.legend(fontsize=8, frameon=False)
    axes.set_ylabel("runs")


def _axis(axes: Axes, key: Choice) -> Vector:
    """Return where the values of a key stand along an axis: names side by side, numbers where they are."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in key.values):
        axes.set_xscale("log" if key.text.startswith("log:") else "linear")
        return np.array(key.values, dtype=float)
    axes.set_xticks(range(len(key.values)), [_short(value) for value in key.values])
    return np.arange(len(key.values), dtype=float)


def _numbers(rows: Sequence[Row], name: str) -> Vector:
    """Return the finite values of a measure."""
    values = np.array([row[name] for row in rows if row.get(name) is not None], dtype=float)
    return np.asarray(values[np.isfinite(values)])


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
