"""How a robot gets up: postures one after the other, from its belly and from its back, in its `gaits.yaml`."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Duration, Length, Number, Strict, validated
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import GAITS_FILE, gaits_file

GETTING_UP = "get_up"
"""The section of a robot's ``gaits.yaml``."""
_SIDES = ("right_", "left_")


class RisingPosture(Strict):
    """A posture on the way up, and how the trunk leans where that goes well."""

    time: Duration
    """To take it [s]."""
    target_deg: dict[str, Number] = Field(default_factory=dict)
    """Where axes go; `knee` is both `right_knee` and `left_knee`. Others stay, and are 0 at first."""
    lean_deg: tuple[Number, Number] = (-180.0, 180.0)
    """How far ahead the trunk then leans, at least and at most; where it does not, the robot begins anew."""


Way = Annotated[tuple[RisingPosture, ...], Field(min_length=1)]


class GettingUp(Strict):
    """How a robot gets up from where it lies."""

    height: Length
    """Of its root over the ground from which it stands [m]."""
    front: Way
    """From its belly."""
    back: Way
    """From its back."""


def load_getting_up(model: RobotModel) -> GettingUp:
    """Return how a robot gets up; raises SimrobError: its ``gaits.yaml`` does not say, or has a wrong entry."""
    found = gaits_file(model)
    if not (own := found.section(GETTING_UP)):
        expected = message(
            "walking.robot_with_getting_up",
            "one whose {file} has postures for it, a section {section}",
            file=GAITS_FILE,
            section=GETTING_UP,
        )
        raise InvalidParameter(
            message("base.robot_called", "robot {name}", name=model.name),
            message("walking.cannot_get_up", "one that cannot get up"),
            expected,
        )
    return validated(GettingUp, dict(own), f"{found.file}: {GETTING_UP}")


def postures(model: RobotModel, way: Sequence[RisingPosture]) -> list[Vector]:
    """Return the postures of a way, shape (n,) each [rad].

    Raises UnknownName: an axis, or a pair, that the robot does not have; InvalidParameter: an angle beyond its limits.
    """
    found: list[Vector] = []
    angles = np.zeros(len(model.axes))
    for number, posture in enumerate(way):
        for axis, angle in posture.target_deg.items():
            places = _places(model, axis)
            angles[places] = np.deg2rad(angle)
            violation = model.limits.find_violation(angles[np.newaxis])
            if violation is not None:
                expected = message("walking.within", "within {limits}", limits=violation.limits)
                raise InvalidParameter(
                    message(
                        "walking.axis_of_posture",
                        "{section}: {axis} of posture {number}",
                        section=GETTING_UP,
                        axis=axis,
                        number=number,
                    ),
                    angle,
                    expected,
                )
        found.append(angles.copy())
    return found


def _places(model: RobotModel, axis: str) -> list[int]:
    """Return the place of an axis, or of a pair that is called without its sides."""
    names = list(model.axes)
    if axis in names:
        return [names.index(axis)]
    if all(side + axis in names for side in _SIDES):
        return [names.index(side + axis) for side in _SIDES]
    pairs = [name.removeprefix(_SIDES[0]) for name in names if name.startswith(_SIDES[0])]
    raise UnknownName(
        message("walking.axis_under", "axis of {model} (under {section})", model=model.name, section=GETTING_UP),
        axis,
        [*names, *pairs],
    )
