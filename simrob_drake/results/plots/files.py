"""The plots of a run as files: joints, tool, a base that is free, and what pieces, sensors and blocks tell."""

from collections.abc import Iterator
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure

from simrob_drake.folders import writing
from simrob_drake.parts.site import StationRobot
from simrob_drake.results.plots.formats import UNDATED, PlotFormat, plot_format
from simrob_drake.results.plots.grid import grid_figure, is_dense
from simrob_drake.results.plots.joint_plots import base_figure, position_stacks, tcp_stacks, torque_stacks
from simrob_drake.results.plots.own import DPI, as_saved
from simrob_drake.results.plots.panel_plots import Sheet, panel_sheets
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.walks import legged_robots

_LONG = 10.0  # a run of so many seconds or more whose curves run together is shown a second time, in part
_DETAIL = 3.0  # seconds of that part


def save_plots(result: RecordedRun, folder: Path, kind: PlotFormat = "png") -> list[Path]:
    """Write the plots of a run as files of a kind: ``position.png``, ``torque.png`` and, with a tool, ``tcp.png``.

    Robots that walk have ``base.png`` too. With several robots each has its own, ``<robot>_position.png`` and so on.
    Where a long run moves to and fro all the time, ``position_detail.png`` and ``torque_detail.png`` show three seconds
    of its middle. Free pieces have ``piece_<piece>.png``, and what was measured stands in ``sensors.png``. Returns the
    files. Raises UnknownName: another kind than ``png``, ``svg``, ``pdf``; OutputError: one cannot be written.
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
    for sheet in panel_sheets(result):
        yield from _with_detail(result, sheet)


def _robot_figures(result: RecordedRun, robot: StationRobot, whose: str) -> Iterator[tuple[str, Figure]]:
    for name, stacks_of in {"position": position_stacks, "torque": torque_stacks}.items():
        yield from _with_detail(result, Sheet(name, f"joint {name}s{whose}", stacks_of(result, robot)))
    if robot.tcp:
        title = f"tool '{robot.tcp}' in the world{whose}"
        yield "tcp", grid_figure(result, title, tcp_stacks(result, robot), columns=3)
    if robot.name in legged_robots(result):
        yield "base", base_figure(result, robot, f"way of the base{whose}")


def _with_detail(result: RecordedRun, sheet: Sheet) -> Iterator[tuple[str, Figure]]:
    """Yield a figure, and some seconds of the middle of a long run where its curves run together."""
    yield sheet.name, grid_figure(result, sheet.title, sheet.stacks, **sheet.layout)
    if result.stop_time >= _LONG and is_dense(stack.plots[0] for stack in sheet.stacks):
        begin = (result.stop_time - _DETAIL) / 2
        title = f"{sheet.title}, {begin:.2f} to {begin + _DETAIL:.2f} s"
        figure = grid_figure(result, title, sheet.stacks, span=(begin, begin + _DETAIL), **sheet.layout)
        yield f"{sheet.name}_detail", figure
