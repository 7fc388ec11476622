"""When feet slip: ``python -m tests.benchmarks.slipping [ROBOT]...``, for docs/results/walking.md.

Each walk that reacts goes 10 s undisturbed, as its station ships. A stance is a time in which a foot touches, of 50 ms
or more; for each foot, the mean of how far it slips in each tenth of a stance.
"""

import sys

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.frames import Vector
from simrob_drake.results.record.touch import Slide

ROBOTS = ("zjudancer", "roid1", "humanoid", "yobotics")
RATE, SHORTEST = 200, 0.05  # looks [Hz], and a stance at least [s]


def tenths(slide: Slide) -> tuple[int, Vector]:
    """Return how many stances a foot had, and the mean of how far it slipped in each tenth of them, shape (10,) [m]."""
    edges = np.flatnonzero(np.diff(np.pad(slide.touching.astype(int), 1)))
    stances = [
        (first, last) for first, last in zip(edges[::2], edges[1::2], strict=True) if last - first >= SHORTEST * RATE
    ]
    found = np.zeros(10)
    for first, last in stances:
        part = 10 * np.arange(last - first) // (last - first)
        found += np.bincount(part, slide.ways[first:last], minlength=10)
    return len(stances), found / max(len(stances), 1)


def main(robots: list[str]) -> None:
    """Walk and print."""
    for robot in robots or ROBOTS:
        result = simulate(load_station(f"{robot}_walking", {"duration": 10, "sample_rate": RATE}), progress=False)
        for (_, link), slide in result.touch.slides.items():
            count, found = tenths(slide)
            print(f"{robot} {link}: {count} stances, mm by tenth: {' '.join(f'{1e3 * each:.2f}' for each in found)}")


if __name__ == "__main__":
    main(sys.argv[1:])
