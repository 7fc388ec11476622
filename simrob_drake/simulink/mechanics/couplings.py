r"""Gears, rods and springs between bodies: what holds them beside joints, and how gears couple joints.

A gear lets two pitch points slip by nothing: :math:`t \cdot (v_B(P_B) - v_F(P_F)) = 0` along the teeth. That is linear
in the speeds of the joints, with factors that stay the same where the gears' axes stay apart as they are, so the sum of
positions times factors stays what it is, planetary gears included.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.frames import Vector
from simrob_drake.simulink.mechanics.bodies import GEARS, Coupling, RigidPart
from simrob_drake.simulink.mechanics.shapes import positive
from simrob_drake.simulink.model.nodes import Node

_TINY = 1e-9
_Z = np.array([0.0, 0.0, 1.0])

Poses = Mapping[RigidPart, RigidTransform]


@dataclass(frozen=True)
class Teeth:
    """Where two gears mesh."""

    base: Vector  # a point of the base, shape (3,) [m]
    follower: Vector  # a point of the follower, shape (3,) [m]
    along: Vector  # the direction in which these do not slip, shape (3,)
    screw: float = 0.0  # how far the follower moves along it as the base turns about it [m/rad]; 0 of what is no screw


def _unit(node: Node, vector: Vector, what: str) -> Vector:
    length = float(np.linalg.norm(vector))
    if length < _TINY:
        raise node.refusal(f"cannot tell where its teeth are: {what}")
    return np.asarray(vector / length)


def _toward(direction: Vector, target: Vector) -> Vector:
    return direction if direction @ target >= 0 else -direction


def _common(node: Node, base: RigidTransform, follower: RigidTransform) -> Teeth:
    inside = node.text("GearType", "External") == "Internal"
    if node.text("SpecificationType", "PitchCircleRadii") == "PitchCircleRadii":
        own, other = _radii(node, "BaseGearRadius", "FollGearRadius")
    else:
        ratio, (distance,) = node.number("GearRatio", "1"), positive(node, "CenterDistance", "20", 1)
        own = distance / (abs(ratio - 1) if inside else ratio + 1)
        other = ratio * own
    between = _unit(node, follower.translation() - base.translation(), "its frames are at one place")
    axis = base.rotation().matrix() @ _Z
    base_side, follower_side = (1.0, -1.0) if not inside else (1.0, 1.0) if own > other else (-1.0, -1.0)
    places = base.translation() + base_side * own * between, follower.translation() + follower_side * other * between
    return Teeth(places[0], places[1], np.cross(axis, between))


def _bevel(node: Node, base: RigidTransform, follower: RigidTransform) -> Teeth:
    axes = [frame.rotation().matrix() @ _Z for frame in (base, follower)]
    across = _unit(node, np.cross(*axes), "its axes are parallel")
    between = follower.translation() - base.translation()
    _unit(node, between, "its frames are at one place")
    radii = _radii(node, "BaseGearRadius", "FollGearRadius")
    places = [
        frame.translation() + radius * _toward(np.cross(across, axis), way)
        for frame, axis, radius, way in zip((base, follower), axes, radii, (between, -between), strict=True)
    ]
    return Teeth(places[0], places[1], across)


def _rack(node: Node, base: RigidTransform, follower: RigidTransform) -> Teeth:
    turning, along = (frame.rotation().matrix() @ _Z for frame in (base, follower))
    out = _unit(node, np.cross(turning, along), "the rack slides along the pinion's axis")
    (radius,) = positive(node, "PinionRadius", "10", 1)
    place = base.translation() + radius * _toward(out, follower.translation() - base.translation())
    return Teeth(place, place, along)


def _worm(node: Node, base: RigidTransform, follower: RigidTransform) -> Teeth:
    along, turning = (frame.rotation().matrix() @ _Z for frame in (base, follower))
    if node.text("SpecificationMethod", "PitchCircleRadii") != "PitchCircleRadii":
        raise node.refusal("is given by distance and ratio; only pitch radii are read")
    worm, gear = _radii(node, "WormRadius", "GearRadius")
    lead = worm * np.tan(node.number("WormLeadAngle", "4.2", unit="rad"))
    out = _unit(node, np.cross(along, turning), "the worm is along the gear's axis")
    place = follower.translation() + gear * _toward(out, base.translation() - follower.translation())
    hand = -1.0 if node.text("WormDirection", "RightHand") == "RightHand" else 1.0
    return Teeth(base.translation(), place, along, hand * lead)


def _radii(node: Node, *names: str) -> tuple[float, float]:
    one, other = (float(positive(node, name, "10", 1)[0]) for name in names)
    return one, other


_TEETH = dict(zip(GEARS, (_common, _bevel, _rack, _worm), strict=True))


def gear_row(coupling: Coupling, poses: Callable[[Vector], Poses], positions: Vector) -> Vector:
    """Return how fast the teeth of a gear slip for the speed of each joint, (n,), at positions (n,) of a tree.

    Args:
        coupling: the gear.
        poses: gives the pose of each body at positions.
        positions: of all joints [rad or m].

    Raises:
        InvalidModel: figures or frames that cannot be.
    """
    here = poses(positions)
    one, other = here[coupling.base], here[coupling.follower]
    teeth = _TEETH[coupling.node.kind](coupling.node, one @ coupling.in_base, other @ coupling.in_follower)
    row = np.zeros(positions.size)
    for place in range(positions.size):
        (slip, turn), step = (np.zeros(3), np.zeros(3)), 1e-6
        for sign in (1.0, -1.0):
            there = poses(positions + sign * step * np.eye(positions.size)[place])
            ways = [there[body] @ here[body].inverse() for body in (coupling.base, coupling.follower)]
            slip = slip + sign * (ways[0].multiply(teeth.base) - ways[1].multiply(teeth.follower))
            turn = turn + sign * _turned(ways[1].inverse() @ ways[0])
        row[place] = teeth.along @ (slip + teeth.screw * turn) / (2 * step)
    row[np.abs(row) < 1e-7 * np.abs(row).max(initial=0.0)] = 0.0
    return row


def _turned(pose: RigidTransform) -> Vector:
    """Return a small turn as a vector, shape (3,) [rad]."""
    matrix = pose.rotation().matrix()
    return np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]) / 2
