"""Figures of many small plots: what is in them is said first, and laid out once all is known.

matplotlib can find margins and align labels by itself, but then it measures every label of a figure for each of its
frames: with 40 of them that takes seconds. Here the room of numbers follows from how many characters they have.
"""

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import Formatter, MaxNLocator, ScalarFormatter

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message, translate, with_decimal_sign
from simrob_drake.results.colours import COLOURS, RED
from simrob_drake.results.record.run import DIVERGED, RecordedRun

VALUE, REFERENCE, ERROR = COLOURS[:3]
ERROR_HEIGHT = 0.65  # of the plot of an error under that of its value [inches]

TIME_LABEL = message("results.time_label", "time [s]")
"""Label of the axis of time."""

Span = tuple[float, float]  # begin and end of the time that is shown [s]

_MARGIN, _GAP, _LABEL = 0.2, 0.25, 0.2  # inches: about the figure, between stacks, for the label of an axis
_TITLE, _BELOW, _BETWEEN = 0.3, 0.3, 0.13  # inches: over a stack, for the ticks under it, between its plots
_HEAD, _LEGEND, _LINE = 0.5, 0.25, 0.2  # inches: title of a figure, legend, and lines of a reason below each other
_FRAME = 2.6  # inches: least width of a frame
_TICK = 8  # points
_DIGIT = 0.64 * _TICK / 72  # inches
_SMALLEST = {"m": 1e-3, "mm": 0.1, "deg": 0.1, "N": 0.01, "N·m": 0.01, "m/s": 1e-3}  # span of an axis: less is noise
_TRUSTED = 0.95  # the part of a diverging run that sets the scale
_HUGE = 1e9  # nobody reads larger values off a plot
_MOST = 48  # stacks of a figure; 300 would take a minute and half a gigabyte
_PLAIN = 1e-4, 1e6  # numbers from and to which nobody needs powers of ten
_STILL = 1e-6  # of a value: what differs by less does not differ
_GREY = "0.35"
_INK = 25.0  # curves that go up and down more often than this per plot are drawn thin


@dataclass(frozen=True)
class Curve:
    """A signal over the time of a run: its values, shape (m,), what the legend calls it, and its looks.

    Its weight is the width of its line, as a part of the usual; its line is matplotlib's "-", "--", "-." or ":".
    """

    values: Vector
    label: str
    colour: str
    weight: float = 1.0
    line: str = "-"


def dashed(values: Vector, label: str, colour: str) -> Curve:
    """Return the dashed curve of a reference or a limit."""
    return Curve(values, label, colour, 0.75, "--")


@dataclass(frozen=True)
class Plot:
    """Curves in one frame."""

    label: str  # of the upright axis, with the unit: "force [N]"
    curves: Sequence[Curve]  # one at least
    height: float = 1.5  # inches
    note: str = ""  # a few words over its right corner


@dataclass(frozen=True)
class Stack:
    """What belongs together: a title, and plots below each other, as many in every stack of a row."""

    title: str
    plots: Sequence[Plot]


def grid_figure(
    result: RecordedRun,
    title: str,
    stacks: Sequence[Stack],
    *,
    columns: int | None = None,
    width: float = 8.0,
    legend: float = 0.0,
    span: Span | None = None,
    remark: str = "",
) -> Figure:
    """Draw stacks side by side in rows, under a title, a legend, and the reason of a stop.

    Only so many stacks are drawn as somebody may look at, which the title says; ``columns`` are at most three, or about
    as many as rows, unless given; the figure has a ``width``, at least, and with ``legend`` so much room to the right
    of each stack for that [inches]; ``span`` is the part of the run to show, a ``remark`` stands below the title.
    """
    if len(stacks) > _MOST:
        title = message(
            "results.first_stacks", "{title}: the first {most} of {count}", title=title, most=_MOST, count=len(stacks)
        )
        stacks = stacks[:_MOST]
    columns = columns or (len(stacks) if len(stacks) <= 3 else int(np.ceil(np.sqrt(len(stacks)))))
    grid = _Grid(result, stacks, columns)
    grid.draw(span or (result.start_time, result.stop_time), legends=legend > 0)
    grid.arrange(title, max(_FRAME, width / columns - 0.8 - legend), legend, remark)
    return grid.figure


def is_dense(plots: Iterable[Plot]) -> bool:
    """Tell whether curves go up and down so often that lines of the usual width would run together; noise does not."""
    return any(_turns(curve.values, smallest(plot.label)) > _INK for plot in plots for curve in plot.curves)


