"""Kinematics of a walking robot: its centre of mass, the positions of its feet, and inverse kinematics of its legs.

The root is the robot's trunk, a free body of the plant. An axis is a joint with a servo; its sign is -1 if it counts
against the sense of Drake's joint. The stance is the posture in which the robot stands with flat soles, side by side. A
sole's frame has its origin in the middle of the sole, or of the ball if the foot is a ball; in the stance, its axes are
those of the robot: x ahead, y to the left, z up. Complex numbers are positions in the plane: x + iy. In names, com is
the centre of mass.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, ModelInstanceIndex, RigidBody
from scipy.linalg.lapack import dgesv

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.robots.axis_map import AxisMap, in_a_row
from simrob_drake.robots.feet import FootContact
from simrob_drake.walking.knees import knee_of
from simrob_drake.walking.parameters import WalkingParameters

Rows = Sequence[Sequence[float]]
"""A matrix as rows of plain numbers."""

# Components of a foot's pose error [roll, pitch, yaw, ahead, left, up] that a leg corrects, by its count of joints.
# A leg of five joints gives up yaw or roll, whichever leaves the better conditioned Jacobian.
_CONTROLLED = {
    7: [[0, 1, 2, 3, 4, 5]],
    6: [[0, 1, 2, 3, 4, 5]],
    5: [[0, 1, 3, 4, 5], [1, 2, 3, 4, 5]],
    4: [[0, 1, 3, 5]],
    3: [[3, 4, 5]],
}

# Rotation vector of a small rotation R, from the nine entries of R row by row:
# 0.5 (R21 - R12, R02 - R20, R10 - R01).
_TO_ROTATION_VECTOR = np.zeros((9, 3))
_TO_ROTATION_VECTOR[[7, 2, 3], [0, 1, 2]] = 0.5
_TO_ROTATION_VECTOR[[5, 6, 1], [0, 1, 2]] = -0.5

_V = JacobianWrtVariable.kV
# Damping of the inverse kinematics: keeps the step finite if a leg is nearly straight [m², rad²].
_DAMPING = 1e-5
# Largest change of a joint in one step of the inverse kinematics [rad].
_LARGEST_STEP = 0.3
# The points of a sole are one point if they are nearer to each other than this [m].
_SAME_POINT = 1e-9
# A root link's position and quaternion (7), and its linear and angular velocity (6).
_ROOT_VALUES = 13


class BodyState(NamedTuple):
    """Motion of a robot in the world. Matrices are rows of plain numbers, as arrays of this size are slower.

    Attributes:
        com: position x y z of the centre of mass [m].
        speed: velocity x y z of the centre of mass [m/s].
        feet: pose of the middle of each sole, shape (3, 4) [1, m]. The rotation is that from a flat sole that looks
            along the world's x.
        trunk: rotation of the root from upright and looking along the world's x, shape (3, 3).
        lowest: height of the lowest point of each foot [m].
    """

    com: Sequence[float]
    speed: Sequence[float]
    feet: Sequence[Rows]
    trunk: Rows
    lowest: Sequence[float]


class Body:
    """Kinematics of a robot on its feet.

    The forward kinematics (:meth:`observe`) are those of the measured state. The inverse kinematics
    (:meth:`solve_posture`) go on from a posture that :meth:`set_posture` sets.

    Attributes:
        facing: rotation from the robot's root link to a root that looks along x.
        homes: position of each sole's middle from the root in the stance, in a root that looks along x, shape (3,) [m].
        ball_radius: height of the foot points above the floor [m]: the radius of feet that are balls, which roll about
            their middles, and 0 for soles.
        sole_reach: largest distance of a sole's corner from its middle, along or across the foot [m].
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        instance: ModelInstanceIndex,
        root: Frame,
        axes: AxisMap,
        limits: tuple[Vector, Vector],
        posture: Vector,
        stance: Vector,
        feet: Sequence[Frame],
        contact: FootContact,
        legs: Sequence[Sequence[int]],
        facing: float,
    ) -> None:
        """Create the kinematics of a robot.

        Args:
            plant: finalized plant, which need not be part of a diagram.
            instance: model instance of the robot, whose root is free.
            root: frame of the root link.
            axes: axes of the robot.
            limits: lower and upper limits of the axes, shape (n,) [rad].
            posture: posture near which the inverse kinematics start, shape (n,) [rad]. Knees stay bent to the same
                side as in this posture.
            stance: posture in which the soles are flat and in their places side by side, shape (n,) [rad].
            feet: frames of the feet's links.
            contact: contact points of the feet.
            legs: indices of the axes of each foot's leg.
            facing: direction in which the robot looks if its root is not turned, from the world's x axis [rad].

        Raises:
            InvalidParameter: a leg has fewer than three joints or more than seven, or not as many as the others.
        """
        _check_legs(feet, legs)
        # The diagram owns both the plant and the block that owns this object. With a strong reference to the plant,
        # they would form a cycle that Python cannot collect.
        self._plant: MultibodyPlant = weakref.proxy(plant)
        self._instance = instance
        self._axes = axes
        self._root = root.index()
        self._feet = [foot.index() for foot in feet]

        # Two contexts: the measured state, and the posture of the inverse kinematics. Each is set before it is used.
        self._measured = plant.CreateDefaultContext()
        self._goal = plant.CreateDefaultContext()
        self._measured_state = plant.GetPositionsAndVelocities(self._measured)
        self._goal_positions = plant.GetPositions(self._goal)

        self.facing = RotationMatrix.MakeZRotation(-facing)
        self._from_facing = self.facing.inverse()
        self._facing_matrix = self.facing.matrix()
        # Pose of the world seen from a root that looks along x, for positions in the world of the goal's context.
        # The root of the goal stays at its default pose, so this transform is constant.
        self._root_from_world = RigidTransform(self.facing).multiply(
            root.CalcPoseInWorld(self._goal).inverse()
        )
        self._measured_indices, self._measured_signs = self._index_measurements(root.body())

        # Indices of the axes, signs of the axes, and columns of their joints in a Jacobian (6, nv), for each leg.
        self._legs = np.array([list(leg) for leg in legs])
        self._columns = list(map(in_a_row, axes.velocity_places[self._legs]))
        self._leg_signs = axes.signs[self._legs]
        self._find_soles(contact, [foot.name() for foot in feet], stance)
        self._sole_matrices = np.array([sole.GetAsMatrix4() for sole in self._soles])

        # Task basis and knees are chosen in this posture.
        self.set_posture(posture)
        self._task_basis = self._choose_task_basis()
        joint_count = self._legs.shape[1]
        self._damping = _DAMPING * np.eye(joint_count)
        self._lower = limits[0].copy()
        self._upper = limits[1].copy()
        self._keep_knees_bent(legs, posture)

    def _index_measurements(self, root: RigidBody) -> tuple[npt.NDArray[np.intp], Vector]:
        """Find where the values that :meth:`observe` takes belong in the plant's state.

        Args:
            root: root link of the robot.

        Returns:
            The index of each value in the state [q, v] of the plant, and its sign, shape (2n + 13,) each: the values
            are those of the n axes, with their signs, and the 13 of the root, with the sign 1.
        """
        axes = self._axes
        num_positions = self._plant.num_positions()
        position_start = root.floating_positions_start()
        velocity_start = num_positions + root.floating_velocities_start_in_v()
        # Drake stores a free body's quaternion before its position, and its angular velocity before its linear one.
        quaternion = range(position_start, position_start + 4)
        position = range(position_start + 4, position_start + 7)
        angular_velocity = range(velocity_start, velocity_start + 3)
        linear_velocity = range(velocity_start + 3, velocity_start + 6)
        indices = np.concatenate(
            [
                axes.position_places,
                num_positions + axes.velocity_places,
                position,
                quaternion,
                linear_velocity,
                angular_velocity,
            ]
        )
        signs = np.concatenate([axes.signs, axes.signs, np.ones(_ROOT_VALUES)])
        return indices.astype(np.intp), signs

    def _choose_task_basis(self) -> Vector | None:
        """Choose the components of a foot's pose error that a leg of fewer than six joints corrects.

        Of several choices, the one is taken that leaves the first leg, in the posture that is set, farthest from a
        singularity. All legs use it.

        Returns:
            The matrix B (6, m), or None if the leg corrects all components: ``error @ B`` are the m corrected
            components of an error (6,) in the root's axes. It depends on the direction in which the robot looks,
            since the components are those of a root that looks along x.
        """
        # From the root's axes to those of a root that looks along x: the same rotation for both halves of a pose error,
        # the rotation vector and the translation. Each row gives one of the components that `_CONTROLLED` lists.
        to_facing = np.kron(np.eye(2), self._facing_matrix)
        joint_count = self._legs.shape[1]
        if joint_count >= len(to_facing):
            return None
        root = self._plant.get_frame(self._root)
        foot = self._plant.get_frame(self._feet[0])
        transposed_jacobian = self._transposed_jacobian(0, foot, root)
        candidates = [to_facing[components].T for components in _CONTROLLED[joint_count]]

        def smallest_singular_value(basis: Vector) -> float:
            """Measure how far a leg is from a singularity, with a basis (6, m)."""
            return float(np.linalg.svd(transposed_jacobian @ basis, compute_uv=False)[-1])

        return max(candidates, key=smallest_singular_value)

    def _keep_knees_bent(self, legs: Sequence[Sequence[int]], posture: Vector) -> None:
        """Narrow the limits `_lower` and `_upper` of the knees, so that they stay bent to the side of a posture.

        A leg that may bend to both sides would flip between them, and a straight leg has no inverse kinematics.

        Args:
            legs: indices of the axes of each foot's leg.
            posture: the posture, shape (n,) [rad], which must be the one that is set.
        """
        plant = self._plant
        axes = self._axes
        joints = {}  # by the index of the joint's velocity
        for index in plant.GetJointIndices(self._instance):
            joint = plant.get_joint(index)
            if joint.num_velocities() == 1:
                joints[joint.velocity_start()] = joint

        for leg, foot, tip in zip(legs, self._feet, self._tips, strict=True):
            chain = [joints[start] for start in axes.velocity_places[list(leg)]]
            knee = knee_of(plant, self._goal, chain, plant.get_frame(foot), tip)
            axis = leg[knee.place]
            # The knee is measured in angles of the joint, the limits are those of the axis.
            knee = replace(knee, straight=axes.signs[axis] * knee.straight)
            limits = knee.limits_on_side_of(posture[axis], self._lower[axis], self._upper[axis])
            self._lower[axis] = limits[0]
            self._upper[axis] = limits[1]

    def _find_soles(self, contact: FootContact, links: Sequence[str], stance: Vector) -> None:
        """Find the middle and the direction of each sole, from the robot in a stance.

        It sets `_tips`, `_soles`, `_corners`, `homes`, `ball_radius` and `sole_reach`, and leaves the context of the
        inverse kinematics (`_goal`) in the stance. In the stance, the z axis of a ball foot's link is assumed to be
        vertical. The feet are assumed to be alike: all are soles, or balls of the same radius.

        Args:
            contact: contact points of the feet.
            links: names of the feet's links.
            stance: posture in which the soles are flat and look ahead, shape (n,) [rad].
        """
        plant = self._plant
        positions = self._axes.spread_positions(stance, plant.GetPositions(self._goal))
        plant.SetPositions(self._goal, positions)
        root = plant.get_frame(self._root)

        self._tips = list[Vector]()  # middle of the sole in the foot's link, shape (3,) [m]
        self._soles = list[RigidTransform]()  # pose of the sole in the foot's link
        # corners of each sole, x y z in the frame of the sole [m]
        self._corners = list[list[list[float]]]()
        self.homes = list[Vector]()
        self.ball_radius = 0.0
        for link, index in zip(links, self._feet, strict=True):
            home = RigidTransform(self.facing) @ plant.get_frame(index).CalcPose(self._goal, root)
            # In the stance the root is upright, so this rotation gives the link's vectors in level axes, x ahead.
            to_level = home.rotation().matrix()
            # The lowest points of the foot's spheres, or the lower corners of its box: in the link's axes, then in
            # level axes, both from the link's origin.
            support_points = contact.support_points(link)
            points = support_points @ to_level.T

            # A foot whose spheres are all on the z axis of its link is a ball. It rolls, so the leg moves the ball's
            # middle.
            middle = (points.min(axis=0) + points.max(axis=0)) / 2
            lowest = points.min(axis=0)[2]
            is_ball = link in contact.points and np.ptp(points[:, :2]) < _SAME_POINT
            radius = contact.surface(link).radius if is_ball else 0.0
            self.ball_radius = radius

            tip = to_level.T @ np.array([middle[0], middle[1], lowest + radius])
            sole = RigidTransform(RotationMatrix(to_level.T), tip)
            # The points of a ball move up to its middle, below which its lowest point stays as it rolls.
            corners = np.add(support_points, (0.0, 0.0, radius))
            self._tips.append(tip)
            self._soles.append(sole)
            self._corners.append(sole.inverse().multiply(corners.T).T.tolist())
            self.homes.append(home.multiply(tip))
        # The largest coordinate along (x) or across (y) the foot, of all corners of all feet.
        self.sole_reach = max(
            abs(coordinate)
            for corners in self._corners
            for corner in corners
            for coordinate in corner[:2]
        )

    def observe(self, measured: Vector) -> BodyState:
        """Compute the motion of the robot from its measured state.

        Args:
            measured: shape (2n + 13,): positions (n) [rad] and velocities (n) [rad/s] of the axes; pose (7) of the
                root link, x y z [m] qw qx qy qz; its linear and angular velocity (6) in the world [m/s, rad/s].
        """
        plant = self._plant
        context = self._measured
        self._measured_state[self._measured_indices] = self._measured_signs * measured
        plant.SetPositionsAndVelocities(context, self._measured_state)

        # Plain lists: the estimator reads single numbers, which takes longer from an array.
        feet = list[Rows]()
        for index, sole in zip(self._feet, self._soles, strict=True):
            pose = plant.get_frame(index).CalcPoseInWorld(context).multiply(sole)
            feet.append(pose.GetAsMatrix34().tolist())
        root = plant.get_frame(self._root).CalcPoseInWorld(context)
        trunk = root.rotation().multiply(self._from_facing)
        instances = [self._instance]
        return BodyState(
            com=plant.CalcCenterOfMassPositionInWorld(context, instances).tolist(),
            speed=plant.CalcCenterOfMassTranslationalVelocityInWorld(context, instances).tolist(),
            feet=feet,
            trunk=trunk.matrix().tolist(),
            # The corners of a ball are its middle, which is one radius above its lowest point.
            lowest=[
                _lowest_height(foot[2], corners) - self.ball_radius
                for foot, corners in zip(feet, self._corners, strict=True)
            ],
        )

    def set_posture(self, posture: Vector) -> None:
        """Set the posture (n,) [rad] that :meth:`com_from_root` and :meth:`solve_posture` start from."""
        self._posture = posture
        self._goal_positions[self._axes.position_places] = self._axes.signs * posture
        self._plant.SetPositions(self._goal, self._goal_positions)

    def com_from_root(self) -> list[float]:
        """Compute the centre of mass x y z from the root, in a root that is upright and looks along x [m]."""
        com = self._plant.CalcCenterOfMassPositionInWorld(self._goal, [self._instance])
        from_root: list[float] = self._root_from_world.multiply(com).tolist()
        return from_root

    def solve_posture(self, trunk: Rows, feet: Vector, rounds: int = 1) -> Vector:
        """Solve the inverse kinematics of the legs by damped Newton steps from the posture that is set.

        Args:
            trunk: desired rotation of the root from upright and looking along x, shape (3, 3).
            feet: desired poses of the soles' frames, shape (feet, 3, 4) [1, m]: positions from the root, in the level
                axes from which `trunk` is the rotation.
            rounds: count of Newton steps. One is enough if the desired poses have only moved on by one sample. With
            more than one, the posture before the last step is the one that is set afterwards.

        Returns:
            The posture, shape (n,) [rad], within the limits of all axes, which are narrowed for the knees. Axes that
            are in no leg stay, unless they are beyond their limits.
        """
        plant = self._plant
        root = plant.get_frame(self._root)
        links = [plant.get_frame(index) for index in self._feet]
        # The Jacobians are in the axes of the root link, so the targets are, too. The rotation of the root link in the
        # level axes is `trunk` times that from the root link to a root that looks along x; its inverse is transposed.
        to_root = (np.array(trunk) @ self._facing_matrix).T
        targets = to_root @ feet

        jacobians = np.empty((*self._legs.shape, 6))
        poses = np.empty((len(links), 3, 4))
        posture = self._posture
        for completed in range(rounds):
            if completed:
                self.set_posture(posture)
            for number, link in enumerate(links):
                poses[number] = link.CalcPose(self._goal, root).GetAsMatrix34()
                jacobians[number] = self._transposed_jacobian(number, link, root)
            posture = posture.copy()  # the caller keeps the one that was set
            posture[self._legs] += self._newton_step(
                jacobians, poses @ self._sole_matrices, targets
            )
            posture = np.minimum(np.maximum(posture, self._lower), self._upper)
        return posture

    def _transposed_jacobian(self, foot: int, link: Frame, root: Frame) -> Vector:
        """Compute the transposed Jacobian (k, 6) of a sole's middle by the k joints of its leg, in the root's axes.

        Args:
            foot: index of the foot.
            link: frame of the foot's link.
            root: frame of the root link.
        """
        # Of all velocities of the plant, `_columns` picks those of the leg's joints.
        jacobian = self._plant.CalcJacobianSpatialVelocity(
            self._goal, _V, link, self._tips[foot], root, root
        )
        return np.asarray(jacobian[:, self._columns[foot]].T)

    def _newton_step(self, jacobians: Vector, poses: Vector, targets: Vector) -> Vector:
        r"""Compute one damped least-squares step of all legs.

        With the Jacobian J of a leg, the pose error e of its foot and the damping :math:`\lambda`,

        .. math:: \Delta q = (J^T J + \lambda I)^{-1} J^T e = J^T (J J^T + \lambda I)^{-1} e .

        The first form is solved here. Its matrix has the size of the leg's joints.

        Args:
            jacobians: transposed Jacobians :math:`J^T`, shape (legs, k, 6), in the root's axes. Their columns are the
                rotation, then the translation.
            poses: poses of the soles' middles in the root's frame, shape (legs, 3, 4).
            targets: desired poses of the soles' middles in the root's frame, shape (legs, 3, 4).

        Returns:
            The change of each axis, shape (legs, k) [rad].
        """
        # Pose error: the small rotation from the pose to the target, and the distance between them.
        rotations = targets[:, :, :3] @ poses[:, :, :3].transpose(0, 2, 1)
        rotation_errors = rotations.reshape(-1, 9) @ _TO_ROTATION_VECTOR
        position_errors = targets[:, :, 3] - poses[:, :, 3]
        errors = np.concatenate([rotation_errors, position_errors], axis=1)
        if self._task_basis is not None:
            jacobians = jacobians @ self._task_basis
            errors = errors @ self._task_basis

        matrices = jacobians @ jacobians.transpose(0, 2, 1) + self._damping
        right_sides = (jacobians @ errors[..., np.newaxis])[..., 0]
        # LAPACK is called leg by leg: np.linalg.solve takes four times as long for matrices of this size.
        solutions = [
            dgesv(matrix, side)[2] for matrix, side in zip(matrices, right_sides, strict=True)
        ]
        # The solutions are angles of the joints; the signs make them those of the axes. A large step would leave the
        # range in which the linearization holds.
        step = np.array(solutions) * self._leg_signs
        return np.asarray(np.minimum(np.maximum(step, -_LARGEST_STEP), _LARGEST_STEP))


