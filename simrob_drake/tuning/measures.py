r"""What a run is judged by: figures of its signals, one column of a table each.

With several robots each has its own, ``<robot>.<measure>``. Errors are of all axes of a robot, in radians, and metres
for axes that slide.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from simrob_drake.results.record.run import DIVERGED, FAILED, RecordedRun
from simrob_drake.results.record.walks import legged_robots, locomotion, mechanical_work

UNITS = {
    "tracking_error": "rad",
    "final_error": "rad",
    "overshoot": "of the move",
    "peak_torque": "of the limit",
    "work": "J",
    "distance": "m",
    "ahead": "m",
    "speed": "m/s",
    "tilt": "rad",
    "smallest_height": "m",
    "cost_of_transport": "–",
    "fall": "of the runs",
    "margin": "× the push",
}
"""The measures of :func:`measures` and their units."""
SIGNED = ("ahead", "speed", "smallest_height")
"""Those that may be negative."""
_WALKS = ("distance", "ahead", "speed", "tilt", "smallest_height", "cost_of_transport")
_STILL = 1e-3  # a reference that moves less has nothing to overshoot [rad or m]


def measures(run: RecordedRun) -> dict[str, float | None]:
    r"""Return the figures of a run; a run that diverged has none, and None stands for what means nothing.

    ``tracking_error`` is the root of the mean of :math:`(q_{ref} - q)^2` over samples and axes, ``final_error`` the
    largest :math:`|q_{ref} - q|` at the end, ``overshoot`` by how much a joint goes beyond all that its reference
    does, as a part of that, ``peak_torque`` the largest :math:`|\tau| / \tau_{max}`, and ``work``
    :math:`\int \sum_i |\tau_i \dot q_i| \, dt`. Legged robots have those of
    :class:`~simrob_drake.results.record.walks.Locomotion`, too, and ``fall``, 1 if a fall ended the run, else 0.
    """
    found: dict[str, float | None] = {}
    if run.ending in (DIVERGED, FAILED):
        return found
    walkers = legged_robots(run)
    for name, robot in run.plant.robots.items():
        own = _of_joints(run, name)
        if name in walkers:
            walk = locomotion(run, name)
            own |= {measure: getattr(walk, measure) for measure in _WALKS}
            own["fall"] = float(not walk.upright)
        found |= {f"{robot.prefix}{measure}": value for measure, value in own.items()}
    return found


def _of_joints(run: RecordedRun, robot: str) -> dict[str, float | None]:
    reference, position = run.axes("q_ref", robot), run.axes("q", robot)
    error, low, high = reference - position, reference.min(axis=0), reference.max(axis=0)
    moving = high - low > _STILL
    beyond = (np.maximum(position - high, low - position)[:, moving]) / (high - low)[moving]
    limit = run.plant.robots[robot].gains.torque_limit
    return {
        "tracking_error": float(np.sqrt(np.mean(error**2))),
        "final_error": float(np.abs(error[-1]).max()),
        "overshoot": float(max(beyond.max(), 0.0)) if moving.any() else None,
        "peak_torque": float((np.abs(run.axes("tau", robot)) / limit).max()) if np.isfinite(limit).all() else None,
        "work": mechanical_work(run, robot),
    }


def measured(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[tuple[float, int]]]:
    """Return for each measure of a table its finite values, each with the number of its run."""
    found: dict[str, list[tuple[float, int]]] = {}
    for row in rows:
        for name, value in row.items():
            if name.rpartition(".")[2] in UNITS and value is not None and np.isfinite(value):
                found.setdefault(name, []).append((value, row["number"]))
    return found
