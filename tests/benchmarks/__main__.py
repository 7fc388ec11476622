"""Measure speed and memory, as ratios within one run: ``python -m tests.benchmarks``.

Every comparison takes its candidates in turn, so that a machine whose speed drifts treats them alike; the figures are
medians, and of ratios the median of the pairs.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from simrob_drake import load_station, simulate
from tests.benchmarks.branches import every_branch
from tests.benchmarks.costs import costs, runner
from tests.benchmarks.hand_wired import stepping_time as hand_wired_time
from tests.benchmarks.importing import imports
from tests.benchmarks.kinematics import inverse_kinematics
from tests.benchmarks.mujoco_humanoid import beside_mujoco
from tests.benchmarks.mujoco_stations import stations_in_mujoco
from tests.benchmarks.programs import attaching, planning
from tests.benchmarks.turns import ROUNDS, in_turn
from tests.benchmarks.verdicts import verdicts

REALIZATIONS = ("per_joint", "vector", "implicit")


def against_hand_wired() -> Table:
    """Stepping of the station against the shortest Drake program with the same blocks and solver."""
    table = Table(
        "realization",
        "station [ms]",
        "by hand [ms]",
        "ratio",
        title="stepping irb120_dynamic for 3 s",
    )
    for realization in REALIZATIONS:
        config = load_station("irb120_dynamic", {"servo.realization": realization})
        times = in_turn(
            {
                "station": lambda config=config: simulate(config).stepping_time,
                "hand": lambda realization=realization: hand_wired_time(realization),
            }
        )
        station, hand = (1e3 * np.median(times[name]) for name in ("station", "hand"))
        ratio = np.median(times["station"] / times["hand"])
        table.add_row(realization, f"{station:.1f}", f"{hand:.1f}", f"{ratio:.3f}")
    return table


def realtime_rates() -> Table:
    """Simulated over wall time of stepping and signals, with the largest error against a converged run."""
    headings = (
        "realization",
        "× real time",
        "stepping [ms]",
        "signals [ms]",
        "largest error [rad]",
    )
    table = Table(*headings, title="realtime_rate of irb120_dynamic")
    converged = simulate(
        load_station("irb120_dynamic", {"solver.accuracy": 1e-6, "solver.max_step": 0.005})
    )
    configs = {
        name: load_station("irb120_dynamic", {"servo.realization": name}) for name in REALIZATIONS
    }
    runs = {name: [] for name in REALIZATIONS}
    for _ in range(ROUNDS + 1):
        for name, config in configs.items():
            runs[name].append(simulate(config))
    for name, results in runs.items():
        rate, stepping, signals = (
            np.median([getattr(result, figure) for result in results[1:]])
            for figure in ("realtime_rate", "stepping_time", "signal_time")
        )
        error = np.abs(results[0].axes("q") - converged.axes("q")).max()
        table.add_row(
            name, f"{rate:.0f}", f"{1e3 * stepping:.1f}", f"{1e3 * signals:.1f}", f"{error:.5f}"
        )
    return table


def contact() -> Table:
    """Speed of the stations with contact and force, and what sensors that only report cost while stepping."""
    table = Table(
        "station", "× real time", "stepping [ms]", "signals [ms]", title="contact and force"
    )
    stations = ("bouncing_ball", "box_on_floor", "irb120_force_stop", "irb120_cobot")
    for name in stations:
        results = [simulate(load_station(name)) for _ in range(ROUNDS + 1)][1:]
        figures = ("realtime_rate", "stepping_time", "signal_time")
        rate, stepping, signals = (
            np.median([getattr(result, figure) for result in results]) for figure in figures
        )
        table.add_row(name, f"{rate:.0f}", f"{1e3 * stepping:.1f}", f"{1e3 * signals:.1f}")
    ball = load_station("bouncing_ball")
    stop = load_station("irb120_force_stop", {"reference.target_deg": [0, 0, 26.1, 0, 63.9, 0]})
    pairs = {
        "sensors of the ball against none": (ball, ball.model_copy(update={"sensors": {}})),
        "monitor of a distance against none": (stop, stop.model_copy(update={"monitors": {}})),
    }
    for name, (more, less) in pairs.items():
        candidates = {"more": more, "less": less}
        times = in_turn(
            {
                key: lambda config=config: simulate(config).stepping_time
                for key, config in candidates.items()
            }
        )
        table.add_row(name, "", f"ratio {np.median(times['more'] / times['less']):.3f}", "")
    return table


def whole_commands() -> Table:
    """Import time, and the command from start to finished recording, with its peak memory."""
    table = Table("whole processes", "median", "worst")
    with tempfile.TemporaryDirectory() as folder:
        run = [sys.executable, "-m", "simrob_drake.cli", "run", "--force", "--out"]
        program = Path(__file__).parents[2] / "examples" / "belt_pick.yaml"
        commands = {
            "python -c pass": [sys.executable, "-c", "pass"],
            "import of simulate": [sys.executable, "-c", "from simrob_drake import simulate"],
            "simrob run irb120_dynamic": [*run, str(Path(folder) / "result"), "irb120_dynamic"],
            "simrob run belt_pick.yaml": [*run, str(Path(folder) / "program"), str(program)],
        }
        times = in_turn(
            {
                name: lambda command=command: _wall_time(command)
                for name, command in commands.items()
            },
            5,
        )
    for name, values in times.items():
        table.add_row(f"{name} [s]", f"{np.median(values):.2f}", f"{values.max():.2f}")
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / (
        1e6 if sys.platform == "darwin" else 1e3
    )
    table.add_row("peak memory of a child [MB]", f"{peak:.0f}", "")
    return table


def _wall_time(command: list[str]) -> float:
    began = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - began


def main() -> None:
    """Print all tables."""
    console = Console(markup=False)
    measures = (
        whole_commands,  # these two first: a child's peak of memory counts the process that it is made from
        imports,
        against_hand_wired,
        realtime_rates,
        costs,
        runner,
        contact,
        verdicts,
        inverse_kinematics,
        every_branch,
        planning,
        attaching,
        beside_mujoco,
        stations_in_mujoco,
    )
    for measure in measures:
        console.print(measure())


if __name__ == "__main__":
    main()
