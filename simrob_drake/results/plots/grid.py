"""Figures of many small plots, as one figure shows all joints of a robot.

A *plot* is a frame with its curves. A *stack* is a title with plots below each other, such as the position of a joint
and the error of this position. A figure has its stacks side by side in rows.

Matplotlib can find margins and align labels by itself, but then it measures every label of a figure for each of its
frames: with 40 frames that takes seconds. Here the width of the numbers at an axis is estimated from the count of their
characters, and all frames are placed at once.
"""

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

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
"""Colours of a value, of its reference, and of the difference of the two."""

ERROR_HEIGHT = 0.65
"""Height of the plot of an error, under the plot of its value [inches]."""

TIME_LABEL = message("results.time_label", "time [s]")
"""Label of the axis of time."""


class Span(NamedTuple):
    """A part of a run, such as the one that a plot shows.

    Attributes:
        begin: its first time [s].
        end: its last time [s].
    """

    begin: float
    end: float


# All widths and heights are in inches.
_MARGIN = 0.2  # around the figure
_GAP = 0.25  # between stacks, without numbers and labels
_LABEL = 0.2  # label of an axis
_TITLE = 0.3  # title over a stack
_BELOW = 0.3  # numbers of the axis of time, under a stack
_BETWEEN = 0.13  # between the plots of a stack
_HEAD = 0.5  # title of the figure
_LEGEND = 0.25  # legend under the title of the figure
_LINE = 0.2  # line of text under the legend
_FRAME = 2.6  # least width of a frame

_TICK_SIZE = 8
"""Size of the font of the numbers at an axis [points, of which an inch has 72]."""

_DIGIT = 0.64 * _TICK_SIZE / 72
"""Width of a digit at an axis [inches]: in Matplotlib's font it is 0.64 of the font's size."""

_LETTERS_PER_INCH = 14
"""Letters of the text under the legend that fit an inch."""

_SMALLEST = {"m": 1e-3, "mm": 0.1, "deg": 0.1, "N": 0.01, "N·m": 0.01, "m/s": 1e-3}
"""Least span of an axis by the unit of its values. Smaller changes are noise, and should look like it."""

_RELIABLE = 0.95
"""Part of a diverging run, from its start, that sets the scale. After that the values grow without limit."""

_HUGE = 1e9
"""Values beyond this are drawn at this value: a plot cannot be read there, and Matplotlib cannot draw infinity."""

_MOST_STACKS = 48
"""Most stacks of a figure. A figure of 300 takes a minute and half a gigabyte."""

_PLAIN = (1e-4, 1e6)
"""Smallest and largest numbers that are written without powers of ten."""

_STILL = 1e-6
"""Relative change up to which a curve counts as constant: it is an error of the arithmetic."""

_GREY = "0.35"
"""Matplotlib's name of a dark grey: 0 is black, 1 white."""

_MANY_TURNS = 25.0
"""Curves that go up and down more often than this in a plot are drawn with thin lines."""

_USUAL_WIDTH = 1.6
_THIN_WIDTH = 0.8
"""Widths of lines [points]."""


@dataclass(frozen=True)
class Curve:
    """A signal over the time of a run.

    Attributes:
        values: the values, shape (m,), one for each time of the run.
        label: name of the curve in the legend.
        colour: colour of the line.
        weight: width of the line, relative to that of other curves.
        line: Matplotlib's style of the line: "-", "--", "-." or ":".
    """

    values: Vector
    label: str
    colour: str
    weight: float = 1.0
    line: str = "-"


def dashed_curve(values: Vector, label: str, colour: str) -> Curve:
    """Make the curve of a reference or a limit, with a dashed line."""
    return Curve(values, label, colour, weight=0.75, line="--")


@dataclass(frozen=True)
class Plot:
    """Curves in one frame.

    Attributes:
        label: label of the upright axis with the unit, such as "force [N]".
        curves: one curve or more.
        height: height of the frame [inches].
        note: a few words above the right corner of the frame.
    """

    label: str
    curves: Sequence[Curve]
    height: float = 1.5
    note: str = ""


@dataclass(frozen=True)
class Stack:
    """Plots that belong together, from top to bottom. All stacks of a row have the same count of plots.

    Attributes:
        title: title above the first plot.
        plots: the plots.
    """

    title: str
    plots: Sequence[Plot]


