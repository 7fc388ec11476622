"""What the joints of a station are asked to do: constants, inputs held at the start, or sources sampled in a table."""

from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.simulink.mechanics.joints import Freedom
from simrob_drake.simulink.signals.forms import Form
from simrob_drake.simulink.signals.sources import step_times, value_over_time

_CORNER = 2e-6  # s: how long a step takes
RATE = 200.0
"""Rows a second of a table of sources."""


def reference(
    axes: dict[Freedom, str], wanted: dict[Freedom, Form], start: dict[str, float], duration: float, table: Path
) -> dict[str, Any]:
    """Return the reference section of a robot.

    Args:
        axes: names by degree of freedom.
        wanted: positions as sums of inputs, sources and constants [rad or m].
        start: where each axis is at the beginning, by name [rad or m].
        duration: of the run [s].
        table: the CSV file to write where sources move the joints.
    """
    moving = any(term.kind == "source" for form in wanted.values() for term in form)
    if not moving:
        targets = {
            name: _held(wanted.get(freedom, {}), start[name]) / (np.pi / 180 if freedom.turns else 1.0)
            for freedom, name in axes.items()
        }
        resting = {name: start[name] / (np.pi / 180 if freedom.turns else 1.0) for freedom, name in axes.items()}
        if targets == resting:
            return {"kind": "hold"}
        return {"kind": "hold", "target_deg": {name: float(f"{value:.12g}") for name, value in targets.items()}}
    corners = [corner for form in wanted.values() for corner in step_times(form) if 0 < corner < duration]
    even = np.linspace(0.0, duration, round(duration * RATE) + 1)
    times = np.unique(np.concatenate([even, corners, np.array(corners) - _CORNER]))
    columns: dict[str, Vector] = {"time": times}
    for freedom, name in axes.items():
        form = wanted.get(freedom, {})
        rest = np.full_like(times, start[name])
        columns[name] = value_over_time(form, times) if _known(form) and form else rest
    rows = np.column_stack(list(columns.values()))
    np.savetxt(table, rows, fmt="%.12g", delimiter=",", header=",".join(columns), comments="")
    return {"kind": "table", "file": table.name, "interpolation": "linear"}


def _known(form: Form) -> bool:
    return not any(term.kind == "input" for term in form)


def _held(form: Form, start: float) -> float:
    """Return a constant position; an input is taken to hold the start."""
    constants = [term.kind == "one" for term in form]
    return float(sum(form.values())) if form and all(constants) else start