def style(axes: Axes, title: str) -> None:
    """Give a frame the looks of all plots of a run."""
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=_TICK)
    axes.yaxis.set_major_formatter(_Numbers())
    axes.xaxis.set_major_formatter(_LocalNumbers())
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(translate(title), loc="left", fontsize=10, y=1.0)  # matplotlib would measure for a place


def trusted(result: RecordedRun, values: Vector) -> Vector:
    """Return the samples, along the last axis, that set a scale: not those that a run diverges with."""
    return values[..., : max(int(_TRUSTED * values.shape[-1]), 1)] if result.stopped_by == DIVERGED else values


class _Numbers(Formatter):
    """Numbers at an axis as they are: no power of ten stands over it, where titles are."""

    def __call__(self, value: float, pos: int | None = None) -> str:
        """Return one of them."""
        return with_decimal_sign(f"{value:g}")

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """Return what stands at each: as many digits as tell them apart."""
        largest = max(map(abs, values), default=0.0)
        step = float(np.diff(np.sort(values)).min()) if len(values) > 1 else largest
        kind = "f" if largest == 0 or _PLAIN[0] <= largest < _PLAIN[1] else "g"
        for digits in range(16):
            texts = [f"{value:.{digits}{kind}}" for value in values]
            if np.abs(np.array(texts, dtype=float) - values).max(initial=0.0) <= 1e-3 * step:
                break
        return [self.fix_minus(with_decimal_sign(text)) for text in texts]


class _LocalNumbers(ScalarFormatter):
    """Numbers at an axis of time as matplotlib writes them, with the decimal sign of the language of the output."""

    def __call__(self, value: float, pos: int | None = None) -> str:
        """Write one number."""
        return with_decimal_sign(super().__call__(value, pos))


