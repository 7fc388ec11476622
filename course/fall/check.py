"""Points of exercise 10: a humanoid is pushed over, with the answer's guard."""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import Any

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.extensions.course.measuring import Reading, at_least, at_most, value_of

END = 0.7  # s, of the push
PUSHES = (3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 14.0)  # N
ACTS = np.deg2rad(5)  # that a guard asks for


def run(force: float, blocks: Any = ()) -> SimulationResult:
    """Push the trunk for 0.2 s."""
    station = load_station(
        "humanoid_fall_forward", {"controllers": {}, "forces.shove.force": [0, force, 0]}
    )
    return simulate(station, blocks=blocks, duration=3.0, progress=False)


@cache
def guarded(answer: ModuleType, force: float) -> SimulationResult:
    """Push with the answer's guard."""
    return run(force, [value_of(answer, "Guard")])


def leans(result: SimulationResult) -> np.ndarray:
    """Return by how much the trunk leans ahead [rad]."""
    pose = result.pose("base")
    return 2 * np.arctan2(pose[:, 4], pose[:, 3])


def foreseen(answer: ModuleType) -> Reading:
    """Ask after each push, and look whether it has fallen ahead at the end."""
    right = 0
    for force in PUSHES:
        result = run(-force)
        lean, at = leans(result), round(END * result.config.sample_rate)
        rate = (lean[at + 1] - lean[at - 1]) / (result.times[at + 1] - result.times[at - 1])
        right += bool(value_of(answer, "tips", float(lean[at]), float(rate))) == bool(lean[-1] > 1)
    return at_least(right, len(PUSHES))


def head(answer: ModuleType, forces: tuple[float, ...]) -> float:
    """Return how near the head comes to the floor [mm]; a run that ends early counts as zero."""
    results = [guarded(answer, force) for force in forces]
    return min(
        1e3 * float(result["distance.head"].min()) * (result.ending == "completed")
        for result in results
    )


def ahead(answer: ModuleType) -> Reading:
    """Let it fall on its hands."""
    return at_least(head(answer, (-8.0, -12.0, -16.0)), 100, "mm")


def back(answer: ModuleType) -> Reading:
    """Let it fall back: pushed so, and after it has rocked."""
    return at_least(head(answer, (-6.0, 8.0)), 100, "mm")


def early(answer: ModuleType) -> Reading:
    """Look how far it leans as the guard acts."""
    result = guarded(answer, -12.0)
    acts = np.abs(result.axes("q_ref")).max(axis=1) > ACTS
    return at_most(np.rad2deg(leans(result)[np.argmax(acts)]) if acts.any() else np.nan, 25, "deg")


def calm(answer: ModuleType) -> Reading:
    """Push so weakly that nothing is to be done; a guard that fails is none."""
    result = guarded(answer, -5.0)
    asked = np.rad2deg(np.abs(result.axes("q_ref")).max())
    return at_most(asked if result.ending == "completed" else np.nan, 1, "deg")
