"""Go to one posture and cruise on the way: trapezoids of speed, and S-curves."""

from typing import Literal

import numpy as np
from pydrake.trajectories import Trajectory

from simrob_drake.blocks.cruise import cruising
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.captions import shown_positions
from simrob_drake.parts.references.reference import ReferenceSection, si_positions
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.axis_map import AxisValues, PositiveAxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.sections import Instant

_ROUNDING = 1e-9


class Cruise(ReferenceSection):
    """What cruises to one posture: straight, all axes at the same time, and none beyond its limits."""

    kind: str
    target_deg: AxisValues = 0.0
    """Posture at the end, per axis."""
    speed_deg: PositiveAxisValues | None = None
    """Largest speed, per axis [deg/s, or m/s]; that of the URDF unless given, and not beyond."""
    acceleration_deg: PositiveAxisValues | None = None
    """Largest acceleration, per axis [deg/s², or m/s²]; that of the robot's files unless given, and not beyond."""
    start: Instant = 0.0
    """When it begins [s]."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m].

        Raises:
            InvalidParameter: a limit that nothing tells, or one beyond that of the robot.
        """
        target = si_positions(self.target_deg, robot, start)
        speeds = _within("speed_deg", self.speed_deg, robot, robot.model.speed_limits, target != start)
        limits = robot.model.accelerations
        accelerations = _within("acceleration_deg", self.acceleration_deg, robot, limits, target != start)
        return cruising(start, target, speeds, accelerations, self._jerks(robot), start_time=self.start)

    def _jerks(self, robot: ResolvedRobot) -> Vector | None:
        return np.full(len(robot.axes), np.inf)

    def caption(self, model: RobotModel) -> str:
        """Return it in words."""
        late = f", from {self.start:g} s" if self.start else ""
        return f"{self.kind.replace('_', '-')} to {shown_positions(self.target_deg, model)}{late}"


class Trapezoid(Cruise):
    """Go to a posture: speed up evenly, cruise, slow down."""

    kind: Literal["trapezoid"]


class SCurve(Cruise):
    """Go to a posture as a trapezoid does, with an acceleration that does not jump."""

    kind: Literal["s_curve"]
    jerk_deg: PositiveAxisValues | None = None
    """Largest jerk, per axis [deg/s³, or m/s³]; unless given, the acceleration rises for a third of the ramp."""

    def _jerks(self, robot: ResolvedRobot) -> Vector | None:
        endless = np.full(len(robot.axes), np.inf)
        return None if self.jerk_deg is None else si_positions(self.jerk_deg, robot, endless, "reference.jerk_deg")


def _within(key: str, values: AxisValues | None, robot: ResolvedRobot, limits: Vector, moves: Vector) -> Vector:
    """Return limits (n,) of the axes as the user wants them, of those that move finite and not beyond their own."""
    chosen = limits if values is None else si_positions(values, robot, limits, f"reference.{key}")
    for axis, (own, limit) in enumerate(zip(chosen, limits, strict=True)):
        unit, per_time = robot.model.user_units[axis], f"{robot.model.unit_names[axis]}/{'s²' if 'acc' in key else 's'}"
        where = f"reference.{key} of {robot.prefix}{robot.axes[axis]}"
        if own > limit * (1 + _ROUNDING):
            most = f"at most {limit / unit:.5g}, the robot's own limit"
            raise InvalidParameter(where, f"{own / unit:.5g} {per_time}", most)
        if moves[axis] and not np.isfinite(own):
            raise InvalidParameter(where, None, f"given [{per_time}]: the robot's files tell none")
    return chosen
