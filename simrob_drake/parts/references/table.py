"""Follow a CSV file."""

from pathlib import Path
from typing import Literal

import numpy as np
from pydrake.trajectories import Trajectory

from simrob_drake.arguments import SHORTEST
from simrob_drake.blocks.references import Samples, hermite, table
from simrob_drake.errors import InvalidConfig
from simrob_drake.files import read_columns
from simrob_drake.frames import Vector
from simrob_drake.parts.references.reference import ReferenceSection
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.catalog import RobotModel

TIME_COLUMN = "time"
_MOST_VALUES = 500_000
"""More take a gigabyte of memory in a run."""

Interpolation = Literal["cubic", "linear", "hermite"]


class Table(ReferenceSection):
    """Follow a CSV file: a column `time` [s] and one for each axis [rad], named as the axis."""

    kind: Literal["table"]
    file: Path
    """The CSV file; relative paths start at the station's file."""
    interpolation: Interpolation = "cubic"
    """Cubic: a spline with continuous acceleration. Linear: straight lines. Hermite: cubics with the speeds [rad/s]
    that stand in a column `v.<axis>` for each axis."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]; the table says where it begins."""
        times, values = self.rows(robot.axes)
        if self.interpolation == "hermite":
            return hermite(times, *np.hsplit(np.asarray(values), 2))
        return table(times, values, linear=self.interpolation == "linear")

    def rows(self, axes: list[str]) -> Samples:
        """Return the times (m,) [s] and the values (m, n), or (m, 2n) with speeds, of the file.

        Raises:
            InvalidConfig: the file cannot be read, lacks a column, holds something that is no number, times that do
                not rise, or far too many rows.
        """
        names = [*axes, *speed_columns(axes)] if self.interpolation == "hermite" else axes
        values, lines = read_columns(self.file, [TIME_COLUMN, *names])
        if len(values) < 2:
            raise InvalidConfig(self.file, "", "holds fewer than two rows of values")
        if values.size > _MOST_VALUES:
            most = _MOST_VALUES // values.shape[1]
            raise InvalidConfig(self.file, "", f"holds {len(values)} rows; thin it out to at most {most}")
        times = values[:, 0]
        close = np.flatnonzero(np.diff(times) < SHORTEST)
        if close.size:
            before, after = times[close[0] : close[0] + 2]
            message = f"time {after:g} s after {before:g} s; times must rise by {SHORTEST:g} s or more from row to row"
            raise InvalidConfig(self.file, f"line {lines[close[0] + 1]}", message)
        return times, values[:, 1:]

    def caption(self, model: RobotModel) -> str:
        """Return it in words."""
        return f"table {self.file.name}"


def speed_columns(axes: list[str]) -> list[str]:
    """Return what the columns of the axes' speeds are called in a CSV file."""
    return [f"v.{axis}" for axis in axes]
