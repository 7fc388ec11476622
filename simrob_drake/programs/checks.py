"""Whether a robot can do a move: joint limits and speeds, before anything moves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pydrake.trajectories import Trajectory

from simrob_drake.frames import Vector
from simrob_drake.kinematics.chain import Chain
from simrob_drake.programs.errors import JointLimitExceeded, SpeedLimitExceeded

Naming = Callable[[float], tuple[int, str]]
"""From a time [s] of a move to the number of its point and the point's name."""

_LOOKS = 4  # a point
_ROUNDING = 1e-9  # rad or m
_MARGIN = 1.02  # of the durations that messages propose


def look_times(duration: float, points: int) -> Vector:
    """Return the times (k,) [s] at which a move of so many points is looked at."""
    return np.linspace(0.0, duration, _LOOKS * max(points, 10) + 1)


def check_limits(chain: Chain, times: Vector, postures: Vector, named: Naming, hint: str = "") -> None:
    """Check that all axes stay within their limits.

    Args:
        chain: whose limits count.
        times: shape (k,) [s].
        postures: at these times, shape (k, n).
        named: how points are called.
        hint: what the message ends with.

    Raises:
        JointLimitExceeded: names the first offending point.
    """
    beyond = np.maximum(chain.lower - postures, postures - chain.upper) > _ROUNDING
    if not beyond.any():
        return
    row = int(np.argmax(beyond.any(axis=1)))
    axis = int(np.argmax(beyond[row]))
    number, name = named(float(times[row]))
    value, revolute = float(postures[row, axis]), bool(chain.revolute[axis])
    limits = f"beyond its limits of {shown(chain.lower[axis], revolute)} to {shown(chain.upper[axis], revolute)}"
    text = f"{shown(value, revolute)}, {limits}{hint}"
    raise JointLimitExceeded(name, chain.names[axis], point=number, time=float(times[row]), value=value, shown=text)


def speed_ratio(trajectory: Trajectory, times: Vector, limits: Vector) -> float:
    """Return the largest ratio of a joint's speed to its limit (n,) on a trajectory; below 1 it can be done."""
    return float((_speeds(trajectory, times) / limits).max())


def check_speeds(chain: Chain, trajectory: Trajectory, times: Vector, limits: Vector, named: Naming) -> None:
    """Check that no axis is faster than its limit.

    Args:
        chain: whose axes move.
        trajectory: of the move.
        times: at which it is looked at, shape (k,) [s].
        limits: largest speeds, shape (n,) [rad/s or m/s].
        named: how points are called.

    Raises:
        SpeedLimitExceeded: names the first offending point, and a duration that would do.
    """
    speeds = _speeds(trajectory, times)
    ratios = speeds / limits
    if ratios.max() <= 1 + _ROUNDING:
        return
    row = int(np.argmax((ratios > 1 + _ROUNDING).any(axis=1)))
    axis = int(np.argmax(ratios[row]))
    number, name = named(float(times[row]))
    revolute = bool(chain.revolute[axis])
    raise SpeedLimitExceeded(
        name,
        chain.names[axis],
        point=number,
        time=float(times[row]),
        speed=float(speeds[row, axis]),
        duration=_MARGIN * float(ratios.max()) * float(times[-1]),
        shown=f"{shown(speeds[row, axis], revolute)}/s, beyond its limit of {shown(limits[axis], revolute)}/s",
    )


def _speeds(trajectory: Trajectory, times: Vector) -> Vector:
    speeds: Vector = np.abs(np.asarray(trajectory.MakeDerivative(1).vector_values(times.tolist())).T)
    return speeds


def shown(value: float, revolute: bool) -> str:
    """Return a position or speed of an axis as messages show it: in degrees or metres."""
    return f"{np.rad2deg(value):.1f} deg" if revolute else f"{value:.3f} m"
