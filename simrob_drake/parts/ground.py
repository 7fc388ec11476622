"""Ground of a station: a level or inclined floor, and boxes to stand on.

The boxes are those of the floor's terrain, and pieces that are fixed in the world. All heights above the ground, and
all directions away from it, are computed here. Points are given in the world [m], in arrays with a row x y z for each.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.frames import Vector
from simrob_drake.base.renaming import keep_former_attributes

# A point that is less deep below a surface counts as on it, since contacts give way [m].
_CONTACT_DEPTH = 5e-3
# A smaller component of the vertical in a box's axes counts as 0: the vertical is along the faces of this axis [1].
_SMALLEST_COMPONENT = 1e-12
# Count of points for which heights are computed at once: it bounds the memory.
_POINTS_AT_ONCE = 500

Box = tuple[RigidTransform, Vector]
"""Pose of a box's middle in the world, and half of its sides, shape (3,) [m]."""


class _Boxes(NamedTuple):
    """Boxes as arrays.

    Attributes:
        rotations: rotations to the world, shape (k, 3, 3).
        middles: middles in the world, shape (k, 1, 3) [m].
        halves: half of the sides, shape (k, 1, 3) [m].
    """

    rotations: Vector
    middles: Vector
    halves: Vector


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground of a station. Without a floor it is the plane z = 0, on which nothing can stand.

    Attributes:
        incline: angle of the floor, a plane through the world's origin [rad].
        heading: direction in which the floor rises, counterclockwise from the world's x axis [rad].
        has_floor: whether there is a floor.
        depth: depth below the floor's plane at which there is ground between the boxes [m]; above 0 if the boxes are
            stones over a ditch.
        boxes: the boxes.
    """

    incline: float = 0.0
    heading: float = 0.0
    has_floor: bool = True
    depth: float = 0.0
    boxes: tuple[Box, ...] = field(default=())

    @property
    def is_level_plane(self) -> bool:
        """Whether the ground is only the plane z = 0."""
        return not (self.incline or self.boxes)

    @cached_property
    def floor_pose(self) -> RigidTransform:
        """Pose of the floor in the world. Its z axis is the floor's normal."""
        # The axis of the rotation is horizontal, to the right of the direction in which the floor rises.
        rotation_axis = np.array([np.sin(self.heading), -np.cos(self.heading), 0.0])
        return RigidTransform(RotationMatrix(AngleAxis(self.incline, rotation_axis)), np.zeros(3))

    def floor_heights(self, points: Vector) -> Vector:
        """Compute the height z in the world at which the floor's plane is below or above each of m points.

        Args:
            points: shape (m, 3) [m]. Their own heights have no effect.

        Returns:
            The heights, shape (m,) [m].
        """
        # The plane goes through the origin: a point of it fulfils n_x x + n_y y + n_z z = 0.
        normal = self.floor_pose.rotation().col(2)
        return np.asarray(-(points[:, :2] @ normal[:2]) / normal[2])

    def beneath(self, points: Vector) -> Vector:
        """Compute the height z in the world of the highest ground beneath each of m points.

        The plane of the floor, lowered by `depth`, is ground for every point, also for a point below it, and also in a
        station without a floor. The top of a box is ground for points above it, or less than `_CONTACT_DEPTH` below it.

        Args:
            points: shape (m, 3) [m].

        Returns:
            The heights, shape (m,) [m].
        """
        # At least one group, which is empty if there are no points.
        groups = np.array_split(points, 1 + len(points) // _POINTS_AT_ONCE)
        return np.concatenate([self._beneath_few(group) for group in groups])

    def _beneath_few(self, points: Vector) -> Vector:
        """Compute the same as `beneath`, for so few points that arrays of the size boxes times points fit in memory."""
        # The depth is measured along the normal, so the plane of that depth lies lower by depth / n_z.
        normal_z = self.floor_pose.rotation().matrix()[2, 2]
        floor_heights = self.floor_heights(points) - self.depth / normal_z
        # Tops of boxes on the vertical lines through the points, shape (k, m). The top of a box above the point, such
        # as a table under which a robot stands, does not count.
        tops = self._box_tops(points)
        is_beneath = tops <= points[:, 2] + _CONTACT_DEPTH
        tops_beneath = np.where(is_beneath, tops, -np.inf)
        return np.asarray(np.maximum(floor_heights, tops_beneath.max(axis=0, initial=-np.inf)))

    def height(self, pose: Vector) -> float:
        """Compute the height of a pose (7,) or a point (3,) above the ground beneath [m]. A pose begins with x y z."""
        # Most stations have level ground. There, this is fast enough to be called in every step.
        if self.is_level_plane:
            return float(pose[2])
        return float(pose[2] - self.beneath(pose[np.newaxis, :3])[0])

    def carries(self, points: Vector, within: float) -> bool:
        """Check that each of m points has something to stand on beneath, within a distance.

        With a floor this is always true, whatever the distance: the floor is beneath every point. Without a floor it is
        false if there are no points, for example of a robot without feet.

        Args:
            points: shape (m, 3) [m].
            within: largest distance from a point down to the top of a box [m].
        """
        if self.has_floor:
            return True
        tops = self._box_tops(points)
        is_beneath = tops <= points[:, 2] + _CONTACT_DEPTH
        is_close = tops >= points[:, 2] - within
        can_stand = is_beneath & is_close  # (boxes, points)
        return len(points) > 0 and bool(can_stand.any(axis=0).all())

    @cached_property
    def _all_boxes(self) -> _Boxes:
        """The boxes of the ground as arrays."""
        # Without boxes, NumPy makes arrays of the shape (0,), which the reshapes turn into (0, 1, 3).
        return _Boxes(
            rotations=np.array([pose.rotation().matrix() for pose, _ in self.boxes]).reshape(
                -1, 3, 3
            ),
            middles=np.array([pose.translation() for pose, _ in self.boxes]).reshape(-1, 1, 3),
            halves=np.array([half for _, half in self.boxes]).reshape(-1, 1, 3),
        )

    def _boxes_near(self, points: Vector) -> _Boxes:
        """Select the boxes that may be below or above one of m points (m, 3). There are none without points."""
        boxes = self._all_boxes
        # No corner of a box is farther from its middle than half of its diagonal. So the middle of a box near the
        # points lies in the rectangle of the points, extended by that on all sides.
        half_diagonals = np.linalg.norm(boxes.halves[:, 0], axis=1)[:, np.newaxis]
        points_xy = points[:, :2]
        # Without points, the minimum is infinite and the maximum minus infinite, so that no box is between them.
        lowest_xy = points_xy.min(axis=0, initial=np.inf) - half_diagonals
        highest_xy = points_xy.max(axis=0, initial=-np.inf) + half_diagonals
        middles_xy = boxes.middles[:, 0, :2]
        is_between = (middles_xy >= lowest_xy) & (middles_xy <= highest_xy)
        is_near = is_between.all(axis=1)
        return _Boxes(
            rotations=boxes.rotations[is_near],
            middles=boxes.middles[is_near],
            halves=boxes.halves[is_near],
        )

    def _box_tops(self, points: Vector) -> Vector:
        """Compute the heights at which vertical lines through points leave boxes.

        Args:
            points: shape (m, 3) [m].

        Returns:
            The heights, shape (k, m) [m], for k boxes near the points; minus infinity if a line misses a box.
        """
        # Slab method. A line in the axes of a box is start + z up, with the height z. It is between the two faces of an
        # axis while -half <= start + z up <= half, and in the box while this holds for all three axes. A line along the
        # faces of an axis (up is 0) is between them at all heights, or at none. A line that lies in a face counts as
        # between them.
        boxes = self._boxes_near(points)
        # The world's vertical in the axes of each box, shape (k, 1, 3). A box that stands upright has components of 0.
        vertical = boxes.rotations[:, 2:]
        is_along = np.abs(vertical) < _SMALLEST_COMPONENT
        up = np.where(is_along, 1.0, vertical)  # without a division by 0
        # The line through a point begins at height 0, so that its parameter is the height z itself.
        points_at_zero = points * [1.0, 1.0, 0.0]
        start = (points_at_zero - boxes.middles) @ boxes.rotations  # shape (k, m, 3)

        # Heights at which a line passes the two faces of each axis, the lower one first.
        at_negative_faces = (-boxes.halves - start) / up
        at_positive_faces = (boxes.halves - start) / up
        at_faces = np.sort(np.stack([at_negative_faces, at_positive_faces]), axis=0)
        # For lines along the faces: between them up to any height, or never.
        upper_if_along = np.where(np.abs(start) <= boxes.halves, np.inf, -np.inf)
        lower = np.where(is_along, -upper_if_along, at_faces[0])
        upper = np.where(is_along, upper_if_along, at_faces[1])
        # The line enters the box once it is between the faces of all axes, and leaves it at the first face after that.
        enter = lower.max(axis=2)
        leave = upper.min(axis=2)
        return np.asarray(np.where(enter <= leave, leave, -np.inf))


keep_former_attributes(Ground, plain="is_level_plane", tilt="floor_pose")
