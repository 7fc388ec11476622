"""Plots as files: those of a run, and users' own figures in their looks."""

import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from warnings import catch_warnings, filterwarnings, warn

import numpy as np
import numpy.typing as npt
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties

from simrob_drake.base.errors import shortened
from simrob_drake.base.extension import ExtensionWarning, usable_objects
from simrob_drake.base.folders import writing
from simrob_drake.base.messages import compound, message, translate
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.results.colours import looks
from simrob_drake.results.plots.formats import UNDATED, PlotFormat, plot_format
from simrob_drake.results.plots.grid import grid_figure, is_dense, style
from simrob_drake.results.plots.joint_plots import base_figure, position_stacks, tcp_stacks, torque_stacks
from simrob_drake.results.plots.panel_plots import Sheet, panel_sheets
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.servos import servo_in_words, servos_of
from simrob_drake.results.record.walks import legged_robots

DPI = 110  # pixels an inch of pictures that are made of pixels

_CURVES = 32  # that differ in colour or kind of line
_BOLD = FontProperties(size=13, weight="bold")
_LETTER = 0.07  # mean width of a letter of a legend [inches]
_BOLD_LETTER = 0.125  # mean width of a letter of a title [inches]
_COLUMN_SPACE = 0.6  # width of a column of a legend without its letters [inches]
_MARGIN = 0.2  # width at the borders of a figure that text leaves free [inches]
_LEAST_LETTERS = 10  # count of letters of a line, however narrow a figure is
_PLAIN: dict[str, Any] = {"frameon": False, "fontsize": 9}


def panels(
    title: str, rows: int = 1, columns: int = 1, *, size: tuple[float, float], titles: Sequence[str] = (), **how: Any
) -> tuple[Figure, npt.NDArray[Any]]:
    """Return a figure with a title, and its empty frames, shape (rows, columns).

    Args:
        title: over all.
        rows: of frames.
        columns: of frames.
        size: width and height of the figure [inches].
        titles: of the frames, row after row.
        how: what matplotlib's ``Figure.subplots`` takes beside, such as ``sharex=True``.
    """
    figure = Figure(figsize=size, layout="constrained")
    frames = figure.subplots(rows, columns, squeeze=False, **how)
    colours, lines = zip(*looks(_CURVES), strict=True)
    for index, axes in enumerate(frames.flat):
        style(axes, titles[index] if index < len(titles) else "")
        axes.set_prop_cycle(color=colours, linestyle=lines)
    figure.set_label(translate(title))  # save_figure() writes it: over a legend, if there is one
    return figure, np.asarray(frames)


def save_figure(figure: Figure, file: Path | str, *, beside: bool = False) -> Path:
    """Write a figure with a legend that covers nothing, and return the file.

    The label of the figure (``figure.set_label``) is its title.

    Args:
        figure: whose curves have labels.
        file: ``.png``, ``.svg`` or ``.pdf``; its folder is made where it does not exist.
        beside: a legend to the right of each frame, in place of one for all under the title.

    Raises:
        UnknownName: another kind of file.
        OutputError: it cannot be written.
    """
    target = Path(file)
    kind = plot_format(target.suffix.removeprefix(".").lower())
    for axes in figure.axes if beside else ():
        if axes.get_legend_handles_labels()[1]:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), **_PLAIN)
    width = figure.get_figwidth()
    title = _wrapped(figure.get_label(), width - _MARGIN, _BOLD_LETTER)
    curves = {} if beside else _labelled(figure.axes)
    if curves:
        labels = [_wrapped(label, width - _COLUMN_SPACE - _MARGIN, _LETTER) for label in curves]
        longest_line = max(len(line) for label in labels for line in label.split("\n"))
        column_width = _COLUMN_SPACE + _LETTER * longest_line
        figure.legend(
            list(curves.values()),
            labels,
            loc="outside upper left",
            ncols=max(1, int(0.9 * width / column_width)),
            title=title,
            title_fontproperties=_BOLD,
            alignment="left",
            **_PLAIN,
        )
    else:
        figure.suptitle(title, x=0.01, ha="left", fontproperties=_BOLD)
    with writing(target.parent), as_saved():
        target.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(target, dpi=DPI, metadata=UNDATED[kind])
    return target


@contextmanager
def as_saved() -> Iterator[None]:
    """Write figures the same way each time; a letter that the font lacks is a box in them, and no warning."""
    with rc_context({"svg.hashsalt": "simrob"}), catch_warnings():
        filterwarnings("ignore", "Glyph .* missing")
        yield


def _wrapped(text: object, width: float, letter: float) -> str:
    """Break a text into lines that are no wider than a figure.

    Args:
        text: the text.
        width: largest width of a line [inches].
        letter: width of a letter [inches].
    """
    most_letters = max(int(width / letter), _LEAST_LETTERS)
    # Breaks only at spaces keep file names and dotted keys whole; a word that is longer than a line is broken, too.
    return textwrap.fill(str(text), most_letters, break_on_hyphens=False)