def _check_legs(feet: Sequence[Frame], legs: Sequence[Sequence[int]]) -> None:
    """Check that all legs have the same count of joints, from three to seven.

    Args:
        feet: frames of the feet's links, for the name in the error.
        legs: indices of the axes of each foot's leg.

    Raises:
        InvalidParameter: a leg has fewer than three joints or more than seven, or not as many as the first leg.
    """
    for frame, leg in zip(feet, legs, strict=True):
        if len(leg) not in _CONTROLLED or len(leg) != len(legs[0]):
            raise InvalidParameter(
                message(
                    "walking.joints_of_leg",
                    "the number of joints in the leg of {frame}",
                    frame=frame.name(),
                ),
                len(leg),
                message("walking.three_to_seven", "from 3 to 7, and the same for all legs"),
            )


def _lowest_height(upward: Sequence[float], corners: Rows) -> float:
    """Compute the height of the lowest corner of a foot [m].

    Args:
        upward: third row of the foot's pose matrix, shape (4,): it gives the height of a point of the foot.
        corners: corners of the foot x y z, in the frame of that pose [m].
    """
    a = upward[0]
    b = upward[1]
    c = upward[2]
    height = upward[3]
    # Plain numbers are faster than a NumPy product of this size.
    return height + min([a * x + b * y + c * z for x, y, z in corners])


