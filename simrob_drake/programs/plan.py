"""A move that is planned and checked."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from simrob_drake.errors import shortened
from simrob_drake.frames import Vector
from simrob_drake.programs.segments import Stretch, named_point, trajectory

Check = Literal["nothing", "limits", "collision"]
"""What is looked at before a move beside its reach: joint limits, speeds and accelerations, or these and collisions."""
_LOOKS = 4  # a point


@dataclass(frozen=True)
class Plan:
    """A move of one robot, ready to be run.

    Attributes:
        robot: whose move it is.
        stretches: the motions from rest to rest that it is made of, one after the other, the first from time 0.
        arrivals: when each target is reached, shape (k,) [s].
        points: on the way to each target.
        check: what was looked at; collisions are again with the moves that are run at the same time.
        entry: what a program's file has of it; None if no file can say it.
        frame: where the work object was when the move was planned; None without one.
    """

    robot: str
    stretches: tuple[Stretch, ...]
    arrivals: Vector
    points: int
    check: Check = "limits"
    entry: Mapping[str, Any] | None = None
    frame: RigidTransform | None = None

    def __repr__(self) -> str:
        """Say in one line whose move it is, how long it takes, and where it leads."""
        times, end = (" ".join(f"{value:.4g}" for value in values) for values in (self.arrivals, self.end))
        return shortened(f"<Plan of {self.robot}: to [{end}], targets at {times} s>", 200)

    @cached_property
    def trajectory(self) -> Trajectory:
        """Of its axes, shape (n, 1), from 0 to the duration."""
        return trajectory(self.stretches)

    @property
    def duration(self) -> float:
        """Of the whole move [s]."""
        return float(self.arrivals[-1])

    @property
    def start(self) -> Vector:
        """Where it begins, shape (n,) [rad or m]."""
        return np.asarray(self.stretches[0].postures[0])

    @property
    def end(self) -> Vector:
        """Where it leads, shape (n,) [rad or m]."""
        return np.asarray(self.stretches[-1].postures[-1])

    @property
    def looks(self) -> Vector:
        """Times at which it is looked at, shape (k,) [s]: evenly, and where its polynomials meet."""
        even = look_times(self.duration, self.points * len(self.arrivals))
        return np.union1d(even, np.concatenate([stretch.times for stretch in self.stretches]))

    def postures(self, times: Vector) -> Vector:
        """Return the postures (m, n) at times (m,) [s]."""
        return np.asarray(self.trajectory.vector_values(times.tolist())).T

    def motion(self, times: Vector) -> tuple[Vector, Vector, Vector]:
        """Return positions, velocities and accelerations at times (m,) [s], (m, n) each, as dynamics take them."""
        orders = [self.trajectory, self.trajectory.MakeDerivative(1), self.trajectory.MakeDerivative(2)]
        positions, velocities, accelerations = (np.array(order.vector_values(times.tolist())).T for order in orders)
        return positions, velocities, accelerations

    def named(self, time: float) -> tuple[int, str]:
        """Return the number of the point that a time [s] belongs to, counted from 1, and its name."""
        index = min(int(np.searchsorted(self.arrivals, time - 1e-9)), len(self.arrivals) - 1)
        begin = self.arrivals[index - 1] if index else 0.0
        part = (time - begin) / (self.arrivals[index] - begin)
        return named_point(part, self.points, target_name(index, len(self.arrivals)))


def target_name(index: int, count: int) -> str:
    """Return what messages call a target."""
    return f"targets[{index}]" if count > 1 else "the target"


def look_times(duration: float, points: int) -> Vector:
    """Return the times (k,) [s] at which a move of so many points is looked at."""
    return np.linspace(0.0, duration, _LOOKS * max(points, 10) + 1)
