"""What the constrained solver can be asked for besides, or instead of, a pose (SimRob's constraints of GIK).

Each goal is a constraint unless it has a ``weight``: then it is a wish, which costs weight · (distance outside its
bounds)² and gives way to constraints and weighs against other wishes. Frames are named as in the URDF; ``"tool"`` is
the chain's tool centre point and ``"base"`` its base frame.
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
from simrob_drake.kinematics.chain import Chain

ORIGIN = (0.0, 0.0, 0.0)
HERE = (0.0,) * POSE_SIZE

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Setting:
    """A chain and the context of its plant that constraints are evaluated in."""

    chain: Chain
    context: Context

    def frame(self, name: str) -> tuple[Frame, RigidTransform]:
        """Return a frame of the plant, and the pose of what is meant in it."""
        place = self.chain.in_plant
        if name == "tool":
            return place.tool, RigidTransform(place.tcp)
        if name == "base":
            return place.base, RigidTransform()
        instance = place.base.model_instance()
        if not place.plant.HasFrameNamed(name, instance):
            frames = [place.plant.get_frame(index) for index in place.plant.GetFrameIndices(instance)]
            raise UnknownName(
                message("base.frame", "frame"), name, ["tool", "base", *(frame.name() for frame in frames)]
            )
        return place.plant.GetFrameByName(name, instance), RigidTransform()


@dataclass(frozen=True, kw_only=True)
class Goal(ABC):
    """One thing asked of a posture."""

    weight: float | Triple | None = None

    @abstractmethod
    def constraint(self, setting: Setting) -> Constraint:
        """Return it as a constraint on the positions of the whole plant."""

    def weights(self, size: int) -> Vector | None:
        """Return the weight of each of the constraint's ``size`` numbers, or None for a constraint."""
        if self.weight is None:
            return None
        weights = np.asarray(self.weight, dtype=float)
        if weights.shape not in ((), (size,)) or not np.isfinite(weights).all() or (weights < 0).any():
            one = (
                message("kinematics.one_weight", "one number, not negative")
                if size == 1
                else message("kinematics.one_or_many_weights", "one number, or {size}, none negative", size=size)
            )
            raise InvalidParameter(
                message("kinematics.weight_of", "weight of {name}", name=type(self).__name__), self.weight, one
            )
        return np.broadcast_to(weights, (size,))


@dataclass(frozen=True, kw_only=True)
class PositionBounds(Goal):
    """The tool centre point stays in a box (SimRob's CartesianBounds; with lower = upper its PositionTarget).

    Attributes:
        lower: of x, y, z [m] in ``frame``; -inf where there is no bound.
        upper: likewise.
        frame: the box' axes, as a pose in the base.
        weight: None, a number, or one each for x, y, z.
    """

    lower: Triple = (-np.inf, -np.inf, -np.inf)
    upper: Triple = (np.inf, np.inf, np.inf)
    frame: Targets = HERE

    def constraint(self, setting: Setting) -> Constraint:
        """Return it as a constraint on the positions of the whole plant."""
        lower, upper = _bounds("PositionBounds", self.lower, self.upper, 3)
        return point_in_box(setting, ORIGIN, RigidTransform(one_pose(self.frame, "frame")), lower, upper)


@dataclass(frozen=True, kw_only=True)
class OrientationCone(Goal):
    """An axis of the tool stays within an angle of a direction (SimRob's OrientationTarget, free about that axis).

    Attributes:
        direction: in the base.
        angle: half the cone's opening [rad], 0 ... π.
        axis: of the tool.
        weight: None, or of the violation of the cosine.
    """

    direction: Triple
    angle: float
    axis: Triple = (0.0, 0.0, 1.0)

    def constraint(self, setting: Setting) -> Constraint:
        """Return it as a constraint on the positions of the whole plant."""
        if not 0 <= self.angle <= np.pi:
            raise InvalidParameter(
                message("kinematics.angle_of_cone", "angle of OrientationCone"),
                self.angle,
                message("kinematics.zero_to_pi", "0 ... π rad"),
            )
        tool, tcp = setting.frame("tool")
        place = setting.chain.in_plant
        axis = tcp.rotation() @ _direction("axis", self.axis)
        direction = _direction("direction", self.direction)
        return AngleBetweenVectorsConstraint(
            place.plant, place.base, direction, tool, axis, 0.0, self.angle, setting.context
        )


@dataclass(frozen=True, kw_only=True)
class Aiming(Goal):
    """An axis of the tool points at a target point (SimRob's AimingConstraint).

    Attributes:
        target: point in the base [m].
        angle: by which the axis may miss it [rad], 0 ... π/2.
        axis: of the tool.
        weight: None, or of Drake's two figures of the cone [m, m²].
    """

    target: Triple
    angle: float = 0.0
    axis: Triple = (0.0, 0.0, 1.0)

    def constraint(self, setting: Setting) -> Constraint:
        """Return it as a constraint on the positions of the whole plant."""
        if not 0 <= self.angle <= np.pi / 2:
            raise InvalidParameter(
                message("kinematics.angle_of_aiming", "angle of Aiming"),
                self.angle,
                message("kinematics.zero_to_half_pi", "0 ... π/2 rad"),
            )
        place = setting.chain.in_plant
        tool, tcp = setting.frame("tool")
        axis = tcp.rotation() @ _direction("axis", self.axis)
        target = _triple("target", self.target)
        return GazeTargetConstraint(
            place.plant, tool, tcp.translation(), axis, place.base, target, self.angle, setting.context
        )