@dataclass(frozen=True)
class StanceFeet:
    """Feet of a robot in its stance, in two groups that stand and swing in turn: 0 the right one, 1 the left one.

    Attributes:
        groups: indices of the feet of each group.
        offsets: position of each foot from the middle of its group, as complex numbers [m].
        slope_weights: change of the group's slope for each metre by which a foot is raised, of each foot [1/m]. The
            real part is the slope ahead, the imaginary part that to the left.
        half_width: distance from the robot's middle to the middle of each group, to the side [m].
        roll_factor: ratio of the distance that the robot goes to the distance that its legs go [1]. Above 1 if the feet
            are balls, which roll while they stand.
    """

    groups: Sequence[Sequence[int]]
    offsets: Sequence[Sequence[complex]]
    slope_weights: Sequence[Sequence[complex]]
    half_width: float
    roll_factor: float

    @classmethod
    def of(
        cls, body: Body, parameters: WalkingParameters, groups: Sequence[Sequence[int]]
    ) -> StanceFeet:
        """Find the feet of a robot in its stance.

        Args:
            body: kinematics of the robot.
            parameters: parameters of the walk. Their `widen` moves each foot outward, and the height of the root gives
                the roll factor.
            groups: indices of the feet that stand together, the right ones first.
        """
        homes = list[complex]()
        for x, y, _ in body.homes:
            # To the foot's own side; a negative `widen` brings the feet nearer to each other.
            to_side = math.copysign(1.0, y) * parameters.widen
            homes.append(complex(x, y) + 1j * to_side)
        middles = [sum(homes[foot] for foot in group) / len(group) for group in groups]

        offsets = list[list[complex]]()
        for group, middle in zip(groups, middles, strict=True):
            offsets.append([homes[foot] - middle for foot in group])
        # Index 0 is the right group, whose middle has a negative y.
        half_width = 0.5 * (middles[1] - middles[0]).imag
        # A leg of length h - r that turns by an angle a moves the hip by (h - r) a from the middle of its ball. The
        # ball of radius r turns with the leg and rolls by r a, so the robot goes by the factor 1 + r / (h - r) more.
        roll_factor = 1.0 + body.ball_radius / (parameters.bearing.height - body.ball_radius)
        weights = [slope_weights_of(positions) for positions in offsets]
        return cls(groups, offsets, weights, half_width, roll_factor)

    def omega(self, height: float) -> float:
        """Natural frequency of the pendulum [1/s], with the centre of mass at a height above the floor [m].

        A robot on balls falls more slowly: its support point rolls after the centre of mass.
        """
        return math.sqrt(STANDARD_GRAVITY / (height * self.roll_factor))


