"""A duration for a move of joints that the robot's servos can follow, for users who name none.

The *lag* of an axis is how far it is behind its reference, the position that it should have.
"""

import math

import numpy as np

from simrob_drake.base.arguments import LONGEST
from simrob_drake.base.frames import Vector
from simrob_drake.blocks.references import PEAK
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.programs.moves.move import MOVE_TIME
from simrob_drake.stations.config import StationConfig

SPEED_SHARE = 0.5
"""Share of an axis' speed limit that a suggested move uses."""
LAG = math.radians(2.0)
"""Largest lag of an axis behind its reference at the end of the move [rad]. The verdict allows 3 degrees."""
SLIDING_LAG = 0.002
"""The same for an axis that slides [m]."""
ROUNDING = 0.1
"""Durations are rounded up to multiples of this time [s]."""


def suggest_duration(
    config: StationConfig, robot: ResolvedRobot, start: Vector, target: Vector
) -> float:
    """Suggest a duration for a move of joints from rest to rest.

    The slowest axis decides: by its speed limit, and by the lag of its servo. A servo whose derivative acts on the
    measured speed lags behind a reference that moves at the speed v by (kd/kp) v: there the proportional part balances
    the damping. A servo that also follows the speed of its reference has no such lag.

    Args:
        config: the station.
        robot: the robot.
        start: positions of the axes at the start, shape (n,) [rad or m].
        target: positions at the end, shape (n,) [rad or m].

    Returns:
        the duration [s], a multiple of `ROUNDING` from `MOVE_TIME` to `LONGEST`.
    """
    # The largest speed of a move from rest to rest is PEAK times its mean speed. So the mean speeds, which are computed
    # here, have to be lower than the limits by this factor.
    speeds = SPEED_SHARE * robot.speed_limits / PEAK
    if not config.follows_speed(robot.name):
        speeds = np.minimum(speeds, _speeds_without_lag(robot))
    distances = np.abs(target - start)
    moves = distances > 0.0
    # Time of the slowest axis [s]; 0 if none moves.
    slowest = float(np.max(distances[moves] / speeds[moves], initial=0.0))
    # Rounded twice, so that a user reads 0.3 and not 0.30000000000000004.
    duration = round(math.ceil(slowest / ROUNDING) * ROUNDING, 3)
    return float(min(max(MOVE_TIME, duration), LONGEST))


def _speeds_without_lag(robot: ResolvedRobot) -> Vector:
    """Speeds at which the servos lag behind their references by `LAG`, or `SLIDING_LAG` for axes that slide.

    Shape (n,) [rad/s or m/s]. The speed of an axis without lag is infinite.
    """
    gains = robot.gains
    lags = np.where(robot.model.prismatic, SLIDING_LAG, LAG)
    # Without damping nothing lags; without stiffness no duration helps. Neither limits the speed.
    has_lag = (gains.kd > 0.0) & (gains.kp > 0.0)
    speeds: Vector = np.divide(
        lags * gains.kp, gains.kd, out=np.full(len(lags), np.inf), where=has_lag
    )
    return speeds
