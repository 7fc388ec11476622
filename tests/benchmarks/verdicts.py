"""What the verdict on a run costs, as part of stepping and signals: ``python -m tests.benchmarks.verdicts``.

Three per cent are allowed without contact figures, and fifteen with them.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
from rich.console import Console
from rich.table import Table

from simrob_drake import Runner
from simrob_drake.results.verdict.judge import verdict_of

STATIONS = {
    "irb120_kinematic": 15,
    "humanoid_fixed": 15,
    "irb120_dynamic": 15,
    "two_irb120": 15,
    "double_pendulum": 15,
    "bouncing_ball": 15,
    "box_on_floor": 15,
    "irb120_force_stop": 5,
    "humanoid_dynamic": 5,
    "yobotics_dynamic": 5,
    "roid1_walking": 1,
    "yobotics_walking": 1,
    "yobotics_terrain": 1,
}
"""How often each is run."""


def part(runner: Runner) -> float:
    """Run a station, and return what its verdict takes by a clock, as part of what the run took."""
    run = runner.run()
    began = perf_counter()
    verdict_of(run)
    return (perf_counter() - began) / run.wall_time


def verdicts() -> Table:
    """Return the median parts."""
    table = Table("station", "with contact", "verdict / run", "at most", title="what verdicts cost")
    for name, rounds in STATIONS.items():
        runner = Runner(name)
        part(runner)  # builds
        cost = np.median([part(runner) for _ in range(rounds)])
        contact = runner.config.contact is not None
        table.add_row(
            name, "yes" if contact else "no", f"{100 * cost:.1f} %", "15 %" if contact else "3 %"
        )
    return table


if __name__ == "__main__":
    Console(markup=False).print(verdicts())