def height_on_slope(slope: complex, place: complex) -> float:
    """Height of a position [m] on a slope [1] through the origin [m]. Real parts are ahead, imaginary parts left."""
    return (slope.conjugate() * place).real


def slope_weights_of(positions: Sequence[complex]) -> list[complex]:
    """Compute the weight of each foot in the slope of the plane or line through all of them [1/m].

    The slope is the least-squares solution: the pseudoinverse of the positions times the heights. A single foot shows
    no slope by its height: its weight is 0.

    Args:
        positions: positions of the feet from their middle, as complex numbers [m].

    Returns:
        One complex number for each foot: the slope ahead (real part) and to the left (imaginary part) for each metre of
        the foot's height.
    """
    # The pseudoinverse of the matrix (feet, 2) has the shape (2, feet).
    ahead, left = np.linalg.pinv(
        [(position.real, position.imag) for position in positions]
    ).tolist()
    return [complex(*weight) for weight in zip(ahead, left, strict=True)]


def slope_through(slope_weights: Sequence[complex], heights: Sequence[float]) -> complex:
    """Slope [1] of the plane or line through feet at heights [m], from the weights of :func:`slope_weights_of`."""
    return sum((weight * height for weight, height in zip(slope_weights, heights, strict=True)), 0j)


keep_former_attributes(
    Body,
    seen="observe",
    take="set_posture",
    centre="com_from_root",
    reached="solve_posture",
    over="ball_radius",
    sole="sole_reach",
)
keep_former_attributes(
    StanceFeet, about="offsets", planes="slope_weights", half="half_width", rolls="roll_factor"
)
if not TYPE_CHECKING:
    __getattr__ = former_names_of(
        __name__,
        {
            "Seen": "BodyState",
            "uphill": "height_on_slope",
            "planes": "slope_weights_of",
            "sloped": "slope_through",
        },
    )
