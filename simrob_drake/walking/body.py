"""A robot's kinematics for its walk: its centre of mass, its feet, and the legs that put them somewhere."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, ModelInstanceIndex

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.robots.feet import FootContact

_ROWS = {6: [0, 1, 2, 3, 4, 5], 4: [0, 1, 3, 5], 3: [3, 4, 5]}
"""Which of [roll, pitch, yaw, ahead, left, up] of its foot a leg of so many joints is asked for."""
_SKEW = [2, 0, 1], [1, 2, 0]  # entries of a small rotation that tell about what
_DAMPING = 1e-5  # of a leg that is nearly straight [m², rad²]
_LEAST_KNEE = 0.05  # so that a leg never bends the other way [rad]
_LARGEST = 0.3  # change of a joint in a sample [rad]


@dataclass(frozen=True)
class Seen:
    """What a robot does, in the world.

    Attributes:
        com, speed: its centre of mass and the velocity of that, shape (3,) [m, m/s].
        feet: poses of the soles' middles, turned from flat and ahead.
        trunk: how the root is turned from upright and ahead.
        lowest: height of each foot's lowest point, shape (feet,) [m].
    """

    com: Vector
    speed: Vector
    feet: Sequence[RigidTransform]
    trunk: RotationMatrix
    lowest: Vector


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
        knees: Sequence[int],
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
            knees: the axes that never get straight.
            feet: the frames of their links.
            contact: what touches the ground there.
            legs: the axes of each foot's leg.
            facing: where the robot looks while its root is not turned, from the world's x axis [rad].

        Raises:
            InvalidParameter: a leg that has neither three, four nor six joints.
        """
        for frame, leg in zip(feet, legs, strict=True):
            if len(leg) not in _ROWS or len(leg) != len(legs[0]):
                raise InvalidParameter(
                    f"leg of {frame.name()}", f"{len(leg)} joints", "three, four or six, all alike, to walk"
                )
        self._plant, self._instance, self._axes = weakref.proxy(plant), instance, axes
        self._root, self._feet = root.index(), [foot.index() for foot in feet]
        self._seen, self._asked = plant.CreateDefaultContext(), plant.CreateDefaultContext()  # set anew each time
        self._positions, self._velocities = plant.GetPositions(self._seen), np.zeros(plant.num_velocities())
        body = root.body()
        self._place, self._motion = body.floating_positions_start(), body.floating_velocities_start_in_v()
        self.facing = RotationMatrix.MakeZRotation(-facing)  # of a root that looks along x
        self._looks = self.facing.inverse()
        self._legs = np.array([list(leg) for leg in legs])
        self._which, self._diagonal = np.arange(len(legs))[:, np.newaxis], np.arange(self._legs.shape[1])
        self._columns, self._senses = axes.velocity_places[self._legs], axes.signs[self._legs][:, np.newaxis]
        rows = _ROWS[
            self._legs.shape[1]
        ]  # such legs keep their soles flat and the way ahead: as seen in that direction
        turn = np.kron(np.eye(2), self.facing.matrix())
        self._seen_ahead = None if len(rows) == 6 else turn[rows]
        self._lower, self._upper = limits[0].copy(), limits[1]
        self._lower[list(knees)] = np.maximum(self._lower[list(knees)], _LEAST_KNEE)
        self._soles(contact, [foot.name() for foot in feet])

    def _soles(self, contact: FootContact, links: Sequence[str]) -> None:
        """Find the middles of the soles, and which way they look, from the robot with all axes at zero."""
        plant, context = self._plant, self._asked
        plant.SetPositions(context, self._axes.spread_positions(0.0, plant.GetPositions(context)))
        root = plant.get_frame(self._root)
        self._tips, self._upright, points_of, self.homes, self.over = [], [], list[Vector](), list[Vector](), 0.0
        for link, index in zip(links, self._feet, strict=True):
            home = RigidTransform(self.facing) @ plant.get_frame(index).CalcPose(context, root)
            turn = home.rotation().matrix()
            points = contact.support_points(link) @ turn.T
            middle = (points.min(axis=0) + points.max(axis=0)) / 2
            under = points.min(axis=0)[2]
            round_ = contact.radius if link in contact.points and np.ptp(points[:, :2]) < 1e-9 else 0.0
            point = turn.T @ np.array([middle[0], middle[1], under + round_])
            self.over = round_  # of the point over the floor [m]: balls roll about their middles
            self._tips.append(point)
            self._upright.append(RigidTransform(RotationMatrix(turn.T), point))
            points_of.append(contact.support_points(link) + [0.0, 0.0, round_])
            self.homes.append(home.multiply(point))
        self._points = np.array(points_of)

    def seen(self, position: Vector, velocity: Vector, base: Vector, motion: Vector) -> Seen:
        """Return what the robot does.

        Args:
            position: of the axes, shape (n,) [rad].
            velocity: likewise [rad/s].
            base: pose of the root link, x y z qw qx qy qz.
            motion: its velocity, then its angular velocity, in the world, shape (6,) [m/s, rad/s].
        """
        plant, context, axes, free = self._plant, self._seen, self._axes, self._place
        self._positions[free : free + 4], self._positions[free + 4 : free + 7] = base[3:], base[:3]
        self._positions[axes.position_places] = axes.signs * position
        self._velocities[self._motion : self._motion + 3] = motion[3:]
        self._velocities[self._motion + 3 : self._motion + 6] = motion[:3]
        self._velocities[axes.velocity_places] = axes.signs * velocity
        plant.SetPositions(context, self._positions)
        plant.SetVelocities(context, self._velocities)
        links = [plant.get_frame(index).CalcPoseInWorld(context) for index in self._feet]
        poses = np.array([link.GetAsMatrix4()[2] for link in links])
        lowest = (self._points @ poses[:, :3, np.newaxis]).min(axis=(1, 2)) + poses[:, 3]
        return Seen(
            com=plant.CalcCenterOfMassPositionInWorld(context, [self._instance]),
            speed=plant.CalcCenterOfMassTranslationalVelocityInWorld(context, [self._instance]),
            feet=[link.multiply(upright) for link, upright in zip(links, self._upright, strict=True)],
            trunk=RotationMatrix(Quaternion(base[3:] / np.linalg.norm(base[3:]))).multiply(self._looks),
            lowest=lowest - self.over,
        )

    def centre(self, posture: Vector) -> Vector:
        """Return where the centre of mass is from the root in a posture (n,), upright and ahead, shape (3,) [m]."""
        plant, context = self._plant, self._asked
        self._put(posture)
        com = plant.CalcCenterOfMassPositionInWorld(context, [self._instance])
        root: RigidTransform = plant.get_frame(self._root).CalcPoseInWorld(context)
        return np.asarray(self.facing.multiply(root.inverse().multiply(com)))

    def posture(self, near: Vector, root: RigidTransform, feet: Sequence[RigidTransform], rounds: int = 1) -> Vector:
        """Return the posture (n,) in which the soles are where they shall be, by Newton's method from one near it.

        Args:
            near: where to begin; one round is enough for a reference that goes on from the last sample's [rad].
            root: pose of the root, turned from upright and ahead.
            feet: poses of the soles' middles.
            rounds: steps of the method.
        """
        plant, context, posture = self._plant, self._asked, near.copy()
        frame, links = plant.get_frame(self._root), [plant.get_frame(index) for index in self._feet]
        seen = root.multiply(RigidTransform(self.facing)).inverse()
        wanted = np.array([seen.multiply(foot).GetAsMatrix4() for foot in feet])
        rates, there = np.empty((len(links), 6, plant.num_velocities())), np.empty((len(links), 4, 4))
        for _ in range(rounds):
            self._put(posture)
            for number, link in enumerate(links):
                there[number] = link.CalcPose(context, frame).multiply(self._upright[number]).GetAsMatrix4()
                rates[number] = plant.CalcJacobianSpatialVelocity(
                    context, JacobianWrtVariable.kV, link, self._tips[number], frame, frame
                )
            posture[self._legs] += self._step(rates, there, wanted)
            posture = np.minimum(np.maximum(posture, self._lower), self._upper)
        return posture

    def _step(self, rates: Vector, there: Vector, wanted: Vector) -> Vector:
        """Return a damped step of the legs' joints (legs, k) from poses of the feet towards others, (legs, 4, 4) each.

        The Jacobians (legs, 6, nv) are in the root's axes, as the poses are.
        """
        turn = wanted[:, :3, :3] @ there[:, :3, :3].transpose(0, 2, 1)
        errors = np.empty((len(turn), 6, 1))
        errors[:, :3, 0] = 0.5 * (turn[:, _SKEW[0], _SKEW[1]] - turn[:, _SKEW[1], _SKEW[0]])
        errors[:, 3:, 0] = wanted[:, :3, 3] - there[:, :3, 3]
        own = rates[self._which, :, self._columns].transpose(0, 2, 1) * self._senses
        if self._seen_ahead is not None:
            own, errors = self._seen_ahead @ own, self._seen_ahead @ errors
        across = own.transpose(0, 2, 1)
        square = across @ own
        square[:, self._diagonal, self._diagonal] += _DAMPING
        step = np.linalg.solve(square, across @ errors)[..., 0]
        return np.minimum(np.maximum(step, -_LARGEST), _LARGEST)

    def _put(self, posture: Vector) -> None:
        positions = self._axes.spread_positions(posture, self._plant.GetPositions(self._asked))
        self._plant.SetPositions(self._asked, positions)