class _HeadLine(NamedTuple):
    """A line of text under the legend, and its colour."""

    text: str
    colour: str


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
    """Draw stacks side by side in rows, under a title and a legend. A run that was stopped has the reason there, too.

    Args:
        result: the run whose times the curves have.
        title: title of the figure, after the name of the station.
        stacks: the stacks. Of more than 48, the first 48 are drawn, and the title has both counts.
        columns: count of stacks in a row. If it is None, up to three stacks are one row, and more are about a square.
        width: width of the figure [inches]. The figure is wider if the frames would be too narrow.
        legend: width of a legend right of each frame [inches]. If it is 0, the figure has one legend at its top.
        span: part of the run that is shown; all of it if None.
        remark: a sentence below the title.
    """
    if len(stacks) > _MOST_STACKS:
        title = message(
            "results.first_stacks",
            "{title}: the first {most} of {count}",
            title=title,
            most=_MOST_STACKS,
            count=len(stacks),
        )
        stacks = stacks[:_MOST_STACKS]
    if not columns:
        columns = len(stacks) if len(stacks) <= 3 else int(np.ceil(np.sqrt(len(stacks))))
    # Numbers, labels and gaps take about 0.8 inches of each column.
    frame_width = max(_FRAME, width / columns - 0.8 - legend)
    grid = _Grid(result, stacks, columns)
    grid.draw(span or Span(result.start_time, result.stop_time), legends=legend > 0)
    grid.arrange(title, frame_width, legend, remark)
    return grid.figure


def is_dense(plots: Iterable[Plot]) -> bool:
    """Whether curves go up and down so often that lines of the usual width would run together.

    Noise does not count: it is smaller than the span of the axis.

    Args:
        plots: the plots. One dense curve is enough.
    """
    for plot in plots:
        for curve in plot.curves:
            if _turn_count(curve.values, smallest(plot.label)) > _MANY_TURNS:
                return True
    return False


def style(axes: Axes, title: str) -> None:
    """Give a frame the style of all plots of a run, and a title at its left; an empty text for no title."""
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=_TICK_SIZE)
    axes.yaxis.set_major_formatter(_Numbers())
    axes.xaxis.set_major_formatter(_LocalNumbers())
    axes.spines[["top", "right"]].set_visible(False)
    # With y given, Matplotlib need not measure all labels to find a free height.
    axes.set_title(translate(title), loc="left", fontsize=10, y=1.0)


def reliable_samples(result: RecordedRun, values: Vector) -> Vector:
    """Samples that may set the scale of a plot: all of them, or of a run that diverged the first 95 % of them.

    Args:
        result: the run.
        values: samples of the whole run or of a part, shape (..., m), with the time along the last axis.
    """
    if result.stopped_by != DIVERGED:
        return values
    count = max(int(_RELIABLE * values.shape[-1]), 1)
    return values[..., :count]


class _Numbers(Formatter):
    """Formatter of the numbers at an upright axis.

    Matplotlib's own formatter may write a common power of ten above the axis, where the titles of the stacks are.
    """

    def __call__(self, value: float, pos: int | None = None) -> str:
        """Write one number."""
        return with_decimal_sign(f"{value:g}")

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """Write the numbers of an axis, all with the fewest digits by which they differ.

        The digits are decimals; for very large or very small numbers they are significant digits, with a power of ten.
        """
        largest = max(map(abs, values), default=0.0)
        # Neighbouring numbers must differ, so the rounding is compared with their distance. A single number has none.
        step = float(np.diff(np.sort(values)).min()) if len(values) > 1 else largest
        is_plain = largest == 0 or _PLAIN[0] <= largest < _PLAIN[1]
        notation = "f" if is_plain else "g"
        # Try more and more digits until the rounding of the texts is a thousandth of that distance at most.
        for digits in range(16):  # a double has no more
            texts = [f"{value:.{digits}{notation}}" for value in values]
            rounding = np.abs(np.array(texts, dtype=float) - values).max(initial=0.0)
            if rounding <= 1e-3 * step:
                break
        return [self.fix_minus(with_decimal_sign(text)) for text in texts]


class _LocalNumbers(ScalarFormatter):
    """Numbers at an axis of time as matplotlib writes them, with the decimal sign of the language of the output."""

    def __call__(self, value: float, pos: int | None = None) -> str:
        """Write one number."""
        return with_decimal_sign(super().__call__(value, pos))


