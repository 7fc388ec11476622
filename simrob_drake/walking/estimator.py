"""Estimator of a walk: converts the measured motion of a robot to the quantities that the planner feeds back.

The feet form two groups that stand and swing in turn: 0 on the right, 1 on the left. The stance foot is the middle of
the group that stands; a pair is a group of two feet. Feet have flat soles, or are balls that roll. Poses of soles are
matrices of shape (3, 4), given as three rows: rotation and position. The divergent component of motion is c + v / omega
for the centre of mass c, its velocity v and the natural frequency omega of a pendulum of its height. In names, com is
the centre of mass and xi the divergent component. The state of the walk, a :class:`Stride`, has the slope of the ground
as far as it is known and, for a pair of stance feet, the tilt of the line between them in addition to it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.walking.body import (
    Body,
    BodyState,
    Rows,
    StanceFeet,
    height_on_slope,
    slope_through,
)
from simrob_drake.walking.parameters import Feedback
from simrob_drake.walking.stride import Ground, Step, Stride

# Estimates of the slope before the first step. Two groups of ball feet alternate, each corrects the slope along the
# line of its feet; eight rounds leave no difference.
_SLOPE_ROUNDS = 8
# Without force sensors, swing feet touch if the lowest one is less than this above the mean height of the stance feet,
# both measured at their lowest points and without the slope [m].
_TOUCH_DISTANCE = 0.001
# Least height of the centre of mass above the feet, for a robot that has fallen [m].
_LEAST_HEIGHT = 0.05
# Least vertical component of the soles' normals, of a robot whose feet stand on edge [1].
_LEAST_UPRIGHT = 0.5


class Estimate(NamedTuple):
    """Motion of a robot as measured. Positions are complex numbers [m] from the stance foot, ahead and to the left.

    Attributes:
        com: position of the centre of mass [m].
        xi: divergent component of motion [m].
        lean: lean of the trunk to the right [rad].
        pitch: lean of the trunk ahead [rad].
        heading: heading of the trunk in the world [rad].
        slope: slope of the ground under the stance foot, ahead and to the left [1].
        touches: whether the swing foot touches the ground. Of a swing pair, both feet must feel the ground if forces
            decide; otherwise the height of the lower one decides.
        down: whether each swing foot feels the ground. Empty if heights decide instead of forces.
        hangs: whether each stance foot does not feel the ground. Empty if heights decide instead of forces.
        origin: position of the stance foot in the world [m].
        turn: factor that converts a vector in the world to one from the stance foot, a complex number of length one.
    """

    com: complex
    xi: complex
    lean: float
    pitch: float
    heading: float
    slope: complex
    touches: bool
    down: tuple[bool, ...] = ()
    hangs: tuple[bool, ...] = ()
    origin: complex = 0j
    turn: complex = 1 + 0j

    def in_world(self, place: complex) -> complex:
        """Convert a position from the stance foot [m] to one in the world [m]."""
        return self.origin + place * self.turn.conjugate()


class _Contacts(NamedTuple):
    """Contacts of the feet, with the meaning of the fields of :class:`Estimate`."""

    touches: bool
    down: tuple[bool, ...] = ()
    hangs: tuple[bool, ...] = ()


class Estimator:
    """Estimates the motion of a robot as seen from its stance foot. It has no state of its own."""

    def __init__(self, body: Body, stance: StanceFeet, feedback: Feedback | None) -> None:
        """Create the estimator of a robot.

        Args:
            body: kinematics of the robot.
            stance: positions of the feet in the robot's stance.
            feedback: parameters of the feedback, or None for a walk without feedback.
        """
        self._body = body
        self._stance = stance
        self._feedback = feedback

    def estimate(
        self, stride: Stride, state: BodyState, forces: Sequence[float] | None = None
    ) -> Estimate:
        """Estimate the motion of the robot from its stance foot.

        Args:
            stride: state of the walk.
            state: measured motion of the robot in the world.
            forces: vertical force on each foot [N], or None if the forces are not measured. The force of a foot that
                :meth:`feet_to_measure` leaves out may have any value: what it says about contact is not used then.
        """
        standing, _ = stride.step.sides  # indices of the stance group and of the swing group
        stance_feet = [state.feet[foot] for foot in self._stance.groups[standing]]

        # The stance frame: its origin in the middle of the feet, its x axis ahead.
        points = [_position(pose) for pose in stance_feet]
        origin = sum(points) / len(points)
        ahead = self._direction_ahead(standing, stance_feet, points, origin)
        turn = ahead.conjugate() / abs(ahead)

        x, y, z = state.com
        com = turn * (complex(x, y) - origin)
        velocity_x, velocity_y, _ = state.speed
        # Balls roll while they stand: the robot moves by this factor more than a pendulum on a fixed foot.
        velocity = turn * complex(velocity_x, velocity_y) / self._stance.roll_factor
        omega = self._stance.omega(max(z - min(state.lowest), _LEAST_HEIGHT))

        # Rows of the rotation matrix of the trunk: the last one has the heights of its x, y and z axes. For small
        # leans, a sine is taken for its angle.
        row_x, row_y, row_z = state.trunk
        contacts = self._find_contacts(stride, state, forces, origin, turn)
        return Estimate(
            com=com,
            xi=com + velocity / omega,
            lean=row_z[1],
            pitch=-row_z[0],
            heading=math.atan2(row_y[0], row_x[0]),
            slope=self._slope_under_soles(stride, stance_feet, turn),
            touches=contacts.touches,
            down=contacts.down,
            hangs=contacts.hangs,
            origin=origin,
            turn=turn,
        )

    def _direction_ahead(
        self, standing: int, poses: Sequence[Rows], points: Sequence[complex], origin: complex
    ) -> complex:
        """Compute the direction in which a stance group looks in the world, as a complex number of any length.

        Args:
            standing: index of the stance group.
            poses: poses of its feet in the world, shape (3, 4) each.
            points: positions of its feet in the world [m].
            origin: middle of these positions [m].
        """
        if len(poses) == 1:
            # The x axis of the only sole.
            return sum(complex(x_row[0], y_row[0]) for x_row, y_row, _ in poses)
        # The feet of a pair may be balls, which turn with their legs. The line between them does not. Each product has
        # the angle by which the pair is turned from its offsets in the stance.
        offsets = zip(points, self._stance.offsets[standing], strict=True)
        return sum((point - origin) * offset.conjugate() for point, offset in offsets)

    def _find_contacts(
        self,
        stride: Stride,
        state: BodyState,
        forces: Sequence[float] | None,
        origin: complex,
        turn: complex,
    ) -> _Contacts:
        """Find which feet touch the ground, by their forces or by their heights.

        Forces decide if they are measured and the feedback has a `touch_force`; they show the contact of each foot.
        Otherwise heights decide, which only show whether the lowest swing foot touches.

        Args:
            stride: state of the walk.
            state: measured motion of the robot in the world.
            forces: vertical force on each foot [N], or None.
            origin: position of the stance foot in the world [m].
            turn: factor that converts a vector in the world to one from the stance foot.
        """
        standing, swinging = stride.step.sides
        stance_feet = self._stance.groups[standing]
        swing_feet = self._stance.groups[swinging]
        feedback = self._feedback
        if forces is not None and feedback is not None and feedback.touch_force is not None:
            # A pair has landed when both of its feet carry weight.
            down = tuple(forces[foot] > feedback.touch_force for foot in swing_feet)
            hangs = tuple(forces[foot] < feedback.touch_force for foot in stance_feet)
            return _Contacts(touches=all(down), down=down, hangs=hangs)

        # Heights are compared at the stance foot: what the slope adds at the swing foot is taken away.
        stance_height = sum(state.lowest[foot] for foot in stance_feet) / len(stance_feet)
        swing_heights = []
        for foot in swing_feet:
            place = turn * (_position(state.feet[foot]) - origin)
            swing_heights.append(state.lowest[foot] - height_on_slope(stride.ground.slope, place))
        return _Contacts(touches=min(swing_heights) < stance_height + _TOUCH_DISTANCE)

    def _slope_under_soles(self, stride: Stride, poses: Sequence[Rows], turn: complex) -> complex:
        """Estimate the slope of the ground under the stance feet, ahead and to the left [1].

        Soles show the slope by their own tilt. Balls only show it along the line between them, by their heights.

        Args:
            stride: state of the walk, with the slope that is known so far.
            poses: poses of the stance feet in the world, shape (3, 4) each.
            turn: factor that converts a vector in the world to one from the stance foot.
        """
        if not self._body.ball_radius:
            # The soles' normals n are the third columns of their rotations. The slope of a plane is -n_xy / n_z.
            normals = sum(complex(x_row[2], y_row[2]) for x_row, y_row, _ in poses)
            upright = sum(z_row[2] for _, _, z_row in poses)
            return -turn * normals / max(upright, _LEAST_UPRIGHT)

        # Two heights determine the slope along the line between the feet. Across it, the known slope stays.
        standing = stride.step.sides[0]
        known_slope = stride.ground.slope + stride.ground.tilt
        # Heights beyond those of the known slope. What all of them have in common has no effect, as the weights of a
        # group of feet sum to zero.
        deviations = []
        for offset, (_, _, z_row) in zip(self._stance.offsets[standing], poses, strict=True):
            deviations.append(z_row[3] - height_on_slope(known_slope, offset))
        return known_slope + slope_through(self._stance.slope_weights[standing], deviations)

    def slope(self, state: BodyState) -> complex:
        """Estimate the slope of the ground under the feet of a robot that stands, ahead and to the left [1].

        The groups of feet are taken in turn, each beginning with the slope that was found before: two balls only show
        the slope along the line between them. Soles show all of it, so that the result is that of the last group.

        Args:
            state: measured motion of the robot in the world, with both groups of feet on the ground.
        """
        slope = 0j
        for number in range(_SLOPE_ROUNDS):
            # Right and left in turn. Of the stride, the estimate of the slope reads only this and the slope.
            step = Step(standing=float(number % 2))
            slope = self.estimate(Stride(step, ground=Ground(slope=slope)), state).slope
        return slope

    def feet_to_measure(self, stride: Stride) -> Sequence[int]:
        """Find the indices of the feet whose forces count in a sample. The others are not read, as that takes time.

        These are the swing feet while they may touch the ground, and the stance feet if the feedback lowers late feet
        (`late_touchdown` is not 0). There are none without feedback.

        Args:
            stride: state of the walk.
        """
        feedback = self._feedback
        if feedback is None:
            return ()
        standing, swinging = stride.step.sides
        # Early in a swing, a foot may still touch the ground that it leaves.
        feet: list[int] = []
        if stride.swing.share > feedback.early_touchdown:
            feet.extend(self._stance.groups[swinging])
        if feedback.late_touchdown:
            feet.extend(self._stance.groups[standing])
        return feet


def _position(pose: Rows) -> complex:
    """Position of a pose of shape (3, 4) in the plane, as a complex number [m]."""
    return complex(pose[0][3], pose[1][3])


keep_former_attributes(Estimator, felt="feet_to_measure")
