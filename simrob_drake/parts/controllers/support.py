"""Kinematics of a robot on its legs: its centre of mass relative to its feet, and the ends of its limbs.

The *root* is the link that floats, also called the base. A *limb* is the chain of joints from the root to a frame, such
as a leg. *At zero* means with all axes at the position 0.
"""

import math
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import cos, sin
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.tree import BodyIndex, Frame, Joint, RevoluteJoint, RigidBody

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.parts.soles import shares_by_height
from simrob_drake.parts.station_plant import StationRobot

# Least height of the centre of mass that is used [m]: a robot that lies would have an infinite omega.
_LEAST_HEIGHT = 0.01

Direction = Literal["sagittal", "lateral", "forward", "backward", "left", "right"]
"""Direction in which an error of the balance is measured. The first two have both signs."""


class _Sense(NamedTuple):
    """Part of an error that counts in a direction.

    Attributes:
        ahead: factor of the error ahead.
        left: factor of the error to the left.
        least: least result: 0 if errors to the other side do not count.
    """

    ahead: float
    left: float
    least: float


_SENSES: dict[Direction, _Sense] = {
    "sagittal": _Sense(1, 0, -math.inf),
    "lateral": _Sense(0, 1, -math.inf),
    "forward": _Sense(1, 0, 0),
    "backward": _Sense(-1, 0, 0),
    "left": _Sense(0, 1, 0),
    "right": _Sense(0, -1, 0),
}


@dataclass(frozen=True)
class BalanceState:
    """Deviation of a robot from its stance at the start. Vectors have the components ahead and to the left.

    Attributes:
        com: centre of mass from its position relative to the feet at the start, shape (2,) [m].
        speed: velocity of the centre of mass over the floor, shape (2,) [m/s].
        omega: natural frequency of tipping, sqrt(g / h), with the height h of the centre of mass [1/s].
        lifted: height of each foot above the lowest one, shape (feet,) [m].
    """

    com: Vector
    speed: Vector
    omega: float
    lifted: Vector

    def error(self, measures: Direction, lead: float | None = None) -> float:
        """Compute the error com + lead * speed in a direction [m].

        Args:
            measures: the direction. "sagittal" is positive ahead, "lateral" positive to the left. For a direction to
                one side alone, the error is 0 if the robot deviates to the other side.
            lead: time by which the velocity is extrapolated [s]. If it is None, it is 1/omega, and the result is the
                error of the capture point.
        """
        sense = _SENSES[measures]
        time = 1 / self.omega if lead is None else lead
        error = self.com + time * self.speed
        return max(sense.ahead * float(error[0]) + sense.left * float(error[1]), sense.least)

    @property
    def capture_point(self) -> Vector:
        """Point at which the robot comes to rest if it stands on its ankles alone, shape (2,) [m]."""
        return self.com + self.speed / self.omega


class _FootState(NamedTuple):
    """Motion of a foot.

    Attributes:
        heights: heights of its contact points, shape (k,) [m].
        arms: contact points from the foot's origin, in the world's axes, shape (k, 3) [m].
        home: present position of the point of the foot that was below the centre of mass at the start, shape (3,) [m].
        velocity: velocity of the foot.
    """

    heights: Vector
    arms: Vector
    home: Vector
    velocity: SpatialVelocity


