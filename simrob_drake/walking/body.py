"""A robot's kinematics for its walk: where its centre of mass and its feet are, and the legs that put feet somewhere."""

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
            if len(leg) not in _ROWS:
                raise InvalidParameter(f"leg of {frame.name()}", f"{len(leg)} joints", "three, four or six, to walk")
        self._plant, self._instance, self._axes = weakref.proxy(plant), instance, axes
        self._root, self._feet = root.index(), [foot.index() for foot in feet]
        self._seen, self._asked = plant.CreateDefaultContext(), plant.CreateDefaultContext()  # set anew each time
        self._positions, self._velocities = plant.GetPositions(self._seen), np.zeros(plant.num_velocities())
        body = root.body()
        self._place, self._motion = body.floating_positions_start(), body.floating_velocities_start_in_v()
        self.facing = RotationMatrix.MakeZRotation(-facing)  # of a root that looks along x
        self.legs = [list(leg) for leg in legs]
        self._rows = [_ROWS[len(leg)] for leg in self.legs]
        self._columns = [axes.velocity_places[leg] for leg in self.legs]
        self._senses = [axes.signs[leg] for leg in self.legs]
        self.lower, self.upper = limits[0].copy(), limits[1]
        self.lower[list(knees)] = np.maximum(self.lower[list(knees)], _LEAST_KNEE)
        self._soles(contact, [foot.name() for foot in feet])

    def _soles(self, contact: FootContact, links: Sequence[str]) -> None:
        """Find the middles of the soles, and which way they look, from the robot with all axes at zero."""
        plant, context = self._plant, self._asked
        plant.SetPositions(context, self._axes.spread_positions(0.0, plant.GetPositions(context)))
        root = plant.get_frame(self._root)
        self._tips, self._upright, self._points, self.homes, self.over = [], [], [], [], 0.0
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
            self._points.append(contact.support_points(link))
            self.homes.append(home.multiply(point))

    def seen(self, position: Vector, velocity: Vector, base: Vector, motion: Vector) -> Seen:
        """Return what the robot does.

        Args:
            position, velocity: of the axes, shape (n,) [rad, rad/s].
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
        lowest = [
            (points @ link.rotation().matrix()[2]).min() + link.translation()[2]
            for link, points in zip(links, self._points, strict=True)
        ]
        return Seen(
            com=plant.CalcCenterOfMassPositionInWorld(context, [self._instance]),
            speed=plant.CalcCenterOfMassTranslationalVelocityInWorld(context, [self._instance]),
            feet=[link @ upright for link, upright in zip(links, self._upright, strict=True)],
            trunk=RotationMatrix(Quaternion(base[3:] / np.linalg.norm(base[3:]))) @ self.facing.inverse(),
            lowest=np.array(lowest),
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
        frame = plant.get_frame(self._root)
        seen = (root @ RigidTransform(self.facing)).inverse()
        wanted = [(seen @ foot).GetAsMatrix4() for foot in feet]
        for _ in range(rounds):
            self._put(posture)
            for number, leg in enumerate(self.legs):
                link = plant.get_frame(self._feet[number])
                pose = (link.CalcPose(context, frame) @ self._upright[number]).GetAsMatrix4()
                turn = wanted[number][:3, :3] @ pose[:3, :3].T
                error = np.array(
                    [
                        0.5 * (turn[2, 1] - turn[1, 2]),
                        0.5 * (turn[0, 2] - turn[2, 0]),
                        0.5 * (turn[1, 0] - turn[0, 1]),
                        *(wanted[number][:3, 3] - pose[:3, 3]),
                    ]
                )
                rates = plant.CalcJacobianSpatialVelocity(
                    context, JacobianWrtVariable.kV, link, self._tips[number], frame, frame
                )[:, self._columns[number]]
                posture[leg] += self._step(number, rates * self._senses[number], error)
            posture = np.minimum(np.maximum(posture, self.lower), self.upper)
        return posture

    def _step(self, number: int, rates: Vector, error: Vector) -> Vector:
        """Return a damped step of a leg's joints (k,) by its Jacobian (6, k) and the error (6,) in the root's axes."""
        rows = self._rows[number]
        if len(rows) == 4:  # such legs keep their soles flat and the way ahead: as seen in walking direction
            turn = self.facing.matrix()
            rates, error = np.vstack([turn @ rates[:3], turn @ rates[3:]]), np.r_[turn @ error[:3], turn @ error[3:]]
        if len(rows) < 6:
            rates, error = rates[rows], error[rows]
        square = rates.T @ rates
        square.flat[:: len(square) + 1] += _DAMPING
        return np.clip(np.linalg.solve(square, rates.T @ error), -_LARGEST, _LARGEST)

    def _put(self, posture: Vector) -> None:
        positions = self._axes.spread_positions(posture, self._plant.GetPositions(self._asked))
        self._plant.SetPositions(self._asked, positions)
