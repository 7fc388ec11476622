"""The motion by which simulators are compared: the thesis's step sequence of the humanoid on its own feet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.base.frames import Vector, transform_from_xyz_quaternion
from simrob_drake.stations.config import StationConfig
from tests.test_legged_stations import STEPPING

SAMPLES = np.arange(601) / 100
BASE_BOUND, JOINT_BOUND = 0.002, 0.01
"""What a run may be off from its simulator's converged one [m, rad]."""


@dataclass(frozen=True)
class Motion:
    """A run at ``SAMPLES``: poses of the base (601, 7), axis positions (601, n), and the time it took [s]."""

    base: Vector
    joints: Vector
    stepping: float
    with_signals: float

    def off(self, other: Motion) -> tuple[float, float]:
        """Return the largest distance between the bases [m] and between axis positions [rad]."""
        apart = np.linalg.norm(self.base[:, :3] - other.base[:, :3], axis=1)
        return float(apart.max()), float(np.abs(self.joints - other.joints).max())

    def within(self, converged: Motion) -> bool:
        """Tell whether a run is as near to a converged one as is asked for."""
        base, joints = self.off(converged)
        return base < BASE_BOUND and joints < JOINT_BOUND

    @property
    def tilt_deg(self) -> float:
        """The angle between the base's z axis and the vertical, at the end [deg]."""
        upright = transform_from_xyz_quaternion(self.base[-1]).rotation().matrix()[2, 2]
        return float(np.rad2deg(np.arccos(np.clip(upright, -1, 1))))


def stepping_station(overrides: dict[str, object] | None = None) -> StationConfig:
    """Return ``humanoid_dynamic`` with the step sequence as its reference."""
    return load_station("humanoid_dynamic", {**STEPPING, **(overrides or {})})


def run_station(config: StationConfig) -> Motion:
    """Run the station once."""
    result = simulate(config, progress=False)
    assert np.array_equal(result.times, SAMPLES)
    return Motion(
        result.pose("base"),
        result.axes("q"),
        result.stepping_time,
        result.stepping_time + result.signal_time,
    )
