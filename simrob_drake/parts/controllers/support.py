"""Where a robot's centre of mass is, and how it moves, against the feet that carry it."""

import math
import weakref
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix
from pydrake.multibody.tree import RigidBody

from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot

_COUNTS = 0.003
"""By how much a point of the feet is higher than the lowest when it counts e times less [m]."""
_LOWEST = 0.01
"""The least height of the centre of mass that is reckoned with [m]: a robot that lies has fallen."""

Direction = Literal["sagittal", "lateral", "forward", "backward", "left", "right"]
_SENSES: dict[Direction, tuple[float, float, float]] = {
    "sagittal": (1, 0, -math.inf),
    "lateral": (0, 1, -math.inf),
    "forward": (1, 0, 0),
    "backward": (-1, 0, 0),
    "left": (0, 1, 0),
    "right": (0, -1, 0),
}
"""Of each direction: its parts ahead and to the left, and the least error that counts."""


@dataclass(frozen=True)
class Balanced:
    """How far a robot is from standing as at the start: ahead and to the left.

    Attributes:
        com: its centre of mass, from where its feet had it at the start, shape (2,) [m].
        speed: of that over the floor, shape (2,) [m/s].
        omega: how fast it would tip, sqrt(g/h) with the height h of the centre of mass [1/s].
        lifted: how high each foot is above the lowest, shape (feet,) [m].
    """

    com: Vector
    speed: Vector
    omega: float
    lifted: Vector

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
        """Return how the robot stands.

        Args:
            position: of the axes, shape (n,) [rad or m].
            velocity: likewise [rad/s or m/s].
            turned: orientation of its root link in the world.
            spin: angular velocity of that, in the world's axes, shape (3,) [rad/s].
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
            share = np.exp((floor - heights) / _COUNTS)
            part, arm = share.sum(), share @ arms
            carried += part
            place += part * own_place
            slip += part * motion.translational() + _cross(motion.rotational(), arm)
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


def _cross(one: Vector, other: Vector) -> Vector:
    """Return the vector product of two vectors (3,): NumPy's takes ten times as long."""
    (a, b, c), (x, y, z) = one, other
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def rotation_of(quaternion: Vector) -> RotationMatrix:
    """Return the rotation of a quaternion (4,) qw qx qy qz that may have any length."""
    return RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))
