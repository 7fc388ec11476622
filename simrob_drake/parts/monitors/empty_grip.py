"""A gripper that has closed with nothing between its fingers, or lost what it held."""

from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Condition
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import MonitorSection
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import NotNegative, Positive


class EmptyGrip(MonitorSection):
    """End the run when all fingers of a gripper are closed: nothing is between them, or what was has slipped out."""

    kind: Literal["empty_grip"]
    hold: NotNegative = 0.05
    """How long they must be [s]."""
    part: Positive = 0.02
    """How near to closed counts, as a part of the way from there to open."""

    def check(self, name: str, station: Surroundings) -> None:
        """Check that the robot has fingers."""
        super().check(name, station)
        robot = station.robot(self.robot, f"monitors.{name}")
        if not robot.model.fingers:
            raise InvalidParameter(f"monitors.{name}.robot", robot.name, "one with a gripper: in its robot.yaml")

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is how much nearer to closed the most open finger is."""
        robot = station.robot(self.robot, f"monitors.{name}")
        places = list(robot.model.fingers)
        closed, opened = np.array(list(robot.model.fingers.values())).T

        def excess(position: Vector) -> float:
            return self.part - float(((position[places] - closed) / (opened - closed)).max())

        def why(position: Vector) -> str:
            return f"the fingers of {robot.name} closed with nothing between them"

        return Condition({f"{robot.prefix}position": len(robot.axes)}, excess, why)
