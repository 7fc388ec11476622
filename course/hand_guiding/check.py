"""Points of exercise 6: an arm that yields is pushed, stiff and with the answer's gains."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from simrob_drake import Arm, SimulationResult, as_transform, load_station, simulate
from simrob_drake.extensions.course.measuring import (
    Reading,
    at_least,
    at_most,
    near,
    number,
    numbers,
)

STATION = "irb120_cobot"
HOME = [0, 0, 0, 0, 90, 0]  # deg
FINE = {"solver.accuracy": 1e-3, "solver.max_step": 0.02}
RATE = 100  # Hz


def run(
    gain: float, force: list[float], seconds: float, kd: float = 10, rest: float = 0.0
) -> SimulationResult:
    """Push the tool from 0.5 s on."""
    push = {"kind": "push", "start": 0.5, "duration": seconds, "force": force}
    servo = {"servo.admittance_gain": gain, "servo.kd": kd}
    station = load_station(
        STATION, {**FINE, **servo, "forces": {"hand": push}, "sample_rate": RATE}
    )
    return simulate(station, duration=0.5 + seconds + rest, progress=False)


def felt(answer: ModuleType) -> Reading:
    """Push a stiff arm until it is at rest."""
    missed = []
    for force in ([5.0, 0, 0], [0, -4.0, 2.0], [1.0, 2.0, -6.0]):
        result = run(0.0, force, 2.5, kd=60)
        q, torque = result.axes("q")[-1], result.axes("tau")[-1]
        missed.append(numbers(answer, "hand_force", q, torque, shape=(3,)) - force)
    return at_most(np.abs(missed).max(), 0.1, "N")


def measured_speed(gain: float, force: list[float]) -> np.ndarray:
    """Return the tool's velocity [m/s] when it has begun to move and is still near HOME."""
    tool = run(gain, force, 0.5).pose("tcp")[:, :3]
    return (tool[95] - tool[70]) * RATE / 25


def speed(answer: ModuleType) -> Reading:
    """Compare velocities, along the measured one."""
    missed = []
    for gain, force in ((200.0, [0, 2.0, 0]), (300.0, [2.0, 0, 0]), (150.0, [0, 3.0, 1.0])):
        measured = measured_speed(gain, force)
        foreseen = numbers(answer, "speed", gain, np.array(force), shape=(3,))
        missed.append(foreseen @ measured / (measured @ measured) - 1)
    return at_most(100 * np.abs(missed).max(), 12, "%")


def chosen(answer: ModuleType) -> Reading:
    """Push with the answer's gain."""
    return near(measured_speed(number(answer, "gain_for", 0.1), [0, 3.0, 0])[0], 0.1, 0.01, "m/s")


def stiffest(answer: ModuleType) -> Reading:
    """Push along the answer's direction, and along the one that is the right one."""
    arm = Arm(load_station(STATION))
    axes, jacobian = (
        as_transform(arm.pose(np.deg2rad(HOME))).rotation().matrix(),
        arm.jacobian(np.deg2rad(HOME))[:3],
    )
    least = axes.T @ np.linalg.eigh(jacobian @ jacobian.T).eigenvectors[:, 0]
    direction = numbers(answer, "stiffest", shape=(3,))
    ways = (direction / np.linalg.norm(direction), least)
    speeds = [abs(measured_speed(200.0, list(2.0 * along)) @ (axes @ along)) for along in ways]
    return at_most(speeds[0] / speeds[1], 1.1)


def pushed(answer: ModuleType) -> tuple[float, float]:
    """Return the ways [mm] during a push and in the two seconds after it."""
    gain, kd = numbers(answer, "settings", shape=(2,))
    tool = run(float(gain), [0, 2.0, 0], 0.5, float(kd), rest=2.0).pose("tcp")[:, :3]
    return float(1e3 * np.linalg.norm(tool[100] - tool[50])), float(
        1e3 * np.linalg.norm(tool[-1] - tool[100])
    )


def moved(answer: ModuleType) -> Reading:
    """Look at the push."""
    return at_least(pushed(answer)[0], 40, "mm")


def stays(answer: ModuleType) -> Reading:
    """Look at what comes after it."""
    return at_most(pushed(answer)[1], 10, "mm")
