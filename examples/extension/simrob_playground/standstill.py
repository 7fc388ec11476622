"""Measure of the verdict: for which share of the run a robot stood still."""

import numpy as np

from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.verdict.verdict import Criterion, Measured

SLOW = 1e-3
"""A robot stands still while each of its joints is slower than this [rad/s or m/s]."""


def _standstill(run: RecordedRun) -> Measured | None:
    """Measure the share of the samples in which each robot stands still. Returns None without a robot."""
    robots = list(run.plant.robots)
    if not robots:
        return None
    shares = [np.mean(np.all(np.abs(run.axes("v", name)) < SLOW, axis=1)) for name in robots]
    return Measured(subjects=robots, values=np.array(shares))


STANDSTILL = Criterion(
    name="standstill",
    unit="1",
    title="standstill",
    sentence="{of} stood still for {value} of the run",
    measure=_standstill,
    per_time=True,
    default_bound=None,
    # Other languages are in languages/<language>.yaml, with ids that begin with this word.
    catalogue="playground",
)
"""The criterion. A station bounds it with ``verdict: {standstill: 0.5}``."""
