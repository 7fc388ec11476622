"""Where the end of a limb is, seen from the root of its robot: by the screws of its joints, from numbers alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import cos, sin

import numpy as np
from pydrake.multibody.tree import Frame, RevoluteJoint

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot


@dataclass(frozen=True, eq=False)
class Limb:
    """Revolute joints in a row, from the root outward.

    Attributes:
        axes: their places among the robot's axes, shape (k,).
        turns: their directions at zero in the root's frame, shape (k, 3).
        points: points on them at zero [m], shape (k, 3).
        end: the point at its end at zero, shape (3,) [m].
    """

    axes: list[int]
    turns: Vector
    points: Vector
    end: Vector

    @cached_property
    def _crossing(self) -> list[tuple[int, Vector, Vector, Vector]]:
        """Axis, matrix K of its direction's cross product, K² and point of each joint, from the end inward."""
        return [
            (axis, cross := np.cross(turn, np.eye(3)).T, cross @ cross, point)
            for axis, turn, point in zip(self.axes[::-1], self.turns[::-1], self.points[::-1], strict=True)
        ]

    @cached_property
    def places(self) -> slice | list[int]:
        """Its axes as an index: a slice, where they stand in a row, is quicker."""
        first, last = self.axes[0], self.axes[-1]
        return slice(first, last + 1) if self.axes == list(range(first, last + 1)) else self.axes

    @cached_property
    def _plain(self) -> tuple[list[tuple[int, list[float], list[float]]], list[float]]:
        """Axis, direction and point of each joint, from the end inward, and the end, as plain numbers."""
        joints = zip(self.axes[::-1], self.turns[::-1].tolist(), self.points[::-1].tolist(), strict=True)
        return list(joints), self.end.tolist()

    def place(self, positions: Sequence[float]) -> tuple[float, float, float]:
        """Return where the end is at positions of all n axes [m]: of plain numbers, for loops ask at every sample."""
        joints, (x, y, z) = self._plain
        for axis, (kx, ky, kz), (px, py, pz) in joints:
            x, y, z, s, c = x - px, y - py, z - pz, sin(positions[axis]), cos(positions[axis])
            along = (1.0 - c) * (kx * x + ky * y + kz * z)
            x, y, z = (
                px + c * x + s * (ky * z - kz * y) + along * kx,
                py + c * y + s * (kz * x - kx * z) + along * ky,
                pz + c * z + s * (kx * y - ky * x) + along * kz,
            )
        return x, y, z

    def rates(self, positions: Vector) -> Vector:
        """Return how the end moves with the joints, shape (3, k) [m/rad]."""
        place, columns = self.end, np.empty((3, 0))
        for axis, cross, twice, point in self._crossing:
            columns = np.column_stack([cross @ (place - point), columns])
            place = point + _turned(place - point, cross, twice, positions[axis])
            columns = _turned(columns, cross, twice, positions[axis])
        return columns


def limb_to(robot: StationRobot, end: Frame) -> Limb:
    """Return the limb of a robot between its root and a frame.

    Raises:
        InvalidParameter: a frame that no joint of the robot moves, or a limb with a joint that slides.
    """
    plant, context = robot.plant, robot.plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant, context, np.zeros(len(robot.axes)))
    axes, turns, points = axes_to(robot, end), list[Vector](), list[Vector]()
    for axis in axes:
        joint = robot.joints[axis]
        assert isinstance(joint, RevoluteJoint)  # axes_to() has looked
        pose = plant.CalcRelativeTransform(context, robot.root, joint.frame_on_child())
        turns.append(robot.axis_map.signs[axis] * (pose.rotation() @ joint.revolute_axis()))
        points.append(pose.translation())
    place = plant.CalcRelativeTransform(context, robot.root, end).translation()
    return Limb(axes, np.array(turns), np.array(points), place)


def axes_to(robot: StationRobot, end: Frame) -> list[int]:
    """Return the places of the axes between the root of a robot and a frame, from the root outward.

    Raises:
        InvalidParameter: a frame that no joint of the robot moves, or a limb with a joint that slides.
    """
    plant, body, axes = robot.plant, end.body(), list[int]()
    inward = {plant.get_joint(index).child_body().index(): plant.get_joint(index) for index in plant.GetJointIndices()}
    places = {joint.index(): number for number, joint in enumerate(robot.joints)}
    while body.index() != robot.root.body().index() and body.index() in inward:
        joint = inward[body.index()]
        if joint.index() in places:
            if not isinstance(joint, RevoluteJoint):
                raise InvalidParameter(f"limb to {end.name()}", f"with {joint.name()}", "of joints that turn")
            axes.insert(0, places[joint.index()])
        body = joint.parent_body()
    if not axes:
        raise InvalidParameter(f"limb to {end.name()}", "without a joint", "one that joints move")
    return axes


def _turned(arms: Vector, cross: Vector, twice: Vector, angle: float) -> Vector:
    """Return arms (3,) or (3, k), turned by an angle about the direction of a joint (Rodrigues)."""
    return np.asarray(arms + sin(angle) * (cross @ arms) + (1.0 - cos(angle)) * (twice @ arms))
