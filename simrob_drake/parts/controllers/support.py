"""The kinematics of a robot on its legs: its centre of mass against its feet, and where the ends of its limbs are."""

import math
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import cos, sin
from typing import Literal

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.tree import Frame, RevoluteJoint, RigidBody

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.parts.soles import shares_by_height
from simrob_drake.parts.station_plant import StationRobot

_LOWEST = 0.01  # the least height of the centre of mass that is reckoned with [m]: a robot that lies has fallen

Direction = Literal["sagittal", "lateral", "forward", "backward", "left", "right"]
_SENSES: dict[Direction, tuple[float, float, float]] = {
    "sagittal": (1, 0, -math.inf),
    "lateral": (0, 1, -math.inf),
    "forward": (1, 0, 0),
    "backward": (-1, 0, 0),
    "left": (0, 1, 0),
    "right": (0, -1, 0),
}  # of each direction: its parts ahead and to the left, and the least error that counts


@dataclass(frozen=True)
class Balanced:
    """How far a robot is from standing as at the start: ahead and to the left."""

    com: Vector  # its centre of mass, from where its feet had it at the start, shape (2,) [m]
    speed: Vector  # of that over the floor, shape (2,) [m/s]
    omega: float  # how fast it would tip, sqrt(g/h) with the height h of the centre of mass [1/s]
    lifted: Vector  # how high each foot is above the lowest, shape (feet,) [m]

    def error(self, measures: Direction, lead: float | None = None) -> float:
        """Return how far it errs in a direction, the velocity counting for ``lead`` seconds, 1/ω unless given [m]."""
        ahead, left, least = _SENSES[measures]
        error = self.com + (1 / self.omega if lead is None else lead) * self.speed
        return max(ahead * float(error[0]) + left * float(error[1]), least)

    @property
    def capture_point(self) -> Vector:
        """Where it comes to rest if it stands on ankles alone, shape (2,) [m]."""
        return self.com + self.speed / self.omega


