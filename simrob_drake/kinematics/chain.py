"""Joints given by their screws, what they carry in many postures at once, and the chain of them from base to tool."""

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
_CROSS = np.zeros((3, 9))  # row i: the matrix of eᵢ ×
_CROSS[[0, 0, 1, 1, 2, 2], [7, 5, 2, 6, 3, 1]] = [1, -1, 1, -1, 1, -1]


@dataclass(frozen=True, eq=False, kw_only=True)
class Screws:
    """Revolute and prismatic joints of a tree, each given by its screw at zero posture in one base frame.

    What a joint carries moves by the product exp(S₁q₁) ... exp(Sᵢqᵢ) of the screws from the base to it, given by axis
    and point (Lynch & Park, Modern Robotics, 2017, §4.1). Positions have shape (k, n) or (n,), in rad, or m for
    prismatic joints.
    """

    axes: Vector  # unit axis of every joint at zero in the base frame, shape (n, 3)
    points: Vector  # a point on every axis at zero [m], shape (n, 3)
    revolute: np.ndarray[Any, np.dtype[np.bool_]]  # whether each joint is revolute, shape (n,)
    order: tuple[int, ...]  # the axes that are followed, from the base outward
    # what each of these stands on: 0 the base, i what the i-th of them carries; in a row unless given
    after: tuple[int, ...] | None = None

    @property
    def size(self) -> int:
        """How many axes there are, n."""
        return len(self.axes)

    def postures(self, positions: npt.ArrayLike, name: str = "positions") -> Vector:
        """Return postures as (k, n); raises InvalidParameter: another shape than (n,) or (k, n), or not finite."""
        expected = message(
            "kinematics.finite_numbers_an_axis",
            "{size} finite numbers, or rows of as many, one an axis",
            size=self.size,
        )
        rows = numbers(positions)
        if not rows.size:
            raise InvalidParameter(name, positions, expected)
        if rows.ndim not in (1, 2) or rows.shape[-1] != self.size:
            raise InvalidParameter(
                name, message("base.array_of_shape", "an array of shape {shape}", shape=rows.shape), expected
            )
        if not np.isfinite(rows).all():
            raise InvalidParameter(name, rows.tolist(), expected)
        return np.atleast_2d(rows)

    def frames(self, postures: Vector, base: Vector = IDENTITY) -> Vector:
        """Return where the base (4, 4) or (k, 4, 4), and what each axis carries, move, shape (m + 1, k, 4, 4)."""
        values = postures.T[self._moving]
        terms = np.empty((*values.shape, 3))
        terms[..., 0] = 1.0
        terms[..., 1] = np.sin(values)
        terms[..., 2] = 1.0 - np.cos(values)
        terms[self._prismatic, :, 1] = values[self._prismatic]
        motions = (terms @ self._exponentials).reshape(len(values), len(postures), 4, 4)
        frames = np.empty((len(values) + 1, len(postures), 4, 4))
        frames[0] = base
        for index, motion in enumerate(motions):
            np.matmul(frames[self.after[index] if self.after else index], motion, out=frames[index + 1])
        return frames

    @cached_property
    def _moving(self) -> Indices:
        return np.array(self.order, dtype=np.intp)

    @cached_property
    def _prismatic(self) -> Indices:
        """Which of the followed axes are prismatic."""
        return np.flatnonzero(~self.revolute[self._moving])

    @cached_property
    def _exponentials(self) -> Vector:
        """Matrices A, B, C (m, 3, 16) of exp(Sq) = A + sin(q)·B + (1 - cos(q))·C, or A + q·B if prismatic."""
        terms = np.zeros((len(self.order), 3, 4, 4))
        terms[:, 0] = IDENTITY
        for term, axis in zip(terms, self.order, strict=True):
            if self.revolute[axis]:
                spin = skew(self.axes[axis])
                term[1, :3] = np.column_stack([spin, -spin @ self.points[axis]])
                term[2, :3] = np.column_stack([spin @ spin, -spin @ spin @ self.points[axis]])
            else:
                term[1, :3, 3] = self.axes[axis]
        return terms.reshape(-1, 3, 16)


def skew(vectors: Vector) -> Vector:
    """Return the matrices (..., 3, 3) whose product with a vector is the cross product of ``vectors`` (..., 3)."""
    matrices: Vector = (vectors @ _CROSS).reshape(*vectors.shape[:-1], 3, 3)
    return matrices


class UnsupportedChain(SimrobError):
    """Frames of a plant that joints other than the given ones move against each other."""


@dataclass(frozen=True, eq=False)
class ChainInPlant:
    """Where a chain lies in a finalized plant, for solvers that ask Drake; whoever owns the plant keeps it alive."""

    plant: MultibodyPlant
    joints: tuple[Joint, ...]  # one an axis
    axes: AxisMap  # where they stand in the plant, and their senses
    base: Frame
    tool: Frame
    tcp: Vector  # pose of the tool centre point in the frame ``tool``, shape (4, 4)


