"""The positions that references name, against the limits of the axes, whether a run reaches them or not."""

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.coupled_axes import Asked
from simrob_drake.stations.config import StationConfig


def check_targets(config: StationConfig, robot: ResolvedRobot) -> None:
    """Check that the positions which a robot's reference names are within the limits of its axes.

    A run finds those that it reaches; this finds the others, too.

    Raises:
        InvalidParameter: a position that no run could reach.
    """
    model = robot.model
    for values in config.reference_of(robot.name).postures():
        named = np.flatnonzero(np.array(model.asked(values)) == Asked.NAMED).tolist()
        positions = model.user_units * model.axis_vector(values, "reference", np.nan)
        violation = model.limits.of_axes(named).find_violation(positions[np.newaxis, named])
        if violation is not None:
            key = f"reference of {robot.prefix}{robot.axes[named[violation.axis]]}"
            expected = f"within the joint's limits of {violation.limits}"
            raise InvalidParameter(key, f"{violation.value} {violation.unit}", expected)
