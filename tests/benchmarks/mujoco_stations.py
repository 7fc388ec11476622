"""Stations in MuJoCo beside Drake, in roll-outs a second: ``python -m tests.benchmarks.mujoco_stations``.

Both are built once. Drake's runs are those of a ``Runner`` with the station as it ships; MuJoCo's are one after the
other, and eight at once on two threads. A walk is that of the robot's gait, four steps with its reference alone.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from rich.console import Console
from rich.table import Table

from simrob_drake import LeggedRobot, load_station
from simrob_drake.simulation.runner import Runner
from simrob_drake.stations.config import StationConfig
from tests.benchmarks.turns import in_turn

WALKERS = ("zjudancer_dynamic", "yobotics_dynamic", "roid1_dynamic")
STEP = 2e-3
BATCH, ROUNDS = 8, 5


def stations_in_mujoco() -> Table:
    """Return roll-outs a second of both engines, or a table that says that MuJoCo is missing."""
    table = Table(
        "motion",
        "Drake, 1/s",
        "MuJoCo, 1/s",
        "ratio",
        "eight on two threads",
        "apart",
        title="roll-outs",
    )
    if importlib.util.find_spec("mujoco") is None:
        table.add_row("mujoco is not installed; the extra mujoco brings it")
        return table
    _add(table, "irb120_dynamic, 3 s", load_station("irb120_dynamic"), None)
    _add(
        table,
        "humanoid_dynamic stands, 3 s",
        load_station("humanoid_dynamic", {"duration": 3.0}),
        None,
    )
    for station in WALKERS:
        walk = LeggedRobot(station).walk(4)
        config = walk.config.model_copy(update={"duration": walk.stop_time})
        _add(table, f"{station} walks, {walk.stop_time:.1f} s", config, walk.references)
    return table


def _add(table: Table, told: str, config: StationConfig, reference: object) -> None:
    from simrob_drake.extensions.mujoco.runner import MujocoRunner, RunRequest

    drake, mujoco = Runner(config), MujocoRunner(config, step=STEP)
    one, other = drake.run(reference=reference), mujoco.run(reference=reference)
    candidates: dict[str, Callable[[], object]] = {
        "drake": partial(drake.run, reference=reference),
        "mujoco": partial(mujoco.run, reference=reference),
        "batch": partial(mujoco.runs, [RunRequest(reference=reference)] * BATCH, threads=2),
    }
    seconds = in_turn({name: partial(_seconds, run) for name, run in candidates.items()}, ROUNDS)
    rates = {name: 1 / np.median(values) for name, values in seconds.items()}
    common = min(len(one.times), len(other.times))
    place = "base" if one.plant.robots["robot"].floats else "tcp"
    apart = np.abs(one.pose(place)[:common, :3] - other.pose(place)[:common, :3]).max()
    ratio, batch = (np.median(seconds["drake"] / seconds[name]) for name in ("mujoco", "batch"))
    figures = (
        f"{rates['drake']:.2f}",
        f"{rates['mujoco']:.2f}",
        f"{ratio:.1f} ×",
        f"{BATCH * batch:.1f} ×",
    )
    table.add_row(told, *figures, f"{place} {1e3 * apart:.1f} mm")


def _seconds(run: Callable[[], object]) -> float:
    began = time.perf_counter()
    run()
    return time.perf_counter() - began


def main() -> None:
    """Print the table."""
    Console(markup=False).print(stations_in_mujoco())


if __name__ == "__main__":
    main()