class Support:
    """Kinematics of a robot on its feet, from its joints and the rotation of its base: no position is measured.

    The lowest contact points of the feet are taken to be at rest on the floor. Each foot has a home: the point below
    the centre of mass at the start, fixed to the foot. A foot that tips or is lifted counts less (see
    :func:`~simrob_drake.parts.soles.shares_by_height`), so it does not shift the result.
    """

    def __init__(self, robot: StationRobot, facing: float) -> None:
        """Prepare the computation.

        Args:
            robot: a robot with feet, whose root floats.
            facing: direction in which the robot looks at the start, from the world's x axis [rad].
        """
        assert robot.feet is not None  # the section has checked it
        plant = robot.plant
        root = robot.root.body()
        self._plant = weakref.proxy(plant)
        self._axes = robot.axis_map
        self._instance = robot.instance
        # Work space: every evaluation sets its state anew.
        self._scratch = plant.CreateDefaultContext()
        self._positions = plant.GetPositions(self._scratch)
        self._velocities = np.zeros(plant.num_velocities())
        # First index of the base's quaternion (4) among the plant's positions, and of its angular velocity (3) among
        # the velocities.
        self._rotation_start = root.floating_positions_start()
        self._spin_start = root.floating_velocities_start_in_v()
        self._gravity = float(np.linalg.norm(plant.gravity_field().gravity_vector()))
        self._links = [
            plant.GetBodyByName(link, robot.instance).index() for link in robot.feet.links
        ]
        self._points = [robot.feet.support_points(link) for link in robot.feet.links]

        rotation = robot.base.rotation()
        # Direction in which the robot looks, in the axes of the root link.
        self._ahead = rotation.inverse() @ np.array([math.cos(facing), math.sin(facing), 0.0])
        # The stance at the start. Its positions are relative: the base stays at the default position of the plant.
        at_rest = np.zeros(len(robot.initial))
        self._set_state(robot.initial, at_rest, rotation, np.zeros(3))
        poses = [link.EvalPoseInWorld(self._scratch) for link in self._feet()]
        below_com = plant.CalcCenterOfMassPositionInWorld(self._scratch, [self._instance])
        # The homes are at the height of the lowest contact point of all feet, which is taken as the floor.
        heights = [
            (pose @ points.T)[2].min() for pose, points in zip(poses, self._points, strict=True)
        ]
        below_com[2] = min(heights)
        self._homes = [pose.inverse() @ below_com for pose in poses]

    def observe(
        self, position: Vector, velocity: Vector, rotation: RotationMatrix, spin: Vector
    ) -> BalanceState:
        """Compute the robot's deviation from its stance at the start.

        Args:
            position: positions of the axes, shape (n,) [rad or m].
            velocity: velocities of the axes, shape (n,) [rad/s or m/s].
            rotation: rotation of the root link in the world.
            spin: angular velocity of the root link in the world's axes, shape (3,) [rad/s].

        Returns:
            The deviation, ahead and to the left in the direction in which the root link looks now.
        """
        self._set_state(position, velocity, rotation, spin)
        plant = self._plant
        instances = [self._instance]
        feet = self._observe_feet()
        floor = min(foot.heights.min() for foot in feet)

        # Means over the contact points, weighted by shares that fall with their heights: the home of the feet, and the
        # velocity of the points. The work space has a base without linear velocity. In truth the points are at rest on
        # the floor, so their velocity in the work space is the one that the base lacks, with the opposite sign.
        total_share = 0.0
        home = np.zeros(3)
        slip = np.zeros(3)
        for foot in feet:
            shares = shares_by_height(foot.heights, floor)
            foot_share = shares.sum()
            # The sum of w_i (v + omega x r_i) over the points i of a foot, with the shares w_i and their sum w, is
            # w v + omega x sum(w_i r_i).
            arm = shares @ foot.arms
            total_share += foot_share
            home += foot_share * foot.home
            slip += foot_share * foot.velocity.translational() + _cross(
                foot.velocity.rotational(), arm
            )
        com = plant.CalcCenterOfMassPositionInWorld(self._scratch, instances)
        com_velocity = plant.CalcCenterOfMassTranslationalVelocityInWorld(self._scratch, instances)
        com_velocity = com_velocity - slip / total_share

        # Rotation of level vectors from the world's axes to ahead and left: the matrix [[x, y], [-y, x]] / |(x, y)|,
        # with the level part (x, y) of the direction in which the robot looks.
        ahead_x, ahead_y, _ = rotation @ self._ahead
        to_heading = np.array([[ahead_x, ahead_y], [-ahead_y, ahead_x]]) / math.hypot(
            ahead_x, ahead_y
        )
        return BalanceState(
            com=to_heading @ (com - home / total_share)[:2],
            speed=to_heading @ com_velocity[:2],
            omega=math.sqrt(self._gravity / max(com[2] - floor, _LEAST_HEIGHT)),
            lifted=np.array([foot.heights.min() - floor for foot in feet]),
        )

    def _observe_feet(self) -> list[_FootState]:
        """Compute the motion of each foot in the state of the work space, in which the base has no linear velocity."""
        feet = []
        for link, points, home in zip(self._feet(), self._points, self._homes, strict=True):
            pose = link.EvalPoseInWorld(self._scratch)
            # R p for each contact point p of the foot, a row of `points` (k, 3).
            arms = points @ pose.rotation().matrix().T
            foot = _FootState(
                heights=pose.translation()[2] + arms[:, 2],
                arms=arms,
                home=pose @ home,
                velocity=link.EvalSpatialVelocityInWorld(self._scratch),
            )
            feet.append(foot)
        return feet

    def _set_state(
        self, position: Vector, velocity: Vector, rotation: RotationMatrix, spin: Vector
    ) -> None:
        """Set the state of the work space. The position of the base stays, and its linear velocity is zero.

        Args:
            position: positions of the axes, shape (n,) [rad or m].
            velocity: velocities of the axes, shape (n,) [rad/s or m/s].
            rotation: rotation of the root link in the world.
            spin: angular velocity of the root link in the world's axes, shape (3,) [rad/s].
        """
        self._positions[self._rotation_start : self._rotation_start + 4] = (
            rotation.ToQuaternion().wxyz()
        )
        # The positive sense of an axis may be opposite to that of its joint, so its value gets the axis's sign.
        self._positions[self._axes.position_places] = self._axes.signs * position
        self._velocities[self._spin_start : self._spin_start + 3] = spin
        self._velocities[self._axes.velocity_places] = self._axes.signs * velocity
        self._plant.SetPositions(self._scratch, self._positions)
        self._plant.SetVelocities(self._scratch, self._velocities)

    def _feet(self) -> list[RigidBody]:
        """Links of the feet."""
        return [self._plant.get_body(index) for index in self._links]


