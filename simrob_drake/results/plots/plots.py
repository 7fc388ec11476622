"""Plots of a run: joint positions, joint torques, the path of the tool and the way of a base that is free."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from simrob_drake.errors import OutputError
from simrob_drake.parts.site import StationRobot
from simrob_drake.results.plots.base_plot import base_figure
from simrob_drake.results.plots.panels import NOTE, Cell, Curve, Panel, Span, grid_figure, is_dense
from simrob_drake.results.plots.sensor_plots import sensor_figures
from simrob_drake.results.plots.side_groups import side_groups
from simrob_drake.results.record.locomotion import legged_robots
from simrob_drake.results.record.run import RecordedRun

_DPI = 110
_VALUE, _REFERENCE, _ERROR = "#1f6fb4", "#e08214", "#8c2d7a"
_DASHED = 0.75  # weight of dashed lines
_NEAR = 1.3  # a limit up to so many times the largest torque is drawn; one further away would flatten the curve
_QUANTITIES = {"deg": "position", "N·m": "torque", "N": "force", "m": "position"}
_SMALLEST_SPAN = {"deg": 0.1, "N·m": 0.01, "N": 0.01, "m": 0.001}
_ERROR_HEIGHT = 0.65  # inches
_LONG = 10.0  # a run of more than so many seconds whose curves run together is shown a second time, in part
_DETAIL = 3.0  # seconds of that part


def save_plots(result: RecordedRun, folder: Path) -> list[Path]:
    """Write the plots of a run as PNG files: ``position.png``, ``torque.png`` and, with a tool, ``tcp.png``.

    Robots that walk have ``base.png`` too. With several robots each has its own, ``<robot>_position.png`` and so on.
    Where a long run moves to and fro all the time, ``position_detail.png`` and ``torque_detail.png`` show three seconds
    of its middle. Free pieces have ``piece_<piece>.png``, and what was measured stands in ``sensors.png``.

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


def _figures(result: RecordedRun, robot: StationRobot) -> Iterator[tuple[str, Figure]]:
    of_robot = "" if result.config.only_robot else f", {robot.name}"
    tool = f"position of the tool '{robot.tcp}' in the world"
    contents: dict[str, tuple[str, Callable[[RecordedRun, StationRobot], list[Cell]]]] = {
        "position": (f"joint positions{of_robot}", _position_cells),
        "torque": (f"joint torques{of_robot}", _torque_cells),
    }
    for name, (title, cells_of) in contents.items():
        cells = cells_of(result, robot)
        yield name, grid_figure(result, title, cells)
        if result.stop_time > _LONG and is_dense([curve for cell in cells for curve in cell.panels[0].curves]):
            begin, end = span = _middle(result)
            yield f"{name}_detail", grid_figure(result, f"{title}, {begin:.2f} to {end:.2f} s", cells, span=span)
    if robot.tcp:
        yield "tcp", grid_figure(result, f"{tool}{of_robot}", _tcp_cells(result, robot))
    if robot.name in legged_robots(result):
        yield "base", base_figure(result, robot, f"way of the base{of_robot}")


def _middle(result: RecordedRun) -> Span:
    middle = result.stop_time / 2
    return middle - _DETAIL / 2, middle + _DETAIL / 2


def _position_cells(result: RecordedRun, robot: StationRobot) -> list[Cell]:
    """Draw each axis against its reference and, where there can be one, the error below."""
    wanted, reached = (result.axes(signal, robot.name) / robot.model.user_units for signal in ("q_ref", "q"))
    with np.errstate(invalid="ignore"):  # a diverging run may end with infinite positions
        error = wanted - reached
    cells = []
    for group in side_groups(robot):
        unit = robot.model.unit_names[group.first]
        smallest = _SMALLEST_SPAN[unit]
        curves = group.curves(reached, "position", _VALUE)
        curves += [
            Curve(wanted[:, place], "reference", _REFERENCE, _DASHED, dashed=True) for place in group.places.values()
        ]
        panels = [Panel(f"{_QUANTITIES[unit]} [{unit}]", curves, smallest)]
        if result.config.mode == "dynamic":
            errors = group.curves(error, "error: reference - position", _ERROR)
            panels.append(Panel(f"error [{unit}]", errors, smallest, _ERROR_HEIGHT))
        cells.append(Cell(group.name, panels))
    return cells


def _torque_cells(result: RecordedRun, robot: StationRobot) -> list[Cell]:
    torques, limits = result.axes("tau", robot.name), robot.gains.torque_limit
    cells = []
    for group in side_groups(robot):
        unit, places = robot.model.effort_units[group.first], list(group.places.values())
        curves = group.curves(torques, "torque", _VALUE)
        for limit in np.unique(limits[places]):
            for sign in (-1, 1):
                if _NEAR * (sign * torques[:, places]).max() >= limit:
                    curves.append(
                        Curve(np.full(len(torques), sign * limit), "torque limit", NOTE, _DASHED, dashed=True)
                    )
        said = " / ".join(f"±{limit:g} {unit}" if np.isfinite(limit) else "none" for limit in np.unique(limits[places]))
        note = f"limit {said}" if np.isfinite(limits[places]).any() else "no limit"
        panel = Panel(f"{_QUANTITIES[unit]} [{unit}]", curves, _SMALLEST_SPAN[unit], note=note)
        cells.append(Cell(group.name, [panel]))
    return cells


def _tcp_cells(result: RecordedRun, robot: StationRobot) -> list[Cell]:
    places = dict(zip("xyz", result.pose("tcp", robot.name)[:, :3].T, strict=True))
    label, smallest = "position [m]", _SMALLEST_SPAN["m"]
    return [Cell(x, [Panel(label, [Curve(way, "tool centre point", _VALUE)], smallest)]) for x, way in places.items()]
