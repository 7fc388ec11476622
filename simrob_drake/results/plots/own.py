"""Plots as files: the plots of a run, and figures of a user's own in the same style.

A *frame* is what Matplotlib calls axes: one plot of a figure. A *stack* is a title with frames below each other. A
*sheet* is a figure that is described, but not drawn: its name, its title and its stacks.
"""

import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from warnings import catch_warnings, filterwarnings, warn

import numpy as np
import numpy.typing as npt
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties

from simrob_drake.base.errors import shorten
from simrob_drake.base.extension import ExtensionWarning, usable_objects
from simrob_drake.base.folders import writing
from simrob_drake.base.messages import compound, message, translate
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.results.colours import looks
from simrob_drake.results.plots.formats import UNDATED, PlotFormat, plot_format
from simrob_drake.results.plots.grid import Span, grid_figure, is_dense, style
from simrob_drake.results.plots.joint_plots import (
    base_figure,
    position_stacks,
    tcp_stacks,
    torque_stacks,
)
from simrob_drake.results.plots.panel_plots import Sheet, panel_sheets
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.servos import servo_in_words, servos_of
from simrob_drake.results.record.walks import legged_robots

DPI = 110
"""Resolution of PNG files [pixels per inch]."""

_CURVE_STYLES = 32
"""Count of curves of a frame that differ in colour or style of line."""

_BOLD = FontProperties(size=13, weight="bold")

# Widths [inches].
_LETTER = 0.07  # a letter of a legend, on average
_BOLD_LETTER = 0.125  # a letter of a title, on average
_COLUMN_SPACE = 0.6  # a column of a legend without its letters
_MARGIN = 0.2  # both borders of a figure, which text leaves free

_LEAST_LETTERS = 10
"""Count of letters of a line, however narrow a figure is."""

_LEGEND_LOOKS: dict[str, Any] = {"frameon": False, "fontsize": 9}

_LEGEND_MARK = "legend of simrob"
"""Identifier (gid of Matplotlib) of the legend that completes a figure."""

_LONG = 10.0
"""Duration from which a run whose curves run together has a second figure, of a part of the run [s]."""

_DETAIL = 3.0
"""Duration of that part [s]."""


class NotebookFigure(Figure):
    """Figure that a notebook shows as a picture, although Matplotlib has no window there."""

    def _repr_png_(self) -> bytes:
        """Draw the figure for a notebook. Jupyter calls this method."""
        with BytesIO() as file, as_saved():
            self.savefig(file, format="png", dpi=DPI, metadata=UNDATED["png"])
            return file.getvalue()


def panels(
    title: str,
    rows: int = 1,
    columns: int = 1,
    *,
    size: tuple[float, float],
    titles: Sequence[str] = (),
    **how: Any,
) -> tuple[NotebookFigure, npt.NDArray[Any]]:
    """Make a figure with empty frames in the style of the plots of a run.

    Args:
        title: title of the figure. :func:`save_figure` writes it.
        rows: count of rows of frames.
        columns: count of frames in a row.
        size: width and height of the figure [inches].
        titles: titles of the frames, row after row. Further frames have no title.
        how: further arguments of Matplotlib's ``Figure.subplots``, such as ``sharex=True``.

    Returns:
        the figure, and its frames, shape (rows, columns).
    """
    # Figures of users have few frames, so that Matplotlib may find their margins itself.
    figure = NotebookFigure(figsize=size, layout="constrained")
    frames = figure.subplots(rows, columns, squeeze=False, **how)
    colours, lines = zip(*looks(_CURVE_STYLES), strict=True)
    for index, axes in enumerate(frames.flat):
        style(axes, titles[index] if index < len(titles) else "")
        axes.set_prop_cycle(color=colours, linestyle=lines)
    # The label keeps the title until save_figure() writes it, with or without a legend below it.
    figure.set_label(translate(title))
    return figure, np.asarray(frames)


def save_figure(figure: Figure, file: Path | str, *, beside: bool = False) -> Path:
    """Write a plot to a file, with a legend that covers no curve. Returns the file.

    The label of the figure (``figure.set_label``) is its title. The figure gets a title and legends.

    Args:
        figure: the figure. The legend has those of its curves that have labels.
        file: the file: ``.png``, ``.svg`` or ``.pdf``. Its folder is made if it does not exist.
        beside: whether each frame has a legend at its right. Otherwise the figure has one legend, under its title.

    Raises:
        UnknownName: the file has another suffix.
        OutputError: the file cannot be written.
    """
    target = Path(file)
    kind = plot_format(target.suffix.removeprefix(".").lower())
    complete_figure(figure, beside=beside)
    with writing(target.parent), as_saved():
        target.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(target, dpi=DPI, metadata=UNDATED[kind])
    return target


