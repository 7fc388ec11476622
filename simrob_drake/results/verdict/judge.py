"""The criteria by which every run is judged: a further one is an entry here, and its bound in ``VerdictConfig``."""

from __future__ import annotations

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.verdict.criterion import Criterion, Measured
from simrob_drake.results.verdict.motion import MOTION, largest
from simrob_drake.results.verdict.verdict import Measure, Verdict


def _below_floor(run: RecordedRun) -> Measured | None:
    """Measure how deep tools in use, floating bases and free pieces were below the ground, negative above it."""
    if run.config.floor is None:
        return None
    robots = run.plant.robots.values()
    poses = {f"tool {robot.prefix}{robot.tcp}": f"{robot.prefix}tcp" for robot in robots if robot.tcp}
    poses |= {f"{robot.prefix}base": f"{robot.prefix}base" for robot in robots if robot.floats}
    poses |= {piece: f"piece.{piece}" for piece in run.config.free_pieces}
    depths = [_depths(run, np.column_stack([run[f"{pose}.{part}"] for part in "xyz"])) for pose in poses.values()]
    return Measured(list(poses), *largest(np.column_stack(depths), run.times)) if depths else None


def _depths(run: RecordedRun, points: Vector) -> Vector:
    """Return how deep points (m, 3) are below the ground, shape (m,) [m]."""
    ground = run.plant.ground
    return np.asarray(-points[:, 2] if ground.plain else ground.beneath(points) - points[:, 2])


def _distance(run: RecordedRun) -> Measured | None:
    felt = [signal for signal in run.signals if signal.role == "distance" and set(signal.names) <= set(run.names)]
    if not felt:
        return None
    nearest, times = largest(-np.column_stack([run[signal.names[0]] for signal in felt]), run.times)
    return Measured([signal.part for signal in felt], -nearest, times)


def _penetration(run: RecordedRun) -> Measured | None:
    found = run.touch.depths
    if not found:
        return None
    values, times = np.array(list(found.values())).T
    return Measured([f"{first} and {second}" for first, second in found], values, times)


def _foot_slip(run: RecordedRun) -> Measured | None:
    found = run.touch.slides
    longest = [slide.longest for slide in found.values()]
    names = [f"{run.plant.robots[robot].prefix}{link}" for robot, link in found]
    times = run.touch.times[[look for _, look in longest]] if longest else np.zeros(0)
    return Measured(names, np.array([way for way, _ in longest]), times)


def _shortened_steps(run: RecordedRun) -> Measured | None:
    if run.shortened is None or len(run.step_times) < 2:
        return None
    steps = np.array([len(run.step_times) - 1.0])
    return Measured(["the solver"], run.shortened / steps, limits=(steps, ["steps"]))


CRITERIA = (
    *MOTION,
    Criterion("below_floor", "m", "below the floor", "{of} was {value} below the floor{when}", _below_floor),
    Criterion("distance", "m", "nearest", "{of} measured a distance of {value}{when}", _distance, least=True),
    Criterion("penetration", "m", "penetration", "{of} were {value} deep in each other{when}", _penetration),
    Criterion("foot_slip", "m", "slip", "{of} slid {value} before it was lifted again{when}", _foot_slip),
    Criterion("shortened_steps", "1", "shortened steps", "{of} shortened {amount}", _shortened_steps),
)
"""What runs are judged by, in the order in which it is told."""


def verdict_of(run: RecordedRun) -> Verdict:
    """Return the verdict on a single run."""
    measures = [Measure(criterion, tuple(entries)) for criterion in CRITERIA if (entries := criterion.entries(run))]
    touched = run.touch.depths or run.touch.slides
    return Verdict(tuple(measures), run.config.sample_rate, run.touch.rate if touched else None)
