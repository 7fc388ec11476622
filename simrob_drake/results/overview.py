"""A run at a glance: lines for a shell, a table of where all ended, and both with a film strip for a notebook."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable
from html import escape

import numpy as np

from simrob_drake.errors import shortened
from simrob_drake.results.record.run import RecordedRun

_WIDTH = 100  # characters of a line


def lines_of(result: RecordedRun) -> list[str]:
    """Return three lines: how a run ended, how much of it there is, and what its columns are called."""
    steps, speed = len(result.step_times) - 1, f"{result.realtime_rate:.0f} × real time"
    return [
        f"{result.config.name}: {result.message}",
        f"{len(result.times)} samples to {result.stop_time:.4g} s, {steps} steps, {speed}",
        shortened(f"{len(result.names)} columns: {', '.join(result.names)}", _WIDTH),
    ]


def table_of(result: RecordedRun) -> list[list[str]]:
    """Return headings, and where every joint ended and its torques; without robots, where the free pieces ended."""
    if not result.plant.robots:
        return _piece_table(result)
    kinematic = result.config.mode == "kinematic"
    table = [["joint", "reference", "position", "unit", "torque", "peak torque", "limit", "unit"]]
    for robot in result.plant.robots.values():
        for index, (axis, limit) in enumerate(zip(robot.axes, robot.gains.torque_limit, strict=True)):
            reference, position, torque = (result[f"{robot.prefix}{s}.{axis}"] for s in ("q_ref", "q", "tau"))
            ends = [f"{values[-1] / robot.model.user_units[index]:.3f}" for values in (reference, position)]
            unit, effort = robot.model.unit_names[index], robot.model.effort_units[index]
            peak = torque[np.argmax(np.abs(torque))]
            shown_limit = "–" if kinematic else f"{limit:g}"
            table.append(
                [f"{robot.prefix}{axis}", *ends, unit, f"{torque[-1]:.3f}", f"{peak:.3f}", shown_limit, effort]
            )
    return table


def html_of(result: RecordedRun) -> str:
    """Return lines, film strip and table as HTML."""
    from simrob_drake.results.animation.pictures import film_strip  # which loads matplotlib

    strip = b64encode(film_strip(result)).decode()
    head, *rows = table_of(result)
    cells = "".join(_row("td", row) for row in rows)
    return (
        f"<p>{'<br>'.join(map(escape, lines_of(result)))}</p>"
        f'<img alt="film strip" style="max-width: 100%" src="data:image/png;base64,{strip}">'
        f"<table>{_row('th', head)}{cells}</table>"
    )


def _row(kind: str, cells: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<{kind}>{escape(cell)}</{kind}>' for cell in cells)}</tr>"


def _piece_table(result: RecordedRun) -> list[list[str]]:
    table = [["piece", "x [m]", "y [m]", "z [m]", "speed [m/s]"]]
    for piece in result.config.free_pieces:
        place, velocity = result.piece_pose(piece)[-1, :3], result.piece_velocity(piece)[-1, :3]
        table.append([piece, *(f"{value:.4f}" for value in place), f"{np.linalg.norm(velocity):.4f}"])
    return table
