"""Go to one posture with continuous acceleration; what moves to one posture share."""

from typing import Literal

from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import move
from simrob_drake.frames import Vector
from simrob_drake.parts.captions import positions_told
from simrob_drake.parts.references.reference import Reference, si_positions
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.quantities import Duration, Instant
from simrob_drake.robots.axis_values import AxisValues
from simrob_drake.robots.catalog import RobotModel


class ToOnePosture(Reference):
    """What moves to one posture share."""

    kind: str
    target_deg: AxisValues = 0.0
    """Posture at the end, per axis."""
    duration: Duration = 1.0
    """Time that the move takes [s]."""
    start: Instant = 0.0
    """When it begins [s]."""

    def course(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]."""
        return self.way(start, si_positions(self.target_deg, robot, start))

    def way(self, start: Vector, target: Vector) -> Trajectory:
        """Return the way between two postures, each (n,) [rad or m]."""
        raise NotImplementedError

    def caption(self, model: RobotModel) -> str:
        """Return it in words."""
        late = f", from {self.start:g} s" if self.start else ""
        return f"{self.kind} to {positions_told(self.target_deg, model)} in {self.duration:g} s{late}"


class Move(ToOnePosture):
    """Go to a posture with continuous acceleration (a polynomial of degree five), and stay there."""

    kind: Literal["move"]

    def way(self, start: Vector, target: Vector) -> Trajectory:
        """Return the way between two postures, each (n,) [rad or m]."""
        return move(start, target, duration=self.duration, start_time=self.start)