class _Grid:
    """Stacks in rows of one picture. :meth:`draw` draws the curves, then :meth:`arrange` places the frames.

    The order matters, since the width of the numbers at the axes depends on the curves.

    Attributes:
        figure: the figure.
    """

    def __init__(self, result: RecordedRun, stacks: Sequence[Stack], columns: int) -> None:
        """Make the empty frames of the stacks.

        Args:
            result: the run.
            stacks: the stacks, row after row.
            columns: count of stacks in a row.
        """
        self._result = result
        self._stacks = stacks
        self._columns = columns
        self.figure = Figure()
        self._frames = [
            # Matplotlib requires a position; `arrange` sets the final one.
            [self.figure.add_axes((0.0, 0.0, 1.0, 1.0)) for _ in stack.plots]
            for stack in stacks
        ]
        self._legend_lines: dict[str, Line2D] = {}  # lines of the legend at the top, by label

    def draw(self, span: Span, *, legends: bool) -> None:
        """Draw all curves and the labels of the axes; in a run that was stopped, also a line at its end.

        Args:
            span: part of the run that is shown.
            legends: whether each frame has a legend of its own. Otherwise the curves are explained at the top.
        """
        times = self._result.times
        is_shown = (times >= span.begin) & (times <= span.end)
        all_plots = [plot for stack in self._stacks for plot in stack.plots]
        # A detail of a run is short enough that its lines do not run together.
        is_thin = is_shown.all() and is_dense(all_plots)
        line_width = _THIN_WIDTH if is_thin else _USUAL_WIDTH
        for index, stack in enumerate(self._stacks):
            frames = self._frames[index]
            for axes, plot in zip(frames, stack.plots, strict=True):
                is_first = axes is frames[0]
                is_last = axes is frames[-1]
                style(axes, stack.title if is_first else "")
                lines = self._draw_curves(axes, plot, is_shown, line_width)
                _set_time_limits(axes, span)
                # All plots of a stack have the same axis of time: its numbers are under the last one.
                axes.tick_params(labelbottom=is_last)
                axes.set_ylabel(
                    translate(plot.label) if self._is_labelled(index) else "", fontsize=9
                )
                if not legends:
                    self._legend_lines.update(lines)
                elif len(lines) > 1:
                    _write_legend(
                        axes,
                        lines,
                        8,
                        loc="upper left",
                        bbox_to_anchor=(1.0, 1.0),
                        borderaxespad=0.0,
                    )
            # Only the lowest stack of each column has the label of the axis of time.
            has_stack_below = index + self._columns < len(self._stacks)
            if not has_stack_below:
                frames[-1].set_xlabel(translate(TIME_LABEL))
        if self._result.stopped_by:
            self._draw_stop()

    def _draw_stop(self) -> None:
        """Draw an upright line in all frames at the time at which the run was stopped. The legend explains it."""
        label = translate(message("results.stop", "stop"))
        looks: dict[str, Any] = {"color": RED, "linewidth": 1.4, "linestyle": ":", "label": label}
        for axes in self.figure.axes:
            self._legend_lines[label] = axes.axvline(self._result.stop_time, **looks)

    def arrange(self, title: str, frame_width: float, legend: float, remark: str) -> None:
        """Place all frames and their labels, set the size of the picture, and write its title.

        Args:
            title: title of the figure, after the name of the station.
            frame_width: width of each frame [inches].
            legend: width of the legend right of each frame [inches]; 0 if there is none.
            remark: a sentence below the title; empty for none.
        """
        # One width for all frames, so that the frames of a column are aligned.
        numbers_width = max(_width_of_numbers(axes) for axes in self.figure.axes)
        # All lengths are in inches. The first stack of a row always has a label; the others need room for one only if
        # one of them has a label.
        inner_stacks = [index for index in range(len(self._stacks)) if index % self._columns != 0]
        inner_label = _LABEL if any(self._is_labelled(index) for index in inner_stacks) else 0.0
        # The left edge of the first column of frames, and the distance from one column to the next.
        left = _MARGIN + _LABEL + numbers_width
        pitch = frame_width + legend + _GAP + numbers_width + inner_label
        width = left + (self._columns - 1) * pitch + frame_width + max(legend, _MARGIN)

        lines = self._head_lines(remark, width)
        head_height = _HEAD + (_LEGEND if self._legend_lines else 0.0)
        tops = self._tops_of_frames(head_height + _LINE * len(lines))
        height = tops.end + _LABEL
        self.figure.set_size_inches(width, height)
        for index, stack in enumerate(self._stacks):
            x = left + index % self._columns * pitch
            for plot, axes in zip(stack.plots, self._frames[index], strict=True):
                # Matplotlib measures from the lower left corner, as parts of the size of the figure.
                y = height - tops.of_frames[axes] - plot.height
                axes.set_position(
                    (x / width, y / height, frame_width / width, plot.height / height)
                )
                # Labels are placed in parts of the frame: left of the widest numbers, in the middle of the
                # height.
                axes.yaxis.set_label_coords(-(numbers_width + 0.08) / frame_width, 0.5)
                axes.xaxis.set_label_coords(0.5, -_BELOW / plot.height)
        self._write_head(f"{self._result.config.name}: {translate(title)}", lines, head_height)

    def _head_lines(self, remark: str, width: float) -> list[_HeadLine]:
        """Break the remark, and the reason why the run was stopped, into lines that fit the width.

        A run that was completed has no reason.

        Args:
            remark: a sentence; empty for none.
            width: width of the figure [inches].
        """
        reason = self._result.end_in_words if self._result.stopped_by else ""
        lines = []
        for text, colour in ((remark, _GREY), (reason, RED)):
            texts = textwrap.wrap(translate(text), int(_LETTERS_PER_INCH * width))
            lines += [_HeadLine(line, colour) for line in texts]
        return lines

    def _tops_of_frames(self, head_height: float) -> "_Tops":
        """Compute the positions of the upper edges of all frames, under a head of some height [inches]."""
        of_frames: dict[Axes, float] = {}
        down = head_height  # distance from the top of the figure [inches]
        for first in range(0, len(self._stacks), self._columns):
            row = slice(first, first + self._columns)
            row_top = down + _TITLE
            for stack, frames in zip(self._stacks[row], self._frames[row], strict=True):
                down = row_top
                for plot, axes in zip(stack.plots, frames, strict=True):
                    of_frames[axes] = down
                    down += plot.height + _BETWEEN
            # No plot follows the last one of a stack, but the numbers of the axis of time do.
            down += _BELOW - _BETWEEN
        return _Tops(of_frames, end=down)

    def _write_head(self, title: str, lines: Sequence[_HeadLine], head_height: float) -> None:
        """Write the title, the legend and the lines of text above all frames.

        Args:
            title: the title.
            lines: lines of text under the legend.
            head_height: height of title and legend [inches].
        """
        width, height = self.figure.get_size_inches()

        def position(down: float, left: float = _MARGIN) -> "_Position":
            """Convert distances from the top and from the left [inches] to Matplotlib's coordinates, from 0 to 1."""
            return _Position(left / width, 1 - down / height)

        title_at = position(0.25)
        self.figure.text(title_at.x, title_at.y, title, va="center", fontsize=13, fontweight="bold")
        looks: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": position(0.54, 0.1)}
        _write_legend(self.figure, self._legend_lines, 9, ncols=len(self._legend_lines), **looks)
        for index, line in enumerate(lines):
            line_at = position(head_height + 0.05 + index * _LINE)
            self.figure.text(
                line_at.x, line_at.y, line.text, va="center", fontsize=9, color=line.colour
            )

    def _draw_curves(
        self, axes: Axes, plot: Plot, is_shown: npt.NDArray[np.bool_], line_width: float
    ) -> dict[str, Line2D]:
        """Draw the curves of a plot, and set the limits of its upright axis.

        Args:
            axes: frame of the plot.
            plot: the plot.
            is_shown: whether each sample of the run is shown, shape (m,).
            line_width: width of a line of usual weight [points].

        Returns:
            the lines by label.
        """
        # A low frame, as that of an error, has room for few numbers.
        tick_count = 5 if plot.height > 1 else 3
        axes.yaxis.set_major_locator(MaxNLocator(tick_count, steps=[1, 2, 2.5, 5, 10]))
        axes.set_title(translate(plot.note), loc="right", fontsize=8, color=RED, y=1.0)
        times = self._result.times[is_shown]
        # A run that was stopped at its start has a single sample, through which no line leads.
        marker = "o" if len(times) == 1 else None
        lines = {}
        for curve in plot.curves:
            label = translate(curve.label)
            looks: dict[str, Any] = {
                "color": curve.colour,
                "linewidth": curve.weight * line_width,
                "marker": marker,
            }
            (lines[label],) = axes.plot(
                times, curve.values[is_shown], curve.line, label=label, **looks
            )
        # The axis is scaled to the shown part: a detail shows small movements large.
        shown_values = np.array([curve.values[is_shown] for curve in plot.curves])
        _set_value_limits(axes, plot.label, _readable(reliable_samples(self._result, shown_values)))
        return lines

    def _is_labelled(self, index: int) -> bool:
        """Whether the upright axes of a stack have labels.

        They have if the stack is the first of its row, or if its quantity is not that of the stack at its left.
        """
        if index % self._columns == 0:
            return True
        # The label ends with the unit, so that stacks of another unit have a label of their own.
        label_at_left = self._stacks[index - 1].plots[0].label
        return self._stacks[index].plots[0].label != label_at_left


