"""Go to a posture at constant speed."""

from __future__ import annotations

from typing import Literal

from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import ramp
from simrob_drake.frames import Vector
from simrob_drake.parts.references.reference import ToOnePosture, si_positions
from simrob_drake.parts.site import ResolvedRobot


class Ramp(ToOnePosture):
    """Go to a posture at constant speed, as SimRob's interpolated moves do, and stay there."""

    kind: Literal["ramp"]

    def course(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]."""
        target = si_positions(self.target_deg, robot, start)
        return ramp(start, target, duration=self.duration, start_time=self.start)