@dataclass(frozen=True, eq=False, kw_only=True)
class Chain(Screws):
    """The joints in a row from a robot's base frame to a tool frame, with their names and limits.

    Attributes:
        names: of the axes.
        lower: lower limit of every axis, shape (n,) [rad or m]; infinite where there is none.
        upper: upper limit of every axis, shape (n,).
        home: pose of the tool at zero, shape (4, 4).
        in_plant: where the chain lies in its plant.
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
        """The ranges of the axes, for checks of positions."""
        return AxisLimits(names=self.names, lower=self.lower, upper=self.upper, revolute=self.revolute)

    @classmethod
    def of_robot(cls, model: RobotModel, tool: str | None = None) -> "Chain":
        """Return the chain from a robot's root link to one of its tools, the first unless named.

        Raises:
            UnknownName: no such tool.
            InvalidParameter: a robot without tools.
            InvalidModel: a URDF that Drake cannot read.
        """
        if not model.tools:
            raise InvalidParameter(
                "tools",
                model.tools,
                message("kinematics.a_tool_frame", "at least one tool frame of {model}", model=model.name),
            )
        name = next(iter(model.tools)) if tool is None else tool
        one_of(message("base.tool_of", "tool of {model}", model=model.name), name, model.tools)
        plant, base = held_robot(model)
        joints = [plant.GetJointByName(axis.joint) for axis in model.axes.values()]
        signs = [axis.sign for axis in model.axes.values()]
        frame = plant.GetFrameByName(model.tools[name])
        return cls.of_plant(plant, joints=joints, signs=signs, base=base, tool=frame, names=list(model.axes))

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
            plant: finalized; it has to stay alive for the solvers that ask Drake.
            joints: the robot's, in axis order; those that do not move the tool are allowed and change nothing.
            base: the frame that poses are given in.
            tool: the frame whose pose is wanted.
            signs: the sense in which each joint is positive, shape (n,); all 1 unless given.
            names: of the axes; the joints' own unless given.

        Raises:
            UnsupportedChain: the frames move against each other by a joint that is not listed, or of another type.
            InvalidParameter: signs or names that are not one a joint.
        """
        labels = tuple(joint.name() for joint in joints) if names is None else tuple(names)
        if len(labels) != len(joints) or len(set(labels)) != len(labels):
            raise InvalidParameter(
                "names",
                names,
                message("kinematics.different_names", "{count} different names, one a joint", count=len(joints)),
            )
        way = _listed(joints_between(plant, base, tool), joints)
        for joint, name in zip(joints, labels, strict=True):
            if not isinstance(joint, RevoluteJoint | PrismaticJoint):
                raise UnsupportedChain(
                    message(
                        "kinematics.unsupported_joint",
                        "{name} is a {kind} joint; chains take revolute and prismatic ones",
                        name=name,
                        kind=joint.type_name(),
                    )
                )
        in_plant = AxisMap.of_joints(plant, joints, signs)
        context = plant.CreateDefaultContext()
        in_plant.set_positions(plant, context, np.zeros(len(joints)))
        axes, points = axes_and_points(context, joints, base)
        along = np.ones(len(joints))
        for axis, sense in way:
            along[axis] = sense
        limits = [(joint.position_lower_limit(), joint.position_upper_limit()) for joint in joints]
        bounds = np.sort(in_plant.signs[:, np.newaxis] * np.reshape(limits, (-1, 2)), axis=1)
        return cls(
            names=labels,
            axes=(in_plant.signs * along)[:, np.newaxis] * axes,
            points=points,
            revolute=np.array([isinstance(joint, RevoluteJoint) for joint in joints], dtype=bool),
            order=tuple(axis for axis, _ in way),
            lower=bounds[:, 0],
            upper=bounds[:, 1],
            home=tool.CalcPose(context, base).GetAsMatrix4(),
            in_plant=ChainInPlant(plant, tuple(joints), in_plant, base, tool, np.eye(4)),
        )

    def with_tool(self, pose: Targets) -> "Chain":
        """Return the chain to another tool centre point, given as one pose in this chain's tool frame."""
        matrix = one_pose(pose, "tool")
        return replace(self, home=self.home @ matrix, in_plant=replace(self.in_plant, tcp=self.in_plant.tcp @ matrix))

    def forward(self, positions: npt.ArrayLike) -> Vector:
        """Return the poses of the tool in the base, shape (k, 4, 4); one posture (n,) gives k = 1."""
        return self.tool_poses(self.frames(self.postures(positions)))

    def jacobian(self, positions: npt.ArrayLike) -> Vector:
        """Return the geometric Jacobian, shape (k, 6, n): what the axes' speeds give of the tool's.

        Rows: velocity of the tool centre point along x, y, z of the base [m/s], then angular velocity about
        x, y, z. (SimRob orders the last three z, y, x: ``jacobian[:, [0, 1, 2, 5, 4, 3]]``.)
        """
        frames = self.frames(self.postures(positions))
        return self.jacobian_at(frames, self.tool_poses(frames)[:, :3, 3])

    def tool_poses(self, frames: Vector) -> Vector:
        """Return the poses of the tool (k, 4, 4) from :meth:`frames`."""
        poses: Vector = frames[-1] @ self.home
        return poses

    def jacobian_at(self, frames: Vector, places: Vector) -> Vector:
        """Return the Jacobian (k, 6, n) from :meth:`frames` and the places (k, 3) of the tool centre point."""
        carried = frames[:-1] @ self._axes_and_points  # (m, k, 4, 2)
        axes, arms = carried[..., :3, 0], places - carried[..., :3, 1]
        columns = np.empty((*axes.shape[:2], 6))
        columns[..., :3] = (skew(axes) @ arms[..., np.newaxis])[..., 0]
        columns[..., 3:] = axes
        columns[self._prismatic, :, :3] = axes[self._prismatic]
        columns[self._prismatic, :, 3:] = 0.0
        jacobian = np.zeros((len(places), 6, self.size))
        jacobian[:, :, self._moving] = columns.transpose(1, 2, 0)
        return jacobian

    @property
    def reach(self) -> float:
        """Upper bound on the distance of the tool from the point of the first moving axis [m]."""
        points = [*self.points[list(self.order)], self.home[:3, 3]]
        spans = sum(float(np.linalg.norm(end - begin)) for begin, end in pairwise(points))
        prismatic = [axis for axis in self.order if not self.revolute[axis]]
        return spans + float(np.maximum(np.abs(self.lower[prismatic]), np.abs(self.upper[prismatic])).sum())

    def axis_index(self, name: str) -> int:
        """Return the place of an axis; raises UnknownName: no such axis."""
        return self.names.index(one_of(message("base.axis", "axis"), name, self.names))

    @cached_property
    def _axes_and_points(self) -> Vector:
        """Homogeneous axis and point of the followed axes, shape (m, 1, 4, 2)."""
        columns = np.zeros((len(self.order), 1, 4, 2))
        columns[:, 0, :3, 0] = self.axes[self._moving]
        columns[:, 0, :3, 1] = self.points[self._moving]
        columns[:, 0, 3, 1] = 1.0
        return columns


