"""Goals of the constrained solver, in addition to a pose or in its place (SimRob's constraints of GIK).

A goal without a ``weight`` is a constraint. A goal with a weight is a cost of weight · (distance outside its
bounds)²: constraints come first, and the sum of the costs is minimised. Frames have their names of the URDF; ``"tool"``
is the chain's tool centre point and ``"base"`` its base frame.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import (
    AngleBetweenVectorsConstraint,
    GazeTargetConstraint,
    PointToPointDistanceConstraint,
    PositionConstraint,
)
from pydrake.multibody.tree import Frame
from pydrake.solvers import BoundingBoxConstraint, Constraint
from pydrake.systems.framework import Context

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.frames import POSE_SIZE, Targets, Vector, one_pose
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.kinematics.chain import Chain

ORIGIN = (0.0, 0.0, 0.0)
"""Origin of a frame, in this frame [m]."""
HERE = (0.0,) * POSE_SIZE
"""Pose of a frame in itself: zero position and zero angles."""

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Setting:
    """A chain, and the context of its plant in which constraints are evaluated.

    Attributes:
        chain: the axes, the base and the tool.
        context: context of the chain's plant. Drake sets its positions in each evaluation of a constraint.
    """

    chain: Chain
    context: Context

    def frame(self, name: str) -> tuple[Frame, RigidTransform]:
        """Find a frame of the robot by its name.

        Args:
            name: a frame of the URDF, ``"tool"`` or ``"base"``.

        Returns:
            a frame of the plant, and the pose of the named frame in it.

        Raises:
            UnknownName: there is no such frame.
        """
        # "tool" and "base" are no frames of the URDF: the tool centre point may be offset from the tool frame.
        in_plant = self.chain.in_plant
        if name == "tool":
            return in_plant.tool, RigidTransform(in_plant.tcp)
        if name == "base":
            return in_plant.base, RigidTransform()
        # Only frames of this robot: a plant with several robots has the same names several times.
        instance = in_plant.base.model_instance()
        if not in_plant.plant.HasFrameNamed(name, instance):
            frames = [
                in_plant.plant.get_frame(index)
                for index in in_plant.plant.GetFrameIndices(instance)
            ]
            raise UnknownName(
                message("base.frame", "frame"),
                name,
                ["tool", "base", *(frame.name() for frame in frames)],
            )
        return in_plant.plant.GetFrameByName(name, instance), RigidTransform()


@dataclass(frozen=True, kw_only=True)
class Goal(ABC):
    """A condition on postures.

    Attributes:
        weight: weight of the cost, one number or one for each value of the condition. If it is None, the goal is a
            constraint.
    """

    weight: float | Triple | None = None

    @abstractmethod
    def constraint(self, setting: Setting) -> Constraint:
        """Make the constraint on the positions of the whole plant, or of one axis for :class:`JointBounds`.

        Args:
            setting: chain and context.

        Raises:
            InvalidParameter: the goal has a value that it cannot have.
            UnknownName: the goal names an axis or frame that does not exist.
        """

    def weights(self, size: int) -> Vector | None:
        """Weights of the cost, one for each value of the condition. Returns None if the goal is a constraint.

        Args:
            size: count of values of the condition.

        Returns:
            the weights, shape (size,). One number for all of them is repeated.

        Raises:
            InvalidParameter: the weights are of another count, negative or not finite.
        """
        if self.weight is None:
            return None
        weights = np.asarray(self.weight, dtype=float)
        if (
            weights.shape not in ((), (size,))
            or not np.isfinite(weights).all()
            or (weights < 0).any()
        ):
            if size == 1:
                expected = message("kinematics.one_weight", "one number, not negative")
            else:
                expected = message(
                    "kinematics.one_or_many_weights",
                    "one number, or {size} numbers, none negative",
                    size=size,
                )
            raise InvalidParameter(
                message("kinematics.weight_of", "weight of {name}", name=type(self).__name__),
                self.weight,
                expected,
            )
        # One number is the weight of every value.
        return np.broadcast_to(weights, (size,))


@dataclass(frozen=True, kw_only=True)
class PositionBounds(Goal):
    """The tool centre point stays in a box (SimRob's CartesianBounds; with lower = upper its PositionTarget).

    Attributes:
        lower: lower bounds of x, y, z in ``frame`` [m]; -inf without a bound.
        upper: upper bounds of x, y, z in ``frame`` [m]; inf without a bound.
        frame: frame of the box, as a pose in the base.
        weight: weight of the cost, one number or one each for x, y, z. If it is None, the goal is a constraint.
    """

    lower: Triple = (-np.inf, -np.inf, -np.inf)
    upper: Triple = (np.inf, np.inf, np.inf)
    frame: Targets = HERE

    def constraint(self, setting: Setting) -> Constraint:
        """Make the constraint on the positions of the whole plant.

        Args:
            setting: chain and context.

        Raises:
            InvalidParameter: a bound is not a number, or a lower bound is above the upper one; or the frame is no pose.
        """
        lower, upper = _bounds("PositionBounds", self.lower, self.upper, 3)
        return point_in_box(
            setting, ORIGIN, RigidTransform(one_pose(self.frame, "frame")), lower, upper
        )


@dataclass(frozen=True, kw_only=True)
class OrientationCone(Goal):
    """An axis of the tool stays within an angle of a direction (SimRob's OrientationTarget, free about that axis).

    Attributes:
        direction: direction in the base, of any length.
        angle: largest angle between axis and direction, 0 to π [rad].
        axis: axis of the tool.
        weight: weight of the squared violation of the cosine. If it is None, the goal is a constraint.
    """

    direction: Triple
    angle: float
    axis: Triple = (0.0, 0.0, 1.0)

    def constraint(self, setting: Setting) -> Constraint:
        """Make the constraint on the positions of the whole plant.

        Args:
            setting: chain and context.

        Raises:
            InvalidParameter: the angle is not from 0 to π; or the direction or the axis is zero, or not three numbers.
        """
        if not 0 <= self.angle <= np.pi:
            raise InvalidParameter(
                message("kinematics.angle_of_cone", "angle of OrientationCone"),
                self.angle,
                message("kinematics.zero_to_pi", "0 ... π rad"),
            )
        # Users give the axis in the tool's own frame. Drake wants it in a frame of the plant.
        tool, tcp = setting.frame("tool")
        in_plant = setting.chain.in_plant
        axis = tcp.rotation() @ _direction("axis", self.axis)
        direction = _direction("direction", self.direction)
        return AngleBetweenVectorsConstraint(
            in_plant.plant, in_plant.base, direction, tool, axis, 0.0, self.angle, setting.context
        )


@dataclass(frozen=True, kw_only=True)
class Aiming(Goal):
    """An axis of the tool points at a target point (SimRob's AimingConstraint).

    Attributes:
        target: point in the base [m].
        angle: largest angle between the axis and the direction to the target, 0 to π/2 [rad].
        axis: axis of the tool.
        weight: weight of the squared violations of Drake's two values of the cone [m, m²]. If it is None, the goal is a
            constraint.
    """

    target: Triple
    angle: float = 0.0
    axis: Triple = (0.0, 0.0, 1.0)

    def constraint(self, setting: Setting) -> Constraint:
        """Make the constraint on the positions of the whole plant.

        Args:
            setting: chain and context.

        Raises:
            InvalidParameter: the angle is not from 0 to π/2; the axis is zero; or target or axis are not three numbers.
        """
        if not 0 <= self.angle <= np.pi / 2:
            raise InvalidParameter(
                message("kinematics.angle_of_aiming", "angle of Aiming"),
                self.angle,
                message("kinematics.zero_to_half_pi", "0 ... π/2 rad"),
            )
        # The line of sight begins at the tool centre point, and not at the origin of the plant's tool frame.
        in_plant = setting.chain.in_plant
        tool, tcp = setting.frame("tool")
        axis = tcp.rotation() @ _direction("axis", self.axis)
        target = _triple("target", self.target)
        return GazeTargetConstraint(
            in_plant.plant,
            tool,
            tcp.translation(),
            axis,
            in_plant.base,
            target,
            self.angle,
            setting.context,
        )


@dataclass(frozen=True, kw_only=True)
class JointBounds(Goal):
    """An axis stays between bounds; with lower = upper it is fixed (SimRob's JointBounds, RevoluteJoint, Prismatic).

    Attributes:
        axis: name of the axis.
        lower: lower bound [rad or m].
        upper: upper bound [rad or m].
        weight: weight of the squared distance outside the bounds. If it is None, the goal is a constraint.
    """

    axis: str
    lower: float = -np.inf
    upper: float = np.inf

    @classmethod
    def at_position(cls, axis: str, value: float, weight: float | None = None) -> "JointBounds":
        """Make the goal that an axis has a position [rad or m]."""
        return cls(axis=axis, lower=value, upper=value, weight=weight)

    def constraint(self, setting: Setting) -> Constraint:
        """Make the constraint on the position of this axis alone.

        Args:
            setting: chain and context.

        Raises:
            UnknownName: there is no such axis.
            InvalidParameter: a bound is not a number, or the lower bound is above the upper one.
        """
        in_plant = setting.chain.in_plant
        sign = in_plant.axes.signs[setting.chain.axis_index(self.axis)]
        lower, upper = _bounds(
            message("kinematics.bounds_of_joint", "JointBounds of {axis}", axis=self.axis),
            [self.lower],
            [self.upper],
            1,
        )
        # The constraint is on the joint's position. An axis against its joint (sign -1) swaps the bounds, so that they
        # are sorted again.
        ends = np.sort(np.concatenate([sign * lower, sign * upper]))
        return BoundingBoxConstraint(ends[:1], ends[1:])


keep_former_attributes(JointBounds, fixed="at_position")


@dataclass(frozen=True, kw_only=True)
class DistanceBounds(Goal):
    """The distance between two points stays between bounds (SimRob's DistanceBounds).

    Attributes:
        frames: frames of the two points: names of the URDF, ``"tool"`` or ``"base"``.
        lower: lower bound of the distance [m].
        upper: upper bound of the distance [m].
        points: the two points in these frames [m].
        weight: weight of the squared violation of the squared distance. If it is None, the goal is a constraint.
    """

    frames: tuple[str, str]
    lower: float = 0.0
    upper: float = np.inf
    points: tuple[Triple, Triple] = (ORIGIN, ORIGIN)

    def constraint(self, setting: Setting) -> Constraint:
        """Make the constraint on the positions of the whole plant.

        Args:
            setting: chain and context.

        Raises:
            InvalidParameter: a bound is not a number or negative, the lower bound is above the upper one, or a point is
                not three numbers.
            UnknownName: there is no such frame.
        """
        lower, upper = _bounds("DistanceBounds", [self.lower], [self.upper], 1)
        # Drake squares the bounds, and a negative one would then look like a positive one.
        if lower[0] < 0:
            raise InvalidParameter(
                message("kinematics.lower_of_distance", "lower of DistanceBounds"),
                self.lower,
                message("kinematics.zero_or_more_metres", "0 or more [m]"),
            )
        name = message("kinematics.points_of_distance", "points of DistanceBounds")
        first_frame, first_pose = setting.frame(self.frames[0])
        second_frame, second_pose = setting.frame(self.frames[1])
        return PointToPointDistanceConstraint(
            setting.chain.in_plant.plant,
            first_frame,
            first_pose @ _triple(name, self.points[0]),
            second_frame,
            second_pose @ _triple(name, self.points[1]),
            lower[0],
            upper[0],
            setting.context,
        )


def point_in_box(
    setting: Setting, point: npt.ArrayLike, box: RigidTransform, lower: Vector, upper: Vector
) -> Constraint:
    """Make the constraint that keeps a point of the tool in a box, on the positions of the whole plant.

    Args:
        setting: chain and context.
        point: the point, from the tool centre point in its axes, shape (3,) [m].
        box: pose of the box's frame in the base.
        lower: lower bounds in the frame of the box, shape (3,) [m].
        upper: upper bounds in the frame of the box, shape (3,) [m].
    """
    tool, tcp = setting.frame("tool")
    in_plant = setting.chain.in_plant
    return PositionConstraint(
        in_plant.plant,
        in_plant.base,
        box,
        lower,
        upper,
        tool,
        tcp @ np.asarray(point, dtype=float),
        setting.context,
    )


def _bounds(
    owner: str, lower: npt.ArrayLike, upper: npt.ArrayLike, size: int
) -> tuple[Vector, Vector]:
    """Convert lower and upper bounds to arrays (size,), and check them.

    Args:
        owner: name of the goal, for the message of an error.
        lower: lower bounds.
        upper: upper bounds.
        size: required count of numbers in each of them.

    Raises:
        InvalidParameter: bounds of another size, or with NaN, or a lower bound above an upper one.
    """
    # Infinite bounds are allowed: they mean that there is no bound. NaN is not, as every comparison with it is false.
    low = np.asarray(lower, dtype=float)
    high = np.asarray(upper, dtype=float)
    if low.shape != (size,) or high.shape != (size,) or np.isnan(low).any() or np.isnan(high).any():
        raise InvalidParameter(
            message("kinematics.bounds_of", "bounds of {owner}", owner=owner),
            (lower, upper),
            message(
                "kinematics.numbers_each",
                "{size} numbers for the lower bounds and {size} for the upper bounds",
                size=size,
            ),
        )
    if (low > high).any():
        raise InvalidParameter(
            message("kinematics.bounds_of", "bounds of {owner}", owner=owner),
            (lower, upper),
            message(
                "kinematics.lower_then_upper", "lower bounds, and upper bounds that are not smaller"
            ),
        )
    return low, high


def _triple(name: str, values: npt.ArrayLike) -> Vector:
    """Convert values to an array (3,).

    Raises:
        InvalidParameter: these are not three finite numbers.
    """
    triple = np.asarray(values, dtype=float)
    if triple.shape != (3,) or not np.isfinite(triple).all():
        raise InvalidParameter(
            name, values, message("kinematics.three_numbers_xyz", "three finite numbers x, y, z")
        )
    return triple


def _direction(name: str, values: npt.ArrayLike) -> Vector:
    """Convert values to a unit vector (3,).

    Raises:
        InvalidParameter: these are not three finite numbers, or all are zero.
    """
    direction = _triple(name, values)
    if not direction.any():
        raise InvalidParameter(
            name, values, message("kinematics.a_direction", "a vector other than zero")
        )
    unit: Vector = direction / np.linalg.norm(direction)
    return unit
