"""Go to a posture with continuous acceleration."""

from __future__ import annotations

from typing import Literal

from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import move
from simrob_drake.frames import Vector
from simrob_drake.parts.references.reference import ToOnePosture, si_positions
from simrob_drake.parts.site import ResolvedRobot


class Move(ToOnePosture):
    """Go to a posture with continuous acceleration (a polynomial of degree five), and stay there."""

    kind: Literal["move"]

    def course(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]."""
        target = si_positions(self.target_deg, robot, start)
        return move(start, target, duration=self.duration, start_time=self.start)
