"""How far a robot went, how straight, and whether it stayed on its feet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.results.result import SimulationResult

FALLEN_DEG = 45.0
"""A trunk that leans further than this from where it began has fallen [deg]."""


@dataclass(frozen=True)
class Journey:
    """What became of a walk, in the robot's own directions at its start.

    Attributes:
        seconds: simulated time [s].
        ahead, left: way of the root [m].
        yaw_deg: how far it turned, to the left; whole turns count [deg].
        tilt_deg: largest angle of the root's z axis from the vertical [deg].
        lowest: smallest height of the root [m].
        fell_at: when it tilted beyond 45 deg, or None [s].
        torque_share: largest torque of a joint over its limit.
        saturated: part of the time that the busiest joint is at its limit.
    """

    seconds: float
    ahead: float
    left: float
    yaw_deg: float
    tilt_deg: float
    lowest: float
    fell_at: float | None
    torque_share: float
    saturated: float

    @property
    def upright(self) -> bool:
        """Whether it stayed on its feet to the end."""
        return self.fell_at is None


def journey(result: SimulationResult, facing_deg: float) -> Journey:
    """Return what became of a walk.

    Args:
        result: of a station with one robot.
        facing_deg: where the robot looks while its root is not turned, counterclockwise from x [deg].
    """
    pose = result.pose("base")
    quaternion = pose[:, 3:]
    yaw = _yaw(quaternion)
    looked = np.deg2rad(facing_deg) + yaw[0]
    way = pose[-1, :2] - pose[0, :2]
    tilt = np.rad2deg(np.arccos(np.clip(1.0 - 2.0 * (quaternion[:, 1] ** 2 + quaternion[:, 2] ** 2), -1.0, 1.0)))
    fallen = np.flatnonzero(tilt > FALLEN_DEG)
    share = np.abs(result.axes("tau")) / next(iter(result.plant.robots.values())).gains.torque_limit
    return Journey(
        seconds=result.stop_time,
        ahead=float(way @ [np.cos(looked), np.sin(looked)]),
        left=float(way @ [-np.sin(looked), np.cos(looked)]),
        yaw_deg=float(np.rad2deg(yaw[-1] - yaw[0])),
        tilt_deg=float(tilt.max()),
        lowest=float(pose[:, 2].min()),
        fell_at=float(result.times[fallen[0]]) if len(fallen) else None,
        torque_share=float(share.max()),
        saturated=float((share > 0.999).mean(axis=0).max()),
    )


def _yaw(quaternion: Vector) -> Vector:
    """Return the turn about the vertical of quaternions w x y z (m, 4), without jumps, shape (m,) [rad]."""
    w, x, y, z = quaternion.T
    return np.asarray(np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))))