@dataclass(frozen=True, kw_only=True)
class JointBounds(Goal):
    """An axis stays between bounds; with lower = upper it is fixed (SimRob's JointBounds, RevoluteJoint, Prismatic).

    Attributes:
        axis: its name.
        lower: [rad or m].
        upper: [rad or m].
        weight: None, or of the distance outside.
    """

    axis: str
    lower: float = -np.inf
    upper: float = np.inf

    @classmethod
    def fixed(cls, axis: str, value: float, weight: float | None = None) -> "JointBounds":
        """Return the goal that an axis stands at a value [rad or m]."""
        return cls(axis=axis, lower=value, upper=value, weight=weight)

    def constraint(self, setting: Setting) -> Constraint:
        """Return it as a constraint on the position of that axis alone."""
        place = setting.chain.in_plant
        sign = place.axes.signs[setting.chain.axis_index(self.axis)]
        lower, upper = _bounds(
            message("kinematics.bounds_of_joint", "JointBounds of {axis}", axis=self.axis),
            [self.lower],
            [self.upper],
            1,
        )
        ends = np.sort(np.concatenate([sign * lower, sign * upper]))
        return BoundingBoxConstraint(ends[:1], ends[1:])


@dataclass(frozen=True, kw_only=True)
class DistanceBounds(Goal):
    """The distance between two points stays between bounds (SimRob's DistanceBounds).

    Attributes:
        frames: of the two points: names of the URDF, ``"tool"`` or ``"base"``.
        lower: [m].
        upper: [m].
        points: in those frames [m].
        weight: None, or of the violation of the squared distance.
    """

    frames: tuple[str, str]
    lower: float = 0.0
    upper: float = np.inf
    points: tuple[Triple, Triple] = (ORIGIN, ORIGIN)

    def constraint(self, setting: Setting) -> Constraint:
        """Return it as a constraint on the positions of the whole plant."""
        lower, upper = _bounds("DistanceBounds", [self.lower], [self.upper], 1)
        if lower[0] < 0:
            raise InvalidParameter(
                message("kinematics.lower_of_distance", "lower of DistanceBounds"),
                self.lower,
                message("kinematics.zero_or_more_metres", "0 or more [m]"),
            )
        (one, at_one), (other, at_other) = (setting.frame(name) for name in self.frames)
        begin, end = (
            _triple(message("kinematics.points_of_distance", "points of DistanceBounds"), point)
            for point in self.points
        )
        return PointToPointDistanceConstraint(
            setting.chain.in_plant.plant,
            one,
            at_one @ begin,
            other,
            at_other @ end,
            lower[0],
            upper[0],
            setting.context,
        )


def point_in_box(
    setting: Setting, point: npt.ArrayLike, box: RigidTransform, lower: Vector, upper: Vector
) -> Constraint:
    """Return the constraint that a point of the tool [m] lies in a box whose axes have a pose in the base."""
    tool, tcp = setting.frame("tool")
    place = setting.chain.in_plant
    return PositionConstraint(
        place.plant, place.base, box, lower, upper, tool, tcp @ np.asarray(point, dtype=float), setting.context
    )


def _bounds(owner: str, lower: npt.ArrayLike, upper: npt.ArrayLike, size: int) -> tuple[Vector, Vector]:
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if low.shape != (size,) or high.shape != (size,) or np.isnan(low).any() or np.isnan(high).any():
        raise InvalidParameter(
            message("kinematics.bounds_of", "bounds of {owner}", owner=owner),
            (lower, upper),
            message("kinematics.numbers_each", "{size} numbers each", size=size),
        )
    if (low > high).any():
        raise InvalidParameter(
            message("kinematics.bounds_of", "bounds of {owner}", owner=owner),
            (lower, upper),
            message("kinematics.lower_then_upper", "lower first, then upper"),
        )
    return low, high


def _triple(name: str, values: npt.ArrayLike) -> Vector:
    triple = np.asarray(values, dtype=float)
    if triple.shape != (3,) or not np.isfinite(triple).all():
        raise InvalidParameter(name, values, message("kinematics.three_numbers_xyz", "three finite numbers x, y, z"))
    return triple


def _direction(name: str, values: npt.ArrayLike) -> Vector:
    direction = _triple(name, values)
    if not direction.any():
        raise InvalidParameter(name, values, message("kinematics.a_direction", "a direction, not zero"))
    unit: Vector = direction / np.linalg.norm(direction)
    return unit
