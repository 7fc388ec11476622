"""Go to one posture with continuous acceleration; what moves to one posture share."""

from typing import Literal

from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import move
from simrob_drake.frames import Vector
from simrob_drake.parts.captions import shown_positions
from simrob_drake.parts.references.reference import ReferenceSection, si_positions
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.sections import Duration, Instant


class ToOnePosture(ReferenceSection):
    """What moves to one posture share."""

    kind: str
    target_deg: AxisValues = 0.0
    """Posture at the end, per axis."""
    duration: Duration = 1.0
    """Time that the move takes [s]."""
    start: Instant = 0.0
    """When it begins [s]."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]."""
        return self.way(start, si_positions(self.target_deg, robot, start))

    def way(self, start: Vector, target: Vector) -> Trajectory:
        """Return the way between two postures, each (n,) [rad or m]."""
        raise NotImplementedError

    def caption(self, model: RobotModel) -> str:
        """Return it in words."""
        late = f", from {self.start:g} s" if self.start else ""
        return f"{self.kind} to {shown_positions(self.target_deg, model)} in {self.duration:g} s{late}"


class SmoothMove(ToOnePosture):
    """Go to a posture with continuous acceleration (a polynomial of degree five), and stay there."""

    kind: Literal["move"]

    def way(self, start: Vector, target: Vector) -> Trajectory:
        """Return the way between two postures, each (n,) [rad or m]."""
        return move(start, target, duration=self.duration, start_time=self.start)
