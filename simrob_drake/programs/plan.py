"""A move that is planned and checked, and what users may say about how it is done."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypedDict

import numpy as np
import numpy.typing as npt
from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import PEAK
from simrob_drake.errors import InvalidParameter, shortened
from simrob_drake.frames import Vector, numbers
from simrob_drake.given import LONGEST, SHORTEST, positive, seconds
from simrob_drake.programs.segments import Segment, named_point
from simrob_drake.programs.trajectories import Stretch, trajectory

Check = Literal["nothing", "limits", "collision"]
"""What is looked at before a move beside its reach: joint limits and speeds, or these and collisions."""

POINT_TIME = 0.1
"""Time that a point of a move takes unless something else is asked [s]; Ts in SimRob."""
_TURN_LENGTH = 0.1  # m that a radian of a joint counts, where moves share a time
_AT_ONCE = 1e-6  # m: what the way to a target counts at least
_LEAST_TIME = 0.01  # s to a target


class How(TypedDict, total=False):
    """How a move is done; at most one of ``duration``, ``times`` and ``speed``.

    Attributes:
        points: interpolated points on the way to each target; more are taken where the path needs them.
        duration: of the whole move [s]; several targets share it by the length of their ways.
        times: when each target is reached, shape (k,) [s].
        speed: the largest speed of the tool centre point [m/s].
        check: what is looked at first, see :data:`Check`.
    """

    points: int
    duration: float
    times: npt.ArrayLike
    speed: float
    check: Check


@dataclass(frozen=True)
class Plan:
    """A move of one robot, ready to be run.

    Attributes:
        robot: whose move it is.
        stretches: the motions from rest to rest that it is made of, one after the other, the first from time 0.
        arrivals: when each target is reached, shape (k,) [s].
        points: on the way to each target.
    """

    robot: str
    stretches: tuple[Stretch, ...]
    arrivals: Vector
    points: int

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

    def postures(self, times: Vector) -> Vector:
        """Return the postures (m, n) at times (m,) [s]."""
        return np.asarray(self.trajectory.vector_values(times.tolist())).T

    def named(self, time: float) -> tuple[int, str]:
        """Return the number of the point that a time [s] belongs to, counted from 1, and its name."""
        index = min(int(np.searchsorted(self.arrivals, time - 1e-9)), len(self.arrivals) - 1)
        begin = self.arrivals[index - 1] if index else 0.0
        part = (time - begin) / (self.arrivals[index] - begin)
        return named_point(part, self.points, target_name(index, len(self.arrivals)))


def target_name(index: int, count: int) -> str:
    """Return what messages call a target."""
    return f"targets[{index}]" if count > 1 else "the target"


def arrivals(segments: Sequence[Segment], how: How, points: int) -> tuple[Vector, bool]:
    """Return when each segment ends, shape (k,) [s], and whether that was left to us.

    Raises:
        InvalidParameter: more than one of duration, times and speed; or one that cannot be.
    """
    given = [key for key in ("duration", "times", "speed") if key in how]
    if len(given) > 1:
        raise InvalidParameter("the time of the move", f"given by {' and '.join(given)}", "given by one of them")
    lengths = np.array([segment.length for segment in segments])
    turns = np.array([np.abs(np.diff(segment.postures, axis=0)).sum(axis=0).max() for segment in segments])
    shares = np.maximum(lengths + _TURN_LENGTH * turns, _AT_ONCE)
    if "times" in how:
        return _checked_times(how["times"], len(segments)), False
    if "duration" in how:
        return _apart(seconds(how["duration"]) * np.cumsum(shares) / shares.sum(), "duration", how["duration"]), False
    if "speed" in how:
        speed = positive(how["speed"], "speed", "m/s")
        ways = np.where(lengths < _AT_ONCE, _TURN_LENGTH * turns, lengths)
        times = np.cumsum(np.maximum(PEAK * (ways / speed), _LEAST_TIME))
        return _apart(times, "speed", how["speed"]), False
    return POINT_TIME * points * np.arange(1.0, len(segments) + 1), True


def joined(segments: Sequence[Segment], times: Vector) -> tuple[Stretch, ...]:
    """Return the motions of segments that end at times (k,) [s], resting at each end."""
    begins = np.concatenate([[0.0], times[:-1]])
    return tuple(
        Stretch(segment.parts, segment.postures).at(begin, end - begin)
        for segment, begin, end in zip(segments, begins, times, strict=True)
    )


def _checked_times(times: npt.ArrayLike, count: int) -> Vector:
    values = np.atleast_1d(numbers(times))
    if values.shape != (count,):
        raise InvalidParameter("times", times, f"{count} times [s], one a target")
    return _apart(values, "times", times)


def _apart(times: Vector, name: str, given: object) -> Vector:
    """Check that times (k,) [s] rise from 0, and are times that a station knows."""
    if not ((np.diff(times, prepend=0.0) >= SHORTEST).all() and times[-1] <= LONGEST):
        raise InvalidParameter(name, given, f"such that each target has its time, up to {LONGEST:g} s")
    return times
