"""Find axes whose reference begins away from the robot: at the start of a run, the servos jump to the reference."""

import numpy as np

from simrob_drake.base.frames import Indices, Vector
from simrob_drake.base.messages import Message, message
from simrob_drake.parts.resolved import ResolvedRobot

_LARGEST_TURN = np.deg2rad(1.0)
"""Distance from the start of a turning axis at which its reference may begin [rad]: a servo that sags is as far off."""

_LARGEST_SHIFT = 1e-3
"""The same for a sliding axis [m]."""


def axes_off_reference(robot: ResolvedRobot, start: Vector, reference: Vector) -> Indices:
    """Find the axes whose reference begins more than 1 deg or 1 mm away from the robot, the farthest first.

    A degree counts as a millimetre.

    Args:
        robot: the robot.
        start: positions at the start, shape (n,) [rad or m].
        reference: the reference at the start, shape (n,) [rad or m].

    Returns:
        indices of the axes, shape (k,); empty if the reference begins about where the robot is.
    """
    slides = np.array([unit.si == "m" for unit in robot.model.units], dtype=bool)
    allowed = np.where(slides, _LARGEST_SHIFT, _LARGEST_TURN)
    # In multiples of what is allowed, so that turning and sliding axes can be compared.
    distance = np.abs(reference - start) / allowed
    # Stable: of equal distances the first axis comes first, in every run.
    order = np.argsort(-distance, kind="stable")
    return np.asarray(order[distance[order] > 1.0])


def jump_text(robot: ResolvedRobot, axis: int, start: float, reference: float) -> Message:
    """Describe the jump of an axis at the start, in the user's unit: degrees, or metres of a prismatic axis.

    Args:
        robot: the robot.
        axis: index of the axis.
        start: position of the axis at the start [rad or m].
        reference: reference of the axis at the start [rad or m].
    """
    unit = robot.model.user_units[axis]
    return message(
        "stations.start_off_reference",
        "{axis} begins at {start:.4g} {unit}, but its reference begins at {reference:.4g} {unit}",
        axis=f"{robot.prefix}{robot.axes[axis]}",
        # Adding 0.0 turns -0.0 into 0.0.
        start=start / unit + 0.0,
        reference=reference / unit + 0.0,
        unit=robot.model.unit_names[axis],
    )