class _Tops(NamedTuple):
    """Distances from the top of the picture [inches].

    Attributes:
        of_frames: distance of the upper edge of each frame.
        end: distance of the end of all frames, with the numbers of the axis of time.
    """

    of_frames: dict[Axes, float]
    end: float


class _Position(NamedTuple):
    """A position in Matplotlib's coordinates: parts of the width and the height, from the lower left corner.

    Attributes:
        x: part of the width, from 0 to 1.
        y: part of the height, from 0 to 1.
    """

    x: float
    y: float


def _set_time_limits(axes: Axes, span: Span) -> None:
    """Set the limits of the axis of time to a span, with a little room (4 % of the span) at the right."""
    if span.end > span.begin:
        axes.set_xlim(span.begin, span.begin + 1.04 * (span.end - span.begin))
    else:
        axes.set_xlim(-0.1, 1.0)  # a run that was stopped at its start


def _set_value_limits(axes: Axes, label: str, values: Vector) -> None:
    """Set the limits of an upright axis around values (k,), so that noise is not shown large.

    Args:
        axes: the frame.
        label: label of the axis, which ends with the unit.
        values: the finite values of all curves, one or more.
    """
    middle = (values.min() + values.max()) / 2
    rounding = _STILL * abs(middle)
    is_constant = np.ptp(values) <= rounding
    # Least span of the axis: that of the unit. Of other units, constants have a span of 1, and changes any span.
    least_span = smallest(label) or (1.0 if is_constant else 0.0) + rounding
    # 0.54 leaves 4 % of the span free above and below the curves.
    half_span = max(0.54 * np.ptp(values), least_span / 2)
    axes.set_ylim(middle - half_span, middle + half_span)


