"""Kinematics of joints that are given by their screws, for many postures at once.

:class:`Screws` are the joints of a tree, :class:`Chain` those from a robot's base to its tool.

An axis is a joint as the robot counts it: its sense is -1 if it counts against Drake's joint. A posture is the
positions of all n axes; zero posture has all of them at 0. Some axes, such as those of fingers, need not move the tool;
the m others are followed from the base outward. The motion of a body is the pose (4, 4) by which it has moved since
zero posture.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, PrismaticJoint, RevoluteJoint
from pydrake.systems.framework import Context

from simrob_drake.base.errors import InvalidParameter, SimrobError, one_of
from simrob_drake.base.frames import Targets, Vector, numbers, one_pose
from simrob_drake.base.messages import message
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.limits import AxisLimits
from simrob_drake.robots.parse import held_robot

Indices = np.ndarray[Any, np.dtype[np.intp]]

IDENTITY = np.eye(4)
"""Pose of the base in the frame of the targets, unless the base moves."""
_CROSS = np.zeros((3, 9))
"""Row i is the matrix of the cross product with the unit vector eᵢ, row by row."""
# The cross product is linear in its first factor, so one product with this array gives the matrices of all axes. For
# instance e₁ × v = (0, -v₃, v₂): element 7 (row 2, column 1) is 1, and element 5 (row 1, column 2) is -1.
_CROSS[[0, 0, 1, 1, 2, 2], [7, 5, 2, 6, 3, 1]] = [1, -1, 1, -1, 1, -1]


@dataclass(frozen=True, eq=False, kw_only=True)
class Screws:
    """Revolute and prismatic joints of a tree, each given by its screw at zero posture in one base frame.

    The body that joint i carries moves by the product exp(S₁q₁) ... exp(Sᵢqᵢ) of the screws from the base to the joint.
    A screw is given by its axis and a point (Lynch & Park, Modern Robotics, 2017, §4.1). Positions have the shape
    (k, n) or (n,), in rad, or m for prismatic joints.

    Attributes:
        axes: unit vector of each axis at zero in the base frame, shape (n, 3).
        points: a point on each axis at zero, shape (n, 3) [m].
        revolute: whether each joint is revolute, shape (n,).
        order: indices of the m axes that are followed, from the base outward.
        after: for each of these axes, the body on which it stands: 0 is the base, i is the body that the i-th of them
            carries. If None, each axis stands on the body that the axis before it carries.
    """

    axes: Vector
    points: Vector
    revolute: np.ndarray[Any, np.dtype[np.bool_]]
    order: tuple[int, ...]
    after: tuple[int, ...] | None = None

    @property
    def size(self) -> int:
        """Count of the axes, n."""
        return len(self.axes)

    def postures(self, positions: npt.ArrayLike, name: str = "positions") -> Vector:
        """Convert positions to postures of the shape (k, n).

        Args:
            positions: one posture (n,) or k postures (k, n) [rad or m].
            name: name of the positions in the message of an error.

        Returns:
            the postures, shape (k, n). One posture gives k = 1.

        Raises:
            InvalidParameter: positions of another shape, or that are not finite.
        """
        expected = message(
            "kinematics.finite_numbers_an_axis",
            "{size} finite numbers, one for each axis, or several such rows",
            size=self.size,
        )
        rows = numbers(positions)
        # An empty list has the shape (0,), which the message below would report as a wrong count of axes.
        if not rows.size:
            raise InvalidParameter(name, positions, expected)
        if rows.ndim not in (1, 2) or rows.shape[-1] != self.size:
            raise InvalidParameter(
                name,
                message("base.array_of_shape", "an array of shape {shape}", shape=rows.shape),
                expected,
            )
        if not np.isfinite(rows).all():
            raise InvalidParameter(name, rows.tolist(), expected)
        return np.atleast_2d(rows)

    def frames(self, postures: Vector, base: Vector = IDENTITY) -> Vector:
        """Compute how the bodies move from their poses at zero.

        The motion of a joint is exp(Sq) = A + sin(q) B + (1 - cos(q)) C, with constant matrices for each axis. The
        motions are multiplied from the base outward.

        Args:
            postures: postures, shape (k, n) [rad or m].
            base: motion of the base, shape (4, 4), (1, 4, 4) or (k, 4, 4).

        Returns:
            motions of the base and of the m bodies that the followed axes carry, shape (m + 1, k, 4, 4).
        """
        # The factors of A, B and C for each axis and posture, shape (m, k, 3).
        values = postures.T[self._order_indices]
        terms = np.empty((*values.shape, 3))
        terms[..., 0] = 1.0
        terms[..., 1] = np.sin(values)
        terms[..., 2] = 1.0 - np.cos(values)
        # The exponential of a prismatic joint is linear, A + q B; its matrix C is zero.
        terms[self._prismatic, :, 1] = values[self._prismatic]
        # One product of all factors with all matrices is far faster than a loop over postures in Python.
        flat_motions = terms @ self._exponentials
        motions = flat_motions.reshape(len(values), len(postures), 4, 4)

        frames = np.empty((len(values) + 1, len(postures), 4, 4))
        frames[0] = base
        # The order is outward, so that the motion of a carrier is ready before those of the bodies on it.
        for index, motion in enumerate(motions):
            carrier = self.after[index] if self.after else index
            # The screws are given at zero posture in the base frame, so that each motion is multiplied from the right.
            np.matmul(frames[carrier], motion, out=frames[index + 1])
        return frames

    @cached_property
    def _order_indices(self) -> Indices:
        """Indices of the followed axes, as an array."""
        return np.array(self.order, dtype=np.intp)

    @cached_property
    def _prismatic(self) -> Indices:
        """Indices of the prismatic axes, counted among the followed axes."""
        return np.flatnonzero(~self.revolute[self._order_indices])

    @cached_property
    def _exponentials(self) -> Vector:
        """Matrices A, B, C (m, 3, 16) of exp(Sq) = A + sin(q)·B + (1 - cos(q))·C, or A + q·B if prismatic."""
        terms = np.zeros((len(self.order), 3, 4, 4))
        terms[:, 0] = IDENTITY
        for term, axis in zip(terms, self.order, strict=True):
            if self.revolute[axis]:
                # Rodrigues' formula with [a], the matrix of the cross product with the axis a:
                #   R = I + sin(q) [a] + (1 - cos(q)) [a]².
                # The points of the axis stay where they are, so that the translation is p - R p.
                spin = skew(self.axes[axis])
                point = self.points[axis]
                term[1, :3, :3] = spin
                term[1, :3, 3] = -spin @ point
                term[2, :3, :3] = spin @ spin
                term[2, :3, 3] = -spin @ spin @ point
            else:
                # A prismatic joint does not turn anything: it shifts by q along its axis.
                term[1, :3, 3] = self.axes[axis]
        # Each matrix as a row of 16 numbers, for one product with the factors of all postures.
        return terms.reshape(-1, 3, 16)


def skew(vectors: Vector) -> Vector:
    """Compute matrices (..., 3, 3) whose product with a vector is the cross product of ``vectors`` (..., 3) with it."""
    matrices: Vector = (vectors @ _CROSS).reshape(*vectors.shape[:-1], 3, 3)
    return matrices


class UnsupportedChain(SimrobError):
    """Raised if a joint between two frames belongs to no axis, or if an axis is neither revolute nor prismatic."""


@dataclass(frozen=True, eq=False)
class ChainInPlant:
    """Joints and frames of a chain in a finalized plant, for solvers that use Drake.

    The owner of the plant must keep the plant alive.

    Attributes:
        plant: the plant.
        joints: the joint of each axis.
        axes: positions of the axes in the plant, and their senses.
        base: the base frame.
        tool: the tool frame.
        tcp: pose of the tool centre point in the tool frame, shape (4, 4).
    """

    plant: MultibodyPlant
    joints: tuple[Joint, ...]
    axes: AxisMap
    base: Frame
    tool: Frame
    tcp: Vector


@dataclass(frozen=True, eq=False, kw_only=True)
class Chain(Screws):
    """The joints in a row from a robot's base frame to a tool frame, with their names and limits.

    Attributes:
        home: pose of the tool at zero, shape (4, 4).
        names: names of the axes.
        lower: lower limit of each axis, shape (n,) [rad or m]; -inf if the axis has none.
        upper: upper limit of each axis, shape (n,) [rad or m]; inf if the axis has none.
        in_plant: joints and frames of the chain in its plant.
    """

    home: Vector
    names: tuple[str, ...]
    lower: Vector
    upper: Vector
    in_plant: ChainInPlant

    def __repr__(self) -> str:
        return f"<Chain of {len(self.names)} axes: {', '.join(self.names)}>"

    @cached_property
    def limits(self) -> AxisLimits:
        """Limits of the axes, for checks of positions."""
        return AxisLimits(
            names=self.names, lower=self.lower, upper=self.upper, revolute=self.revolute
        )

    @classmethod
    def of_robot(cls, model: RobotModel, tool: str | None = None) -> "Chain":
        """Extract the chain from a robot's root link to one of its tools.

        Args:
            model: the robot.
            tool: name of the tool; the robot's first one unless given.

        Raises:
            UnknownName: the robot has no tool of this name.
            InvalidParameter: the robot has no tools.
            InvalidModel: Drake cannot read the robot's URDF.
            UnsupportedChain: a joint that is no axis of the robot moves the tool.
        """
        if not model.tools:
            raise InvalidParameter(
                "tools",
                model.tools,
                message(
                    "kinematics.a_tool_frame",
                    "at least one tool frame of {model}",
                    model=model.name,
                ),
            )
        name = next(iter(model.tools)) if tool is None else tool
        one_of(message("base.tool_of", "tool of {model}", model=model.name), name, model.tools)
        plant, base = held_robot(model)
        joints = [plant.GetJointByName(axis.joint) for axis in model.axes.values()]
        signs = [axis.sign for axis in model.axes.values()]
        frame = plant.GetFrameByName(model.tools[name])
        return cls.of_plant(
            plant, joints=joints, signs=signs, base=base, tool=frame, names=list(model.axes)
        )

    @classmethod
    def of_plant(
        cls,
        plant: MultibodyPlant,
        *,
        joints: Sequence[Joint],
        base: Frame,
        tool: Frame,
        signs: npt.ArrayLike | None = None,
        names: Sequence[str] | None = None,
    ) -> "Chain":
        """Extract the chain between two frames of a finalized plant.

        Args:
            plant: the plant, finalized. It must stay alive for the solvers that use Drake.
            joints: joints of the robot, in axis order. Joints that do not move the tool are allowed and have no effect.
            base: the base frame, in which poses are given.
            tool: the tool frame.
            signs: senses of the joints, 1 or -1, shape (n,); all 1 unless given.
            names: names of the axes; names of the joints unless given.

        Raises:
            UnsupportedChain: the frames move against each other by a joint that is not in ``joints``; or one of
                ``joints`` is neither revolute nor prismatic, even if it does not move the tool.
            InvalidParameter: there is not one sign, 1 or -1, and one name of its own for each joint.
        """
        labels = tuple(joint.name() for joint in joints) if names is None else tuple(names)
        if len(labels) != len(joints) or len(set(labels)) != len(labels):
            raise InvalidParameter(
                "names",
                names,
                message(
                    "kinematics.different_names",
                    "{count} different names, one for each joint",
                    count=len(joints),
                ),
            )
        path = _axes_of_path(joints_between(plant, base, tool), joints)
        for joint, name in zip(joints, labels, strict=True):
            if not isinstance(joint, RevoluteJoint | PrismaticJoint):
                raise UnsupportedChain(
                    message(
                        "kinematics.unsupported_joint",
                        "{name} is a {kind} joint; a kinematic chain can only have revolute and prismatic joints",
                        name=name,
                        kind=joint.type_name(),
                    )
                )
        # Screws are given at zero posture, but the default posture of a plant can be another one.
        in_plant = AxisMap.of_joints(plant, joints, signs)
        context = plant.CreateDefaultContext()
        in_plant.set_positions(plant, context, np.zeros(len(joints)))
        axes, points = axes_and_points(context, joints, base)
        # A joint between the base and the world moves the base. Seen from the base, the rest moves the other way, so
        # the sense of such a joint on the path is -1.
        senses = np.ones(len(joints))
        for axis, sense in path:
            senses[axis] = sense
        limits = [(joint.position_lower_limit(), joint.position_upper_limit()) for joint in joints]
        # An axis against its joint has the limits -upper and -lower; sorting puts the lower one first.
        bounds = np.sort(in_plant.signs[:, np.newaxis] * np.reshape(limits, (-1, 2)), axis=1)
        return cls(
            names=labels,
            axes=(in_plant.signs * senses)[:, np.newaxis] * axes,
            points=points,
            revolute=np.array([isinstance(joint, RevoluteJoint) for joint in joints], dtype=bool),
            order=tuple(axis for axis, _ in path),
            lower=bounds[:, 0],
            upper=bounds[:, 1],
            home=tool.CalcPose(context, base).GetAsMatrix4(),
            in_plant=ChainInPlant(plant, tuple(joints), in_plant, base, tool, np.eye(4)),
        )

    def with_tool(self, pose: Targets) -> "Chain":
        """Make the chain to another tool centre point.

        Args:
            pose: pose of the new tool centre point as seen from the present one: a vector [x y z Rz Ry Rx], a matrix or
                a RigidTransform.

        Raises:
            InvalidParameter: the pose has another shape, or is not finite.
        """
        matrix = one_pose(pose, "tool")
        # The chain has the pose at zero twice, once for its own forward kinematics and once for solvers of Drake.
        in_plant = replace(self.in_plant, tcp=self.in_plant.tcp @ matrix)
        return replace(self, home=self.home @ matrix, in_plant=in_plant)

    def forward(self, positions: npt.ArrayLike) -> Vector:
        """Compute the poses of the tool in the base, shape (k, 4, 4).

        Args:
            positions: one posture (n,), which gives k = 1, or k postures (k, n) [rad or m].

        Raises:
            InvalidParameter: positions of another shape, or that are not finite.
        """
        return self.tool_poses(self.frames(self.postures(positions)))

    def jacobian(self, positions: npt.ArrayLike) -> Vector:
        """Compute the geometric Jacobian, shape (k, 6, n): the tool's velocity for a unit speed of each axis.

        The rows are the velocity of the tool centre point along x, y, z of the base [m/s], then the angular velocity
        about x, y, z [rad/s]. (SimRob orders the last three z, y, x: ``jacobian[:, [0, 1, 2, 5, 4, 3]]``.)

        Args:
            positions: one posture (n,), which gives k = 1, or k postures (k, n) [rad or m].
        """
        frames = self.frames(self.postures(positions))
        return self.jacobian_at(frames, self.tool_poses(frames)[:, :3, 3])

    def tool_poses(self, frames: Vector) -> Vector:
        """Compute the poses of the tool, shape (k, 4, 4), from :meth:`frames`."""
        # The last body of the chain carries the tool: T = exp(S₁q₁) ... exp(Sₘqₘ) T(0), the product of exponentials.
        poses: Vector = frames[-1] @ self.home
        return poses

    def jacobian_at(self, frames: Vector, places: Vector) -> Vector:
        """Compute the geometric Jacobian.

        A revolute axis with the unit vector a through the point p moves the tool centre point c with the velocity
        a × (c - p), and turns the tool about a. A prismatic axis moves the tool along a.

        Args:
            frames: motions of the bodies, from :meth:`frames`.
            places: positions of the tool centre point, shape (k, 3) [m].

        Returns:
            the Jacobian, shape (k, 6, n): velocity, then angular velocity, in the frame in which the motion of the base
            is given.
        """
        # Each axis moves with the body on which it stands, which is the one before in a chain. Shape (m, k, 4, 2).
        carried = frames[:-1] @ self._axes_and_points
        axes = carried[..., :3, 0]
        points = carried[..., :3, 1]
        arms = places - points
        columns = np.empty((*axes.shape[:2], 6))
        # Revolute axes: v = a × (c - p) and ω = a. A product with [a] is faster than np.cross for many small vectors.
        velocities = skew(axes) @ arms[..., np.newaxis]
        columns[..., :3] = velocities[..., 0]
        columns[..., 3:] = axes
        # Prismatic axes: v = a and ω = 0.
        columns[self._prismatic, :, :3] = axes[self._prismatic]
        columns[self._prismatic, :, 3:] = 0.0
        # The columns of axes that do not move the tool, such as fingers, stay zero.
        jacobian = np.zeros((len(places), 6, self.size))
        jacobian[:, :, self._order_indices] = columns.transpose(1, 2, 0)
        return jacobian

    @property
    def reach(self) -> float:
        """Upper bound of the distance between the tool and the point of the first moving axis [m].

        It is infinite if a prismatic axis that moves the tool has no limit.
        """
        # A revolute axis keeps the distance from its point to the next one, whatever its position is. A straight line
        # is no longer than the way over all of these points.
        # From the first moving axis over the others to the tool centre point.
        points = [*self.points[list(self.order)], self.home[:3, 3]]
        distances = sum(float(np.linalg.norm(end - begin)) for begin, end in pairwise(points))
        # A prismatic axis adds its travel from zero.
        prismatic = [axis for axis in self.order if not self.revolute[axis]]
        longest_slides = np.maximum(np.abs(self.lower[prismatic]), np.abs(self.upper[prismatic]))
        return distances + float(longest_slides.sum())

    def axis_index(self, name: str) -> int:
        """Find the index of an axis by its name.

        Raises:
            UnknownName: there is no axis of this name.
        """
        return self.names.index(one_of(message("base.axis", "axis"), name, self.names))

    @cached_property
    def _axes_and_points(self) -> Vector:
        """Homogeneous coordinates of the unit vector and the point of each followed axis, shape (m, 1, 4, 2)."""
        columns = np.zeros((len(self.order), 1, 4, 2))
        # A direction has the fourth coordinate 0, so that frames only turn it; a point has 1, and is shifted as well.
        columns[:, 0, :3, 0] = self.axes[self._order_indices]
        columns[:, 0, :3, 1] = self.points[self._order_indices]
        columns[:, 0, 3, 1] = 1.0
        return columns


def axes_and_points(
    context: Context, joints: Sequence[Joint], base: Frame
) -> tuple[Vector, Vector]:
    """Compute the axes of joints in a base frame.

    Args:
        context: context of the plant, with the posture in which the axes are taken.
        joints: the joints, revolute or prismatic.
        base: the base frame.

    Returns:
        the unit vectors of the axes, shape (n, 3), and a point on each axis, shape (n, 3) [m].
    """
    # The origin of a joint's frame is on its axis, and the frame on the parent does not move with the joint itself.
    poses = [joint.frame_on_parent().CalcPose(context, base) for joint in joints]
    axes = [
        pose.rotation().matrix() @ _axis(joint) for pose, joint in zip(poses, joints, strict=True)
    ]
    points = [pose.translation() for pose in poses]
    return np.reshape(axes, (-1, 3)), np.reshape(points, (-1, 3))


def _axis(joint: Joint) -> Vector:
    """Unit vector (3,) of a joint's axis in the joint's frame on its parent."""
    axis: Vector = (
        joint.revolute_axis() if isinstance(joint, RevoluteJoint) else joint.translation_axis()
    )
    return axis


def _axes_of_path(
    path: list[tuple[Joint, float]], joints: Sequence[Joint]
) -> list[tuple[int, float]]:
    """Find the axes of the joints on a path.

    Args:
        path: joints with their senses, from :func:`joints_between`.
        joints: the joint of each axis.

    Returns:
        index and sense of each axis on the path.

    Raises:
        UnsupportedChain: a joint on the path belongs to no axis.
    """
    axis_of_joint = {joint.index(): axis for axis, joint in enumerate(joints)}
    missing = [joint.name() for joint, _ in path if joint.index() not in axis_of_joint]
    if missing:
        raise UnsupportedChain(
            message(
                "kinematics.undriven_joint",
                "joints that belong to no axis of the robot move the tool: {missing}",
                missing=", ".join(missing),
            )
        )
    return [(axis_of_joint[joint.index()], sense) for joint, sense in path]


def joints_between(plant: MultibodyPlant, base: Frame, tool: Frame) -> list[tuple[Joint, float]]:
    """Find the joints of a finalized plant that can move a tool frame against a base frame.

    The tool may be on another branch of the tree than the base. The path then leads back towards the world first.

    Args:
        plant: the plant.
        base: the base frame.
        tool: the tool frame.

    Returns:
        the joints in order from the base. Each comes with its sense: 1 if the path leads outward through the joint, -1
        if it leads back towards the world.
    """
    inboard_joints = {}  # the joint that carries each body
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        inboard_joints[joint.child_body().index()] = joint
    back = _joints_to_world(inboard_joints, base)
    out = _joints_to_world(inboard_joints, tool)
    # Joints that carry both frames do not move them against each other.
    while back and out and back[-1].index() == out[-1].index():
        back.pop()
        out.pop()
    # The list `out` begins at the tool, and a path begins at the base.
    path = [(joint, -1.0) for joint in back] + [(joint, 1.0) for joint in reversed(out)]
    # Welds have no positions.
    return [(joint, sense) for joint, sense in path if joint.num_positions() > 0]


def _joints_to_world(inboard_joints: dict[int, Joint], frame: Frame) -> list[Joint]:
    """List the joints, welds included, from a frame back to the world, the one next to the frame first.

    Args:
        inboard_joints: the joint that carries each body, by the index of the body.
        frame: the frame.
    """
    joints = []
    body = frame.body()
    while body.index() in inboard_joints:
        joint = inboard_joints[body.index()]
        joints.append(joint)
        body = joint.parent_body()
    return joints
