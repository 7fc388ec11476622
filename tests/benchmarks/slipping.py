"""How far feet slip, and when: ``python -m tests.benchmarks.slipping [ROBOT[:DRAWS]]...``, for docs/results/walking.md.

Each walk that reacts goes 10 s undisturbed, as its station ships, and then with other draws of robot and floor. A
stance is a time in which a foot touches, of 60 ms or more; for each foot, the mean of how far it slips in each tenth of
a stance, and in a metre of the walk.
"""

import sys

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.base.frames import Vector
from simrob_drake.extensions.tuning.doubts import drawn
from simrob_drake.results.record.touch import Slide
from simrob_drake.results.record.walks import locomotion

ROBOTS = ("zjudancer", "roid1", "humanoid", "yobotics")
SHORTEST = 0.06  # a stance at least [s]


def tenths(slide: Slide, rate: float) -> tuple[int, Vector]:
    """Return how many stances a foot had, and the mean of how far it slipped in each tenth of them, shape (10,) [m]."""
    edges = np.flatnonzero(np.diff(np.pad(slide.in_contact.astype(int), 1)))
    stances = [
        (first, last)
        for first, last in zip(edges[::2], edges[1::2], strict=True)
        if last - first >= SHORTEST * rate
    ]
    found = np.zeros(10)
    for first, last in stances:
        part = 10 * np.arange(last - first) // (last - first)
        found += np.bincount(part, slide.distances[first:last], minlength=10)
    return len(stances), found / max(len(stances), 1)


def main(robots: list[str]) -> None:
    """Walk and print."""
    for asked in robots or ROBOTS:
        robot, _, draws = asked.partition(":")
        station = load_station(f"{robot}_walking")
        ways = []
        for draw in range(1 + int(draws or 0)):
            changed = drawn(station, 300 + draw) if draw else {}
            result = simulate(
                load_station(f"{robot}_walking", {**changed, "duration": 10}), progress=False
            )
            ahead, slides = locomotion(result).ahead, result.touch.slides.items()
            ways.append([1e3 * slide.total / ahead for _, slide in slides])
            if not draw:
                for ((_, link), slide), way in zip(slides, ways[0], strict=True):
                    count, found = tenths(slide, result.touch.rate)
                    parts = " ".join(f"{1e3 * each:.2f}" for each in found)
                    print(
                        f"{robot} {link}: {way:.0f} mm a metre, {count} stances, mm by tenth: {parts}",
                        flush=True,
                    )
        if draws:
            means = np.mean(ways[1:], axis=1)
            error = means.std(ddof=1) / np.sqrt(len(means))
            print(
                f"{robot}, {draws} draws: {means.mean():.0f} mm a metre and foot, standard error {error:.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])
