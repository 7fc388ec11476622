"""A robot whose joints take too much power."""

from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Condition
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import MonitorSection, of_axes, worst
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import Positive


class PowerLimit(MonitorSection):
    r"""End the run when the mechanical power of a robot's joints, :math:`\sum_i |\tau_i v_i|`, is too large."""

    kind: Literal["power_limit"]
    limit: Positive
    """Largest power of all joints together [W]; braking counts as driving does."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the power over the limit [W]."""
        robot = station.robot(self.robot, f"monitors.{name}")

        def power(torque: Vector, velocity: Vector) -> Vector:
            return np.array([np.abs(torque * velocity).sum() - self.limit])

        def why(*_: float) -> str:
            return f"the power of the joints of {robot.name} reached the limit of {self.limit:g} W{self.lasting}"

        return worst(of_axes(robot, "torque", "velocity"), power, why)
