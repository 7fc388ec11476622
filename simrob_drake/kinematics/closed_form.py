"""The eight postures of a six-axis arm for a pose, in closed form, for many poses at once.

The wrist centre fixes axis 1, as its distance along axis 2 does not change with the parallel axes. With a spherical
wrist its distance from axis 2 fixes axes 2 and 3, and the orientation that is left axes 4 to 6. With a parallel one the
orientation fixes axes 5, 6 and the sum of the parallel angles, which leaves a triangle of axes 2, 3 and 4. Each of the
three steps has two answers: shoulder, elbow and wrist. (The subproblems of Paden and Kahan: Murray, Li & Sastry,
A Mathematical Introduction to Robotic Manipulation, 1994, §3.3.)
"""

from dataclasses import dataclass

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.kinematics.least_squares import Flags
from simrob_drake.kinematics.screws import skew
from simrob_drake.kinematics.six_axis_arm import Complex, SixAxisArm

BRANCHES = 8
SHOULDERS, ELBOWS, WRISTS = ("right", "left"), ("up", "down"), ("no_flip", "flip")
"""Branch 4·shoulder + 2·elbow + wrist takes each by its place here; see :class:`AnalyticSolver`."""

_SINGULAR = 1e-10  # m or rad within which an axis may stand anywhere: 1e4 times rounding, a tenth of what is promised


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """All postures for k poses."""

    # of axes 1 ... 6 from the base, shape (k, 8, 6), in no particular turn; where a pose is out of reach, the arm
    # stretched or folded towards it.
    postures: Vector
    short: Vector  # how far the wrist centre lies out of reach [m], shape (k, 8); 0 within
    singular: Flags  # where axis 1 or axis 4 may stand anywhere and was taken from the start, shape (k,)


def all_postures(arm: SixAxisArm, targets: Vector, starts: Vector) -> ClosedForm:
    """Return all postures that bring the tool to each target.

    Args:
        arm: the geometry.
        targets: shape (k, 4, 4).
        starts: of axes 1 ... 6, shape (k, 6); they give axis 1 and axis 4 where these may stand anywhere.
    """
    turns = targets[:, :3, :3] @ arm.home[:3, :3].T
    centres = targets[:, :3, 3] + turns @ (arm.centre - arm.home[:3, 3])
    first, side_short, any_first = _shoulder(arm, centres, starts[:, 0])
    back = arm.turn(0, -first, (centres - arm.shoulder)[:, np.newaxis]) + arm.shoulder - arm.upper_arm
    planar = (back @ arm.plane)[..., np.newaxis, np.newaxis]  # (k, shoulder, elbow, wrist) from here on
    third, fourth = arm.senses
    postures = np.empty((len(targets), 2, 2, 2, 6))
    postures[..., 0] = first[:, :, np.newaxis, np.newaxis]
    if arm.parallel:
        angle = _closing(arm, planar, starts[:, 1] + third * starts[:, 2] + fourth * starts[:, 3])
        wrist, any_wrist = _wrist(arm, turns, first, np.zeros((len(targets), 2, 1)), fourth * angle)
        total = fourth * wrist[..., 0]
        postures[..., 1], postures[..., 2], reach_short = _elbow(arm, planar - arm.hand * np.exp(1j * total))
        postures[..., 3] = fourth * (total - postures[..., 1] - third * postures[..., 2])
        postures[..., 4:] = wrist[..., 1:]
    else:
        postures[..., 1], postures[..., 2], reach_short = _elbow(arm, planar)
        bent = postures[..., 0, 1] + third * postures[..., 0, 2]
        postures[..., 3:], any_wrist = _wrist(arm, turns, first, bent, _column(starts[:, 3]))
    short = np.broadcast_to(np.hypot(_column(side_short), reach_short), postures.shape[:-1])
    singular = any_first | any_wrist.any(axis=(1, 2))
    return ClosedForm(postures.reshape(-1, BRANCHES, 6), short.reshape(-1, BRANCHES), singular)


def _shoulder(arm: SixAxisArm, centres: Vector, starts: Vector) -> tuple[Vector, Vector, Flags]:
    """Return axis 1 (k, 2) right and left, how far out of reach (k,), and where axis 1 may stand anywhere (k,).

    Turned back by axis 1, the wrist centre must lie as far along axis 2 as at zero: A cos q + B sin q = D.
    """
    one, two = arm.axes[:2]
    away = centres - arm.shoulder
    height = away @ one
    a = away @ two - height * (one @ two)
    b = -(away @ (arm.spins[0].T @ two))
    d = arm.side - height * (one @ two)
    radius = np.hypot(a, b)
    spread = np.arccos(np.clip(d / np.maximum(radius, _SINGULAR), -1.0, 1.0))
    ahead = np.arctan2(b, a)
    free = radius < _SINGULAR
    sign = _right(arm)
    first = np.stack([ahead + sign * spread, ahead - sign * spread], axis=1)
    first[free] = starts[free, np.newaxis]
    return first, np.maximum(np.abs(d) - radius, 0.0), free


def _right(arm: SixAxisArm) -> float:
    """Return the sign of the shoulder's answer in which the wrist is ahead and, if offset, the arm on the right."""
    ahead = np.cross(arm.axes[1], arm.axes[0])
    if abs(arm.side) > 1e-6:
        return -float(np.sign(arm.side))
    return -1.0 if ahead @ (arm.centre - arm.shoulder) < -1e-6 else 1.0


