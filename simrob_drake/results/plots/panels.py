"""Figures of many small plots: what is in them is said first, and laid out once all is known.

matplotlib can find margins and align labels by itself, but then it measures every label of a figure for each of its
panels: with 40 of them that takes seconds. Here each label is measured once.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from simrob_drake.frames import Vector
from simrob_drake.results.record.run import DIVERGED, RecordedRun

STOP = "#d7301f"
"""The colour of a run's stop and its reason."""

NOTE = "#b2182b"
"""The colour of notes and limits."""

Span = tuple[float, float]
"""Begin and end of the time that is shown [s]."""

_MARGIN, _GAP, _LABEL = 0.2, 0.25, 0.2  # inches: about the figure, between cells, for the label of an axis
_TITLE, _BELOW, _BETWEEN = 0.3, 0.3, 0.13  # inches: over a cell, for the ticks under it, between its panels
_NARROWEST = 8.0  # inches: titles need the room
_TICK = 8  # points
_TRUSTED = 0.95  # the part of a diverging run that sets the scale
_HUGE = 1e9  # nobody reads larger values off a plot
_INK = 25.0  # curves that go up and down more often than this per panel are drawn thin


@dataclass(frozen=True)
class Curve:
    """A signal over the time of a run: its values, shape (m,), what the legend calls it, and its looks.

    Its weight is the width of its line, as a part of the usual.
    """

    values: Vector
    label: str
    colour: str
    weight: float = 1.0
    dashed: bool = False


@dataclass(frozen=True)
class Panel:
    """Curves in one frame.

    Attributes:
        label: of the upright axis, with the unit.
        curves: one at least.
        smallest: span of the upright axis, in its unit: less is noise, which is not blown up.
        height: inches.
        note: a few words over its right corner.
    """

    label: str
    curves: Sequence[Curve]
    smallest: float
    height: float = 1.5
    note: str = ""


@dataclass(frozen=True)
class Cell:
    """What belongs to one axis: a title, and panels below each other, as many in every cell of a figure."""

    title: str
    panels: Sequence[Panel]


def grid_figure(result: RecordedRun, title: str, cells: Sequence[Cell], *, span: Span | None = None) -> Figure:
    """Draw cells side by side in rows, under a title and one legend.

    Args:
        result: the run, for its times and its end.
        title: what is shown.
        cells: in the order of reading.
        span: the part of the run to show; all of it unless given.
    """
    grid = _Grid(result, cells, span or _whole(result))
    grid.draw()
    grid.head(title)
    return grid.figure


def is_dense(curves: Sequence[Curve]) -> bool:
    """Tell whether curves go up and down so often that lines of the usual width would run together."""
    return any(_turns(curve.values) > _INK for curve in curves)


def fit(axes: Axes, curves: Vector, smallest: float) -> None:
    """Show all of the curves, shape (k, m), with some room, but no noise at full height."""
    values = _readable(curves)
    half = max(0.54 * np.ptp(values), smallest / 2)
    middle = (values.min() + values.max()) / 2
    axes.set_ylim(middle - half, middle + half)


def style(axes: Axes) -> None:
    """Give a frame the looks of all plots of a run."""
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=_TICK)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.spines[["top", "right"]].set_visible(False)


def trusted(result: RecordedRun, values: Vector) -> Vector:
    """Return the samples, along the last axis, that set a scale: not those that a run diverges with."""
    return values[..., : max(int(_TRUSTED * values.shape[-1]), 1)] if result.stopped_by == DIVERGED else values


def write_head(figure: Figure, result: RecordedRun, title: str, lines: dict[str, Any]) -> None:
    """Write the title of a figure, the legend of its curves by label, and why the run was stopped if it was."""
    width, height = figure.get_size_inches()

    def write(text: str, below_top: float, **looks: Any) -> None:
        figure.text(_MARGIN / width, 1 - below_top / height, text, va="center", **looks)

    write(f"{result.config.name}: {title}", 0.25, fontsize=13, fontweight="bold")
    at, looks = (0.1 / width, 1 - 0.54 / height), {"ncols": len(lines), "frameon": False, "fontsize": 9}
    figure.legend(list(lines.values()), list(lines), loc="center left", bbox_to_anchor=at, **looks)
    if result.stopped_by:
        by_monitor = result.ending == "monitor"
        text = f"stopped by {result.stopped_by}: {result.message}" if by_monitor else result.message
        write(textwrap.shorten(text, int(14 * width), placeholder=" ..."), 0.8, fontsize=9, color=STOP)


def head_height(result: RecordedRun) -> float:
    """Return how much room the head of a figure takes [inches]."""
    return 1.0 if result.stopped_by else 0.75


def mark_stop(axes: Axes, result: RecordedRun) -> None:
    """Mark the end of a run that was stopped."""
    if result.stopped_by:
        axes.axvline(result.stop_time, color=STOP, linewidth=1.4, linestyle=":", label="stop")


