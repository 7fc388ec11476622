r"""Find the knee of a leg by its geometry: the joint that folds the leg most.

While one joint turns by the angle q, the square of the distance from hip to foot is :math:`a + b \cos(q - q_0)`. Three
angles determine the three constants. The leg is straight at the angle :math:`q_0` at which the distance between the
nearest parallel joints above and below the knee is largest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import remainder, tau

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, RevoluteJoint
from pydrake.systems.framework import Context

from simrob_drake.base.frames import Vector
from simrob_drake.base.renaming import keep_former_attributes

# Least bend of a knee, so that a leg never bends to the other side [rad].
_LEAST_BEND = 0.05
# Three equally spaced angles, at which a cosine is measured [rad].
_ANGLES = np.array([-tau / 3, 0.0, tau / 3])
# Two axes are parallel if the cosine of the angle between them is larger [1].
_PARALLEL = 0.9


@dataclass(frozen=True)
class Knee:
    """The joint that folds a leg.

    Attributes:
        place: index of the joint in the leg.
        straight: angle of the joint at which the leg is straight [rad].
        fold: largest part by which the joint shortens the square of the leg's length [1]. It is 1 if thigh and shank
            have the same length.
    """

    place: int
    straight: float
    fold: float

    def bend_at(self, angle: float) -> float:
        """Signed bend of the knee at an angle of its joint, from -pi to pi [rad]. It is 0 if the leg is straight."""
        return remainder(angle - self.straight, tau)

    def limits_on_side_of(self, angle: float, lower: float, upper: float) -> tuple[float, float]:
        """Narrow the limits of the joint, so that the knee stays bent to the same side.

        Args:
            angle: angle of the joint in a posture with the knee bent to the desired side [rad].
            lower: lower limit of the joint [rad].
            upper: upper limit of the joint [rad].

        Returns:
            The lower and the upper limit [rad].
        """
        bend = self.bend_at(angle)
        # The angle of the straight leg that is nearest to the posture: `self.straight`, or whole turns away from it.
        straight = angle - bend
        if bend >= 0:
            return max(lower, straight + _LEAST_BEND), upper
        return lower, min(upper, straight - _LEAST_BEND)


def knee_of(
    plant: MultibodyPlant,
    context: Context,
    joints: Sequence[RevoluteJoint],
    foot: Frame,
    tip: Vector,
) -> Knee:
    """Find the knee of a leg.

    Args:
        plant: plant of the robot.
        context: context of the plant with a posture near which the leg is examined. It is the same afterwards.
        joints: joints of the leg, from the hip to the foot.
        foot: frame of the leg's foot.
        tip: point of the foot that stands on the ground, in the frame of the foot, shape (3,) [m].

    Returns:
        The knee. Its `fold` is measured from the hip to the tip of the foot, its `straight` between the nearest joints
        above and below it that are parallel to it, or from the hip, or to the tip, if there is no such joint.
    """

    def origin(joint: RevoluteJoint) -> Vector:
        """Position of a joint in the world [m]."""
        return np.asarray(joint.frame_on_child().CalcPoseInWorld(context).translation())

    def end() -> Vector:
        """Position of the tip of the foot in the world [m]."""
        return np.asarray(foot.CalcPoseInWorld(context) @ tip)

    def direction(joint: RevoluteJoint) -> Vector:
        """Direction of a joint's axis in the world, of length one."""
        return np.asarray(
            joint.frame_on_child().CalcPoseInWorld(context).rotation() @ joint.revolute_axis()
        )

    def from_hip_to_tip() -> Vector:
        """Vector from the first joint to the tip of the foot in the world [m]."""
        return end() - origin(joints[0])

    # The knee is the joint that changes the distance from the hip to the foot most.
    folds = [_find_fold(context, joint, from_hip_to_tip) for joint in joints]
    knee = int(np.argmax([fold for _, fold in folds]))

    # Thigh and shank are measured between parallel axes: joints across the knee do not fold the leg.
    directions = [direction(joint) for joint in joints]
    # Without a parallel joint, the thigh begins at the hip, and the shank ends at the tip of the foot.
    is_parallel = [abs(each @ directions[knee]) > _PARALLEL for each in directions]
    above = next(
        (joints[other] for other in range(knee - 1, -1, -1) if is_parallel[other]), joints[0]
    )
    below = next(
        (joints[other] for other in range(knee + 1, len(joints)) if is_parallel[other]), None
    )

    def from_above_to_below() -> Vector:
        """Vector in the world from the parallel joint above the knee to that below, or to the tip of the foot [m]."""
        lower_end = origin(below) if below else end()
        return lower_end - origin(above)

    straight, _ = _find_fold(context, joints[knee], from_above_to_below)
    return Knee(knee, straight, folds[knee][1])


def _find_fold(
    context: Context, joint: RevoluteJoint, vector: Callable[[], Vector]
) -> tuple[float, float]:
    """Measure how a joint folds a leg.

    Args:
        context: context of the plant. It is the same afterwards.
        joint: the joint that is turned.
        vector: function that gives the vector between the ends of the leg in the present posture, shape (3,) [m].

    Returns:
        The angle at which the vector is longest [rad], and the largest part by which its square gets shorter [1].
    """
    before = joint.get_angle(context)
    squares: list[float] = []
    for angle in _ANGLES:
        joint.set_angle(context, angle)
        squares.append(float(np.square(vector()).sum()))
    joint.set_angle(context, before)  # the caller's context is the same afterwards

    # The square of the length is a + b cos(q - q0). The first Fourier coefficient of this function is b exp(i q0), and
    # its mean is a. The square varies between a - b and a + b, so the part is 2 b / (a + b).
    coefficient = 2.0 / 3.0 * np.exp(1j * _ANGLES) @ squares
    longest_at = float(np.angle(coefficient))
    largest = np.mean(squares) + abs(coefficient)
    return longest_at, float(2.0 * abs(coefficient) / largest)


keep_former_attributes(Knee, bent="bend_at", kept_bent="limits_on_side_of")