class _Grid:
    """A figure whose frames stand where the widths of their numbers let them."""

    def __init__(self, result: RecordedRun, stacks: Sequence[Stack], columns: int) -> None:
        self._result, self._stacks, self._columns = result, stacks, columns
        self.figure = Figure()
        self._frames = [[self.figure.add_axes((0.0, 0.0, 1.0, 1.0)) for _ in stack.plots] for stack in stacks]
        self._explained: dict[str, Line2D] = {}  # in the head, by label

    def draw(self, span: Span, *, legends: bool) -> None:
        """Draw all curves, with legends beside the plots or in the head."""
        begin, end = span
        within = (self._result.times >= begin) & (self._result.times <= end)
        thin = within.all() and is_dense(plot for stack in self._stacks for plot in stack.plots)
        for index, (stack, frames) in enumerate(zip(self._stacks, self._frames, strict=True)):
            for axes, plot in zip(frames, stack.plots, strict=True):
                style(axes, stack.title if axes is frames[0] else "")
                lines = self._draw_curves(axes, plot, within, 0.8 if thin else 1.6)
                axes.set_xlim(begin, begin + 1.04 * (end - begin)) if end > begin else axes.set_xlim(-0.1, 1.0)
                axes.tick_params(labelbottom=axes is frames[-1])
                axes.set_ylabel(translate(plot.label) if self._is_labelled(index) else "", fontsize=9)
                if not legends:
                    self._explained |= lines
                elif len(lines) > 1:
                    _write_legend(axes, lines, 8, loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
            if index + self._columns >= len(self._stacks):
                frames[-1].set_xlabel(translate(TIME_LABEL))
        if self._result.stopped_by:
            stop = translate(message("results.stop", "stop"))
            looks: dict[str, Any] = {"color": RED, "linewidth": 1.4, "linestyle": ":", "label": stop}
            for axes in self.figure.axes:
                self._explained[stop] = axes.axvline(self._result.stop_time, **looks)

    def arrange(self, title: str, frame: float, legend: float, remark: str) -> None:
        """Give the figure its head and size, and the frames, of a width [inches], and their labels a place."""
        numbers = max(map(_width_of_numbers, self.figure.axes))
        labels = any(self._is_labelled(index) for index in range(len(self._stacks)) if index % self._columns)
        left, pitch = _MARGIN + _LABEL + numbers, frame + legend + _GAP + numbers + _LABEL * labels
        width = left + (self._columns - 1) * pitch + frame + max(legend, _MARGIN)
        words = ((remark, _GREY), (self._result.end_in_words if self._result.stopped_by else "", RED))
        lines = [(line, colour) for text, colour in words for line in textwrap.wrap(translate(text), int(14 * width))]
        head = _HEAD + _LEGEND * bool(self._explained)
        tops, down = self._tops(head + _LINE * len(lines))
        height = down + _LABEL
        self.figure.set_size_inches(width, height)
        for index, (stack, frames) in enumerate(zip(self._stacks, self._frames, strict=True)):
            for plot, axes in zip(stack.plots, frames, strict=True):
                x, y = left + index % self._columns * pitch, height - tops[axes] - plot.height
                axes.set_position((x / width, y / height, frame / width, plot.height / height))
                axes.yaxis.set_label_coords(-(numbers + 0.08) / frame, 0.5)
                axes.xaxis.set_label_coords(0.5, -_BELOW / plot.height)
        self._write_head(f"{self._result.config.name}: {translate(title)}", lines, head)

    def _tops(self, down: float) -> tuple[dict[Axes, float], float]:
        """Return how far below the top of the figure the frames begin, the first row at ``down``, and where all end."""
        tops = {}
        for begin in range(0, len(self._stacks), self._columns):
            row, top = slice(begin, begin + self._columns), down + _TITLE
            for stack, frames in zip(self._stacks[row], self._frames[row], strict=True):
                down = top
                for plot, axes in zip(stack.plots, frames, strict=True):
                    tops[axes] = down
                    down += plot.height + _BETWEEN
            down += _BELOW - _BETWEEN
        return tops, down

    def _write_head(self, title: str, lines: list[tuple[str, str]], head: float) -> None:
        width, height = self.figure.get_size_inches()

        def place(down: float, left: float = _MARGIN) -> Span:
            return left / width, 1 - down / height

        looks: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": place(0.54, 0.1)}
        self.figure.text(*place(0.25), title, va="center", fontsize=13, fontweight="bold")
        _write_legend(self.figure, self._explained, 9, ncols=len(self._explained), **looks)
        for number, (line, colour) in enumerate(lines):
            self.figure.text(*place(head + 0.05 + number * _LINE), line, va="center", fontsize=9, color=colour)

    def _draw_curves(self, axes: Axes, plot: Plot, within: npt.NDArray[np.bool_], width: float) -> dict[str, Line2D]:
        """Draw what a plot shows, with lines of a width [points]; return them by label."""
        axes.yaxis.set_major_locator(MaxNLocator(5 if plot.height > 1 else 3, steps=[1, 2, 2.5, 5, 10]))
        axes.set_title(translate(plot.note), loc="right", fontsize=8, color=RED, y=1.0)
        times = self._result.times[within]
        marker = "o" if len(times) == 1 else None  # a run that was stopped at its start
        lines = {}
        for curve in plot.curves:
            looks: dict[str, Any] = {"color": curve.colour, "linewidth": curve.weight * width, "marker": marker}
            label = translate(curve.label)
            (lines[label],) = axes.plot(times, curve.values[within], curve.line, label=label, **looks)
        shown = np.array([curve.values[within] for curve in plot.curves])
        values = _readable(trusted(self._result, shown))
        middle = (values.min() + values.max()) / 2
        still = 1.0 if np.ptp(values) <= _STILL * abs(middle) else 0.0  # a constant, as computed
        half = max(0.54 * np.ptp(values), (smallest(plot.label) or still + _STILL * abs(middle)) / 2)
        axes.set_ylim(middle - half, middle + half)
        return lines

    def _is_labelled(self, index: int) -> bool:
        """Tell whether a stack says what its upright axes are: the first of a row, and one that differs from it."""
        stacks = self._stacks
        return index % self._columns == 0 or stacks[index].plots[0].label != stacks[index - 1].plots[0].label


def _write_legend(where: Axes | Figure, lines: dict[str, Line2D], size: float, **place: Any) -> None:
    where.legend(list(lines.values()), list(lines), fontsize=size, frameon=False, **place)


def _width_of_numbers(axes: Axes) -> float:
    """Return how far the numbers left of a frame reach, with the tick and its distance [inches]."""
    texts = axes.yaxis.get_major_formatter().format_ticks(list(axes.yaxis.get_majorticklocs()))
    return _DIGIT * max(map(len, texts), default=0) + 0.08


def smallest(label: str) -> float:
    """Return the span of a plot below which curves are noise, by the unit in its label; 0 of units without any."""
    return _SMALLEST.get(label.rpartition("[")[2].rstrip("]"), 0.0)


def _turns(values: Vector, least: float) -> float:
    """Return how often a curve goes through its whole height, or through the ``least`` span that is shown."""
    curve = _readable(values)
    height = max(float(np.ptp(curve)), least)
    return float(np.abs(np.diff(curve)).sum() / height) if height > 0 else 0.0


def _readable(values: Vector) -> Vector:
    """Return values that can be read off a plot, one after the other; 0 where there are none."""
    found = values[~np.isnan(values)]
    return np.asarray(np.clip(found, -_HUGE, _HUGE)) if found.size else np.zeros(1)