class _Grid:
    """A figure with cells; its width is that of the panels and of the numbers left of them."""

    def __init__(self, result: RecordedRun, cells: Sequence[Cell], span: Span) -> None:
        self._result, self._cells, self._span = result, cells, span
        self._columns = len(cells) if len(cells) <= 3 else int(np.ceil(np.sqrt(len(cells))))
        self._rows = -(-len(cells) // self._columns)
        self._panel_width = max(2.6, _NARROWEST / self._columns - 0.8)
        self.figure = Figure()
        FigureCanvasAgg(self.figure)  # by which texts are measured
        self._widths: dict[str, float] = {}
        self._frames: list[list[Axes]] = []

    def draw(self) -> None:
        """Draw all curves, and put the frames where the widths of their numbers let them stand."""
        within = (self._result.times >= self._span[0]) & (self._result.times <= self._span[1])
        thin = is_dense([curve for cell in self._cells for panel in cell.panels for curve in panel.curves])
        for cell in self._cells:
            frames = [self.figure.add_axes((0.0, 0.0, 1.0, 1.0)) for _ in cell.panels]
            self._frames.append(frames)
            for axes, panel in zip(frames, cell.panels, strict=True):
                self._draw_panel(axes, panel, within, width=0.8 if thin and within.all() else 1.6)
                axes.tick_params(labelbottom=axes is frames[-1])
            frames[0].set_title(cell.title, loc="left", fontsize=10, y=1.0)  # matplotlib would measure for a place
        self._arrange()

    def head(self, title: str) -> None:
        """Write title, legend and the reason of a stop."""
        write_head(self.figure, self._result, title, self._lines())

    def _draw_panel(self, axes: Axes, panel: Panel, within: npt.NDArray[np.bool_], *, width: float) -> None:
        style(axes)
        axes.yaxis.set_major_locator(MaxNLocator(5 if panel.height > 1 else 3, steps=[1, 2, 2.5, 5, 10]))
        times = self._result.times[within]
        marker = "o" if len(times) == 1 else None  # a run that was stopped at its start
        for curve in panel.curves:
            looks: dict[str, Any] = {"color": curve.colour, "linewidth": curve.weight * width}
            shape = "--" if curve.dashed else "-"
            axes.plot(times, curve.values[within], shape, label=curve.label, marker=marker, **looks)
        fit(axes, trusted(self._result, np.array([curve.values[within] for curve in panel.curves])), panel.smallest)
        begin, end = self._span
        axes.set_xlim(begin, begin + 1.04 * (end - begin)) if end > begin else axes.set_xlim(-0.1, 1.0)
        axes.set_title(panel.note, loc="right", fontsize=8, color=NOTE, y=1.0)
        mark_stop(axes, self._result)

    def _arrange(self) -> None:
        """Give the figure its size, and every frame and label its place."""
        numbers = [[self._width_of_numbers(axes) for axes in frames] for frames in self._frames]
        lefts = list(self._lefts(numbers))
        panels = [panel.height for panel in self._cells[0].panels]
        row = _TITLE + sum(panels) + _BETWEEN * (len(panels) - 1) + _BELOW
        width = lefts[-1] + self._panel_width + _MARGIN
        height = head_height(self._result) + row * self._rows + _LABEL
        self.figure.set_size_inches(width, height)
        for index, (frames, cell) in enumerate(zip(self._frames, self._cells, strict=True)):
            line, column = divmod(index, self._columns)
            widest = max(max(numbers[place]) for place in range(column, len(numbers), self._columns))
            y = height - head_height(self._result) - line * row - _TITLE
            for axes, panel in zip(frames, cell.panels, strict=True):
                y -= panel.height
                at = lefts[column] / width, y / height, self._panel_width / width, panel.height / height
                axes.set_position(at)
                if self._is_labelled(index):
                    axes.set_ylabel(panel.label)
                axes.yaxis.set_label_coords(-(widest + 0.08) / self._panel_width, 0.5)
                axes.xaxis.set_label_coords(0.5, -_BELOW / panel.height)
                y -= _BETWEEN
            if index + self._columns >= len(self._cells):
                frames[-1].set_xlabel("time [s]")

    def _lefts(self, numbers: list[list[float]]) -> Iterator[float]:
        """Yield where the columns begin [inches]: after the numbers and labels of their frames."""
        end = 0.0
        for column in range(self._columns):
            places = range(column, len(self._cells), self._columns)
            label = _LABEL if any(map(self._is_labelled, places)) else 0.0
            end += (_MARGIN if column == 0 else _GAP) + label + max(max(numbers[place]) for place in places)
            yield end
            end += self._panel_width

    def _is_labelled(self, index: int) -> bool:
        """Tell whether a cell says what its upright axes are: the first of a row, and one that differs from it."""
        cells = self._cells
        return index % self._columns == 0 or cells[index].panels[0].label != cells[index - 1].panels[0].label

    def _width_of_numbers(self, axes: Axes) -> float:
        """Return how far the numbers left of a frame reach [inches]."""
        texts = axes.yaxis.get_major_formatter().format_ticks(list(axes.yaxis.get_majorticklocs()))
        return max(map(self._width_of, texts), default=0.0) + 0.08  # the tick and its distance

    def _width_of(self, text: str) -> float:
        """Return how wide a number is [inches]."""
        if text not in self._widths:
            shown = self.figure.text(0.0, 0.0, text, fontsize=_TICK)
            self._widths[text] = shown.get_window_extent().width / self.figure.dpi
            shown.remove()
        return self._widths[text]

    def _lines(self) -> dict[str, Any]:
        frames = [axes for frames in self._frames for axes in frames]
        return {str(line.get_label()): line for axes in frames for line in axes.get_lines()}


def _whole(result: RecordedRun) -> Span:
    return 0.0, result.stop_time


def _turns(values: Vector) -> float:
    """Return how often a curve goes through its whole height."""
    curve = _readable(values)
    height = np.ptp(curve)
    return float(np.abs(np.diff(curve)).sum() / height) if height > 0 else 0.0


def _readable(values: Vector) -> Vector:
    return np.asarray(np.clip(np.nan_to_num(values), -_HUGE, _HUGE))
