"""Getting up after a fall: sequences of postures from the belly and from the back, from a robot's `gaits.yaml`.

A sequence is called a way. Its postures name only the axes that move.
"""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from simrob_drake.base.errors import InvalidParameter, UnknownName, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Duration, Length, Number, Strict, validate_section
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import GAITS_FILE, gaits_file

GETTING_UP = "get_up"
"""Name of the section in a robot's ``gaits.yaml``."""

# Prefixes of the two axes of a pair, such as ``right_knee`` and ``left_knee``.
_SIDES = ("right_", "left_")


class RisingPosture(Strict):
    """A posture on the way up, and the lean of the trunk that is expected at its end."""

    time: Duration
    """Duration of the motion to the posture [s]."""
    target_deg: dict[str, Number] = Field(default_factory=dict)
    """Positions of axes; `knee` is both `right_knee` and `left_knee`. Axes that are not named keep their position,
    which is 0 at first."""
    lean_deg: tuple[Number, Number] = (-180.0, 180.0)
    """Least and largest lean of the trunk ahead after the motion; outside of them, the robot tries again from the
    start."""


Way = Annotated[tuple[RisingPosture, ...], Field(min_length=1)]


class GettingUp(Strict):
    """Sequences of postures with which a robot gets up."""

    height: Length
    """Height of the root over the ground above which the robot stands [m]."""
    front: Way
    """Postures from lying on the front."""
    back: Way
    """Postures from lying on the back."""


def load_getting_up(model: RobotModel) -> GettingUp:
    """Load the postures with which a robot gets up.

    Raises:
        InvalidParameter: the robot has no file ``gaits.yaml``.
        Unsuitable: the file has no section ``get_up``, or an empty one.
        InvalidConfig: the file cannot be read, or the section has an invalid entry.
    """
    gaits = gaits_file(model)
    section = gaits.section(GETTING_UP)
    if not section:
        raise Unsuitable(
            message("base.robot_called", "robot {name}", name=model.name),
            message(
                "walking.cannot_get_up",
                "its {file} has no section {section} with the postures for getting up",
                file=GAITS_FILE,
                section=GETTING_UP,
            ),
            message("walking.add_section", "add the section, or choose another robot"),
        )
    return validate_section(GettingUp, dict(section), f"{gaits.file}: {GETTING_UP}")


def postures(model: RobotModel, way: Sequence[RisingPosture]) -> list[Vector]:
    """Convert a sequence of postures to angles of all axes, shape (n,) each [rad].

    Args:
        model: model of the robot.
        way: the sequence. An axis that a posture does not name keeps its angle of the posture before; it is 0 at first.

    Returns:
        The angles after each posture, in the order of the robot's axes.

    Raises:
        UnknownName: a posture names neither an axis nor a pair of axes of the robot.
        InvalidParameter: an angle is beyond the limits of its axis, also if it is the 0 of an axis that no posture has
            named so far.
    """
    sequence: list[Vector] = []
    angles = np.zeros(len(model.axes))
    for number, posture in enumerate(way):
        for axis, angle in posture.target_deg.items():
            indices = _axis_indices(model, axis)
            angles[indices] = np.deg2rad(angle)
            violation = model.limits.find_violation(angles[np.newaxis])
            if violation is not None:
                # An axis that the sequence has not named is at 0, which may be beyond its limits, too.
                wrong_axis = axis if violation.axis in indices else list(model.axes)[violation.axis]
                expected = message("walking.within", "within {limits}", limits=violation.limits)
                raise InvalidParameter(
                    message(
                        "walking.axis_of_posture",
                        "{section}: {axis} of posture {number}",
                        section=GETTING_UP,
                        axis=wrong_axis,
                        number=number,
                    ),
                    float(np.rad2deg(angles[violation.axis])),
                    expected,
                )
        sequence.append(angles.copy())
    return sequence


def _axis_indices(model: RobotModel, axis: str) -> list[int]:
    """Find the index of an axis, or both indices of a pair of axes that is named without its sides.

    Args:
        model: model of the robot.
        axis: name of the axis, or of the pair: ``knee`` is ``right_knee`` and ``left_knee``.

    Raises:
        UnknownName: the robot has neither an axis nor a pair of this name.
    """
    names = list(model.axes)
    if axis in names:
        return [names.index(axis)]
    if all(side + axis in names for side in _SIDES):
        return [names.index(side + axis) for side in _SIDES]
    pairs = [name.removeprefix(_SIDES[0]) for name in names if name.startswith(_SIDES[0])]
    raise UnknownName(
        message(
            "walking.axis_under",
            "axis of {model} (under {section})",
            model=model.name,
            section=GETTING_UP,
        ),
        axis,
        [*names, *pairs],
    )