def _write_legend(
    where: Axes | Figure, lines: dict[str, Line2D], size: float, **place: Any
) -> None:
    """Write a legend without a frame.

    Args:
        where: frame or figure of the legend.
        lines: lines by label.
        size: size of the font [points].
        place: arguments of Matplotlib's ``legend`` that place it.
    """
    where.legend(list(lines.values()), list(lines), fontsize=size, frameon=False, **place)


def _width_of_numbers(axes: Axes) -> float:
    """Estimated width of the numbers left of a frame, with the tick and its distance (0.08) [inches]."""
    texts = axes.yaxis.get_major_formatter().format_ticks(list(axes.yaxis.get_majorticklocs()))
    most_digits = max(map(len, texts), default=0)
    return _DIGIT * most_digits + 0.08


def smallest(label: str) -> float:
    """Span of an axis below which changes are noise, in the unit at the end of its label.

    Args:
        label: label of the axis, such as "force [N]".

    Returns:
        the span, or 0 if none is known for the unit.
    """
    _, _, end = label.rpartition("[")
    return _SMALLEST.get(end.rstrip("]"), 0.0)


def _turn_count(values: Vector, least_span: float) -> float:
    """Count of passes of a curve through its whole height: the sum of its changes over its height.

    Args:
        values: values of the curve, shape (m,).
        least_span: height at which a lower curve is judged. It is that of the axis.
    """
    curve = _readable(values)
    height = max(float(np.ptp(curve)), least_span)
    return float(np.abs(np.diff(curve)).sum() / height) if height > 0 else 0.0


def _readable(values: Vector) -> Vector:
    """Values without NaN, and within a range that a plot can show, shape (k,). If none is left, a single 0."""
    # Samples without a value are NaN, such as those of a controller before its first sample.
    found = values[~np.isnan(values)]
    return np.asarray(np.clip(found, -_HUGE, _HUGE)) if found.size else np.zeros(1)
