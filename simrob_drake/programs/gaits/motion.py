"""What a planner hands to a simulation: joint angles over time, and the pose that the robot begins in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.frames import Vector, poses_from_matrices
from simrob_drake.paths import models_root
from simrob_drake.robots.catalog import ROBOT_FILE, AxisValues, RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station

MAX_STEP = 0.01
"""Of the scheme `cenic` [s]: references stand still over a step."""
_FLOOR_MARGIN = 2.0  # floor beyond the way that a motion goes [m]


@dataclass(frozen=True)
class JointMotion:
    """A planned motion of a robot.

    Attributes:
        model: of the robot.
        feet: the kind of feet it is planned for; the default one if None.
        times: shape (m,) [s].
        positions: of the axes, shape (m, n) [rad].
        root: planned poses of the root in the world, shape (m, 4, 4).
        servo: figures of the servos for it, in place of the station's: kp, kd.
        feed_velocity: whether the servos are told the reference's velocity, too.
    """

    model: RobotModel
    feet: str | None
    times: Vector
    positions: Vector
    root: Vector
    servo: Mapping[str, AxisValues] = field(default_factory=dict)
    feed_velocity: bool = True

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.times[-1])

    @property
    def velocities(self) -> Vector:
        """Of the axes, shape (m, n) [rad/s]; zero at both ends."""
        rates = np.gradient(self.positions, self.times, axis=0)
        rates[[0, -1]] = 0.0
        return np.asarray(rates)

    def trajectory(self) -> Trajectory:
        """Return the angles as a smooth curve through the samples (cubics with their velocities)."""
        return PiecewisePolynomial.CubicHermite(self.times, self.positions.T, self.velocities.T)

    def station(self, overrides: Mapping[str, Any] | None = None, *, name: str | None = None) -> StationConfig:
        """Return the robot's dynamic station, set to begin this motion; its trajectory is the reference to give it.

        Args:
            overrides: further changes, as of ``load_station``.
            name: of the station; ``<robot>_dynamic`` with steps of ``MAX_STEP`` unless given. To give that one another
                kind of solver, override its whole section ``solver``.
        """
        way = float(np.abs(self.root[:, :2, 3]).max())
        settings: dict[str, Any] = {
            "robot.base": poses_from_matrices(self.root)[0].tolist(),
            "robot.initial_deg": [float(value) for value in np.rad2deg(self.positions[0])],
            "inputs": ["reference_velocity"] if self.feed_velocity else [],
            "floor.size": float(np.ceil(2.0 * (way + _FLOOR_MARGIN))),
            "duration": self.duration,
        }
        if name is None:
            settings["solver.max_step"] = MAX_STEP
        settings.update({f"servo.{key}": value for key, value in self.servo.items()})
        if self.feet is not None:
            settings["robot.feet"] = self.feet
        if self.model.folder != models_root() / self.model.name:
            settings["robot.model"] = str(self.model.folder / ROBOT_FILE)
        return load_station(name or f"{self.model.name}_dynamic", {**settings, **(overrides or {})})
