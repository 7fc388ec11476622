"""Walking engine: computes the posture of a robot in every sample, from a command and an estimate of its motion.

The feet form two groups, 0 on the right and 1 on the left, of one foot or several each. The stance foot is the middle
of the group that stands, the swing foot that of the group that moves. Positions are measured from the stance foot: x
ahead, in the direction in which it looks, y to the left, z up. In the plane they are complex numbers x + iy, and a
slope is a complex number, too: rise for each metre ahead (real part) and to the left (imaginary part). In names, com is
the centre of mass and zmp the zero-moment point.

The planner moves the references of the trunk and of the feet, which a :class:`Stride` has; the inverse kinematics give
the posture with these references.
"""

import cmath
import math
from collections.abc import Sequence
from operator import mul
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.walking.body import Body, Rows, StanceFeet, height_on_slope
from simrob_drake.walking.estimator import Estimate, Estimator
from simrob_drake.walking.height_map import HeightMap
from simrob_drake.walking.parameters import WalkingParameters
from simrob_drake.walking.planner import WalkPlanner
from simrob_drake.walking.steps import Command, Landing
from simrob_drake.walking.stride import Ground, Step, Stride, Swing, Trunk

# Newton steps of the legs for the first posture, which may be far from the one that the search starts from.
_FIRST_ROUNDS = 10
# Repetitions for the first posture: the centre of mass moves with the legs, and the root moves with it.
_COM_ITERATIONS = 12

Position = tuple[float, float, float]
"""Position x y z [m]."""


class _GroupPose(NamedTuple):
    """Desired pose of a group of feet.

    Attributes:
        places: position of each foot from the stance foot, as complex numbers [m].
        offsets: position of each foot from the middle of its group, as complex numbers [m].
        rotation: rotation of the soles from those of a stance foot on level ground, shape (3, 3).
        height: height of the middle of the group above a slope through the stance foot [m].
        tilt: slope of the line between the feet, in addition to that of the ground [1].
    """

    places: Sequence[complex]
    offsets: Sequence[complex]
    rotation: Rows
    height: float
    tilt: complex


