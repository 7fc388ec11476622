"""A robot as its gaits are planned for it: its skeleton, its feet, and the parameters of its gaits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from simrob_drake.errors import UnknownName
from simrob_drake.frames import Vector
from simrob_drake.kinematics.skeleton import Skeleton, skeleton_of
from simrob_drake.programs.gaits.feet import Foot, feet_of
from simrob_drake.programs.gaits.parameters import Gaits, load_gaits
from simrob_drake.programs.gaits.zmp import LEVEL
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.yaml_files import validated

_SCALED = ("step_length", "stride", "sideways", "turn_deg")  # what an amplitude scales
_SIDES = {"left": "right", "right": "left"}


@dataclass(frozen=True, eq=False)
class Walker:
    """What planners know of a robot."""

    skeleton: Skeleton
    """The robot, with what it carries."""
    gaits: Gaits
    gravity: Vector = field(default_factory=LEVEL.copy)
    """In the frame of the ground, the robot looking along x, shape (3,) [m/s²]."""
    differs: bool = False
    """Whether it carries something or stands on a slope, which its gaits are not made for."""

    @classmethod
    def of(cls, robot: str | RobotModel | Walker) -> Walker:
        """Return what planners know of a robot, which has a ``gaits.yaml`` beside its ``robot.yaml``.

        Args:
            robot: a robot of the package by its name, any other's model, or what is known of it already.

        Raises:
            UnknownName: no such robot.
            InvalidParameter: a robot without gaits, or whose joints do not all turn.
            InvalidConfig: a file with a wrong entry.
        """
        if isinstance(robot, Walker):
            return robot
        gaits = load_gaits(robot)
        return cls(skeleton_of(robot), gaits)

    @property
    def model(self) -> RobotModel:
        """The robot's model."""
        return self.skeleton.model

    def gait(self, section: str, name: str, changes: Mapping[str, Any], amplitude: float = 1.0) -> Any:
        """Return the parameters of a gait, some of them changed.

        Args:
            section: of its file, such as ``walks``.
            name: which.
            changes: parameters in place of the gait's own.
            amplitude: scales lengths and turns of its steps.

        Raises:
            UnknownName: no such gait there; tells what there is, in other sections if this one is empty.
            InvalidConfig: a parameter that cannot be.
        """
        known: Mapping[str, Any] = getattr(self.gaits, section)
        if name not in known:
            sections = [key for key in Gaits.model_fields if isinstance(getattr(self.gaits, key), dict)]
            others = [f"{other} ({key})" for key in sections for other in getattr(self.gaits, key)]
            raise UnknownName(f"gait of {self.model.name} under {section}", name, known or others)
        found = known[name]
        scaled = {key: amplitude * value for key in _SCALED if (value := getattr(found, key, 0.0))}
        return validated(type(found), {**found.model_dump(exclude_unset=True), **scaled, **changes}, f"gait {name}")

    def feet(self, kind: str | None = None) -> list[Foot]:
        """Return the feet of a kind, of the default one unless given; see :func:`feet_of`."""
        return feet_of(self.skeleton, self.gaits.facing_deg, kind)


def mirrored(model: RobotModel, values: Vector) -> Vector:
    """Return per-axis values (n,) with left and right exchanged; turns to a side change their sense."""
    names = list(model.axes)
    result = np.empty_like(values)
    for place, name in enumerate(names):
        side, _, rest = name.partition("_")
        other = names.index(f"{_SIDES[side]}_{rest}") if side in _SIDES else place
        result[place] = -values[other] if name.endswith("yaw") else values[other]
    return result
