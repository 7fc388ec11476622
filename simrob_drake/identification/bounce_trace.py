"""Measured bounces: a ball's height over time, from a CSV file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simrob_drake.csv_files import read_columns
from simrob_drake.errors import InvalidConfig
from simrob_drake.frames import Vector

COLUMNS = ("time", "height")
_LONGEST_GAP = 5.0  # times the usual interval
_FEWEST_SAMPLES = 20
_FEWEST_BOUNCES = 2


@dataclass(frozen=True)
class BounceTrace:
    """Heights of a ball that bounces.

    Attributes:
        times: shape (m,) [s], rising.
        heights: of the ball's lowest point over the floor, shape (m,) [m]; negative while it is pressed in.
    """

    times: Vector
    heights: Vector

    @property
    def bounces(self) -> int:
        """How often the ball came back up: falls to the floor with a rise behind them."""
        high = (self.heights.max() - min(self.heights.min(), 0.0)) / 10
        low_points, falling = 0, False
        for height in self.heights:
            if height > high:
                low_points, falling = low_points + falling, False
            elif height < high / 2:
                falling = True
        return low_points


def read_bounces(file: Path) -> BounceTrace:
    """Read a CSV file with the columns ``time`` [s] and ``height`` [m] of the ball's lowest point over the floor.

    Raises:
        InvalidConfig: a file without these columns, with something that is no number, with gaps, with times that do
            not rise, or with too few bounces to learn from.
    """
    values, lines = read_columns(file, COLUMNS)
    times, heights = values.T
    if len(times) < _FEWEST_SAMPLES:
        raise InvalidConfig(file, "", f"has {len(times)} samples; it takes at least {_FEWEST_SAMPLES}")
    intervals = np.diff(times)
    if (intervals <= 0).any():
        row = int(np.flatnonzero(intervals <= 0)[0])
        problem = f"times must rise, but {times[row + 1]:g} s follows {times[row]:g} s"
        raise InvalidConfig(file, f"line {lines[row + 1]}", problem)
    usual = float(np.median(intervals))
    if intervals.max() > _LONGEST_GAP * usual:
        row = int(np.argmax(intervals))
        problem = f"a gap of {intervals[row]:.3g} s from {times[row]:.4g} s on, where {usual:.3g} s is usual"
        raise InvalidConfig(file, f"line {lines[row + 1]}", f"{problem}; cut the trace there or measure again")
    trace = BounceTrace(times, heights)
    if trace.bounces < _FEWEST_BOUNCES:
        problem = f"holds {trace.bounces} bounces; it takes at least {_FEWEST_BOUNCES}, each with the rise behind it"
        raise InvalidConfig(file, "", problem)
    return trace