def _labelled(frames: Sequence[Axes]) -> dict[str, Any]:
    """Return the curves of frames by their labels, the first of each."""
    found: dict[str, Any] = {}
    for axes in frames:
        for curve, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, curve)
    return found


_LONG = 10.0  # a run of so many seconds or more whose curves run together is shown a second time, in part
_DETAIL = 3.0  # seconds of that part


def save_plots(result: RecordedRun, folder: Path, kind: PlotFormat = "png") -> list[Path]:
    """Write the plots of a run as files of a kind: ``position.png``, ``torque.png`` and, with a tool, ``tcp.png``.

    Robots that walk have ``base.png`` too. With several robots each has its own, ``<robot>_position.png`` and so on.
    Where a long run moves to and fro all the time, ``position_detail.png`` and ``torque_detail.png`` show three seconds
    of its middle. Free pieces have ``piece_<piece>.png``, and what was measured stands in ``sensors.png``. The plots of
    installed extensions follow. Returns the files. Raises UnknownName: another kind than ``png``, ``svg``, ``pdf``;
    OutputError: one cannot be written.
    """
    plot_format(kind)
    written = []
    with writing(folder), as_saved(), rc_context({"text.parse_math": False}):  # a $ in a name is one
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in _figures(result):
            written.append(folder / f"{name}.{kind}")
            figure.savefig(written[-1], dpi=DPI, metadata=UNDATED[kind])
        written += _save_plots_of_extensions(result, folder, kind, {file.stem for file in written})
    return written


def _save_plots_of_extensions(result: RecordedRun, folder: Path, kind: PlotFormat, taken: set[str]) -> list[Path]:
    """Write the plots that installed extensions make of a run.

    A plot whose name is taken, or whose function fails, is left out with an ExtensionWarning.

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
            if name in taken:
                raise ValueError(
                    message(
                        "results.plot_name_taken", "the run has a plot of this name already: {file}", file=file.name
                    )
                )
            figure = draw(result)
            if figure is not None:
                written.append(save_figure(figure, file))
        except Exception as problem:  # a function of somebody else must not cost the files of a run
            reason = shortened(compound("{name}: {problem}", name=type(problem).__name__, problem=problem), 200)
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


def _figures(result: RecordedRun) -> Iterator[tuple[str, Figure]]:
    for robot in result.plant.robots.values():
        for name, figure in _robot_figures(result, robot, "" if result.config.only_robot else f", {robot.name}"):
            yield f"{robot.prefix.replace('.', '_')}{name}", figure
    for sheet in panel_sheets(result):
        yield from _with_detail(result, sheet)


def _robot_figures(result: RecordedRun, robot: StationRobot, whose: str) -> Iterator[tuple[str, Figure]]:
    """Yield names and figures of a robot: positions, torques, and the paths of its tool and its base if it has them.

    Args:
        result: the run.
        robot: the robot.
        whose: end of the titles, such as ", left"; empty for the only robot.
    """
    servo = servos_of(result).get(robot.name)
    layout = {}
    if servo:
        layout = {"remark": message("results.servos", "servos: {servo}", servo=servo_in_words(servo))}
    positions = message("results.joint_positions", "joint positions{whose}", whose=whose)
    yield from _with_detail(result, Sheet("position", positions, position_stacks(result, robot), layout))
    torques = message("results.joint_torques", "joint torques{whose}", whose=whose)
    yield from _with_detail(result, Sheet("torque", torques, torque_stacks(result, robot), layout))
    if robot.tcp:
        title = message("results.tool_in_world", "tool '{tool}' in the world{whose}", tool=robot.tcp, whose=whose)
        yield "tcp", grid_figure(result, title, tcp_stacks(result, robot), columns=3)
    if robot.name in legged_robots(result):
        title = message("results.path_of_base", "path of the base{whose}", whose=whose)
        yield "base", base_figure(result, robot, title)


def _with_detail(result: RecordedRun, sheet: Sheet) -> Iterator[tuple[str, Figure]]:
    """Yield a figure, and some seconds of the middle of a long run where its curves run together."""
    yield sheet.name, grid_figure(result, sheet.title, sheet.stacks, **sheet.layout)
    if result.simulated_time >= _LONG and is_dense(stack.plots[0] for stack in sheet.stacks):
        begin = result.start_time + (result.simulated_time - _DETAIL) / 2
        title = message(
            "results.title_of_detail",
            "{title}, {begin:.2f} to {end:.2f} s",
            title=sheet.title,
            begin=begin,
            end=begin + _DETAIL,
        )
        figure = grid_figure(result, title, sheet.stacks, span=(begin, begin + _DETAIL), **sheet.layout)
        yield f"{sheet.name}_detail", figure
