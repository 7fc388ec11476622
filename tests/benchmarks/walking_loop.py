"""What a sample of the loop `walk` costs, with reading and remembering: ``python -m tests.benchmarks.walking_loop``.

A robot walks by a command for some seconds in a process of its own; the table tells the median over its samples, and
that of the sample without what the diagram does for it.
"""

from __future__ import annotations

import sys
from time import perf_counter
from typing import Any
from unittest.mock import patch

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.parts.controllers.walk import WalkingLoop

ROBOTS = ("zjudancer", "roid1", "yobotics", "humanoid")
SECONDS = 8.0
COMMANDS = [{"time": 0.1, "ahead": 0.1}]


def timed(method: Any, times: list[float]) -> Any:
    """Return a method that adds how long each of its calls took [ms]."""

    def measured(*arguments: Any) -> Any:
        begins = perf_counter()
        try:
            return method(*arguments)
        finally:
            times.append(1e3 * (perf_counter() - begins))

    return measured


def costs(robot: str) -> tuple[float, float, int]:
    """Return the medians of a sample with and without the diagram's part [ms], and over how many samples."""
    whole, own = list[float](), list[float]()
    with (
        patch.object(WalkingLoop, "_update", timed(WalkingLoop._update, whole)),
        patch.object(WalkingLoop, "sample", timed(WalkingLoop.sample, own)),
    ):
        settings = {"controllers.walk.commands": COMMANDS}
        simulate(load_station(f"{robot}_walking", settings), duration=SECONDS, progress=False)
    return float(np.median(whole)), float(np.median(own)), len(whole)


if __name__ == "__main__":
    for name in sys.argv[1:] or ROBOTS:
        sample, alone, count = costs(name)
        print(
            f"{name}: {sample:.3f} ms a sample, of which the loop itself {alone:.3f} ms ({count} samples)",
            flush=True,
        )