keep_former_attributes(Support, balanced="observe")


def _cross(first: Vector, second: Vector) -> Vector:
    """Compute the cross product of two vectors (3,). NumPy's takes ten times as long."""
    a, b, c = first
    x, y, z = second
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


class _PlainJoint(NamedTuple):
    """A joint of a limb in plain numbers.

    Attributes:
        axis: index among the robot's n axes.
        direction: unit vector about which the joint turns, at zero in the root's frame, 3 numbers.
        point: a point on the line about which it turns, at zero in the root's frame, 3 numbers [m].
    """

    axis: int
    direction: list[float]
    point: list[float]


class _JointMatrices(NamedTuple):
    """Matrices of a joint of a limb, for rotations about its axis.

    Attributes:
        axis: index among the robot's n axes.
        cross: matrix K of the cross product with its direction, shape (3, 3).
        cross_squared: K², shape (3, 3).
        point: a point on the line about which the joint turns, at zero in the root's frame, shape (3,) [m].
    """

    axis: int
    cross: Vector
    cross_squared: Vector
    point: Vector

    def rotate(self, arms: Vector, angle: float) -> Vector:
        """Rotate vectors, shape (3,) or (3, k), about the joint's direction by an angle [rad].

        Rodrigues' formula: r + sin(angle) K r + (1 - cos(angle)) K² r.
        """
        return np.asarray(
            arms
            + sin(angle) * (self.cross @ arms)
            + (1.0 - cos(angle)) * (self.cross_squared @ arms)
        )


@dataclass(frozen=True, eq=False)
class Limb:
    """A chain of k revolute joints, from the root outward.

    Attributes:
        axes: indices of the joints among the robot's n axes.
        turns: unit vectors about which the joints turn, at zero in the root's frame, shape (k, 3).
        points: a point on the line about which each joint turns, at zero in the root's frame, shape (k, 3) [m].
        end: the point at the limb's end at zero in the root's frame, shape (3,) [m].
    """

    axes: list[int]
    turns: Vector
    points: Vector
    end: Vector

    @cached_property
    def places(self) -> slice | list[int]:
        """Index of its axes in arrays over all axes. If they are consecutive, it is a slice, which is faster."""
        first = self.axes[0]
        last = self.axes[-1]
        is_consecutive = self.axes == list(range(first, last + 1))
        return slice(first, last + 1) if is_consecutive else self.axes

    # `place` and `rates` go from the end inward: each joint rotates the whole part of the limb beyond it. So directions
    # and points at zero suffice.

    @cached_property
    def _plain_joints(self) -> list[_PlainJoint]:
        """Joints in plain numbers, from the end inward."""
        joints = zip(self.axes, self.turns.tolist(), self.points.tolist(), strict=True)
        return [_PlainJoint(axis, direction, point) for axis, direction, point in joints][::-1]

    @cached_property
    def _plain_end(self) -> list[float]:
        """End of the limb at zero, 3 numbers [m]."""
        end: list[float] = self.end.tolist()
        return end

    @cached_property
    def _joint_matrices(self) -> list[_JointMatrices]:
        """Matrices of the joints, from the end inward."""
        found = []
        for axis, turn, point in zip(self.axes, self.turns, self.points, strict=True):
            cross = np.cross(turn, np.eye(3)).T  # its columns are k x e_i, so K r = k x r
            found.append(_JointMatrices(axis, cross, cross @ cross, point))
        return found[::-1]

    def place(self, positions: Sequence[float]) -> tuple[float, float, float]:
        """Compute the position of the end in the root's frame [m], for positions of all n axes [rad].

        It uses plain numbers, which are faster than arrays of this size: loops call it at every sample.
        """
        x, y, z = self._plain_end
        for joint in self._plain_joints:
            kx, ky, kz = joint.direction
            px, py, pz = joint.point
            angle = positions[joint.axis]
            s = sin(angle)
            c = cos(angle)
            # Rodrigues' formula for the arm r from the joint: c r + s (k x r) + (1 - c) (k r) k.
            x -= px
            y -= py
            z -= pz
            along = (1.0 - c) * (kx * x + ky * y + kz * z)
            new_x = px + c * x + s * (ky * z - kz * y) + along * kx
            new_y = py + c * y + s * (kz * x - kx * z) + along * ky
            new_z = pz + c * z + s * (kx * y - ky * x) + along * kz
            x = new_x
            y = new_y
            z = new_z
        return x, y, z

    def rates(self, positions: Vector) -> Vector:
        """Compute the Jacobian of the end's position in the root's frame, shape (3, k) [m/rad].

        Its columns are the limb's joints, from the root outward.

        Args:
            positions: positions of all n axes, shape (n,) [rad].
        """
        place = self.end
        columns = np.empty((3, 0))
        # From the end inward, each joint adds a column, k x arm, in front of the others. Then it rotates all columns:
        # its own too, since its arm was that at its angle 0.
        for joint in self._joint_matrices:
            arm = place - joint.point
            angle = positions[joint.axis]
            columns = np.column_stack([joint.cross @ arm, columns])
            place = joint.point + joint.rotate(arm, angle)
            columns = joint.rotate(columns, angle)
        return columns


