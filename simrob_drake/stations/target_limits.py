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
    model = robot.model
    lower, upper = (limit / model.user_units for limit in model.axis_limits)
    for values in config.reference_of(robot.name).postures():
        positions = model.axis_vector(values, "reference", np.nan)
        is_named = np.array(model.asked(values)) == Asked.NAMED
        is_inside = (positions >= lower - _ROUNDED) & (positions <= upper + _ROUNDED)
        for axis in np.flatnonzero(is_named & ~is_inside).tolist():
            unit, value = model.unit_names[axis], positions[axis]
            expected = f"within the joint's limits of {lower[axis]:.5g} to {upper[axis]:.5g} {unit}"
            key = f"reference of {robot.prefix}{robot.axes[axis]}"
            raise InvalidParameter(key, f"{value:.5g} {unit}", expected)
