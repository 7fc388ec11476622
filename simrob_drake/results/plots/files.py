"""The plots of a run as files: joints, tool, a base that is free, and what pieces, sensors and blocks tell."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from simrob_drake.folders import writing
from simrob_drake.parts.site import StationRobot
from simrob_drake.results.colours import looks
from simrob_drake.results.plots.base_plot import base_figure
from simrob_drake.results.plots.formats import UNDATED, PlotFormat, plot_format
from simrob_drake.results.plots.grid import Curve, Plot, Stack, grid_figure, is_dense
from simrob_drake.results.plots.joint_plots import position_stacks, torque_stacks
from simrob_drake.results.plots.own import DPI, as_saved
from simrob_drake.results.plots.tool_plots import tcp_stacks
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.walks import legged_robots
from simrob_drake.signals import Panel

_LONG = 10.0  # a run of more than so many seconds whose curves run together is shown a second time, in part
_DETAIL = 3.0  # seconds of that part
_WIDTH, _HEIGHT = 9.0, 1.8  # inches, of a figure and of a frame
_ENTRY, _HANDLE, _CHARACTER = 0.18, 0.45, 0.065  # inches: height of a legend's entry, width of its line and letters


def save_plots(result: RecordedRun, folder: Path, kind: PlotFormat = "png") -> list[Path]:
    """Write the plots of a run as files: ``position.png``, ``torque.png`` and, with a tool, ``tcp.png``.

    Robots that walk have ``base.png`` too. With several robots each has its own, ``<robot>_position.png`` and so on.
    Where a long run moves to and fro all the time, ``position_detail.png`` and ``torque_detail.png`` show three seconds
    of its middle. Free pieces have ``piece_<piece>.png``, and what was measured stands in ``sensors.png``.

    Args:
        result: the run.
        folder: where to; it is made where it does not exist.
        kind: ``png``, ``svg`` or ``pdf``.

    Returns:
        the files.

    Raises:
        UnknownName: another kind.
        OutputError: a file cannot be written.
    """
    plot_format(kind)
    written = []
    with writing(folder), as_saved(), rc_context({"text.parse_math": False}):  # a $ in a name is one
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in _figures(result):
            written.append(folder / f"{name}.{kind}")
            figure.savefig(written[-1], dpi=DPI, metadata=UNDATED[kind])
    return written


def _figures(result: RecordedRun) -> Iterator[tuple[str, Figure]]:
    for robot in result.plant.robots.values():
        for name, figure in _robot_figures(result, robot, "" if result.config.only_robot else f", {robot.name}"):
            yield f"{robot.prefix.replace('.', '_')}{name}", figure
    yield from panel_figures(result)


def _robot_figures(result: RecordedRun, robot: StationRobot, whose: str) -> Iterator[tuple[str, Figure]]:
    for name, stacks_of in {"position": position_stacks, "torque": torque_stacks}.items():
        title, stacks = f"joint {name}s{whose}", stacks_of(result, robot)
        yield name, grid_figure(result, title, stacks)
        if result.stop_time > _LONG and is_dense(stack.plots[0] for stack in stacks):
            begin = (result.stop_time - _DETAIL) / 2
            part = begin, begin + _DETAIL
            yield f"{name}_detail", grid_figure(result, f"{title}, {part[0]:.2f} to {part[1]:.2f} s", stacks, span=part)
    if robot.tcp:
        title = f"tool '{robot.tcp}' in the world{whose}"
        yield "tcp", grid_figure(result, title, tcp_stacks(result, robot), columns=3)
    if robot.name in legged_robots(result):
        yield "base", base_figure(result, robot, f"way of the base{whose}")


def panel_figures(result: RecordedRun) -> Iterator[tuple[str, Figure]]:
    """Yield the figures of a run's panels with their names, such as ``piece_<piece>`` and ``sensors``."""
    for name in dict.fromkeys(panel.figure for panel in result.panels):
        panels = [panel for panel in result.panels if panel.figure == name]
        heading = ", ".join(dict.fromkeys(panel.heading for panel in panels))
        stacks = [_stack(result, panel) for panel in panels]
        explained = [_part(column) for panel in panels if len(panel.columns) > 1 for column in panel.columns]
        legend = _HANDLE + _CHARACTER * max(map(len, explained), default=0)
        yield name, grid_figure(result, heading, stacks, columns=1, width=_WIDTH, legend=legend)


def _stack(result: RecordedRun, panel: Panel) -> Stack:
    first = 1.4 if len(panel.columns) > 1 else 1.0  # weight of a line; later ones are thinner: equal ones are all seen
    scale = np.rad2deg(1.0) if panel.label.endswith("[rad]") else 1.0  # angles are read in degrees
    curves = [
        Curve(scale * result[column], _part(column), colour, max(first - 0.3 * place, 0.8), line)
        for place, (column, (colour, line)) in enumerate(zip(panel.columns, looks(len(panel.columns)), strict=True))
    ]
    return Stack(panel.title, [Plot(panel.label.replace("[rad]", "[deg]"), curves, max(_HEIGHT, _ENTRY * len(curves)))])


def _part(column: str) -> str:
    """Return what a column is of its signal: "x", "joint_1"."""
    return column.rpartition(".")[2]