class Support:
    """The kinematics of a robot on its feet, of joints and of how its base turns alone: nothing tells where it is.

    The lowest contact points of the feet are taken to stand still on the floor. Each foot knows the place under the
    centre of mass at the start, so a foot that tips or is lifted does not move it.
    """

    def __init__(self, robot: StationRobot, facing: float) -> None:
        """Prepare a robot on feet that looks along ``facing`` at the start: an angle from the world's x axis [rad]."""
        assert robot.feet is not None  # the section has checked
        plant, root = robot.plant, robot.root.body()
        self._plant, self._axes, self._instance = weakref.proxy(plant), robot.axis_map, robot.instance
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew
        self._positions, self._velocities = plant.GetPositions(self._scratch), np.zeros(plant.num_velocities())
        self._turn, self._spin = root.floating_positions_start(), root.floating_velocities_start_in_v()
        self._gravity = float(np.linalg.norm(plant.gravity_field().gravity_vector()))
        self._links = [plant.GetBodyByName(link, robot.instance).index() for link in robot.feet.links]
        self._points = [robot.feet.support_points(link) for link in robot.feet.links]
        start = robot.base.rotation()
        self._ahead = start.inverse() @ np.array([math.cos(facing), math.sin(facing), 0.0])
        self._put(robot.initial, np.zeros(len(robot.initial)), start, np.zeros(3))
        poses = [link.EvalPoseInWorld(self._scratch) for link in self._feet()]
        under = plant.CalcCenterOfMassPositionInWorld(self._scratch, [self._instance])
        points = zip(poses, self._points, strict=True)
        under[2] = min((pose @ points.T)[2].min() for pose, points in points)
        self._unders = [pose.inverse() @ under for pose in poses]

    def balanced(self, position: Vector, velocity: Vector, turned: RotationMatrix, spin: Vector) -> Balanced:
        """Return how the robot stands, of its axes (n,) [rad or m] and their velocities, and of its root link.

        That is ``turned`` in the world, with an angular velocity ``spin`` (3,) [rad/s] in the world's axes.
        """
        self._put(position, velocity, turned, spin)
        plant, scratch, feet = self._plant, self._scratch, []
        for link, points, under in zip(self._feet(), self._points, self._unders, strict=True):
            pose, motion = link.EvalPoseInWorld(scratch), link.EvalSpatialVelocityInWorld(scratch)
            arms = points @ pose.rotation().matrix().T
            feet.append((pose.translation()[2] + arms[:, 2], arms, pose @ under, motion))
        floor = min(heights.min() for heights, *_ in feet)
        carried, place, slip = 0.0, np.zeros(3), np.zeros(3)
        for heights, arms, own_place, motion in feet:
            share = shares_by_height(heights, floor)
            part, arm = share.sum(), share @ arms
            carried += part
            place += part * own_place
            # the vector product, by hand: NumPy's takes ten times as long
            (a, b, c), (x, y, z) = motion.rotational(), arm
            slip += part * motion.translational() + np.array([b * z - c * y, c * x - a * z, a * y - b * x])
        centre = plant.CalcCenterOfMassPositionInWorld(scratch, [self._instance])
        speed = plant.CalcCenterOfMassTranslationalVelocityInWorld(scratch, [self._instance]) - slip / carried
        ahead, left, _ = turned @ self._ahead
        heading = np.array([[ahead, left], [-left, ahead]]) / math.hypot(ahead, left)
        omega = math.sqrt(self._gravity / max(centre[2] - floor, _LOWEST))
        lifted = np.array([heights.min() - floor for heights, *_ in feet])
        return Balanced(heading @ (centre - place / carried)[:2], heading @ speed[:2], omega, lifted)

    def _put(self, position: Vector, velocity: Vector, turned: RotationMatrix, spin: Vector) -> None:
        self._positions[self._turn : self._turn + 4] = turned.ToQuaternion().wxyz()
        self._positions[self._axes.position_places] = self._axes.signs * position
        self._velocities[self._spin : self._spin + 3] = spin
        self._velocities[self._axes.velocity_places] = self._axes.signs * velocity
        self._plant.SetPositions(self._scratch, self._positions)
        self._plant.SetVelocities(self._scratch, self._velocities)

    def _feet(self) -> list[RigidBody]:
        return [self._plant.get_body(index) for index in self._links]


@dataclass(frozen=True, eq=False)
class Limb:
    """Revolute joints in a row, from the root outward."""

    axes: list[int]  # their places among the robot's axes, shape (k,)
    turns: Vector  # their directions at zero in the root's frame, shape (k, 3)
    points: Vector  # points on them at zero [m], shape (k, 3)
    end: Vector  # the point at its end at zero, shape (3,) [m]

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
    """Return the limb from a robot's root to a frame; raises InvalidParameter: no joint moves it, or one slides."""
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
    """Return the axes' places from a robot's root outward to a frame; raises InvalidParameter: as :func:`limb_to`."""
    plant, body, axes = robot.plant, end.body(), list[int]()
    inward = {plant.get_joint(index).child_body().index(): plant.get_joint(index) for index in plant.GetJointIndices()}
    places = {joint.index(): number for number, joint in enumerate(robot.joints)}
    while body.index() != robot.root.body().index() and body.index() in inward:
        joint = inward[body.index()]
        if joint.index() in places:
            if not isinstance(joint, RevoluteJoint):
                raise InvalidParameter(
                    message("parts.limb_to", "limb to {end}", end=end.name()),
                    message("parts.with_joint", "with {joint}", joint=joint.name()),
                    message("parts.of_turning_joints", "of joints that turn"),
                )
            axes.insert(0, places[joint.index()])
        body = joint.parent_body()
    if not axes:
        raise InvalidParameter(
            message("parts.limb_to", "limb to {end}", end=end.name()),
            message("parts.without_joint", "without a joint"),
            message("parts.moved_by_joints", "one that joints move"),
        )
    return axes


def _turned(arms: Vector, cross: Vector, twice: Vector, angle: float) -> Vector:
    """Return arms (3,) or (3, k), turned by an angle about the direction of a joint (Rodrigues)."""
    return np.asarray(arms + sin(angle) * (cross @ arms) + (1.0 - cos(angle)) * (twice @ arms))
