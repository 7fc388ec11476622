"""Walks that are pushed twice, 0.2 to 0.5 s apart: ``python -m tests.benchmarks.two_pushes [ROBOT[:DRAWS]]...``.

Both pushes last 0.1 s and come from any side; the first acts 2.5 to 3.2 s after the start. Robot and floor are drawn,
too. A walk that is up 2 s after the second push has withstood both. Figures are in docs/results/walking.md.
"""

import sys

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.extensions.tuning.doubts import drawn

FORCES = {"zjudancer": 20.0, "roid1": 7.0, "humanoid": 15.0, "yobotics": 110.0}  # N
DRAWS = 50


def withstands(robot: str, seed: int) -> bool:
    """Return whether a robot is still up after the two pushes of a seed."""
    random, station = np.random.default_rng(100 + seed), f"{robot}_walking"
    first, gap = random.uniform(2.5, 3.2), random.uniform(0.2, 0.5)
    settings = {**drawn(load_station(station), 500 + seed), "duration": first + gap + 2.3}
    for name, start in (("first", first), ("second", first + gap)):
        angle = random.uniform(0.0, 2.0 * np.pi)
        force = [FORCES[robot] * float(np.cos(angle)), FORCES[robot] * float(np.sin(angle)), 0.0]
        settings[f"forces.{name}"] = {"kind": "push", "start": start, "force": force}
    return simulate(load_station(station, settings), progress=False).ending == "completed"


def main(robots: list[str]) -> None:
    """Push each robot, and say how often it stays up."""
    for asked in robots or list(FORCES):
        robot, _, count = asked.partition(":")
        draws = int(count or DRAWS)
        print(
            f"{robot}: {sum(withstands(robot, seed) for seed in range(draws))} of {draws}",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