class WalkingEngine:
    """Computes a walk sample by sample. All of its state is in a :class:`Stride` and the last posture.

    Attributes:
        body: kinematics of the robot.
        stance: positions of the feet in the robot's stance.
        estimator: converts measurements to an estimate.
        planner: moves the references of the trunk and of the feet.
        max_speed: largest commands that the legs can follow.
    """

    def __init__(
        self,
        body: Body,
        parameters: WalkingParameters,
        groups: Sequence[Sequence[int]],
        period: float,
        height_map: HeightMap | None = None,
    ) -> None:
        """Create the engine of a robot.

        Args:
            body: kinematics of the robot.
            parameters: parameters of the walk.
            groups: indices of the feet that stand and swing together, the right ones first.
            period: sample time [s].
            height_map: heights of the ground, or None if only the feet can feel it.
        """
        self.body = body
        self.max_speed = parameters.max_speed
        self.stance = StanceFeet.of(body, parameters, groups)
        self.estimator = Estimator(body, self.stance, parameters.feedback)
        self.planner = WalkPlanner(parameters, self.stance, period, height_map)
        # Height [m] and pitch of the root while the robot walks.
        self._bearing = parameters.bearing

    def stand(self, posture: Vector, slope: complex = 0j) -> tuple[Stride, Vector]:
        """Compute the state and the posture of a robot that stands with its feet side by side.

        Args:
            posture: posture from which the inverse kinematics start, shape (n,) [rad].
            slope: slope of the ground, ahead and to the left [1].

        Returns:
            The state of the walk, and the posture, shape (n,) [rad].
        """
        steps = self.planner.steps
        # The left group of feet (1) stands, as in a Step by default, and the right one (0) is the swing foot beside it.
        right_foot = steps.standing_places[0]
        middle = steps.middle(1, right_foot)  # of both feet, over which the zero-moment point is
        stride = Stride(
            step=Step(zmp_from=middle),
            swing=Swing(place=right_foot),
            landing=Landing(time=0.0, place=right_foot),
            trunk=Trunk(com=middle, zmp=middle),
            ground=Ground(slope=slope),
        )
        # The legs' posture moves the centre of mass, by which the root is placed, which changes the posture again.
        for _ in range(_COM_ITERATIONS):
            self.body.set_posture(posture)
            posture = self._posture(stride, self.body.com_from_root(), 0.0, _FIRST_ROUNDS)
        return stride, posture

    def sample(
        self, stride: Stride, posture: Vector, command: Command, estimate: Estimate | None
    ) -> tuple[Stride, Vector]:
        """Advance the walk by one sample.

        Args:
            stride: state of the walk.
            posture: posture of the last sample, shape (n,) [rad].
            command: desired motion.
            estimate: what the sensors measure, or None to walk without feedback.

        Returns:
            The state for the next sample, and the posture of this one, shape (n,) [rad].
        """
        # The centre of mass and the Jacobians are those of the last posture: one Newton step follows the references.
        self.body.set_posture(posture)
        com_from_root = self.body.com_from_root()
        omega = self.stance.omega(self._bearing.height + com_from_root[2])
        now, lift, next_stride = self.planner.sample(stride, command, estimate, omega)
        return next_stride, self._posture(now, com_from_root, lift)

    def _posture(
        self, stride: Stride, com_from_root: Sequence[float], lift: float, rounds: int = 1
    ) -> Vector:
        """Compute the posture that has the references of a stride, from the posture that the body has set.

        Args:
            stride: references of the trunk and of the feet.
            com_from_root: centre of mass x y z from the root in that posture, in a root that is upright and looks along
                x [m].
            lift: height of the swing foot above the ground [m].
            rounds: count of Newton steps of the inverse kinematics.

        Returns:
            The posture, shape (n,) [rad].
        """
        bearing = self._bearing
        trunk = stride.trunk
        # A slow correction [rad]: of the lean to the right (real part) and of the pitch (imaginary part).
        correction = stride.corrections.lean_integral
        trunk_rotation = rotation_matrix(
            roll=trunk.lean + correction.real,
            pitch=math.radians(bearing.pitch_deg) + trunk.pitch + correction.imag,
            yaw=trunk.heading,
        )

        # The root is where the centre of mass is over its reference, at the height of the walk. The trunk's rotation
        # turns the vector from the root to the centre of mass.
        com_x = sum(map(mul, trunk_rotation[0], com_from_root))
        com_y = sum(map(mul, trunk_rotation[1], com_from_root))
        root = (
            trunk.com.real - com_x,
            trunk.com.imag - com_y,
            bearing.height + trunk.rise,
        )

        standing, swinging = self._group_poses(stride, lift)
        stance_feet = self._foot_poses(standing, stride.ground.slope, root)
        swing_feet = self._foot_poses(swinging, stride.ground.slope, root)
        # The body takes the right group of feet (0) first.
        right_stands = stride.step.sides[0] == 0
        feet = [*stance_feet, *swing_feet] if right_stands else [*swing_feet, *stance_feet]
        return self.body.solve_posture(trunk_rotation, np.array(feet), rounds)

    def _group_poses(self, stride: Stride, lift: float) -> tuple[_GroupPose, _GroupPose]:
        """Compute the desired poses of the stance group and of the swing group.

        Args:
            stride: references of the feet.
            lift: height of the swing foot above the ground [m].

        Returns:
            The pose of the stance group, then that of the swing group.
        """
        standing, swinging = stride.step.sides
        ground = stride.ground
        swing = stride.swing

        # Soles lie flat on the slope, and the swing sole is also turned by its yaw.
        on_slope = rotation_matrix(
            roll=math.atan(ground.slope.imag),
            pitch=-math.atan(ground.slope.real),
            yaw=0.0,
        )
        swing_rotation = on_slope
        if swing.yaw:  # most steps go straight ahead
            swing_rotation = (np.array(on_slope) @ rotation_matrix(0.0, 0.0, swing.yaw)).tolist()

        turn = cmath.exp(1j * swing.yaw)
        stance_offsets = self.stance.offsets[standing]
        swing_offsets = self.stance.offsets[swinging]
        stance_pose = _GroupPose(
            places=stance_offsets,
            offsets=stance_offsets,
            rotation=on_slope,
            height=0.0,
            tilt=ground.tilt,
        )
        swing_pose = _GroupPose(
            places=[swing.place + turn * offset for offset in swing_offsets],
            offsets=swing_offsets,
            rotation=swing_rotation,
            height=ground.height + lift,
            tilt=ground.foot_tilt,
        )
        return stance_pose, swing_pose

    def _foot_poses(self, group: _GroupPose, slope: complex, root: Position) -> list[Rows]:
        """Compute the desired poses of a group's soles: positions from the root, axes of the stance foot.

        Args:
            group: desired pose of the group.
            slope: slope of the ground, ahead and to the left [1].
            root: position of the root from the stance foot [m].

        Returns:
            One matrix of shape (3, 4) for each foot [1, m]: the rotation, and the position as last column.
        """
        row_x, row_y, row_z = group.rotation
        root_x, root_y, root_z = root
        # The pose of a foot that is a ball is that of its middle, a radius above the floor; the radius of soles is 0.
        height = group.height + self.body.ball_radius
        poses = list[Rows]()
        for place, offset in zip(group.places, group.offsets, strict=True):
            z = height + height_on_slope(slope, place) + height_on_slope(group.tilt, offset)
            pose = (
                (*row_x, place.real - root_x),
                (*row_y, place.imag - root_y),
                (*row_z, z - root_z),
            )
            poses.append(pose)
        return poses


def rotation_matrix(roll: float, pitch: float, yaw: float) -> Rows:
    """Compute the rotation matrix Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3), in plain numbers.

    Args:
        roll: angle about the x axis [rad], the first rotation.
        pitch: angle about the fixed y axis [rad].
        yaw: angle about the fixed z axis [rad], the last rotation.
    """
    # Plain numbers: NumPy and Drake take several times as long for one small matrix.
    cos_roll = math.cos(roll)
    sin_roll = math.sin(roll)
    cos_pitch = math.cos(pitch)
    sin_pitch = math.sin(pitch)
    cos_yaw = math.cos(yaw)
    sin_yaw = math.sin(yaw)
    return (
        (
            cos_yaw * cos_pitch,
            cos_yaw * sin_pitch * sin_roll - sin_yaw * cos_roll,
            cos_yaw * sin_pitch * cos_roll + sin_yaw * sin_roll,
        ),
        (
            sin_yaw * cos_pitch,
            sin_yaw * sin_pitch * sin_roll + cos_yaw * cos_roll,
            sin_yaw * sin_pitch * cos_roll - cos_yaw * sin_roll,
        ),
        (-sin_pitch, cos_pitch * sin_roll, cos_pitch * cos_roll),
    )


keep_former_attributes(WalkingEngine, standing="stand")
if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"turned": "rotation_matrix"})
