r"""The knee of a leg, by geometry: the joint that folds it most.

While one joint turns, the square of the distance from hip to foot is :math:`a + b \cos(q - q_0)`: three angles tell
all of it. The leg is straight where that of the nearest parallel joints above and below the knee is largest.
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

_LEAST = 0.05  # so that a leg never bends the other way [rad]
_ANGLES = np.array([-tau / 3, 0.0, tau / 3])
_PARALLEL = 0.9  # cosine


@dataclass(frozen=True)
class Knee:
    """The joint that folds a leg.

    Attributes:
        place: among the joints of the leg.
        straight: its angle where the leg is straight [rad].
        fold: by which part of the square of its length the leg gets shorter at most: 1 if thigh and shank are alike.
    """

    place: int
    straight: float
    fold: float

    def bent(self, angle: float) -> float:
        """Return how far it is bent at an angle, either way [rad]."""
        return remainder(angle - self.straight, tau)

    def kept_bent(self, angle: float, lower: float, upper: float) -> tuple[float, float]:
        """Return limits within others that keep it on the side of an angle [rad]."""
        bent = self.bent(angle)
        straight = angle - bent
        return (max(lower, straight + _LEAST), upper) if bent >= 0 else (lower, min(upper, straight - _LEAST))


def knee_of(plant: MultibodyPlant, context: Context, joints: Sequence[RevoluteJoint], foot: Frame, tip: Vector) -> Knee:
    """Return the knee of a leg.

    Args:
        plant: in which it is.
        context: with a posture near which it is looked.
        joints: of the leg, from the hip on.
        foot: the frame of its foot.
        tip: the point there with which it stands, shape (3,) [m].
    """

    def origin(joint: RevoluteJoint) -> Vector:
        return np.asarray(joint.frame_on_child().CalcPoseInWorld(context).translation())

    def end() -> Vector:
        return np.asarray(foot.CalcPoseInWorld(context) @ tip)

    folds = [_fold(context, joint, lambda: end() - origin(joints[0])) for joint in joints]
    place = int(np.argmax([fold for _, fold in folds]))
    turns = [joint.frame_on_child().CalcPoseInWorld(context).rotation() @ joint.revolute_axis() for joint in joints]
    parallel = [abs(turn @ turns[place]) > _PARALLEL for turn in turns]
    above = next((joints[other] for other in range(place - 1, -1, -1) if parallel[other]), joints[0])
    below = next((joints[other] for other in range(place + 1, len(joints)) if parallel[other]), None)
    straight, _ = _fold(context, joints[place], lambda: (origin(below) if below else end()) - origin(above))
    return Knee(place, straight, folds[place][1])


def _fold(context: Context, joint: RevoluteJoint, way: Callable[[], Vector]) -> tuple[float, float]:
    """Return at which angle of a joint a way is longest [rad], and by which part of its square it gets shorter."""
    before, squares = joint.get_angle(context), []
    for angle in _ANGLES:
        joint.set_angle(context, angle)
        squares.append(float(np.square(way()).sum()))
    joint.set_angle(context, before)
    swing = 2.0 / 3.0 * np.exp(1j * _ANGLES) @ squares
    return float(np.angle(swing)), float(2.0 * abs(swing) / (np.mean(squares) + abs(swing)))
