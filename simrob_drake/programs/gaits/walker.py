"""A robot as its gaits are planned for it: its skeleton, its feet, and the parameters of its gaits."""

from dataclasses import dataclass, field

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.kinematics.skeleton import Skeleton, skeleton_of
from simrob_drake.programs.gaits.feet import Foot, feet_of
from simrob_drake.programs.gaits.zmp import LEVEL
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import GaitsFile, gaits_file

_SIDES = {"left": "right", "right": "left"}


@dataclass(frozen=True, eq=False)
class Walker:
    """What planners know of a robot."""

    skeleton: Skeleton  # the robot, with what it carries
    gaits: GaitsFile
    gravity: Vector = field(default_factory=LEVEL.copy)
    """In the frame of the ground, the robot looking along x, shape (3,) [m/s²]."""
    differs: bool = False  # whether it carries something or stands on a slope, which its gaits are not made for

    @classmethod
    def of(cls, robot: "str | RobotModel | Walker") -> "Walker":
        """Return what planners know of a robot with a ``gaits.yaml``: of its name, its model, or what is known already.

        Raises UnknownName: no such robot; InvalidParameter: one without gaits, or with joints that do not turn;
        InvalidConfig: a file with a wrong entry.
        """
        if isinstance(robot, Walker):
            return robot
        gaits = gaits_file(robot)
        return cls(skeleton_of(robot), gaits)

    @property
    def model(self) -> RobotModel:
        """The robot's model."""
        return self.skeleton.model

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
