"""Points of exercise 2: each runs the station irb120_dynamic with what the answer gives."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.base.errors import one_of
from simrob_drake.extensions.course.measuring import (
    Reading,
    at_least,
    at_most,
    number,
    numbers,
    value_of,
)

TARGET = 30.0  # deg


def run(**settings: object) -> SimulationResult:
    """Run the move with settings of the servos."""
    station = load_station(
        "irb120_dynamic", {f"servo.{key}": value for key, value in settings.items()}
    )
    return simulate(station, duration=3.0, progress=False)


def with_gains(answer: ModuleType) -> SimulationResult:
    """Run the move with the answer's gains."""
    kp, kd = numbers(answer, "gains", shape=(2,))
    return run(kp=float(kp), kd=float(kd))


def sag(answer: ModuleType) -> Reading:
    """Compare with runs."""
    missed = []
    for kp in (500.0, 2000.0, 5000.0):
        measured = np.rad2deg(run(kp=kp)["q.joint_2"][-1]) - TARGET
        missed.append(abs(number(answer, "sag", kp) / measured - 1))
    return at_most(100 * max(missed), 5, "%")


def final_error(answer: ModuleType) -> Reading:
    """Look where the joints end."""
    return at_most(np.abs(np.rad2deg(with_gains(answer).axes("q")[-1]) - TARGET).max(), 0.4, "deg")


def overshoot(answer: ModuleType) -> Reading:
    """Look how far the joints went beyond their end."""
    q = np.rad2deg(with_gains(answer).axes("q"))
    return at_most((q.max(axis=0) - q[-1]).max(), 0.25, "deg")


def peak_torque(answer: ModuleType) -> Reading:
    """Look at the torque of joint 2."""
    return at_most(np.abs(with_gains(answer)["tau.joint_2"]).max(), 45, "N·m")


def missed_with(limit: float) -> float:
    """Return the largest error of joint 2 [deg] in the last half second with a limit of its torque."""
    result = run(torque_limit={"joint_2": limit})
    return float(np.abs(np.rad2deg(result["q.joint_2"][result.times > 2.5]) - TARGET).max())


def enough(answer: ModuleType) -> Reading:
    """Run with the limit."""
    return at_most(missed_with(number(answer, "torque_limit")), 1.5, "deg")


def just_enough(answer: ModuleType) -> Reading:
    """Run with a little less, which must not do."""
    return at_least(missed_with(0.95 * number(answer, "torque_limit")), 1.5, "deg")


def disturbed(answer: ModuleType) -> Reading:
    """Look how far each joint strays from its reference."""
    weak = run(torque_limit=10.0)
    strayed = np.abs(weak.axes("q") - weak.axes("q_ref")).max(axis=0)
    others = {
        f"joint_{index + 1}": float(value) for index, value in enumerate(strayed) if index != 1
    }
    name = one_of("joint besides joint_2", value_of(answer, "disturbed"), others)
    return at_least(others[name] / max(others.values()), 1)
