"""Straight moves of axes in the least time within limits of speed, acceleration and jerk (Ruckig, Berscheid 2021)."""

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.extras import needed
from simrob_drake.frames import Vector
from simrob_drake.programs.segments import Stretch
from simrob_drake.robots.catalog import RobotModel

_STRAIGHT = 1e-9  # rad or m that a way may leave its straight line
_POINTS = 6  # of each part in which all accelerations rise or fall evenly
_SHORTEST = 1e-6  # s between two parts
_LIMITS = (
    ("velocity", "speed_limits", "its URDF"),
    ("acceleration", "accelerations", "acceleration_deg in its robot.yaml"),
    ("jerk", "jerks", "jerk_deg in its robot.yaml"),
)


def jerk_limited(robots: Iterable[RobotModel], postures: Vector) -> tuple[Stretch, ...]:
    """Return the motions from rest to rest along straight postures (k, n) of robots, one after the other.

    All axes arrive at the same time; they stay on the line where that takes no longer. Raises InvalidParameter: an axis
    of which a limit is not known, or a way that is not straight in the axes.
    """
    with needed("profile jerk_limited", "plan"):
        from ruckig import InputParameter, Ruckig, Synchronization, Trajectory
    own = [*robots]
    start, end = postures[0], postures[-1]
    parts = np.linspace(0.0, 1.0, len(postures))[:, np.newaxis]
    if np.abs(start + parts * (end - start) - postures).max() > _STRAIGHT:
        expected = "another one: it goes with moves that are straight in the axes, without zones"
        raise InvalidParameter("profile", "jerk_limited", expected)
    names = [axis for robot in own for axis in robot.axes]
    task = InputParameter(len(names))
    task.current_position, task.target_position = start.tolist(), end.tolist()
    for key, own_key, where in _LIMITS:
        limits = np.concatenate([getattr(robot, own_key) for robot in own])
        if not np.isfinite(limits).all():
            raise InvalidParameter(f"the {key} of {names[limits.argmax()]}", "not limited", f"limited by {where}")
        setattr(task, f"max_{key}", limits.tolist())
    task.synchronization = Synchronization.Phase
    found = Trajectory(len(names))
    if (said := Ruckig(len(names)).calculate(task, found)).value < 0:
        raise InvalidParameter("profile", "jerk_limited", f"another one: Ruckig found no motion ({said.name})")
    times = np.cumsum([[0.0, *profile.t] for profile in found.profiles[0]], axis=1).ravel()
    breaks = np.unique(np.clip(times, 0.0, found.duration))
    breaks = np.append(breaks[:-1][np.diff(breaks) > _SHORTEST], found.duration)
    return tuple(_stretch(np.linspace(begin, stop, _POINTS), found) for begin, stop in pairwise(breaks))


def _stretch(times: Vector, found: Any) -> Stretch:
    positions, speeds, pushes = np.array([found.at_time(time) for time in times]).transpose(1, 0, 2)
    return Stretch(times, positions, ((speeds[0], pushes[0]), (speeds[-1], pushes[-1])))
