"""Check of the positions that references name against the limits of the axes, before any run."""

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.coupled_axes import Firmness
from simrob_drake.stations.config import StationConfig


def check_targets(config: StationConfig, robot: ResolvedRobot) -> None:
    """Check the positions that a robot's reference gives for single axes (a mapping or a list) against the limits.

    The check of a run finds only positions that are reached within the run's duration; this check finds the others,
    too. One number for all axes is not checked here, since it does not count for axes that a coupling makes follow
    others. The check of the run, which comes after the couplings, covers that number.

    Args:
        config: configuration of the station.
        robot: the robot whose reference is checked.

    Raises:
        InvalidParameter: a position is beyond a limit of its axis; the message names the axis and the limits.
    """
    model = robot.model
    for target in config.reference_of(robot.name).postures():
        firmness = np.array(model.firmness(target))
        axes_with_target = np.flatnonzero(firmness == Firmness.NAMED).tolist()
        # Axes that a mapping leaves out become NaN. They are not among axes_with_target, so no NaN is compared.
        positions = model.user_units * model.axis_vector(target, "reference", np.nan)
        limits = model.limits.of_axes(axes_with_target)
        violation = limits.find_violation(positions[np.newaxis, axes_with_target])
        if violation is not None:
            axis = axes_with_target[violation.axis]
            key = f"reference of {robot.prefix}{robot.axes[axis]}"
            expected = f"within the joint's limits of {violation.limits}"
            raise InvalidParameter(key, f"{violation.value} {violation.unit}", expected)