def _column(values: Vector) -> Vector:
    """Return values (k,) for all shoulders, elbows and wrists: (k, 1, 1, 1)."""
    return values[:, np.newaxis, np.newaxis, np.newaxis]


def _closing(arm: SixAxisArm, target: Complex, total: Vector) -> Vector:
    """Return the sum of the parallel angles nearest to a wanted one (k,) with which axes 2, 3 and 4 reach a target.

    Where axis 6 lies along axis 4 the sum may be any, but not for each do the three close the way (k, 2, 1, 1).
    """
    hand, away = max(abs(arm.hand), _SINGULAR), np.maximum(np.abs(target), _SINGULAR)
    angle = np.broadcast_to(_column(total), target.shape)
    distance = np.abs(target - arm.hand * np.exp(1j * angle))
    reach = np.clip(distance, abs(abs(arm.upper) - abs(arm.fore)), abs(arm.upper) + abs(arm.fore))
    ahead = np.angle(target * np.conj(arm.hand))
    swing = np.arccos(np.clip((away**2 + hand**2 - reach**2) / (2.0 * away * hand), -1.0, 1.0))
    return np.where(reach == distance, angle, ahead + np.copysign(swing, np.sin(angle - ahead)))


def _elbow(arm: SixAxisArm, target: Complex) -> tuple[Vector, Vector, Vector]:
    """Return axes 2 and 3, and how far out of reach, each (k, shoulder, 2, ...), for targets (k, shoulder, 1, ...).

    In the plane across axis 2: exp(i·q2)·(upper + fore·exp(i·q3)) = target.
    """
    upper, fore = abs(arm.upper), abs(arm.fore)
    distance = np.abs(target)
    cosine = (distance**2 - upper**2 - fore**2) / (2.0 * upper * fore)
    bend = np.arccos(np.clip(cosine, -1.0, 1.0))
    up = _right(arm) * np.array([[[1.0], [-1.0]], [[-1.0], [1.0]]])  # facing the other way, up is the other answer
    angle = up * bend - np.angle(arm.fore / arm.upper)
    reached = arm.upper + arm.fore * np.exp(1j * angle)
    second = np.angle(target * np.conj(reached))
    short = np.maximum(np.maximum(distance - (upper + fore), abs(upper - fore) - distance), 0.0)
    return second, angle * arm.senses[0], short


def _wrist(arm: SixAxisArm, turns: Vector, first: Vector, bent: Vector, starts: Vector) -> tuple[Vector, Flags]:
    """Return axes 4, 5, 6 (k, 2, e, 2, 3) and where axis 4 may stand anywhere (k, 2, e).

    Args:
        arm: the geometry.
        turns: of the tool from zero, shape (k, 3, 3).
        first: axis 1, shape (k, 2).
        bent: axes 2 and 3 together, about axis 2, shape (k, 2, e); 0 to have all parallel axes in axis 4.
        starts: axis 4 of the start, shape (k, 1 or 2, 1, 1).

    Axis 5 is an angle of the spherical triangle with sides (4, 5), (5, 6) and (4, turned 6), by the half-angle form,
    which loses no digits where axes 4 and 6 line up; axis 6 is what is left of the orientation.
    """
    four, five, six = arm.axes[3:]
    probe = np.cross(five, six)
    probe /= np.linalg.norm(probe)

    def forearm(vectors: Vector) -> Vector:
        """Turn vectors (k, 3) of the base back by axes 1, 2 and 3: (k, 2, e, 3)."""
        return arm.turn(1, -bent, arm.turn(0, -first, vectors[:, np.newaxis])[:, :, np.newaxis])

    sixth, probes = forearm(turns @ six), forearm(turns @ probe)
    across = np.linalg.norm(sixth @ arm.spins[3].T, axis=-1)
    opening = np.arctan2(across, sixth @ four)
    front, rear = _angle(four, five), _angle(five, six)
    away = np.sin((opening + front - rear) / 2) * np.sin((opening - front + rear) / 2)
    near = np.sin((front + rear + opening) / 2) * np.sin((front + rear - opening) / 2)
    bend = 2.0 * np.arctan2(np.sqrt(np.maximum(away, 0.0)), np.sqrt(np.maximum(near, 0.0)))[..., np.newaxis]
    zero = _about(five, np.cross(np.cross(five, four), five), np.cross(np.cross(five, six), five))
    fifth = np.concatenate([bend, -bend], axis=-1) - zero
    free = across < _SINGULAR
    tip = arm.turn(4, fifth, six)
    fourth = _about(four, tip, sixth[..., np.newaxis, :])
    fourth = np.where(free[..., np.newaxis], starts, fourth)
    left = arm.turn(4, -fifth, arm.turn(3, -fourth, probes[..., np.newaxis, :]))
    return np.stack([fourth, fifth, _about(six, probe, left)], axis=-1), free


def _angle(one: Vector, other: Vector) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


def _about(axis: Vector, begin: Vector, end: Vector) -> Vector:
    """Return the angle about an axis that leads from vectors (..., 3) to vectors (..., 3); they may lie near it."""
    spin = skew(axis).T
    begin, end = begin @ spin, end @ spin  # across the axis first: their own product would lose what is small
    angle: Vector = np.arctan2(np.vecdot(begin @ spin, end), np.vecdot(begin, end))
    return angle
