"""Points of exercise 8: a humanoid marches by the answer's moves."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.extensions.course.measuring import (
    Reading,
    at_least,
    at_most,
    number,
    numbers,
    value_of,
)

STEPS = 4
RIGHT = [
    ({"CadIF": 60, "RodI": 60}, {"CadDF": 60, "RodD": 60}),
    ({"RodD": 30, "TobD": -30}, {"RodI": 30, "TobI": -30}),
    ({"HomDF": 20, "CadIL": 5}, {"HomIF": 20, "CadDL": 5}),
    ({"TobI": 3, "RodD": -4, "CadDF": 1}, {"TobD": 3, "RodI": -4, "CadIF": 1}),
]


def mirror(answer: ModuleType) -> Reading:
    """Compare moves."""
    return at_least(
        sum(value_of(answer, "mirrored", move) == other for move, other in RIGHT), len(RIGHT)
    )


def march(moves: Sequence[Any], seconds: float, kd: float) -> SimulationResult:
    """Let the humanoid go through moves."""
    targets = [{"time": (k + 1) * seconds, "target_deg": move} for k, move in enumerate(moves)]
    changes = {"reference": {"kind": "sequence", "targets": targets}, "servo.kd": kd}
    return simulate(
        load_station("humanoid_dynamic", changes), duration=len(moves) * seconds + 1, progress=False
    )


@cache
def marched(answer: ModuleType) -> SimulationResult:
    """Return the march as the thesis's servos do it."""
    return march(value_of(answer, "moves", STEPS), 1.0, 100.0)


def way(result: SimulationResult) -> np.ndarray:
    """Return where the base went [m]; it looks along -y."""
    place = result.pose("base")[:, :3]
    return place[-1] - place[0] if result.ending == "completed" else np.full(3, np.nan)


def upright(answer: ModuleType) -> Reading:
    """Look whether it falls, and whether there are as many moves as four steps take."""
    result = marched(answer)
    return at_least(100 * result.stop_time / max(result.config.duration, 13.0), 100, "%")


def ahead(answer: ModuleType) -> Reading:
    """Look how far it goes."""
    return at_least(-1e3 * way(marched(answer))[1] / STEPS, 60, "mm")


def straight(answer: ModuleType) -> Reading:
    """Look how far it goes to the side: less than a tenth of a step, though each step sways."""
    moved = way(marched(answer))
    return at_most(1e3 * abs(moved[0]) if moved[1] < -0.1 else np.nan, 15, "mm")


def lagging(answer: ModuleType) -> Reading:
    """Let the neck turn along a ramp: no weight pulls at it, and it has hardly any inertia."""
    missed = []
    for kp, kd in ((100.0, 30.0), (200.0, 20.0), (50.0, 25.0)):
        ramp = {"kind": "ramp", "target_deg": {"neck_yaw": 60}, "duration": 4.0}
        # references stand still over a step
        servo = {
            "servo.kp": kp,
            "servo.kd": kd,
            "solver.max_step": 0.002,
        }
        result = simulate(
            load_station("humanoid_dynamic", {"reference": ramp, **servo}),
            duration=4.0,
            progress=False,
        )
        behind = (result["q_ref.neck_yaw"][-1] - result["q.neck_yaw"][-1]) / np.deg2rad(15)
        missed.append(number(answer, "lag", kp, kd) / behind - 1)
    return at_most(100 * np.abs(missed).max(), 10, "%")


@cache
def quick(answer: ModuleType) -> tuple[SimulationResult, float]:
    """Return the answer's quick march, and how long its moves take [s]."""
    kd, seconds = numbers(answer, "quick", shape=(2,))
    moves = value_of(answer, "moves", STEPS)
    return march(moves, float(seconds), float(kd)), len(moves) * float(seconds)


def speed(answer: ModuleType) -> Reading:
    """Look how fast it goes; one that falls has no speed."""
    result, seconds = quick(answer)
    return at_least(-1e3 * way(result)[1] / seconds, 45, "mm/s")


def turned(answer: ModuleType) -> Reading:
    """Look how far it turns."""
    pose = quick(answer)[0].pose("base")[-1]
    angle = np.rad2deg(2 * np.arctan2(pose[6], pose[3]))
    return at_most(abs(angle) if quick(answer)[0].ending == "completed" else np.nan, 10, "deg")
