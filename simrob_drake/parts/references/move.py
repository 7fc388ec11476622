"""Go to one posture with continuous acceleration."""

from typing import Literal

from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import move
from simrob_drake.frames import Vector
from simrob_drake.parts.references.reference import ToOnePosture


class SmoothMove(ToOnePosture):
    """Go to a posture with continuous acceleration (a polynomial of degree five), and stay there."""

    kind: Literal["move"]

    def way(self, start: Vector, target: Vector) -> Trajectory:
        """Return the way between two postures, each (n,) [rad or m]."""
        return move(start, target, duration=self.duration, start_time=self.start)
