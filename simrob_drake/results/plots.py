"""Plots of a run: joint positions, joint torques and the path of the tool, one small plot an axis."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from simrob_drake.errors import OutputError
from simrob_drake.frames import Vector
from simrob_drake.results.result import DIVERGED, SimulationResult
from simrob_drake.results.sensor_plots import sensor_figures
from simrob_drake.stations.robots import StationRobot

_DPI = 110
_VALUE, _REFERENCE, _ERROR, _LIMIT, _STOP = "#1f6fb4", "#e08214", "#8c2d7a", "#b2182b", "#d7301f"
_NEAR = 1.3  # a limit up to so many times the largest torque is drawn; one further away would flatten the curve
_QUANTITIES = {"deg": "position", "N·m": "torque", "N": "force", "m": "position"}
_TRUSTED = 0.95  # the part of a diverging run that sets the scale
_HUGE = 1e9  # nobody reads larger values off a plot
_SMALLEST_SPAN = {"deg": 0.1, "N·m": 0.01, "N": 0.01, "m": 0.001}  # of a plot: less is noise, which is not blown up


def save_plots(result: SimulationResult, folder: Path) -> list[Path]:
    """Write the plots of a run as PNG files: ``position.png``, ``torque.png`` and, with a tool, ``tcp.png``.

    With several robots each has its own, ``<robot>_position.png`` and so on. Free pieces have ``piece_<piece>.png``,
    and what was measured stands in ``sensors.png``.

    Args:
        result: the run.
        folder: where to; it is made where it does not exist.

    Returns:
        the files.

    Raises:
        OutputError: a file cannot be written.
    """
    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for robot in result.plant.robots.values():
            for name, figure in _figures(result, robot):
                written.append(folder / f"{robot.prefix.replace('.', '_')}{name}.png")
                figure.savefig(written[-1], dpi=_DPI)
        for name, figure in sensor_figures(result):
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1], dpi=_DPI)
    except OSError as problem:
        raise OutputError(f"{folder}: plots cannot be written: {problem.strerror}") from problem
    return written


def _figures(result: SimulationResult, robot: StationRobot) -> Iterator[tuple[str, Figure]]:
    yield "position", _position_figure(result, robot)
    yield "torque", _torque_figure(result, robot)
    if robot.tcp:
        yield "tcp", _tcp_figure(result, robot)


def _position_figure(result: SimulationResult, robot: StationRobot) -> Figure:
    """Draw each axis against its reference and, where there can be one, the error below."""
    dynamic = result.config.mode == "dynamic"
    grid = _Grid(result, robot, "joint positions", cells=robot.axes, units=robot.model.unit_names, errors=dynamic)
    reference, position = (result.axes(signal, robot.name) / robot.model.user_units for signal in ("q_ref", "q"))
    for panels, wanted, reached in zip(grid.cells, reference.T, position.T, strict=True):
        grid.draw(panels[0], reached, "position", _VALUE)
        grid.draw(panels[0], wanted, "reference", _REFERENCE, dashed=True)
        if dynamic:
            with np.errstate(invalid="ignore"):  # a diverging run may end with infinite positions
                error = wanted - reached
            grid.draw(panels[1], error, "error: reference - position", _ERROR)
    return grid.finished()


def _torque_figure(result: SimulationResult, robot: StationRobot) -> Figure:
    grid = _Grid(result, robot, "joint torques", cells=robot.axes, units=robot.model.effort_units)
    torques = result.axes("tau", robot.name).T
    limits = zip(robot.gains.torque_limit, robot.model.effort_units, strict=True)
    for (panel,), torque, (limit, unit) in zip(grid.cells, torques, limits, strict=True):
        grid.draw(panel, torque, "torque", _VALUE)
        for sign in (-1, 1):
            if _NEAR * (sign * torque).max() >= limit:
                grid.draw(panel, np.full_like(torque, sign * limit), "torque limit", _LIMIT, dashed=True)
        grid.note(panel, f"limit ±{limit:g} {unit}" if np.isfinite(limit) else "no limit")
    return grid.finished()


def _tcp_figure(result: SimulationResult, robot: StationRobot) -> Figure:
    title = f"position of the tool '{robot.tcp}' in the world"
    grid = _Grid(result, robot, title, cells=["x", "y", "z"], units=["m"] * 3)
    for (panel,), coordinate in zip(grid.cells, result.pose("tcp", robot.name)[:, :3].T, strict=True):
        grid.draw(panel, coordinate, "tool centre point", _VALUE)
    return grid.finished()


class _Grid:
    """A figure with one cell an axis, each in its unit; a cell has a panel for the value and one for the error."""

    def __init__(
        self,
        result: SimulationResult,
        robot: StationRobot,
        title: str,
        *,
        cells: Sequence[str],
        units: Sequence[str],
        errors: bool = False,
    ) -> None:
        self._result, self._units, self._ratios = result, units, [3, 1.3] if errors else [3]
        columns = len(cells) if len(cells) <= 3 else int(np.ceil(np.sqrt(len(cells))))
        rows = -(-len(cells) // columns)
        self._size = max(3.4 * columns, 8.0), (2.9 if errors else 2.2) * rows + 1.3
        self._figure = Figure(figsize=self._size)
        places = self._figure.add_gridspec(rows, columns, **self._edges(), wspace=0.28, hspace=0.3 if errors else 0.4)
        self.cells = [self._cell(places[divmod(index, columns)], name) for index, name in enumerate(cells)]
        for index, (panels, unit) in enumerate(zip(self.cells, units, strict=True)):
            if index % columns == 0 or unit != units[index - 1]:
                for panel in panels:
                    panel.set_ylabel(f"error [{unit}]" if panel is not panels[0] else f"{_QUANTITIES[unit]} [{unit}]")
        for panels in self.cells[-columns:]:
            panels[-1].set_xlabel("time [s]")
        of_robot = "" if result.config.only_robot else f", {robot.name}"
        self._write(f"{result.config.name}{of_robot}: {title}", 0.25, fontsize=13, fontweight="bold")

    def draw(self, panel: Axes, values: Vector, label: str, colour: str, *, dashed: bool = False) -> None:
        """Draw a signal, shape (m,), over the time of the run."""
        style, width = ("--", 1.2) if dashed else ("-", 1.6)
        marker = "o" if len(values) == 1 else None  # a run that was stopped at its start
        panel.plot(self._result.times, values, style, label=label, color=colour, linewidth=width, marker=marker)

    def note(self, panel: Axes, text: str) -> None:
        """Write a few words into a corner of a panel."""
        panel.set_title(text, loc="right", fontsize=8, color=_LIMIT)

    def finished(self) -> Figure:
        """Return the figure, with a legend and, where the run was stopped, its end and the reason."""
        for panels, unit in zip(self.cells, self._units, strict=True):
            for panel in panels:
                self._fit(panel, _SMALLEST_SPAN[unit])
        if self._result.stopped_by:
            self._mark_stop()
        self._add_legend()
        self._figure.align_ylabels()
        return self._figure

    def _edges(self) -> dict[str, float]:
        """Return where the cells begin and end, as parts of the figure; fixed margins, since fitting them is slow."""
        width, height = self._size
        top = 1.3 if self._result.stopped_by else 1.05
        return {"left": 0.75 / width, "right": 1 - 0.2 / width, "bottom": 0.5 / height, "top": 1 - top / height}

    def _cell(self, place: SubplotSpec, name: str) -> list[Axes]:
        ratios = self._ratios
        inner = place.subgridspec(len(ratios), 1, height_ratios=ratios, hspace=0.12)
        panels = [self._figure.add_subplot(inner[row, 0]) for row in range(len(ratios))]
        panels[0].set_title(name, loc="left", fontsize=10)
        for panel in panels:
            panel.grid(color="0.9")
            panel.tick_params(labelsize=8, labelbottom=panel is panels[-1])
            panel.ticklabel_format(axis="y", useOffset=False)
            panel.spines[["top", "right"]].set_visible(False)
            end = self._result.stop_time
            panel.set_xlim(*((0.0, 1.04 * end) if end > 0 else (-0.1, 1.0)))
        return panels

    def _fit(self, panel: Axes, smallest: float) -> None:
        """Show all of the curves, but neither noise at full height nor what a diverging run ends with alone."""
        curves = np.array([line.get_ydata() for line in panel.get_lines()], dtype=float)
        if self._result.stopped_by == DIVERGED:
            curves = curves[:, : max(int(_TRUSTED * curves.shape[1]), 1)]
        values = np.clip(np.nan_to_num(curves), -_HUGE, _HUGE)
        half = max(0.54 * np.ptp(values), smallest / 2)
        middle = (values.min() + values.max()) / 2
        panel.set_ylim(middle - half, middle + half)

    def _mark_stop(self) -> None:
        result = self._result
        for panel in (panel for panels in self.cells for panel in panels):
            panel.axvline(result.stop_time, color=_STOP, linewidth=1.4, linestyle=":", label="stop")
        by_monitor = result.ending == "monitor"
        text = f"stopped by {result.stopped_by}: {result.message}" if by_monitor else result.message
        self._write(textwrap.shorten(text, int(14 * self._size[0]), placeholder=" ..."), 0.8, fontsize=9, color=_STOP)

    def _add_legend(self) -> None:
        """Say once, in a line under the title, what the curves of all panels are."""
        lines = {str(line.get_label()): line for cell in self.cells for panel in cell for line in panel.get_lines()}
        at = 0.1 / self._size[0], 1 - 0.54 / self._size[1]
        style: dict[str, Any] = {"ncols": len(lines), "frameon": False, "fontsize": 9}
        self._figure.legend(lines.values(), lines.keys(), loc="center left", bbox_to_anchor=at, **style)

    def _write(self, text: str, below_top: float, **style: Any) -> None:
        self._figure.text(0.2 / self._size[0], 1 - below_top / self._size[1], text, va="center", **style)
