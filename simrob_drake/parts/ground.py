"""What robots stand on: a floor, level or inclined, and the boxes of pieces that are fixed in the world.

Everything that asks how high something is over the ground, or which way is up from it, asks here.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import Vector

_PRESSED_IN = 5e-3  # a point that lies so little below a surface is on it: contacts give way [m]
_UPRIGHT = 1e-12


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground of a station; without a floor it is the plane z = 0, which carries nothing.

    Attributes:
        incline: angle of the floor, a plane through the world's origin [rad].
        heading: which way it rises, counterclockwise from the world's x [rad].
        has_floor: whether there is a floor.
        boxes: further bodies to stand on: pose in the world, and half of the sides, shape (3,) [m].
    """

    incline: float = 0.0
    heading: float = 0.0
    has_floor: bool = True
    boxes: tuple[tuple[RigidTransform, Vector], ...] = field(default=())

    @property
    def plain(self) -> bool:
        """Whether it is the plane z = 0 and no more."""
        return not (self.incline or self.boxes)

    @cached_property
    def tilt(self) -> RigidTransform:
        """Pose of the floor in the world: its z axis is the normal."""
        about = np.array([np.sin(self.heading), -np.cos(self.heading), 0.0])
        return RigidTransform(RotationMatrix(AngleAxis(self.incline, about)), np.zeros(3))

    def floor_heights(self, points: Vector) -> Vector:
        """Return the heights of the floor over or under points (m, 3), shape (m,) [m]."""
        normal = self.tilt.rotation().col(2)
        return np.asarray(-(points[:, :2] @ normal[:2]) / normal[2])

    def beneath(self, points: Vector) -> Vector:
        """Return the height of the ground beneath each of some points (m, 3): the highest there is, shape (m,) [m]."""
        highest = self.floor_heights(points)
        for pose, half in self.boxes:
            tops = _tops(pose, half, points)
            highest = np.where(tops <= points[:, 2] + _PRESSED_IN, np.maximum(highest, tops), highest)
        return highest

    def height(self, pose: Vector) -> float:
        """Return how high a pose (7,) or a point (3,) is over the ground beneath [m]: quickly, for every step."""
        return float(pose[2]) if self.plain else float(pose[2] - self.beneath(pose[np.newaxis, :3])[0])

    def carries(self, points: Vector, within: float) -> bool:
        """Tell whether there is something to stand on ``within`` a distance [m] beneath each of some points (m, 3)."""
        if self.has_floor:
            return True
        tops = np.array([_tops(pose, half, points) for pose, half in self.boxes])
        near = (tops <= points[:, 2] + _PRESSED_IN) & (tops >= points[:, 2] - within)
        return bool(near.size and near.any(axis=0).all())


def _tops(pose: RigidTransform, half: Vector, points: Vector) -> Vector:
    """Return the heights at which vertical lines through points (m, 3) leave a box [m]; -inf where they miss it."""
    rotation = pose.rotation().matrix()
    up = rotation[2]  # in the box
    along = np.where(np.abs(up) < _UPRIGHT, _UPRIGHT, up)
    foot = (points * [1.0, 1.0, 0.0] - pose.translation()) @ rotation
    ends = np.sort(np.stack([(-half - foot) / along, (half - foot) / along]), axis=0)
    enter, leave = ends[0].max(axis=1), ends[1].min(axis=1)
    return np.asarray(np.where(enter <= leave, leave, -np.inf))
