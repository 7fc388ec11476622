"""A robot's kinematics for its walk: its centre of mass, how its feet stand about each other, and its legs."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

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
from simrob_drake.robots.axis_map import AxisMap, in_a_row
from simrob_drake.robots.feet import FootContact
from simrob_drake.walking.knees import knee_of
from simrob_drake.walking.parameters import WalkingParameters

Rows = Sequence[Sequence[float]]
"""A matrix."""
_ROWS = {7: [[0, 1, 2, 3, 4, 5]], 6: [[0, 1, 2, 3, 4, 5]], 5: [[0, 1, 3, 4, 5], [1, 2, 3, 4, 5]]}
_ROWS |= {4: [[0, 1, 3, 5]], 3: [[3, 4, 5]]}
"""Which of [roll, pitch, yaw, ahead, left, up] of its foot a leg of so many joints is asked for; of several what it
can best."""
_ABOUT = np.zeros((9, 3))  # from the entries of a small rotation, a row after the other, to what it turns about
_ABOUT[[7, 2, 3], [0, 1, 2]], _ABOUT[[5, 6, 1], [0, 1, 2]] = 0.5, -0.5
_V = JacobianWrtVariable.kV
_DAMPING = 1e-5  # of a leg that is nearly straight [m², rad²]
_LARGEST = 0.3  # change of a joint in a sample [rad]


class Seen(NamedTuple):
    """What a robot does, in the world; matrices are rows of plain numbers, which are quicker than arrays.

    Attributes:
        com, speed: its centre of mass and the velocity of that, x y z [m, m/s].
        feet: poses of the soles' middles, turned from flat and ahead, shape (3, 4) each.
        trunk: how the root is turned from upright and ahead, shape (3, 3).
        lowest: height of each foot's lowest point [m].
    """

    com: Sequence[float]
    speed: Sequence[float]
    feet: Sequence[Rows]
    trunk: Rows
    lowest: Sequence[float]


class Body:
    """The kinematics of a robot on its feet."""

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
        """Prepare.

        Args:
            plant: finalized; it need not be part of a diagram.
            instance: the robot in it, on a free root.
            root: the frame of its root link.
            axes: of the robot.
            limits: of the axes, lower and upper, shape (n,) [rad].
            posture: near which legs are found, shape (n,) [rad]; knees stay on the side to which they bend there.
            stance: in which the soles are flat and stand as they shall side by side, shape (n,) [rad].
            feet: the frames of their links.
            contact: what touches the ground there.
            legs: the axes of each foot's leg.
            facing: where the robot looks while its root is not turned, from the world's x axis [rad].

        Raises:
            InvalidParameter: a leg that has fewer than three joints or more than seven, or not as many as the others.
        """
        for frame, leg in zip(feet, legs, strict=True):
            if len(leg) not in _ROWS or len(leg) != len(legs[0]):
                raise InvalidParameter(
                    message("walking.leg_of", "leg of {frame}", frame=frame.name()),
                    message("walking.count_of_joints", "{count} joints", count=len(leg)),
                    message("walking.three_to_seven", "three to seven, all alike, to walk"),
                )
        self._plant, self._instance, self._axes = weakref.proxy(plant), instance, axes
        self._root, self._feet = root.index(), [foot.index() for foot in feet]
        self._seen, self._goal = plant.CreateDefaultContext(), plant.CreateDefaultContext()  # set anew each time
        self._state, self._positions = plant.GetPositionsAndVelocities(self._seen), plant.GetPositions(self._goal)
        self.facing = RotationMatrix.MakeZRotation(-facing)  # of a root that looks along x
        self._ahead, self._behind = RigidTransform(self.facing), self.facing.inverse()
        self._from_com = self._ahead.multiply(root.CalcPoseInWorld(self._goal).inverse())
        self._places, self._signs = self._read(root.body())
        self._legs = np.array([list(leg) for leg in legs])
        joints = self._legs.shape[1]
        self._columns, self._senses = list(map(in_a_row, axes.velocity_places[self._legs])), axes.signs[self._legs]
        # legs of fewer joints keep their soles flat and the way ahead: as seen in that direction
        self._soles(contact, [foot.name() for foot in feet], stance)
        self.take(posture)
        self._rows = self._asked(np.kron(np.eye(2), self.facing.matrix()), joints)
        self._damping = _DAMPING * np.eye(joints)
        self._lower, self._upper = limits[0].copy(), limits[1].copy()
        self._bend_knees(legs, posture)
        self._facing = self.facing.matrix()  # arrays of what is multiplied in every sample
        self._middles = np.array([upright.GetAsMatrix4() for upright in self._upright])

    def _read(self, root: RigidBody) -> tuple[npt.NDArray[np.intp], Vector]:
        """Return where in the plant's state the values lie that are read, in their order, and their signs."""
        axes, ahead = self._axes, self._plant.num_positions()
        pose, motion = root.floating_positions_start(), ahead + root.floating_velocities_start_in_v()
        free = [*range(pose + 4, pose + 7), *range(pose, pose + 4), *range(motion + 3, motion + 6)]  # Drake turns first
        places = [axes.position_places, ahead + axes.velocity_places, free, range(motion, motion + 3)]
        return np.concatenate([*places]).astype(np.intp), np.concatenate([axes.signs, axes.signs, np.ones(13)])

    def _asked(self, turn: Vector, joints: int) -> Vector | None:
        """Return how [roll, pitch, yaw, ahead, left, up] of a foot become what its leg is asked for; None: as they are.

        ``turn`` (6, 6) lets them be seen the way the robot looks.
        """
        if joints >= len(turn):
            return None
        root, foot = self._plant.get_frame(self._root), self._plant.get_frame(self._feet[0])
        rates, choices = self._rates(0, foot, root), [turn[rows].T for rows in _ROWS[joints]]
        return max(choices, key=lambda rows: float(np.linalg.svd(rates @ rows, compute_uv=False)[-1]))

    def _bend_knees(self, legs: Sequence[Sequence[int]], posture: Vector) -> None:
        """Narrow the limits so that knees stay bent as they are in a posture (n,), which is the one taken."""
        plant, axes, lower, upper = self._plant, self._axes, self._lower, self._upper
        all_joints = map(plant.get_joint, plant.GetJointIndices(self._instance))
        joints = {joint.velocity_start(): joint for joint in all_joints if joint.num_velocities() == 1}
        for leg, foot, tip in zip(legs, self._feet, self._tips, strict=True):
            chain = [joints[place] for place in axes.velocity_places[list(leg)]]
            knee = knee_of(plant, self._goal, chain, plant.get_frame(foot), tip)
            axis = leg[knee.place]
            knee = replace(knee, straight=axes.signs[axis] * knee.straight)
            lower[axis], upper[axis] = knee.kept_bent(posture[axis], lower[axis], upper[axis])

    def _soles(self, contact: FootContact, links: Sequence[str], stance: Vector) -> None:
        """Find the middles of the soles, and which way they look, from the robot in a stance (n,)."""
        plant, context = self._plant, self._goal
        plant.SetPositions(context, self._axes.spread_positions(stance, plant.GetPositions(context)))
        root = plant.get_frame(self._root)
        self._tips, self._upright, self.homes, self.over = list[Vector](), list[RigidTransform](), list[Vector](), 0.0
        self._corners = list[list[list[float]]]()
        for link, index in zip(links, self._feet, strict=True):
            home = RigidTransform(self.facing) @ plant.get_frame(index).CalcPose(context, root)
            turn = home.rotation().matrix()
            points = contact.support_points(link) @ turn.T
            middle = (points.min(axis=0) + points.max(axis=0)) / 2
            under = points.min(axis=0)[2]
            round_ = contact.surface(link).radius if link in contact.points and np.ptp(points[:, :2]) < 1e-9 else 0.0
            point = turn.T @ np.array([middle[0], middle[1], under + round_])
            self.over = round_  # of the point over the floor [m]: balls roll about their middles
            upright = RigidTransform(RotationMatrix(turn.T), point)
            self._tips.append(point)
            self._upright.append(upright)
            corners = np.add(contact.support_points(link), (0.0, 0.0, round_))
            self._corners.append(upright.inverse().multiply(corners.T).T.tolist())
            self.homes.append(home.multiply(point))
        self.sole = max(abs(part) for corners in self._corners for corner in corners for part in corner[:2])

    def seen(self, read: Vector) -> Seen:
        """Return what the robot does.

        Args:
            read: one after another, shape (2n + 13,): position (n) and velocity (n) of the axes [rad, rad/s]; pose (7)
                of the root link, x y z [m] qw qx qy qz; its velocity, linear and angular, in the world [m/s, rad/s].
        """
        plant, context, state = self._plant, self._seen, self._state
        state[self._places] = self._signs * read
        plant.SetPositionsAndVelocities(context, state)
        links = zip(self._feet, self._upright, strict=True)
        poses = [plant.get_frame(index).CalcPoseInWorld(context).multiply(upright) for index, upright in links]
        feet: list[Rows] = [pose.GetAsMatrix34().tolist() for pose in poses]
        trunk = plant.get_frame(self._root).CalcPoseInWorld(context).rotation().multiply(self._behind)
        return Seen(
            com=plant.CalcCenterOfMassPositionInWorld(context, [self._instance]).tolist(),
            speed=plant.CalcCenterOfMassTranslationalVelocityInWorld(context, [self._instance]).tolist(),
            feet=feet,
            trunk=trunk.matrix().tolist(),
            lowest=[_lowest(foot[2], corners) - self.over for foot, corners in zip(feet, self._corners, strict=True)],
        )

    def take(self, posture: Vector) -> None:
        """Take a posture (n,), upright and ahead: that which :meth:`centre` and :meth:`reached` are about."""
        self._posture = posture
        self._positions[self._axes.position_places] = self._axes.signs * posture
        self._plant.SetPositions(self._goal, self._positions)

    def centre(self) -> list[float]:
        """Return where the centre of mass is from the root, x y z [m]."""
        com = self._plant.CalcCenterOfMassPositionInWorld(self._goal, [self._instance])
        found: list[float] = self._from_com.multiply(com).tolist()
        return found

    def reached(self, turn: Rows, feet: Vector, rounds: int = 1) -> Vector:
        """Return the posture (n,) in which the soles are where they shall be, by Newton's method from the one taken.

        Args:
            turn: how the root is turned from upright and ahead, shape (3, 3).
            feet: poses of the soles' middles from the root, in the world's axes, shape (feet, 3, 4) [1, m].
            rounds: steps of the method; one is enough for a reference that goes on from the last sample's.
        """
        plant, context, posture = self._plant, self._goal, self._posture
        frame, links = plant.get_frame(self._root), [plant.get_frame(index) for index in self._feet]
        target = (np.array(turn) @ self._facing).T @ feet  # as seen from the root
        rates, poses = np.empty((*self._legs.shape, 6)), np.empty((len(links), 3, 4))
        for done in range(rounds):
            if done:
                self.take(posture)
            for number, link in enumerate(links):
                poses[number] = link.CalcPose(context, frame).GetAsMatrix34()
                rates[number] = self._rates(number, link, frame)
            posture = posture.copy()
            posture[self._legs] += self._step(rates, poses @ self._middles, target)
            posture = np.minimum(np.maximum(posture, self._lower), self._upper)
        return posture

    def _rates(self, foot: int, link: Frame, root: Frame) -> Vector:
        """Return the transposed Jacobian (k, 6) of the middle of a sole by its leg, in the root's axes, as taken."""
        of_plant = self._plant.CalcJacobianSpatialVelocity(self._goal, _V, link, self._tips[foot], root, root)
        return np.asarray(of_plant[:, self._columns[foot]].T)

    def _step(self, own: Vector, there: Vector, target: Vector) -> Vector:
        """Return a damped step of the legs' joints (legs, k) from poses of the feet towards others, (legs, 3, 4) each.

        The transposed Jacobians (legs, k, 6) are in the root's axes, as the poses are.
        """
        turn = target[:, :, :3] @ there[:, :, :3].transpose(0, 2, 1)
        errors = np.concatenate([turn.reshape(-1, 9) @ _ABOUT, target[:, :, 3] - there[:, :, 3]], axis=1)
        if self._rows is not None:
            own, errors = own @ self._rows, errors @ self._rows
        squares, sides = own @ own.transpose(0, 2, 1) + self._damping, (own @ errors[..., np.newaxis])[..., 0]
        # NumPy's own way there takes four times as long
        step = np.array([dgesv(square, side)[2] for square, side in zip(squares, sides, strict=True)]) * self._senses
        return np.asarray(np.minimum(np.maximum(step, -_LARGEST), _LARGEST))


