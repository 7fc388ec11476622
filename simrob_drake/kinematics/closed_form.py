"""All postures of a six-axis arm for a pose of its tool, in closed form.

The arm has axis 2 parallel to axis 3, and a wrist of one of two kinds:

* In a *spherical* wrist, axes 4, 5 and 6 meet in a point, the wrist centre.
* In a *parallel* wrist, as cobots have it, axis 4 is parallel to axis 3, and axes 5 and 6 meet in the wrist centre.

The pose of the tool gives the wrist centre. Its distance from axis 1 along axis 2 does not change with the axes that
are parallel to axis 2, so axis 1 follows from it. The rest differs:

* With a spherical wrist, the distance of the wrist centre from axis 2 gives axes 2 and 3. The remaining orientation
  gives axes 4 to 6.
* With a parallel wrist, the orientation gives axes 5 and 6, and the sum of the angles of the parallel axes. This leaves
  a triangle of axes 2, 3 and 4.

Each of three steps has two solutions, called shoulder, elbow and wrist; so there are eight postures. With the right
shoulder, the upper arm is on the right of axis 1, seen from axis 1 towards the wrist, or, if it has no offset to a
side, the wrist is on the same side of axis 1 as at zero; with the left one, the arm is turned round and bent backwards.
With the elbow up, axis 3 is above the line from axis 2 to the end of the forearm. The wrist is flipped if axis 5 is on
the negative side of the position in which axes 4 and 6 are parallel. The steps are the subproblems of Paden and Kahan
(Murray, Li & Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, §3.3).

Vectors across axis 2 are written as complex numbers: a turn about axis 2 by q is then a product with exp(iq).

The upper arm leads from axis 2 to axis 3. The forearm leads from axis 3 to the wrist centre or, with a parallel wrist,
to axis 4; there, the hand leads from axis 4 to the wrist centre. "At zero" is with all axes at 0.
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

_LENGTH = 1e-4
"""Distance by which axes may miss each other [m]. Published dimensions are rounded; the solver removes the errors."""

_ANGLE = 1e-4
"""Angle by which parallel axes may differ [rad], for the same reason: rpy="0 1.5708 0" is off by 4e-6."""

_SAME_DIRECTION = 1e-3
"""Sine of the angle between two axes below which they count as one direction."""

_OFFSET = 1e-6
"""Distance above which an arm counts as offset to one side [m]."""

_SINGULAR = 1e-10
"""Distance [m] or sine below which an axis may have any position. It is 1e4 times the rounding error, and a tenth of
the error that the solver promises."""

_LEAST_MISS = 1e-3
"""Angle by which axis 6 has to miss its direction so that it counts as missed [rad]. Rounded dimensions of an arm cause
angles of a tenth of it."""

BRANCHES = 8
"""Count of postures. The index of a posture is 4·shoulder + 2·elbow + wrist, each of which is 0 or 1."""
SHOULDERS = ("right", "left")
"""Names of the shoulders 0 and 1 of that index."""
ELBOWS = ("up", "down")
"""Names of the elbows 0 and 1 of that index."""
WRISTS = ("no_flip", "flip")
"""Names of the wrists 0 and 1 of that index."""

Complex = np.ndarray[Any, np.dtype[np.complex128]]


class NoClosedForm(SimrobError):
    """Raised for an arm whose geometry the analytic solver does not cover."""

    def __init__(self, problem: str) -> None:
        """Write the message.

        Args:
            problem: the condition that the geometry does not fulfil, in words.
        """
        super().__init__(
            message(
                "kinematics.no_closed_form",
                "this arm has no inverse kinematics in closed form: {problem}; use the numeric solver instead",
                problem=problem,
            )
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class SixAxisArm:
    """Geometry of an arm with six revolute axes that has a closed form.

    Axis 1 need not meet axis 2 (the shoulder may be offset along the arm). The wrist centre need not lie in the plane
    of axis 1 and the arm (the shoulder may be offset across the arm, as that of the Puma). Axis 4 need not point at
    axis 3 (the elbow may be offset).

    Attributes:
        axes: unit vectors of axes 1 to 6 at zero, shape (6, 3).
        shoulder: a point on axis 1, shape (3,) [m].
        upper_arm: a point on axis 2 at zero, shape (3,) [m].
        centre: the wrist centre at zero, shape (3,) [m].
        parallel: whether the wrist is parallel.
        senses: senses of axes 3 and 4: 1 if the axis points as axis 2 does, -1 if it points the other way. That of axis
            4 means this only with a parallel wrist, and has no effect with a spherical one.
        upper: vector from axis 2 to axis 3 at zero, across axis 2 [m].
        fore: vector from axis 3 to the wrist centre, or to axis 4 of a parallel wrist, across axis 2 [m].
        hand: vector from axis 4 of a parallel wrist to the wrist centre, across axis 2 [m]; 0 for a spherical wrist.
        home: pose of the tool at zero, shape (4, 4).
    """

    axes: Vector
    shoulder: Vector
    upper_arm: Vector
    centre: Vector
    parallel: bool
    senses: tuple[float, float]
    upper: complex
    fore: complex
    hand: complex
    home: Vector

    @classmethod
    def of(cls, chain: Chain) -> "SixAxisArm":
        """Recognise the geometry of a chain, from its axes and points at zero.

        Args:
            chain: the chain of an arm.

        Raises:
            NoClosedForm: the geometry is not one that has a closed form here.
        """
        # Axes that do not move the tool, such as fingers, are not in the order and do not count.
        order = list(chain.order)
        if len(order) != 6 or not chain.revolute[order].all():
            raise NoClosedForm(
                message(
                    "kinematics.six_revolute_axes",
                    "the closed form needs six revolute axes, and {count} axes, revolute or prismatic, move the tool",
                    count=len(order),
                )
            )
        axes = chain.axes[order]
        points = chain.points[order]
        _check_directions(axes)

        # With axis 4 parallel to axis 3 only axes 5 and 6 have to meet; otherwise axes 4 to 6 must meet in one point.
        parallel = bool(np.linalg.norm(np.cross(axes[2], axes[3])) <= _ANGLE)
        first_of_wrist = 4 if parallel else 3
        centre, miss = _nearest_point(axes[first_of_wrist:], points[first_of_wrist:])
        if miss > _LENGTH:
            raise NoClosedForm(
                message(
                    "kinematics.axes_do_not_meet",
                    "the last {count} axes do not meet in a point: they miss it by {miss:.3g} m",
                    count=2 if parallel else 3,
                    miss=miss,
                )
            )

        # Axes 1 to 3 decide where the end of the forearm is: a spherical wrist turns about its centre, which is then
        # that end; in a parallel wrist, axis 4 still moves the centre.
        plane = _plane_across(axes[1])
        end_of_forearm = points[3] if parallel else centre
        upper = complex(plane @ (points[2] - points[1]))
        fore = complex(plane @ (end_of_forearm - points[2]))
        hand = complex(plane @ (centre - end_of_forearm))
        # Without an upper arm or a forearm there is no triangle, and the law of cosines would divide by zero.
        if min(abs(upper), abs(fore)) < _LENGTH:
            axis_4 = message("kinematics.axis_4", "axis 4")
            wrist_centre = message("kinematics.wrist_centre", "the wrist centre")
            raise NoClosedForm(
                message(
                    "kinematics.lies_on_axis_3",
                    "the distance between axis 3 and axis 2, or between axis 3 and {part}, is zero",
                    part=axis_4 if parallel else wrist_centre,
                )
            )
        return cls(
            axes=axes,
            shoulder=points[0],
            upper_arm=points[1],
            centre=centre,
            parallel=parallel,
            senses=(float(np.sign(axes[1] @ axes[2])), float(np.sign(axes[1] @ axes[3]))),
            upper=upper,
            fore=fore,
            hand=hand,
            home=chain.home,
        )

    @cached_property
    def plane(self) -> Complex:
        """Complex row vector (3,) whose product with a vector is the part of the vector across axis 2."""
        return _plane_across(self.axes[1])

    @cached_property
    def side(self) -> float:
        """Distance of the wrist centre from axis 1 along axis 2 [m]."""
        return float(self.axes[1] @ (self.centre - self.shoulder))

    @cached_property
    def spins(self) -> Vector:
        """Matrices of the cross products with the axes, shape (6, 3, 3)."""
        return skew(self.axes)

    @cached_property
    def sign_of_right(self) -> float:
        """Sign s, 1 or -1, with which axis 1 = middle + s · spread is the right shoulder.

        These are the two solutions of :func:`_solve_shoulder` for axis 1: the same angle to both sides of a middle.

        With s = 1 the wrist centre is in front, on the side of axis 1 to which axis 2 × axis 1 points. An arm that is
        offset along axis 2 is then on the left, seen from axis 1 towards the wrist. So s is -1 for such an arm. An arm
        without an offset has its right shoulder where the wrist centre is on the same side of axis 1 as at zero.
        """
        # Two arms that are built as mirror images have their offsets on opposite sides, hence the sign of the offset.
        if abs(self.side) > _OFFSET:
            return -float(np.sign(self.side))
        front = np.cross(self.axes[1], self.axes[0])
        is_behind_at_zero = front @ (self.centre - self.shoulder) < -_OFFSET
        return -1.0 if is_behind_at_zero else 1.0

    def turn(self, axis: int, angles: Vector, vectors: Vector) -> Vector:
        """Turn vectors about an axis at zero, by Rodrigues' formula.

        Args:
            axis: index of the axis, 0 to 5.
            angles: angles, shape (...) [rad].
            vectors: vectors, shape (..., 3).

        Returns:
            the turned vectors, of the common shape of both, (..., 3).
        """
        # v cos(q) + (a × v) sin(q) + a (a·v) (1 - cos(q)) = v + sin(q) (a × v) + (1 - cos(q)) a × (a × v).
        # Vectors are rows here, so that a × v is the product of v with the transposed matrix.
        spin = self.spins[axis].T
        sine = np.sin(angles)[..., np.newaxis]
        versine = 1.0 - np.cos(angles)[..., np.newaxis]
        across = vectors @ spin
        turned: Vector = vectors + sine * across + versine * (across @ spin)
        return turned

    def forward(self, positions: Vector) -> Vector:
        """Compute poses of the tool from this geometry alone, to check it against the chain.

        Args:
            positions: positions of axes 1 to 6, shape (k, 6) [rad].

        Returns:
            the poses, shape (k, 4, 4).
        """
        q = positions.T
        third, fourth = self.senses

        # The wrist centre, first in the plane across axis 2, then turned about axis 1:
        #   p = exp(i q2) (upper + exp(i q3) (fore + exp(i q4) hand)), with q3 and q4 in the sense of axis 2.
        hand = self.hand * np.exp(1j * fourth * q[3])
        planar = np.exp(1j * q[1]) * (self.upper + (self.fore + hand) * np.exp(1j * third * q[2]))
        # The component along axis 2 does not depend on the axes that are parallel to axis 2.
        along = self.axes[1] * (self.axes[1] @ (self.centre - self.upper_arm))
        arm = (
            planar[:, np.newaxis].real * self.plane.real
            + planar[:, np.newaxis].imag * self.plane.imag
            + along
        )
        centres = self.shoulder + self.turn(0, q[0], self.upper_arm - self.shoulder + arm)

        # The three axes of the tool, and the vector from the wrist centre to it, at zero. Shape (4, 1, 3).
        columns = np.column_stack([self.home[:3, :3], self.home[:3, 3] - self.centre]).T[
            :, np.newaxis
        ]
        # From the tool to the base: axis 6 turns the tool first. Axes 2 and 3 are parallel, so that one turn by the
        # sum of their angles about axis 2 has the effect of both on a direction.
        angle_of_forearm = q[1] + third * q[2]
        turns = ((5, q[5]), (4, q[4]), (3, q[3]), (1, angle_of_forearm), (0, q[0]))
        for axis, angles in turns:
            columns = self.turn(axis, np.broadcast_to(angles, (4, len(positions))), columns)

        # The last column is the vector from the wrist centre so far; the wrist centre is added to it.
        poses = np.zeros((len(positions), 4, 4))
        poses[:, :3] = columns.transpose(1, 2, 0)
        poses[:, :3, 3] += centres
        poses[:, 3, 3] = 1.0
        return poses


def _check_directions(axes: Vector) -> None:
    """Check which of the axes (6, 3) are parallel.

    Raises:
        NoClosedForm: axes 2 and 3 are not, or two neighbours are that must not be: 1 and 2, 4 and 5, or 5 and 6.
    """
    if np.linalg.norm(np.cross(axes[1], axes[2])) > _ANGLE:
        raise NoClosedForm(
            message("kinematics.axis_3_not_parallel", "axis 3 is not parallel to axis 2")
        )
    # Two neighbours that are parallel turn the same direction, and the arm lacks a degree of freedom there.
    for one, other in ((0, 1), (3, 4), (4, 5)):
        if np.linalg.norm(np.cross(axes[one], axes[other])) < _SAME_DIRECTION:
            raise NoClosedForm(
                message(
                    "kinematics.axes_are_parallel",
                    "axis {one} is parallel to axis {other}",
                    one=one + 1,
                    other=other + 1,
                )
            )


def _plane_across(axis: Vector) -> Complex:
    """Compute a complex row vector u + iv with unit vectors u, v across an axis; u, v, axis are right-handed."""
    # The coordinate axis that is least parallel to the axis gives the cross product with the smallest rounding error.
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    plane: Complex = first + 1j * np.cross(axis, first)
    return plane


def _nearest_point(axes: Vector, points: Vector) -> tuple[Vector, float]:
    """Find the point closest to straight lines in the sense of least squares.

    Args:
        axes: unit vectors of m lines, shape (m, 3).
        points: a point on each line, shape (m, 3) [m].

    Returns:
        the point, and its largest distance from one of the lines [m].
    """
    # The vector from line i to the point p is (I - aᵢ aᵢ') (p - pᵢ). The sum of its squares is least if
    #   Σ (I - aᵢ aᵢ') p = Σ (I - aᵢ aᵢ') pᵢ.
    across = np.eye(3) - axes[:, :, np.newaxis] * axes[:, np.newaxis, :]
    right_side = (across @ points[..., np.newaxis]).sum(axis=0)[:, 0]
    # Least squares also solve the singular case of parallel lines, whose distance then shows that they do not meet.
    point = np.linalg.lstsq(across.sum(axis=0), right_side, rcond=None)[0]
    misses = (across @ (point - points)[..., np.newaxis])[..., 0]
    return point, float(np.linalg.norm(misses, axis=1).max())


@dataclass(frozen=True, eq=False, kw_only=True)
class ClosedForm:
    """Postures of an arm for k poses, eight for each.

    Attributes:
        postures: positions of axes 1 to 6, in any whole turn, shape (k, 8, 6) [rad]. If a pose is out of reach, the arm
            is stretched or folded towards it.
        out_of_reach: distance of the wrist centre beyond what the arm reaches, shape (k, 8) [m]; 0 if it is in reach.
        missed_turn: angle by which the wrist cannot turn axis 6 to its direction, shape (k, 8) [rad]; 0 if it can. Only
            wrists whose axes are not at right angles miss directions.
        is_singular: whether, in at least one of the eight postures, an axis may have any position and was taken from
            the start: axis 1, or axis 4. With a parallel wrist, the sum of axes 2 to 4 stands for axis 4; it comes as
            close to that of the start as the arm reaches. Shape (k,).
    """

    postures: Vector
    out_of_reach: Vector
    missed_turn: Vector
    is_singular: Flags


def all_postures(arm: SixAxisArm, targets: Vector, starts: Vector) -> ClosedForm:
    """Compute all postures for poses of the tool.

    Arrays of the shape (k, 2, 2, 2) have one value for each shoulder, elbow and wrist.

    Args:
        arm: the arm.
        targets: the poses, shape (k, 4, 4).
        starts: positions of axes 1 to 6, shape (k, 6) [rad]. Axes that may have any position get theirs from these.

    Returns:
        the eight postures of each pose, whether or not they reach it, and how far they miss it.
    """
    # Rotations of the tool from its orientation at zero. The wrist centre is fixed in the tool, so that the pose of the
    # tool gives its position.
    rotations = targets[:, :3, :3] @ arm.home[:3, :3].T
    centres = targets[:, :3, 3] + rotations @ (arm.centre - arm.home[:3, 3])
    first, out_of_side, is_any_first = _solve_shoulder(arm, centres, starts[:, 0])

    # The wrist centre as seen from axis 2, in the plane across it, after axis 1 is turned back. Shape (k, 2, 1, 1).
    turned_back = (
        arm.turn(0, -first, (centres - arm.shoulder)[:, np.newaxis]) + arm.shoulder - arm.upper_arm
    )
    planar = (turned_back @ arm.plane)[..., np.newaxis, np.newaxis]

    third, fourth = arm.senses
    postures = np.empty((len(targets), 2, 2, 2, 6))
    postures[..., 0] = first[:, :, np.newaxis, np.newaxis]
    if arm.parallel:
        # First the wrist, whose "axis 4" is here the sum of the parallel axes 2, 3 and 4. Then the elbow, and axis 4 as
        # what remains of the sum. If the pose leaves the sum free, it is as close to that of the start as possible.
        total_of_start = starts[:, 1] + third * starts[:, 2] + fourth * starts[:, 3]
        total_if_free = _closest_total(arm, planar, total_of_start)
        no_forearm = np.zeros((len(targets), 2, 1))
        wrist, missed, is_any_wrist = _solve_wrist(
            arm, rotations, first, no_forearm, fourth * total_if_free
        )
        total = fourth * wrist[..., 0]
        # The hand now has a known direction, exp(i total), so that the end of the forearm is known as well.
        end_of_forearm = planar - arm.hand * np.exp(1j * total)
        postures[..., 1], postures[..., 2], out_of_arm = _solve_elbow(arm, end_of_forearm)
        # total = q2 + s3 q3 + s4 q4, with the senses s3, s4; a sense is its own inverse.
        postures[..., 3] = fourth * (total - postures[..., 1] - third * postures[..., 2])
        postures[..., 4:] = wrist[..., 1:]
    else:
        # First the elbow, then the wrist. Axes 2 and 3 are the same for both wrists, so those of wrist 0 are taken.
        postures[..., 1], postures[..., 2], out_of_arm = _solve_elbow(arm, planar)
        angle_of_forearm = postures[..., 0, 1] + third * postures[..., 0, 2]
        postures[..., 3:], missed, is_any_wrist = _solve_wrist(
            arm, rotations, first, angle_of_forearm, _column(starts[:, 3])
        )

    # The miss along axis 2 and the miss across axis 2 are at right angles.
    out_of_reach = np.broadcast_to(np.hypot(_column(out_of_side), out_of_arm), postures.shape[:-1])
    # The two wrists of a shoulder and an elbow miss the same direction.
    missed_turn = np.broadcast_to(missed[..., np.newaxis], postures.shape[:-1])
    return ClosedForm(
        postures=postures.reshape(-1, BRANCHES, 6),
        out_of_reach=out_of_reach.reshape(-1, BRANCHES),
        missed_turn=missed_turn.reshape(-1, BRANCHES),
        is_singular=is_any_first | is_any_wrist.any(axis=(1, 2)),
    )


def _solve_shoulder(
    arm: SixAxisArm, centres: Vector, starts: Vector
) -> tuple[Vector, Vector, Flags]:
    """Solve for axis 1.

    Turned back by axis 1, the wrist centre is as far along axis 2 as at zero. This gives A cos q + B sin q = D.

    Args:
        arm: the arm.
        centres: the wrist centres, shape (k, 3) [m].
        starts: positions of axis 1 in the starts, shape (k,) [rad].

    Returns:
        axis 1 for the right and the left shoulder, shape (k, 2) [rad]; how far the wrist centre is out of reach, shape
        (k,) [m]; and whether axis 1 may have any position, shape (k,).
    """
    one = arm.axes[0]
    two = arm.axes[1]
    away = centres - arm.shoulder
    # Rodrigues' formula for a turn by -q about axis 1, with the vectors u along axis 1, v along axis 2 and w to the
    # wrist centre:  v·R(-q) w = (v·w - h u·v) cos q + w·(u × v) sin q + h u·v, where h = u·w.
    height = away @ one
    a = away @ two - height * (one @ two)
    # The transposed matrix of a cross product gives its negative, hence the sign.
    b = -(away @ (arm.spins[0].T @ two))
    d = arm.side - height * (one @ two)

    # With A = r cos m and B = r sin m the equation is r cos(q - m) = D, so that q = m ± arccos(D / r). If |D| > r, the
    # wrist centre is out of reach, and the clipped cosine turns the arm towards it.
    radius = np.hypot(a, b)
    spread = np.arccos(np.clip(d / np.maximum(radius, _SINGULAR), -1.0, 1.0))
    middle = np.arctan2(b, a)
    sign = arm.sign_of_right
    first = np.stack([middle + sign * spread, middle - sign * spread], axis=1)

    # A wrist centre on axis 1 stays there for every q. The angle of the start moves the axis least.
    is_any = radius < _SINGULAR
    first[is_any] = starts[is_any, np.newaxis]
    return first, np.maximum(np.abs(d) - radius, 0.0), is_any


def _column(values: Vector) -> Vector:
    """Add dimensions for shoulders, elbows and wrists to values (k,). Returns shape (k, 1, 1, 1)."""
    return values[:, np.newaxis, np.newaxis, np.newaxis]


def _closest_total(arm: SixAxisArm, target: Complex, total: Vector) -> Vector:
    """Find the sum of the parallel angles, closest to a desired one, with which axes 2, 3 and 4 reach a target.

    If axis 6 is parallel to axis 4, the pose allows any sum. But not for each sum can upper arm, forearm and hand close
    the way to the target: the end of the forearm must be in reach of the other two. The sum is then moved to the limit
    of this range, by the law of cosines in the triangle of hand, reach and target.

    Args:
        arm: the arm.
        target: wrist centres across axis 2, shape (k, 2, 1, 1) [m].
        total: the desired sums, shape (k,) [rad].

    Returns:
        the sums, shape (k, 2, 1, 1) [rad].
    """
    # Distance from axis 2 to axis 4 with the desired sum, and the closest distance that upper arm and forearm reach.
    desired = np.broadcast_to(_column(total), target.shape)
    distance = np.abs(target - arm.hand * np.exp(1j * desired))
    least = abs(abs(arm.upper) - abs(arm.fore))
    most = abs(arm.upper) + abs(arm.fore)
    reach = np.clip(distance, least, most)

    # Law of cosines, reach² = away² + hand² - 2 away hand cos(swing): the swing is the angle between the hand and the
    # direction to the target. Lengths of zero are replaced, so that nothing is divided by 0.
    hand = max(abs(arm.hand), _SINGULAR)
    away = np.maximum(np.abs(target), _SINGULAR)
    ahead = np.angle(target * np.conj(arm.hand))
    cosine = (away**2 + hand**2 - reach**2) / (2.0 * away * hand)
    swing = np.arccos(np.clip(cosine, -1.0, 1.0))
    # Of the two directions of the hand, on either side of the target, the one closer to the desired sum.
    at_limit = ahead + np.copysign(swing, np.sin(desired - ahead))
    return np.where(reach == distance, desired, at_limit)


def _solve_elbow(arm: SixAxisArm, target: Complex) -> tuple[Vector, Vector, Vector]:
    """Solve exp(i q2) (upper + fore exp(i q3)) = target for axes 2 and 3, by the law of cosines.

    In this equation, q3 is counted in the sense of axis 2. If the target is out of reach, the arm is stretched or
    folded towards it.

    Args:
        arm: the arm.
        target: desired position of the end of the forearm across axis 2, shape (k, 2, 1, w) [m], for each shoulder.
            With a parallel wrist, w is 2, for each wrist; otherwise 1.

    Returns:
        axis 2 and axis 3 for each shoulder and elbow, shape (k, 2, 2, w) [rad], and how far the target is out of reach,
        shape (k, 2, 1, w) [m].
    """
    upper = abs(arm.upper)
    fore = abs(arm.fore)
    # Law of cosines for the angle between the extended upper arm and the forearm:
    #   distance² = upper² + fore² + 2 upper fore cos(bend).
    # If the target is too far away, the cosine is above 1 and the arm is stretched. If it is too near, the cosine is
    # below -1 and the arm is folded.
    distance = np.abs(target)
    cosine = (distance**2 - upper**2 - fore**2) / (2.0 * upper * fore)
    bend = np.arccos(np.clip(cosine, -1.0, 1.0))

    # The sense of the bend by shoulder and elbow, shape (2, 2, 1). If the wrist is in front, a positive turn about
    # axis 2 bends the arm down. With the left shoulder the arm is turned round, so that the senses change.
    sense_of_bend = arm.sign_of_right * np.array([[[1.0], [-1.0]], [[-1.0], [1.0]]])
    # At zero posture the arm is bent already, by the angle between upper arm and forearm.
    angle = sense_of_bend * bend - np.angle(arm.fore / arm.upper)
    # Axis 2 then turns the bent arm as a whole to the target.
    end_of_forearm = arm.upper + arm.fore * np.exp(1j * angle)
    second = np.angle(target * np.conj(end_of_forearm))
    third = angle * arm.senses[0]
    out_of_reach = np.maximum(
        np.maximum(distance - (upper + fore), abs(upper - fore) - distance), 0.0
    )
    return second, third, out_of_reach


def _solve_wrist(
    arm: SixAxisArm, rotations: Vector, first: Vector, angle_of_forearm: Vector, starts: Vector
) -> tuple[Vector, Vector, Flags]:
    """Solve for axes 4, 5 and 6.

    The directions of axis 4, axis 5 and the turned axis 6 are a spherical triangle. Its sides are the angles between
    them, and axis 5 is one of its angles. The half-angle form is used for it, since it loses no digits if axes 4 and 6
    are almost parallel. Axis 6 is what remains of the orientation.

    Args:
        arm: the arm.
        rotations: rotations of the tool from zero, shape (k, 3, 3).
        first: axis 1, shape (k, 2) [rad].
        angle_of_forearm: turn of the forearm about axis 2, shape (k, 2, e) [rad]. It is 0 for a parallel wrist, so that
            axis 4 gets the turns of all parallel axes.
        starts: axis 4 in the starts, in case it may have any position, shape (k, 1 or 2, 1, 1) [rad].

    Returns:
        axes 4, 5 and 6, shape (k, 2, e, 2, 3) [rad]; the angle by which axis 6 misses its direction, shape (k, 2, e)
        [rad]; and whether axis 4 may have any position, shape (k, 2, e).
    """
    four, five, six = arm.axes[3:]
    # A vector across axes 5 and 6 shows how far axis 6 is turned.
    probe = np.cross(five, six)
    probe /= np.linalg.norm(probe)

    def in_forearm(vectors: Vector) -> Vector:
        """Turn vectors (k, 3) of the base back by axes 1, 2 and 3. Returns shape (k, 2, e, 3)."""
        turned_by_first = arm.turn(0, -first, vectors[:, np.newaxis])
        return arm.turn(1, -angle_of_forearm, turned_by_first[:, :, np.newaxis])

    sixth = in_forearm(rotations @ six)
    probes = in_forearm(rotations @ probe)

    # Axis 5: tan²(bend / 2) = sin(s - a) sin(s - b) / (sin(s) sin(s - c)) with the sides a, b, c and their half sum s.
    # Side a is the angle between axes 4 and 5, b that between axes 5 and 6, and c the angle between axis 4 and the
    # turned axis 6. The arctangent of sine and cosine is exact for small angles, where an arccosine is not.
    across = np.linalg.norm(sixth @ arm.spins[3].T, axis=-1)
    opening = np.arctan2(across, sixth @ four)
    front = _angle_between(four, five)
    rear = _angle_between(five, six)
    numerator = np.sin((opening + front - rear) / 2) * np.sin((opening - front + rear) / 2)
    denominator = np.sin((front + rear + opening) / 2) * np.sin((front + rear - opening) / 2)
    # A negative product means that the three sides do not close a triangle: axis 6 cannot point in that direction. The
    # bend is then 0 or π, which brings axis 6 as close to it as the wrist can.
    half_bend = np.arctan2(
        np.sqrt(np.maximum(numerator, 0.0)), np.sqrt(np.maximum(denominator, 0.0))
    )
    bend = 2.0 * half_bend[..., np.newaxis]
    # The side c of a triangle is at least the difference of the other two, and at most their sum, or what this leaves
    # of a whole turn.
    least = abs(front - rear)
    most = min(front + rear, 2.0 * np.pi - front - rear)
    missed = np.maximum(np.maximum(least - opening, opening - most), 0.0)
    missed = np.where(missed > _LEAST_MISS, missed, 0.0)
    four_across_five = np.cross(np.cross(five, four), five)
    six_across_five = np.cross(np.cross(five, six), five)
    # At zero posture the wrist may be bent already: the bend is counted from axis 4, the position from zero.
    bend_at_zero = _angle_about(five, four_across_five, six_across_five)
    fifth = np.concatenate([bend, -bend], axis=-1) - bend_at_zero

    # Axis 4 brings the turned axis 6 to its direction. If the two axes are parallel, every angle of axis 4 does.
    is_any = across < _SINGULAR
    tip = arm.turn(4, fifth, six)
    fourth = _angle_about(four, tip, sixth[..., np.newaxis, :])
    fourth = np.where(is_any[..., np.newaxis], starts, fourth)

    # Axis 6 brings the probe to its direction.
    remaining = arm.turn(4, -fifth, arm.turn(3, -fourth, probes[..., np.newaxis, :]))
    axes = np.stack([fourth, fifth, _angle_about(six, probe, remaining)], axis=-1)
    return axes, missed, is_any


def _angle_between(one: Vector, other: Vector) -> float:
    """Compute the angle between two vectors (3,) [rad]."""
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


def _angle_about(axis: Vector, begin: Vector, end: Vector) -> Vector:
    """Compute the angles about an axis (3,) from vectors (..., 3) to vectors (..., 3), -π to π, shape (...) [rad]."""
    spin = skew(axis).T
    # Vectors may be almost parallel to the axis. Their parts across the axis are compared, since the product of the
    # vectors themselves would lose what is small. A product with `spin` is a × v: the part across the axis, turned by a
    # right angle. A second one turns it by another right angle, for the sine.
    begin_across = begin @ spin
    end_across = end @ spin
    angle: Vector = np.arctan2(
        np.vecdot(begin_across @ spin, end_across), np.vecdot(begin_across, end_across)
    )
    return angle
