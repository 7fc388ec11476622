"""What robots stand on: a floor, level or inclined, and boxes: of its terrain, and of pieces fixed in the world.

Everything that asks how high something is over the ground, or which way is up from it, asks here.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.frames import Vector

_PRESSED_IN = 5e-3  # a point that lies so little below a surface is on it: contacts give way [m]
_UPRIGHT = 1e-12
_TOGETHER = 500  # points that are looked at in one go


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground of a station; without a floor it is the plane z = 0, which carries nothing."""

    incline: float = 0.0  # angle of the floor, a plane through the world's origin [rad]
    heading: float = 0.0  # which way it rises, counterclockwise from the world's x [rad]
    has_floor: bool = True  # whether there is a floor
    depth: float = 0.0  # how far below the origin the plane lies that all else of the floor lies on [m]
    # further bodies to stand on: pose in the world, and half of the sides, shape (3,) [m]
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
        """Return the level heights of the floor over or under points (m, 3), shape (m,) [m]."""
        normal = self.tilt.rotation().col(2)
        return np.asarray(-(points[:, :2] @ normal[:2]) / normal[2])

    def beneath(self, points: Vector) -> Vector:
        """Return the height of the ground beneath each of some points (m, 3): the highest there is, shape (m,) [m]."""
        parts = np.array_split(points, 1 + len(points) // _TOGETHER)
        return np.concatenate([self._beneath(part) for part in parts])

    def _beneath(self, points: Vector) -> Vector:
        lowest = self.floor_heights(points) - self.depth / self.tilt.rotation().matrix()[2, 2]
        tops = self._tops(points)
        beneath = np.where(tops <= points[:, 2] + _PRESSED_IN, tops, -np.inf)
        return np.asarray(np.maximum(lowest, beneath.max(axis=0, initial=-np.inf)))

    def height(self, pose: Vector) -> float:
        """Return how high a pose (7,) or a point (3,) is over the ground beneath [m]: quickly, for every step."""
        return float(pose[2]) if self.plain else float(pose[2] - self.beneath(pose[np.newaxis, :3])[0])

    def carries(self, points: Vector, within: float) -> bool:
        """Tell whether there is something to stand on ``within`` a distance [m] beneath each of some points (m, 3)."""
        if self.has_floor:
            return True
        tops = self._tops(points)
        near = (tops <= points[:, 2] + _PRESSED_IN) & (tops >= points[:, 2] - within)
        return bool(near.size and near.any(axis=0).all())

    @cached_property
    def _stacked(self) -> tuple[Vector, Vector, Vector]:
        """The boxes' rotations (k, 3, 3), middles (k, 1, 3) and halves (k, 1, 3)."""
        turns = np.array([pose.rotation().matrix() for pose, _ in self.boxes]).reshape(-1, 3, 3)
        middles = np.array([pose.translation() for pose, _ in self.boxes]).reshape(-1, 1, 3)
        return turns, middles, np.array([half for _, half in self.boxes]).reshape(-1, 1, 3)

    def _tops(self, points: Vector) -> Vector:
        """Return where vertical lines through points (m, 3) leave each of k boxes, (k, m) [m], -inf where they miss."""
        turns, middles, half = self._stacked
        reach = np.linalg.norm(half[:, 0], axis=1)[:, np.newaxis]
        low, high = points[:, :2].min(axis=0) - reach, points[:, :2].max(axis=0) + reach
        near = ((middles[:, 0, :2] >= low) & (middles[:, 0, :2] <= high)).all(axis=1)
        turns, middles, half = turns[near], middles[near], half[near]  # of boxes over or under some of the points
        up = turns[:, 2:]  # in the boxes
        along = np.where(np.abs(up) < _UPRIGHT, _UPRIGHT, up)
        foot = (points * [1.0, 1.0, 0.0] - middles) @ turns
        ends = np.sort(np.stack([(-half - foot) / along, (half - foot) / along]), axis=0)
        enter, leave = ends[0].max(axis=2), ends[1].min(axis=2)
        return np.asarray(np.where(enter <= leave, leave, -np.inf))
