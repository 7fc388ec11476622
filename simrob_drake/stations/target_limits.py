"""Check of the target positions of references against the limits of the axes, before any run.

The *reference* of a robot is a section of its station that describes the desired motion of the axes, such as a move to
a target posture.
"""

from collections.abc import Mapping

import numpy as np

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import compound, message
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.robots.coupled_axes import Firmness
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.servos import passive_axis


def check_targets(config: StationConfig, robot: ResolvedRobot) -> None:
    """Check the targets that a robot's reference gives axis by axis against the limits of the axes.

    The check that a run makes finds only positions that are reached within the run's duration; this check finds the
    others, too. A single number for all axes is not checked here, because it does not apply to axes that follow others
    by a coupling. The run's check comes after the couplings have been evaluated.

    Args:
        config: configuration of the station.
        robot: the robot whose reference is checked.

    Raises:
        InvalidParameter: a target is beyond a limit of its axis; the message names the axis and the limits.
        Unsuitable: a mapping gives a value to a passive axis of a dynamic station, which no motor moves there.
    """
    model = robot.model
    # The reference of a kinematic station moves passive axes, too.
    if config.engine.moves_by_forces:
        _check_passive_axes(config, robot)
    for target in config.reference_of(robot.name).postures():
        # How firmly the target asks each axis for a position: an axis is NAMED if the target is a list, or a mapping
        # that contains the axis. A single number names no axis: nothing is checked.
        firmness = np.array(model.firmness(target))
        axes_with_target = np.flatnonzero(firmness == Firmness.NAMED).tolist()
        # Axes that a mapping leaves out become NaN. They are not among axes_with_target, so no NaN is compared.
        # The product is in rad or m.
        positions = model.user_units * model.axis_vector(target, "reference", np.nan)
        limits = model.limits.of_axes(axes_with_target)
        violation = limits.find_violation(positions[np.newaxis, axes_with_target])
        if violation is not None:
            axis = axes_with_target[violation.axis]
            key = message(
                "stations.reference_of_axis",
                "reference of {prefix}{axis}",
                prefix=robot.prefix,
                axis=robot.axes[axis],
            )
            found = compound("{violation} {unit}", violation=violation.value, unit=violation.unit)
            expected = message(
                "stations.within_limits",
                "within the joint's limits of {limits}",
                limits=violation.limits,
            )
            raise InvalidParameter(key, found, expected)


def _check_passive_axes(config: StationConfig, robot: ResolvedRobot) -> None:
    """Check that a robot's reference gives no value to a passive axis by its name.

    Numbers and lists for all axes are meant for the axes with motors.

    Raises:
        Unsuitable: a mapping names a passive axis.
    """
    for key, values in config.reference_of(robot.name).axis_values().items():
        if not isinstance(values, Mapping):
            continue
        for axis in values:
            if robot.gains.passive[robot.model.axis_index(axis, f"reference.{key}")]:
                raise passive_axis(f"{robot.prefix}reference.{key}.{axis}", axis)
