"""Stay at one posture."""

from typing import Literal

from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import hold
from simrob_drake.frames import Vector
from simrob_drake.parts.captions import shown_positions
from simrob_drake.parts.references.reference import ReferenceSection, si_positions
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel


class Hold(ReferenceSection):
    """Stay at one posture."""

    kind: Literal["hold"]
    target_deg: AxisValues | None = None
    """Posture, per axis; the initial one unless given."""

    def trajectory(self, robot: ResolvedRobot, start: Vector) -> Trajectory:
        """Return the trajectory, shape (n, 1) [rad or m]."""
        return hold(start if self.target_deg is None else si_positions(self.target_deg, robot, start))

    def caption(self, model: RobotModel) -> str:
        """Return it in words."""
        return "hold the start" if self.target_deg is None else f"hold {shown_positions(self.target_deg, model)}"
