"""A robot as its gaits are planned for it: its skeleton, its feet, and the figures of its gaits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from simrob_drake.kinematics.skeleton import Skeleton, skeleton_of
from simrob_drake.programs.gaits.feet import Foot, feet_of
from simrob_drake.programs.gaits.parameters import Gaits, gait, load_gaits
from simrob_drake.robots.catalog import RobotModel


@dataclass(frozen=True, eq=False)
class Walker:
    """What planners know of a robot."""

    skeleton: Skeleton
    gaits: Gaits

    @classmethod
    def of(cls, robot: str | RobotModel) -> Walker:
        """Return what planners know of a robot, which has a ``gaits.yaml`` beside its ``robot.yaml``.

        Args:
            robot: a robot of the package by its name, or any other's model.

        Raises:
            UnknownName: no such robot.
            InvalidParameter: a robot without gaits, or whose joints do not all turn.
            InvalidConfig: a file with a wrong entry.
        """
        gaits = load_gaits(robot)
        return cls(skeleton_of(robot), gaits)

    @property
    def model(self) -> RobotModel:
        """The robot's model."""
        return self.skeleton.model

    def gait(self, section: str, name: str, changes: Mapping[str, Any], amplitude: float = 1.0) -> Any:
        """Return the figures of one of its gaits, some of them changed; see :func:`gait`."""
        return gait(self.model.name, self.gaits, section, name, changes, amplitude)

    def feet(self, kind: str | None = None) -> list[Foot]:
        """Return the feet of a kind, of the default one unless given; see :func:`feet_of`."""
        return feet_of(self.skeleton, self.gaits.facing_deg, kind)
