"""Six-axis arms with a spherical wrist, or three parallel axes as cobots have: their postures for a pose, closed form.

The wrist centre fixes axis 1, as its distance along axis 2 does not change with the parallel axes. With a spherical
wrist its distance from axis 2 fixes axes 2 and 3, and the orientation that is left axes 4 to 6. With a parallel one the
orientation fixes axes 5, 6 and the sum of the parallel angles, which leaves a triangle of axes 2, 3 and 4. Each of the
three steps has two answers: shoulder, elbow and wrist. (The subproblems of Paden and Kahan: Murray, Li & Sastry,
A Mathematical Introduction to Robotic Manipulation, 1994, §3.3.)
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.kinematics.chain import Chain, skew
from simrob_drake.kinematics.numeric import Flags

_LENGTH = 1e-4  # m that axes may miss each other by: published figures are rounded, and the solver polishes
_ANGLE = 1e-4  # rad that parallel axes may differ by, likewise: rpy="0 1.5708 0" is off by 4e-6
_ALONG = 1e-3  # sine below which two axes count as one direction

Complex = np.ndarray[Any, np.dtype[np.complex128]]


class NoClosedForm(SimrobError):
    """A robot whose geometry the analytic solver does not cover."""

    def __init__(self, problem: str) -> None:
        """Say what the geometry lacks, and which solver takes any robot."""
        super().__init__(
            message(
                "kinematics.no_closed_form",
                "there is no closed form for this arm: {problem}; the numeric solver takes any robot",
                problem=problem,
            )
        )


@dataclass(frozen=True, eq=False)
class SixAxisArm:
    """An arm of six revolute axes, 2 parallel to 3, neither to 1, with a wrist of one of two kinds.

    Spherical: axes 4, 5 and 6 meet in one point, the wrist centre. Parallel, as the UR arms have it: axis 4 is parallel
    to axis 3, and axes 5 and 6 meet in the wrist centre.

    Axis 1 need not meet axis 2 (shoulder offset along the arm), nor the wrist centre lie in the plane of axis 1 and
    the arm (shoulder offset across it, as the Puma has), nor axis 4 point at axis 3 (elbow offset).
    """

    axes: Vector  # unit axes 1 ... 6 at zero, shape (6, 3)
    shoulder: Vector  # a point on axis 1 [m], shape (3,)
    upper_arm: Vector  # a point on axis 2, in the base at zero [m], shape (3,)
    centre: Vector  # the wrist centre at zero [m], shape (3,)
    parallel: bool  # whether axis 4 is parallel to axis 3
    senses: tuple[float, float]  # of axes 3 and 4: 1 where they point as axis 2 does, -1 where against it
    upper: complex  # from axis 2 to axis 3 at zero, as a complex number in the plane across axis 2 [m]
    fore: complex  # from axis 3 to the wrist centre, or to axis 4 if parallel, likewise
    hand: complex  # from axis 4 to the wrist centre if parallel, else 0
    home: Vector  # pose of the tool at zero, shape (4, 4)

    @classmethod
    def of(cls, chain: Chain) -> "SixAxisArm":
        """Recognise the geometry in a chain; raises NoClosedForm: what it lacks."""
        order = list(chain.order)
        if len(order) != 6 or not chain.revolute[order].all():
            raise NoClosedForm(
                message(
                    "kinematics.six_revolute_axes",
                    "it has {count} moving axes, and the form is for six revolute ones",
                    count=len(order),
                )
            )
        axes, points = chain.axes[order], chain.points[order]
        if np.linalg.norm(np.cross(axes[1], axes[2])) > _ANGLE:
            raise NoClosedForm(message("kinematics.axis_3_not_parallel", "axis 3 is not parallel to axis 2"))
        for one, other in ((0, 1), (3, 4), (4, 5)):
            if np.linalg.norm(np.cross(axes[one], axes[other])) < _ALONG:
                raise NoClosedForm(
                    message(
                        "kinematics.axes_are_parallel",
                        "axis {one} is parallel to axis {other}",
                        one=one + 1,
                        other=other + 1,
                    )
                )
        parallel = bool(np.linalg.norm(np.cross(axes[2], axes[3])) <= _ANGLE)
        first = 4 if parallel else 3
        centre, miss = _nearest_point(axes[first:], points[first:])
        if miss > _LENGTH:
            count = "two" if parallel else "three"
            raise NoClosedForm(
                message(
                    "kinematics.axes_do_not_meet",
                    "the last {count} axes do not meet in a point: they miss it by {miss:.3g} m",
                    count=count,
                    miss=miss,
                )
            )
        plane = _plane(axes[1])
        wrist = points[3] if parallel else centre
        upper, fore, hand = (complex(plane @ way) for way in (points[2] - points[1], wrist - points[2], centre - wrist))
        if min(abs(upper), abs(fore)) < _LENGTH:
            raise NoClosedForm(
                message(
                    "kinematics.lies_on_axis_3",
                    "{part} or axis 2 lies on axis 3",
                    part=message("kinematics.axis_4", "axis 4")
                    if parallel
                    else message("kinematics.wrist_centre", "the wrist centre"),
                )
            )
        senses = (float(np.sign(axes[1] @ axes[2])), float(np.sign(axes[1] @ axes[3])))
        return cls(axes, points[0], points[1], centre, parallel, senses, upper, fore, hand, chain.home)

    @cached_property
    def plane(self) -> Complex:
        """Complex row (3,) whose product with a vector is its part across axis 2; turning by q multiplies by e^iq."""
        return _plane(self.axes[1])

    @cached_property
    def side(self) -> float:
        """How far the wrist centre lies from axis 1 along axis 2 [m]."""
        return float(self.axes[1] @ (self.centre - self.shoulder))

    @cached_property
    def spins(self) -> Vector:
        """The matrix of the cross product with each axis, shape (6, 3, 3)."""
        return skew(self.axes)

    def turn(self, axis: int, angles: Vector, vectors: Vector) -> Vector:
        """Turn vectors (..., 3) about an axis, 0 to 5, at zero, by angles (...)."""
        sine, versine = np.sin(angles)[..., np.newaxis], 1.0 - np.cos(angles)[..., np.newaxis]
        across = vectors @ self.spins[axis].T
        turned: Vector = vectors + sine * across + versine * (across @ self.spins[axis].T)
        return turned

    def forward(self, positions: Vector) -> Vector:
        """Return the poses of the tool (k, 4, 4) for positions (k, 6) of axes 1 ... 6, from this geometry alone."""
        q = positions.T
        third, fourth = self.senses
        hand = self.hand * np.exp(1j * fourth * q[3])
        planar = np.exp(1j * q[1]) * (self.upper + (self.fore + hand) * np.exp(1j * third * q[2]))
        along = self.axes[1] * (self.axes[1] @ (self.centre - self.upper_arm))
        arm = planar[:, np.newaxis].real * self.plane.real + planar[:, np.newaxis].imag * self.plane.imag + along
        centres = self.shoulder + self.turn(0, q[0], self.upper_arm - self.shoulder + arm)
        columns = np.column_stack([self.home[:3, :3], self.home[:3, 3] - self.centre]).T[:, np.newaxis]
        bent = (q[0], q[1] + third * q[2], q[3], q[4], q[5])
        for axis, angles in zip((5, 4, 3, 1, 0), reversed(bent), strict=True):
            columns = self.turn(axis, np.broadcast_to(angles, (4, len(positions))), columns)
        poses = np.zeros((len(positions), 4, 4))
        poses[:, :3] = columns.transpose(1, 2, 0)
        poses[:, :3, 3] += centres
        poses[:, 3, 3] = 1.0
        return poses


def _plane(axis: Vector) -> Complex:
    """Return a complex row u + iv with unit vectors u, v across an axis; u, v and the axis are right-handed."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    plane: Complex = first + 1j * np.cross(axis, first)
    return plane