def complete_figure(figure: Figure, *, beside: bool = False) -> None:
    """Write title and legends into a figure. A second call with the same ``beside`` replaces those of the first.

    Args:
        figure: the figure, whose label is its title. Curves without labels are in no legend.
        beside: whether each frame has a legend at its right. Otherwise the figure has one legend, under its title.
    """
    # A notebook shows a figure that may be saved afterwards: it must not get a second legend.
    for legend in [legend for legend in figure.legends if legend.get_gid() == _LEGEND_MARK]:
        legend.remove()
    if beside:
        for axes in figure.axes:
            if axes.get_legend_handles_labels()[1]:
                axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), **_LEGEND_LOOKS)
    title = _wrap(figure.get_label(), figure.get_figwidth() - _MARGIN, _BOLD_LETTER)
    curves = {} if beside else _curves_by_label(figure.axes)
    if curves:
        _write_legend(figure, title, curves)
    else:
        figure.suptitle(title, x=0.01, ha="left", fontproperties=_BOLD)


def _write_legend(figure: Figure, title: str, curves: dict[str, Any]) -> None:
    """Write a title and a legend above all frames, in as many columns as fit.

    Args:
        figure: the figure.
        title: the title, in lines that fit.
        curves: curves by label.
    """
    width = figure.get_figwidth()
    labels = [_wrap(label, width - _COLUMN_SPACE - _MARGIN, _LETTER) for label in curves]
    longest_line = max(len(line) for label in labels for line in label.split("\n"))
    column_width = _COLUMN_SPACE + _LETTER * longest_line
    # The widths are estimates: a tenth of the figure is kept in reserve.
    column_count = max(1, int(0.9 * width / column_width))
    legend = figure.legend(
        list(curves.values()),
        labels,
        loc="outside upper left",
        ncols=column_count,
        title=title,
        title_fontproperties=_BOLD,
        alignment="left",
        **_LEGEND_LOOKS,
    )
    legend.set_gid(_LEGEND_MARK)


@contextmanager
def as_saved() -> Iterator[None]:
    """Context manager in which saving the same plots gives the same files.

    A letter that the font does not have is drawn as a box. Matplotlib's warning of it is not shown.
    """
    # Matplotlib makes the identifiers in SVG files from this text; without it they are random.
    with rc_context({"svg.hashsalt": "simrob"}), catch_warnings():
        filterwarnings("ignore", "Glyph .* missing")
        yield


def _wrap(text: object, width: float, letter_width: float) -> str:
    """Break a text into lines that are no wider than a given width.

    Args:
        text: the text.
        width: largest width of a line [inches].
        letter_width: width of a letter [inches].
    """
    most_letters = max(int(width / letter_width), _LEAST_LETTERS)
    # Breaks only at spaces keep file names and dotted keys whole; a word that is longer than a line is broken, too.
    return textwrap.fill(str(text), most_letters, break_on_hyphens=False)


def _curves_by_label(frames: Sequence[Axes]) -> dict[str, Any]:
    """Find the curves of frames that have labels, by label. Of several with the same label, the first counts."""
    curves: dict[str, Any] = {}
    for axes in frames:
        for curve, label in zip(*axes.get_legend_handles_labels(), strict=True):
            curves.setdefault(label, curve)
    return curves


def save_plots(result: RecordedRun, folder: Path, kind: PlotFormat = "png") -> list[Path]:
    """Write the plots of a run. Returns the files.

    There are ``position.png`` and ``torque.png``, with a tool ``tcp.png``, and for robots that can walk ``base.png``.
    With several robots, these names begin with the robot: ``<robot>_position.png``. Free pieces have
    ``piece_<piece>.png``, sensors ``sensors.png``, and controllers ``controller_<name>.png``. In a long run whose
    curves run together, ``position_detail.png`` and the like show three seconds of its middle. The plots of installed
    extensions follow.

    Args:
        result: the run.
        folder: folder of the files. It is made if it does not exist.
        kind: format of the files, which is also their suffix.

    Raises:
        UnknownName: the format is not ``png``, ``svg`` or ``pdf``.
        OutputError: a file cannot be written.
    """
    plot_format(kind)
    written = []
    # A $ in a name is a letter, and does not begin a formula.
    with writing(folder), as_saved(), rc_context({"text.parse_math": False}):
        folder.mkdir(parents=True, exist_ok=True)
        for named_figure in _figures(result):
            file = folder / f"{named_figure.name}.{kind}"
            named_figure.figure.savefig(file, dpi=DPI, metadata=UNDATED[kind])
            written.append(file)
        written += _save_plots_of_extensions(result, folder, kind, {file.stem for file in written})
    return written