def _lowest(upward: Sequence[float], corners: Rows) -> float:
    """Return how high the lowest of some points of a foot is [m], by the last row of its pose."""
    a, b, c, over = upward
    return over + min([a * x + b * y + c * z for x, y, z in corners])


@dataclass(frozen=True)
class StanceFeet:
    """The feet of a robot in two groups that stand and swing in turn, 0 the right one, 1 the left one.

    Attributes:
        groups: the feet of each group, by their places.
        about: where they stand about the middle of their group [m].
        planes: what each counts for the slope of its group [1/m].
        half: how far the middles of the groups are to the side of the robot's [m].
        rolls: how much further than its legs go a robot gets because its feet roll meanwhile.
    """

    groups: Sequence[Sequence[int]]
    about: Sequence[Sequence[complex]]
    planes: Sequence[Sequence[complex]]
    half: float
    rolls: float

    @classmethod
    def of(cls, body: Body, parameters: WalkingParameters, groups: Sequence[Sequence[int]]) -> StanceFeet:
        """Return the stance of a robot; ``groups`` are its feet that stand together, the right ones first."""
        homes = [complex(*home[:2]) + 1j * math.copysign(parameters.widen, home[1]) for home in body.homes]
        middles = [sum(homes[foot] for foot in group) / len(group) for group in groups]
        about = [[homes[foot] - middle for foot in group] for group, middle in zip(groups, middles, strict=True)]
        rolls = 1.0 + body.over / (parameters.bearing.height - body.over)
        return cls(groups, about, [planes(each) for each in about], 0.5 * (middles[1] - middles[0]).imag, rolls)

    def omega(self, height: float) -> float:
        """Return that of the pendulum [1/s]: its point comes after it where feet are balls, and it falls slower."""
        return math.sqrt(STANDARD_GRAVITY / (height * self.rolls))


def uphill(slope: complex, place: complex) -> float:
    """Return how much higher a place is on a slope than its origin [m]."""
    return (slope.conjugate() * place).real


def planes(places: Sequence[complex]) -> list[complex]:
    """Return what each of some places counts for the slope of the plane, or the line, through them [1/m]."""
    ahead, left = np.linalg.pinv([(place.real, place.imag) for place in places]).tolist()
    return [complex(*parts) for parts in zip(ahead, left, strict=True)]


def sloped(plane: Sequence[complex], ways: Sequence[float]) -> complex:
    """Return the slope of a plane or line through feet that are raised by so much [m]."""
    return sum((part * way for part, way in zip(plane, ways, strict=True)), 0j)