def _nearest_point(axes: Vector, points: Vector) -> tuple[Vector, float]:
    """Return the point nearest to lines in the sense of least squares, and its largest distance from one."""
    across = np.eye(3) - axes[:, :, np.newaxis] * axes[:, np.newaxis, :]
    point = np.linalg.lstsq(across.sum(axis=0), (across @ points[..., np.newaxis]).sum(axis=0)[:, 0], rcond=None)[0]
    misses = (across @ (point - points)[..., np.newaxis])[..., 0]
    return point, float(np.linalg.norm(misses, axis=1).max())


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
    """Return all postures that reach targets (k, 4, 4); starts (k, 6) give axes 1 and 4 where these may be anywhere."""
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
    """Return axes 2, 3 and what is out of reach (k, shoulder, 2, ...): exp(i·q2)·(upper + fore·exp(i·q3)) = target."""
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

    ``turns`` are those of the tool from zero, shape (k, 3, 3), ``first`` is axis 1 (k, 2), ``bent`` axes 2 and 3
    together, about axis 2 (k, 2, e), or 0 to have all parallel axes in axis 4; ``starts`` are of axis 4 (k, 1 or 2, 1,
    1). Axis 5 is an angle of the spherical triangle with sides (4, 5), (5, 6) and (4, turned 6), by the half-angle
    form, which loses no digits where axes 4 and 6 line up; axis 6 is what is left of the orientation.
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