def _save_plots_of_extensions(
    result: RecordedRun, folder: Path, kind: PlotFormat, taken: set[str]
) -> list[Path]:
    """Write the plots that installed extensions make of a run.

    A plot whose name is taken, or whose function fails, is left out with an ExtensionWarning. A function that returns
    None has no plot of this run.

    Args:
        result: the run.
        folder: folder of the plots.
        kind: format of the files, which is also their suffix.
        taken: names of the plots that are there already.

    Returns:
        the files that were written.
    """
    written = []
    for name, draw in usable_objects("plots", Callable).items():
        file = folder / f"{name}.{kind}"
        try:
            # Names are checked before drawing, since a plot of the core must not be replaced.
            if name in taken:
                problem_of_name = message(
                    "results.plot_name_taken",
                    "the run has a plot of this name already: {file}",
                    file=file.name,
                )
                raise ValueError(problem_of_name)
            figure = draw(result)
            if figure is not None:
                written.append(save_figure(figure, file))
        except Exception as problem:  # a function of somebody else must not cost the files of a run
            reason = shorten(
                compound("{name}: {problem}", name=type(problem).__name__, problem=problem), 200
            )
            warn(
                message(
                    "results.plot_left_out",
                    "the plot {name} of an extension is left out: {reason}",
                    name=name,
                    reason=reason,
                ),
                ExtensionWarning,
                stacklevel=2,
            )
    return written


class _NamedFigure(NamedTuple):
    """A plot that is ready to be written.

    Attributes:
        name: name of its file without suffix.
        figure: Matplotlib's figure.
    """

    name: str
    figure: Figure


def _figures(result: RecordedRun) -> Iterator[_NamedFigure]:
    """Yield the plots of a run: those of its robots, then those of its sensors, pieces and blocks.

    Names and titles contain the robot, unless it is the only one.
    """
    for robot in result.plant.robots.values():
        end_of_titles = "" if result.config.only_robot else f", {robot.name}"
        # The prefix of a robot is its name with a dot, or nothing for the only robot.
        prefix = robot.prefix.replace(".", "_")
        for named_figure in _robot_figures(result, robot, end_of_titles):
            yield named_figure._replace(name=f"{prefix}{named_figure.name}")
    for sheet in panel_sheets(result):
        yield from _with_detail(result, sheet)


def _robot_figures(result: RecordedRun, robot: StationRobot, whose: str) -> Iterator[_NamedFigure]:
    """Yield the plots of a robot: positions, torques, the pose of its tool, and the path of its base.

    A robot without a tool has no plot of its tool, and only a robot that can walk has a plot of its base.

    Args:
        result: the run.
        robot: the robot.
        whose: end of the titles, such as ", left"; empty for the only robot.
    """
    servo = servos_of(result).get(robot.name)
    layout = {}
    if servo:
        layout = {
            "remark": message("results.servos", "servos: {servo}", servo=servo_in_words(servo))
        }
    positions = message("results.joint_positions", "joint positions{whose}", whose=whose)
    yield from _with_detail(
        result, Sheet("position", positions, position_stacks(result, robot), layout)
    )
    torques = message("results.joint_torques", "joint torques{whose}", whose=whose)
    yield from _with_detail(result, Sheet("torque", torques, torque_stacks(result, robot), layout))
    if robot.tcp:
        title = message(
            "results.tool_in_world",
            "tool '{tool}' in the world{whose}",
            tool=robot.tcp,
            whose=whose,
        )
        yield _NamedFigure("tcp", grid_figure(result, title, tcp_stacks(result, robot), columns=3))
    # The base of an arm stays in its place, and needs no plot.
    if robot.name in legged_robots(result):
        title = message("results.path_of_base", "path of the base{whose}", whose=whose)
        yield _NamedFigure("base", base_figure(result, robot, title))


def _with_detail(result: RecordedRun, sheet: Sheet) -> Iterator[_NamedFigure]:
    """Draw a sheet, and yield its plot.

    If the run is long (10 s or more) and its curves are dense, yield a second plot, which shows three seconds of the
    middle of the run. Curves are dense if they go up and down so often that their lines run together.
    """
    yield _NamedFigure(sheet.name, grid_figure(result, sheet.title, sheet.stacks, **sheet.layout))
    # The first plot of a stack shows the value, the others its error.
    first_plots = [stack.plots[0] for stack in sheet.stacks]
    if result.simulated_time < _LONG or not is_dense(first_plots):
        return
    # The middle of the run: at its start and its end robots often rest.
    begin = result.start_time + (result.simulated_time - _DETAIL) / 2
    span = Span(begin, begin + _DETAIL)
    title = message(
        "results.title_of_detail",
        "{title}, {begin:.2f} to {end:.2f} s",
        title=sheet.title,
        begin=span.begin,
        end=span.end,
    )
    figure = grid_figure(result, title, sheet.stacks, span=span, **sheet.layout)
    yield _NamedFigure(f"{sheet.name}_detail", figure)
