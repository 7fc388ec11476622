"""Points of exercise 5: an arm that presses on the floor, and runs that end by a force."""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import Any

import numpy as np

from simrob_drake import Arm, SimulationResult, load_station, simulate
from simrob_drake.extensions.course.measuring import Reading, at_least, at_most, number, value_of

STATION = "irb120_force_stop"
STRONG = {
    "servo.torque_limit": 500,
    "servo.kd": 50,
    "contact.friction": {"static": 0, "dynamic": 0},
}
FINE = {"sample_rate": 5000, "solver.accuracy": 1e-4, "solver.max_step": 0.01}
HOME = np.deg2rad([0, 0, 26.1, 0, 63.9, 0])
RADIUS = 0.01  # m, of the ball
DEEPEST = 0.06  # m


@cache
def arm() -> Arm:
    """Return the arm with its ball."""
    return Arm(load_station(STATION))


def run(depth: float, seconds: float = 2.0, rest: float = 1.0, **changes: Any) -> SimulationResult:
    """Let the reference go down to a depth [m] in so many seconds, and wait."""
    pose = arm().pose(HOME).copy()
    pose[2] = RADIUS - depth
    target = list(np.rad2deg(arm().joint(pose)))
    moves = {"reference.target_deg": target, "reference.duration": seconds}
    station = load_station(STATION, {**moves, "monitors": {}, **changes})
    return simulate(station, duration=seconds + rest, progress=False)


def pressed(depth: float, kp: float) -> float:
    """Return the force [N] at rest."""
    return float(run(depth, **STRONG, **{"servo.kp": kp})["force.touch.z"][-1])


def stiffness(answer: ModuleType) -> Reading:
    """Measure the slope between two depths."""
    missed = []
    for kp in (1000.0, 3000.0):
        slope = (pressed(0.012, kp) - pressed(0.006, kp)) / 0.006
        missed.append(number(answer, "stiffness", kp) / slope - 1)
    return at_most(100 * np.abs(missed).max(), 15, "%")


def press(answer: ModuleType) -> Reading:
    """Send the tip as deep as the answer says."""
    missed = [pressed(number(answer, "depth", force), 1000.0) - force for force in (40.0, 90.0)]
    return at_most(np.abs(missed).max(), 5, "N")


def stops(answer: ModuleType) -> Reading:
    """Let the answer's monitors end the run; one that goes to its end misses by its whole force."""
    missed = []
    for limit in (20.0, 80.0):
        result = run(DEEPEST, monitors=value_of(answer, "monitors", limit))
        missed.append(np.linalg.norm(result.vector("force.touch")[-1]) - limit)
    return at_most(np.abs(missed).max(), 3, "N")


@cache
def touching(seconds: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return times after touching, forces, and the speed [m/s] before, of a way down without a stop."""
    result = run(DEEPEST, seconds, rest=0.0, **FINE)
    force, gap, times = result["force.touch.z"], result["distance.gap"], result.times
    first = int(np.argmax(force > 0))
    speed = (gap[first - 20] - gap[first - 1]) / (times[first - 1] - times[first - 20])
    touched = times[first - 1] + gap[first - 1] / speed
    return times[first - 1 :] - touched, force[first - 1 :], float(speed)


def late(answer: ModuleType) -> Reading:
    """Compare forces a little after touching."""
    missed = []
    for seconds in (0.8, 1.5, 3.0):
        times, force, speed = touching(seconds)
        for delay in (0.001, 0.003):
            measured = np.interp(delay, times, force)
            missed.append(number(answer, "force_after", speed, delay) / measured - 1)
    return at_most(100 * np.abs(missed).max(), 12, "%")


def force_with(seconds: float) -> float:
    """Return the force [N] 4 ms after touching."""
    times, force, _ = touching(seconds)
    return float(np.interp(0.004, times, force))


def safe(answer: ModuleType) -> Reading:
    """Go down in the answer's time."""
    return at_most(force_with(number(answer, "shortest", 140.0)), 140, "N")


def quick(answer: ModuleType) -> Reading:
    """Go down a little quicker, which must be too much."""
    return at_least(force_with(0.85 * number(answer, "shortest", 140.0)), 140, "N")
