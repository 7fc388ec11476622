"""What the kinds of reference share: all, and those that go to one posture."""

import numpy as np
from pydrake.trajectories import Trajectory

from simrob_drake.frames import Vector
from simrob_drake.parts.captions import shown_positions
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.sections import Duration, Instant, Strict


class ReferenceSection(Strict):
    """A section ``reference``: what a robot is asked to do over time.

    A kind has its key ``kind``, and the methods ``trajectory(robot, start)``, which gives it over time, and
    ``caption(model)``, which tells it in words.
    """

    def axis_values(self) -> dict[str, AxisValues | None]:
        """Return the figures per axis, by their keys, to be checked against a robot's axes: all that are in degrees."""
        return {key: value for key, value in self if key.endswith("_deg")}


def si_positions(
    values: AxisValues, robot: ResolvedRobot, otherwise: Vector, key: str = "reference.target_deg"
) -> Vector:
    """Return a user's figures per axis in SI, shape (n,); axes that a mapping leaves out stay where they were."""
    units = robot.model.user_units
    return np.asarray(units * robot.model.axis_vector(values, key, otherwise / units))


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