def axes_and_points(context: Context, joints: Sequence[Joint], base: Frame) -> tuple[Vector, Vector]:
    """Return the axes of joints, and a point on each, in a frame, both of shape (n, 3)."""
    places = [joint.frame_on_parent().CalcPose(context, base) for joint in joints]
    axes = [place.rotation().matrix() @ _axis(joint) for place, joint in zip(places, joints, strict=True)]
    return np.reshape(axes, (-1, 3)), np.reshape([place.translation() for place in places], (-1, 3))


def _axis(joint: Joint) -> Vector:
    axis: Vector = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else joint.translation_axis()
    return axis


def _listed(way: list[tuple[Joint, float]], joints: Sequence[Joint]) -> list[tuple[int, float]]:
    """Return the places among ``joints`` of the joints on the way."""
    places = {joint.index(): axis for axis, joint in enumerate(joints)}
    missing = [joint.name() for joint, _ in way if joint.index() not in places]
    if missing:
        raise UnsupportedChain(
            message(
                "kinematics.undriven_joint",
                "the tool moves also by {missing}, which no axis of the robot drives",
                missing=", ".join(missing),
            )
        )
    return [(places[joint.index()], sense) for joint, sense in way]


def joints_between(plant: MultibodyPlant, base: Frame, tool: Frame) -> list[tuple[Joint, float]]:
    """Return the joints of a finalized plant that can move ``tool`` against ``base``, in order from the base.

    Each comes with 1 where the way leads outward through it, or -1 where it leads back towards the world; the tool may
    be on another branch of the tree.
    """
    inboard = {}
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        inboard[joint.child_body().index()] = joint
    back, out = _to_world(inboard, base), _to_world(inboard, tool)
    while back and out and back[-1].index() == out[-1].index():  # what carries both does not count
        back.pop()
        out.pop()
    way = [(joint, -1.0) for joint in back] + [(joint, 1.0) for joint in reversed(out)]
    return [(joint, sense) for joint, sense in way if joint.num_positions() > 0]


def _to_world(inboard: dict[int, Joint], frame: Frame) -> list[Joint]:
    joints, body = [], frame.body()
    while body.index() in inboard:
        joints.append(inboard[body.index()])
        body = joints[-1].parent_body()
    return joints
