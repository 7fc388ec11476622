"""Points of exercise 9: a humanoid crouches by the answer's loop."""

from __future__ import annotations

from functools import cache
from types import ModuleType

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.extensions.course.measuring import Reading, at_least, at_most, value_of
from simrob_drake.robots.catalog import load_robot

HEIGHTS = (0.40, 0.37)  # m
SECONDS = 8.0
ARMS = ("right_shoulder_pitch", "left_shoulder_pitch")


@cache
def crouched(answer: ModuleType, height: float, trunk: float = 1.0) -> SimulationResult:
    """Let the answer's loop bring the hip to a height; the trunk may be heavier by a factor."""
    changes = {} if trunk == 1 else {"robot.mass_factors": {load_robot("humanoid").root: trunk}}
    station = load_station("humanoid_dynamic", changes)
    return simulate(
        station, blocks=[value_of(answer, "Height", height)], duration=SECONDS, progress=False
    )


def whole(result: SimulationResult, value: float) -> float:
    """Return a value of a run that went to its end, else no number."""
    return float(value) if result.ending == "completed" else float("nan")


def weights(answer: ModuleType) -> Reading:
    """Look whether the trunk stays upright while the legs bend in the answer's proportions, without any loop."""
    proportions = value_of(answer, "weights")
    targets = {axis: 60 * float(weight) for axis, weight in proportions.items()}
    bent = {"reference": {"kind": "move", "target_deg": targets, "duration": 4.0}}
    result = simulate(load_station("humanoid_dynamic", bent), duration=6.0, progress=False)
    pose = result.pose("base")
    lean = np.rad2deg(2 * np.hypot(pose[:, 4], pose[:, 5]).max())
    sunk = pose[0, 2] - pose[-1, 2]
    return at_most(whole(result, lean) if sunk > 0.02 else np.nan, 3, "deg")


def reached(answer: ModuleType) -> Reading:
    """Compare heights when all has settled."""
    missed = []
    for height in HEIGHTS:
        result = crouched(answer, height)
        late = result["base.z"][result.times > SECONDS - 2]
        missed.append(whole(result, 1e3 * np.abs(late - height).max()))
    return at_most(np.max(missed), 3, "mm")


def overshoot(answer: ModuleType) -> Reading:
    """Look how far it sinks too low, in runs that get down."""
    results = [(crouched(answer, height), height) for height in HEIGHTS]
    sunk = [whole(run, 1e3 * (height - run["base.z"].min())) for run, height in results]
    return at_most(np.max(sunk) if np.min(sunk) > -5 else np.nan, 10, "mm")


def heavier(answer: ModuleType) -> Reading:
    """Let a heavier robot crouch."""
    result = crouched(answer, HEIGHTS[0], 2.0)
    return at_most(whole(result, 1e3 * abs(result["base.z"][-1] - HEIGHTS[0])), 3, "mm")


def then(answer: ModuleType) -> Reading:
    """Look where the arms end."""
    result = crouched(answer, HEIGHTS[0])
    return at_least(
        whole(result, np.rad2deg(min(result[f"q.{arm}"][-1] for arm in ARMS))), 60, "deg"
    )


def before(answer: ModuleType) -> Reading:
    """Look what is asked of the arms while the hip is not there, in a run that gets there."""
    result = crouched(answer, HEIGHTS[0])
    far = np.abs(result["base.z"] - HEIGHTS[0]) > 0.01
    asked = max(np.rad2deg(np.abs(result[f"q_ref.{arm}"][far])).max() for arm in ARMS)
    return at_most(whole(result, asked) if not far[-1] else np.nan, 1, "deg")