def limb_to(robot: StationRobot, end: Frame) -> Limb:
    """Find the limb from a robot's root to a frame, whose origin is the end of the limb.

    Raises:
        Unsuitable: no axis moves the frame, or an axis on the way does not turn.
    """
    plant = robot.plant
    context = plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant, context, np.zeros(len(robot.axes)))
    axes = axes_to(robot, end)
    turns = list[Vector]()
    points = list[Vector]()
    for axis in axes:
        joint = robot.joints[axis]
        assert isinstance(joint, RevoluteJoint)  # axes_to() has checked it
        # At zero, the frames of the joint on its parent and on its child are equal.
        pose = plant.CalcRelativeTransform(context, robot.root, joint.frame_on_child())
        turns.append(robot.axis_map.signs[axis] * (pose.rotation() @ joint.revolute_axis()))
        points.append(pose.translation())
    end_point = plant.CalcRelativeTransform(context, robot.root, end).translation()
    return Limb(axes=axes, turns=np.array(turns), points=np.array(points), end=end_point)


def axes_to(robot: StationRobot, end: Frame) -> list[int]:
    """Find the indices of the axes between a robot's root and a frame, from the root outward.

    Joints that are no axes of the robot, such as welds, are left out.

    Raises:
        Unsuitable: no axis moves the frame, or an axis on the way does not turn.
    """
    plant = robot.plant
    # Joint that moves a body, by the body: each body of a plant has at most one.
    joint_of_body = dict[BodyIndex, Joint]()
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        joint_of_body[joint.child_body().index()] = joint
    axis_of_joint = {joint.index(): axis for axis, joint in enumerate(robot.joints)}

    # From the end inward, to the root, or to a body that no joint moves if the frame is not part of the robot.
    axes = list[int]()
    body = end.body()
    while body.index() != robot.root.body().index() and body.index() in joint_of_body:
        joint = joint_of_body[body.index()]
        if joint.index() in axis_of_joint:
            if not isinstance(joint, RevoluteJoint):
                raise Unsuitable(
                    message("parts.limb_to", "limb to {end}", end=end.name()),
                    message(
                        "parts.joint_does_not_turn",
                        "its joint {joint} does not turn",
                        joint=joint.name(),
                    ),
                    message("parts.of_turning_joints", "name a limb whose joints all turn"),
                )
            axes.insert(0, axis_of_joint[joint.index()])
        body = joint.parent_body()
    if not axes:
        raise Unsuitable(
            message("parts.limb_to", "limb to {end}", end=end.name()),
            message("parts.without_joint", "no joint moves it"),
            message("parts.moved_by_joints", "name a limb that joints move"),
        )
    return axes


if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"Balanced": "BalanceState"})
