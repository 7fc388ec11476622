"""What the command line shows: results, findings and robots as tables."""

from __future__ import annotations

import numpy as np
from rich.table import Table
from rich.text import Text

from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.checks import Finding

_MARKS = {"ok": "[green]ok[/]", "warning": "[yellow]warning[/]"}


def result_table(result: SimulationResult) -> Table:
    """Return where every joint ended, and its torques; without robots, where the free pieces ended."""
    if not result.plant.robots:
        return _piece_table(result)
    table = _numbers("joint", "reference [deg]", "position [deg]", "torque [N·m]", "peak torque [N·m]", "limit [N·m]")
    kinematic = result.config.mode == "kinematic"
    for robot in result.plant.robots.values():
        for axis, limit in zip(robot.axes, robot.gains.torque_limit, strict=True):
            reference, position, torque = (result[f"{robot.prefix}{s}.{axis}"] for s in ("q_ref", "q", "tau"))
            angles = [f"{np.rad2deg(values[-1]):.3f}" for values in (reference, position)]
            peak = torque[np.argmax(np.abs(torque))]
            shown_limit = "–" if kinematic else f"{limit:g}"
            table.add_row(f"{robot.prefix}{axis}", *angles, f"{torque[-1]:.3f}", f"{peak:.3f}", shown_limit)
    return table


def _piece_table(result: SimulationResult) -> Table:
    table = _numbers("piece", "x [m]", "y [m]", "z [m]", "speed [m/s]")
    for piece in result.config.free_pieces:
        place, velocity = result.piece_pose(piece)[-1, :3], result.piece_velocity(piece)[-1, :3]
        table.add_row(piece, *(f"{value:.4f}" for value in place), f"{np.linalg.norm(velocity):.4f}")
    return table


def convergence_table(result: SimulationResult, tight: SimulationResult) -> Table:
    """Return the largest difference of every joint between a run and a tighter one, over their common time."""
    common = min(len(result.times), len(tight.times))
    table = _numbers("joint", "largest difference [rad]", "at [s]", "in torque at the end [N·m]")
    table.title = "against a run ten times tighter"
    for robot in result.plant.robots.values():
        for axis in robot.axes:
            column = f"{robot.prefix}q.{axis}"
            difference = np.abs(result[column][:common] - tight[column][:common])
            worst = int(np.argmax(difference))
            torque = f"{robot.prefix}tau.{axis}"
            end = abs(result[torque][common - 1] - tight[torque][common - 1])
            table.add_row(
                f"{robot.prefix}{axis}", f"{difference[worst]:.2e}", f"{result.times[worst]:.2f}", f"{end:.2e}"
            )
    for piece in result.config.free_pieces:
        ways = result.piece_pose(piece)[:common, :3] - tight.piece_pose(piece)[:common, :3]
        distance = np.linalg.norm(ways, axis=1)
        worst = int(np.argmax(distance))
        table.add_row(piece, f"{distance[worst]:.2e} m", f"{result.times[worst]:.2f}", "–")
    return table


def findings_table(findings: list[Finding]) -> Table:
    """Return the findings of a check, a row each."""
    table = Table("", "subject", "finding", box=None, pad_edge=False)
    for finding in findings:
        table.add_row(_MARKS[finding.level], finding.subject, finding.text)
    return table


def robot_table(robot: RobotModel) -> Table:
    """Return the axes of a robot with their limits."""
    table = _numbers("axis", "lower [deg]", "upper [deg]", "effort [N·m]")
    table.title = f"{robot.name}: {len(robot.axes)} axes, {robot.base} base"
    lower, upper = np.rad2deg(robot.axis_limits)
    for axis, low, high, effort in zip(robot.axes, lower, upper, robot.efforts, strict=True):
        table.add_row(axis, f"{low:.1f}", f"{high:.1f}", f"{effort:g}")
    return table


def _numbers(first: str, *others: str) -> Table:
    """Return an empty table whose first column is a name and whose others are numbers."""
    table = Table(first, box=None, pad_edge=False)
    for heading in others:
        table.add_column(Text(heading), justify="right")  # text: [s] would be a mark-up
    return table
