"""What the kinds of reference share."""

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.sections import Strict


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
