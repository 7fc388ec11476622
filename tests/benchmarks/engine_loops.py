"""Walks that react, stepped by Drake and by MuJoCo: ``python -m tests.benchmarks.engine_loops [STATION]...``.

Ratios are of processor time in one process, runs in turn: the whole run, and what its loop does not take.
"""

import sys
import time
from typing import Any

import numpy as np

from simrob_drake import load_station
from simrob_drake.parts.controllers import walk
from simrob_drake.simulation.runner import Runner

ROUNDS, SECONDS = 5, 10.0
STEPS = {
    "zjudancer_walking": 0.01,
    "roid1_walking": 0.005,
    "humanoid_walking": 0.005,
    "yobotics_walking": 0.005,
}


def main(stations: list[str]) -> None:
    """Run and print."""
    loop, sample = [0.0], walk.WalkingLoop.sample

    def timed(self: Any, *read: Any) -> Any:
        began = time.process_time()
        try:
            return sample(self, *read)
        finally:
            loop[0] += time.process_time() - began

    walk.WalkingLoop.sample = timed  # type: ignore[method-assign]
    for station in stations or STEPS:
        solver = {"kind": "mujoco", "time_step": STEPS[station]}
        runners = [Runner(load_station(station, own)) for own in ({}, {"solver": solver})]
        rows = []
        for _ in range(ROUNDS):
            for runner in runners:
                loop[0], began = 0.0, time.process_time()
                runner.run(duration=SECONDS)
                whole = time.process_time() - began
                rows.append((whole, whole - loop[0], loop[0]))
        drake, mujoco = np.median(np.array(rows).reshape(ROUNDS, 2, 3), axis=0)
        print(
            f"{station}: Drake {drake[0]:.2f} s ({drake[1]:.2f} s without its loop), MuJoCo {mujoco[0]:.2f} s "
            f"({mujoco[1]:.2f} s): {drake[0] / mujoco[0]:.2f} and {drake[1] / mujoco[1]:.2f} times as fast",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
