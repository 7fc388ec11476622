"""The positions that references name, against the limits of the axes, whether a run reaches them or not."""

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.coupled_axes import Asked
from simrob_drake.stations.config import StationConfig

_ROUNDED = 1e-6  # deg or m: limits that a user writes as they are shown


def check_targets(config: StationConfig, robot: ResolvedRobot) -> None:
    """Check that the positions which a robot's reference names are within the limits of its axes.

    A run finds those that it reaches; this finds the others, too.

    Raises:
        InvalidParameter: a position that no run could reach.
    """
    model, reference = robot.model, config.reference_of(robot.name)
    lower, upper = (limit / model.user_units for limit in model.axis_limits)
    for values in reference.postures():
        positions = model.axis_vector(values, "reference", np.nan)
        for axis, asked in enumerate(model.asked(values)):
            value = positions[axis]
            if asked == Asked.NAMED and not lower[axis] - _ROUNDED <= value <= upper[axis] + _ROUNDED:
                unit = model.unit_names[axis]
                expected = f"within the joint's limits of {lower[axis]:.5g} to {upper[axis]:.5g} {unit}"
                raise InvalidParameter(
                    f"reference of {robot.prefix}{robot.axes[axis]}", f"{value:.5g} {unit}", expected
                )
