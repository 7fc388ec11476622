"""What a robot on legs is tried at: to stand, to shift its weight, to step on the spot, to walk for ten seconds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.errors import SimrobError
from simrob_drake.results.record.walks import locomotion
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation.runner import simulate
from simrob_drake.stations.load import load_station

_SECONDS = 10.0
_STARTS = 0.5  # s
_CREEP = 1e-3  # m/s: asked for of a robot that steps on the spot
_FLAT = 1e-4  # m: the lift of a foot that only gives its weight away
_LEANS = 10.0  # deg
_PART = 0.5  # of the way asked for that a walk is to come at least
TRIALS = "stands", "shifts its weight", "steps", "walks"


@dataclass(frozen=True)
class Attempt:
    """What became of one of the trials.

    Attributes:
        trial: which.
        done: whether the robot can do it.
        outcome: what happened, in words.
        ahead: how far it came [m].
        result: the run; None if it could not begin.
    """

    trial: str
    done: bool
    outcome: str
    ahead: float = 0.0
    result: SimulationResult | None = None

    @property
    def lasted(self) -> float:
        """How long the run was [s]."""
        return 0.0 if self.result is None else self.result.stop_time


def attempt(station: Path, trial: str, speed: float = 0.0) -> Attempt:
    """Return what becomes of a trial of a station whose only loop, of all but the first trial, is ``walk``.

    Args:
        station: whose.
        trial: one of :data:`TRIALS`.
        speed: of the walk [m/s].
    """
    asked = {TRIALS[0]: 0.0, TRIALS[3]: speed}.get(trial, _CREEP)
    overrides: dict[str, Any] = {"duration": _STARTS + _SECONDS}
    if asked:
        overrides["controllers.walk.commands"] = [{"time": _STARTS, "ahead": asked}]
    if trial == TRIALS[1]:
        overrides["controllers.walk.gait.lift"] = _FLAT
    try:
        result = simulate(load_station(station, overrides), progress=False)
    except SimrobError as problem:
        return Attempt(trial, False, str(problem))
    if result.ending == "diverged":
        return Attempt(trial, False, f"diverged at {result.stop_time:.1f} s", result=result)
    found = locomotion(result)
    lean, far = np.rad2deg(found.tilt), f"{found.ahead:.2f} m ahead and {abs(found.drift):.2f} m aside"
    if result.ending != "completed":
        return Attempt(trial, False, f"fell at {result.stop_time:.1f} s ({far})", found.ahead, result)
    if trial == TRIALS[3] and found.ahead < _PART * speed * _SECONDS:
        outcome = f"stays on its feet but comes only {far}, of {speed * _SECONDS:.2f} m"
        return Attempt(trial, False, outcome, found.ahead, result)
    outcome = f"{_SECONDS:g} s, {far}, leans by {lean:.0f} deg at most"
    outcome += f"; its busiest joint takes {found.peak_torque['ratio']:.0%} of its torque"
    return Attempt(trial, trial != TRIALS[0] or bool(lean < _LEANS), outcome, found.ahead, result)
