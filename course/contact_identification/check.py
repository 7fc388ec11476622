"""Points of exercise 4: balls that bounce on floors which the answer does not know."""

from __future__ import annotations

from functools import cache
from types import ModuleType

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.extensions.course.measuring import Reading, at_most, number, numbers

FLOORS = ((1400.0, 0.09), (5500.0, 0.22))  # N/m, s/m
SAMPLES, RATE, NOISE = 150, 250, 5e-4  # Hz, m


def bounce(
    stiffness: float, dissipation: float, seconds: float, height: float = 0.1
) -> SimulationResult:
    """Drop the ball."""
    changes = {
        "contact": {"model": "point", "stiffness": stiffness, "dissipation": dissipation},
        "pieces.ball.pose": [0, 0, 0.06 + height, 0, 0, 0],
        "sample_rate": RATE,
        "solver.accuracy": 1e-6,
        "solver.max_step": 0.002,
    }
    return simulate(load_station("bouncing_ball", changes), duration=seconds, progress=False)


def sink(answer: ModuleType) -> Reading:
    """Let the ball come to rest."""
    missed = [
        number(answer, "sink", k) + bounce(k, 5.0, 3.0, height=0.0)["distance.gap"][-1]
        for k in (1000.0, 3000.0, 8000.0)
    ]
    return at_most(1e3 * np.abs(missed).max(), 0.1, "mm")


def contact_time(answer: ModuleType) -> Reading:
    """Measure how long the ball is below the floor's height."""
    missed = []
    for k in (1000.0, 3000.0, 8000.0):
        result = bounce(k, 0.0, 0.4)
        times = np.linspace(0, 0.4, 4001)
        low = times[np.interp(times, result.times, result["distance.gap"]) < 0]
        missed.append(number(answer, "contact_time", k) / (low[-1] - low[0]) - 1)
    return at_most(100 * np.abs(missed).max(), 5, "%")


def measured(floor: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and heights of a bounce, with noise."""
    result = bounce(*FLOORS[floor], (SAMPLES - 1) / RATE)
    noise = np.random.default_rng(floor).normal(0, NOISE, SAMPLES)
    return result.times[:SAMPLES], result["distance.gap"][:SAMPLES] + noise


@cache
def found(answer: ModuleType) -> np.ndarray:
    """Return what the answer finds of each floor, shape (2, 2)."""
    return np.array(
        [numbers(answer, "identify", *measured(floor), shape=(2,)) for floor in range(len(FLOORS))]
    )


def stiffness(answer: ModuleType) -> Reading:
    """Compare stiffnesses."""
    return at_most(100 * np.abs(found(answer)[:, 0] / np.array(FLOORS)[:, 0] - 1).max(), 5, "%")


def dissipation(answer: ModuleType) -> Reading:
    """Compare dissipations."""
    return at_most(100 * np.abs(found(answer)[:, 1] / np.array(FLOORS)[:, 1] - 1).max(), 10, "%")


def again(answer: ModuleType) -> Reading:
    """Drop the ball onto the floors that were found."""
    missed = []
    for floor, (k, d) in enumerate(found(answer)):
        heights = measured(floor)[1]
        own = bounce(float(k), float(d), (SAMPLES - 1) / RATE)["distance.gap"][:SAMPLES]
        missed.append(np.sqrt(np.mean((heights - own) ** 2)))
    return at_most(1e3 * max(missed), 1.5, "mm")


def design(answer: ModuleType) -> Reading:
    """Measure how high the ball rises after its first bounce."""
    missed = []
    for height in (0.03, 0.05, 0.07):
        gap = bounce(4000.0, number(answer, "dissipation_for", height), 0.5)["distance.gap"]
        landed = int(np.argmax(gap < 0))
        missed.append(gap[landed:].max() - height)
    return at_most(1e3 * np.abs(missed).max(), 1, "mm")
