"""Paths and motions of an arm: from the path to a target to the spline that the axes follow.

A *path* (:class:`Way`) is geometry without time: the poses of the tool, or the postures of the axes, at each part of
the path from 0 to 1. Paths to several targets can be joined within *zones*, so that the tool turns from one to the next
without coming to rest. A :class:`Segment` is a path on which the postures are known. The path of a tool is solved at
few points that are joined by a spline; where the tool would leave its line or arc between them, points are added.

A :class:`Stretch` is a motion: a segment that a law of time makes a function of time. The law gives the part of the
path that is covered at each time, see :class:`~simrob_drake.blocks.cruise.TimeLaw`.

Messages name a part of a path by numbered *points* on the way to a target, the same that users count. A solver of the
inverse kinematics finds postures for poses; it *reaches* a pose if it finds one.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import BsplineBasis
from pydrake.trajectories import BsplineTrajectory, CompositeTrajectory, Trajectory
from scipy.interpolate import BSpline, make_interp_spline

from simrob_drake.base.arguments import positive
from simrob_drake.base.errors import InvalidParameter, angle, quote_value
from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import stack_poses, turned_by
from simrob_drake.base.messages import compound, message
from simrob_drake.blocks.cruise import TimeLaw
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.incremental import IncrementalSolver
from simrob_drake.kinematics.solver import Solutions, Solver
from simrob_drake.programs.errors import BrokenPath

_LARGEST_ZONE = 200  # largest zone of RAPID, z200 [mm]
_SMALLEST_ZONE = 3e-4  # size of RAPID's zone z0 [m]
_KNOWN_ZONES = message(
    "programs.known_zones",
    "'fine', 'z0' to 'z{largest}' for so many millimetres, or a number from {smallest:g} [m]",
    largest=_LARGEST_ZONE,
    smallest=_SMALLEST_ZONE,
)
_ROUNDING = 1 + 1e-9  # factor by which a zone may be too large because of rounding errors

Curve = Callable[[Vector], Vector]
"""Function that gives postures (k, n), or poses (k, 4, 4), at parts (k,) of a path."""


@dataclass(frozen=True)
class Way:
    """A path to one target, or past several targets.

    Attributes:
        curve: postures or poses at parts of the path.
        length: length of the path of the tool [m].
        passes: parts of the path at which the targets are, shape (m,).
    """

    curve: Curve
    length: float
    passes: Vector = field(default_factory=lambda: np.ones(1))


def zone_size(zone: object) -> float:
    """Read the size of a zone: the distance from a target at which the tool begins to turn to the next one [m].

    Args:
        zone: ``fine`` for the size 0, a name of RAPID such as ``z10`` for 10 mm (``z0`` is 0.3 mm), or the size [m].

    Raises:
        InvalidParameter: there is no such zone.
    """
    if not isinstance(zone, str):
        size = positive(zone, "zone", "m")
        if size < _SMALLEST_ZONE:
            raise InvalidParameter("zone", zone, _KNOWN_ZONES)
        return size
    if zone == "fine":
        return 0.0
    number = re.fullmatch(r"z(\d{1,3})", zone)
    if number is None or int(number[1]) > _LARGEST_ZONE:
        raise InvalidParameter("zone", quote_value(zone), _KNOWN_ZONES)
    return max(int(number[1]) / 1e3, _SMALLEST_ZONE)


def through_zones(ways: Sequence[Way], zone: float) -> Way:
    r"""Join paths to one target each, so that the tool passes the targets within zones as in RAPID.

    Let x be the distance past the corner between two paths, in zones, from -1 (before it) to 1. Within the zone the
    motions of both paths are added: of the second, :math:`g(x) = 2 t^3 - t^4` with :math:`t = (x + 1) / 2` is covered,
    and of the first, :math:`g(-x)` is left. Position, direction and curvature are continuous, because :math:`g'` rises
    from 0 to 1 and :math:`g(x) - g(-x) = x`.

    Args:
        ways: the paths, one after the other.
        zone: size of the zones [m].

    Returns:
        The joined path. It is as long as all paths together, and passes the targets where the zones are in their
        middle.

    Raises:
        InvalidParameter: the zone is larger than half of a path that leads into or out of one.
    """
    ends = np.cumsum([way.length for way in ways])  # length of the joined path at each target [m]
    for index, pair in enumerate(pairwise(ways)):
        most = min(way.length for way in pair) / 2
        if zone > most * _ROUNDING:
            expected = message(
                "programs.largest_zone",
                "at most {most:.4g} mm at targets[{index}]: half of the shorter of the two paths that meet there",
                most=1e3 * most,
                index=index,
            )
            raise InvalidParameter("zone", compound("{zone:.4g} mm", zone=1e3 * zone), expected)

    def curve(parts: Vector) -> Vector:
        """Postures or poses at parts (k,) of the joined path, which are in ascending order."""
        covered = parts * ends[-1]  # length from the start [m]
        # First without zones: each part belongs to one of the paths.
        indices = np.minimum(np.searchsorted(ends, covered), len(ways) - 1)
        pieces = []
        # A place on a path is its distance from the path's end, with a negative sign [m].
        for index, way in enumerate(ways):
            from_end = covered[indices == index] - ends[index]
            if from_end.size:
                pieces.append(_before_end(way, from_end))
        result = np.concatenate(pieces)
        # Then the parts within each zone are replaced.
        for corner, (before, after) in zip(ends, pairwise(ways), strict=False):
            is_near = np.abs(covered - corner) < zone
            if is_near.any():
                x = (covered[is_near] - corner) / zone
                # The motion that is left of the first path, and the one that has entered the second.
                left = _before_end(before, -zone * _zone_share(-x))
                entered = _before_end(after, zone * _zone_share(x) - after.length)
                corner_value = before.curve(np.ones(1))[0]
                result[is_near] = _add_motions(left, corner_value, entered)
        return result

    return Way(curve, float(ends[-1]), ends / ends[-1])


def _before_end(way: Way, from_end: Vector) -> Vector:
    """Postures or poses of a path at distances from its end, shape (k,) [m]. The distances are negative."""
    return way.curve(np.clip(1 + from_end / way.length, 0.0, 1.0))


def _zone_share(x: Vector) -> Vector:
    """Function g of :func:`through_zones`: the length of the second path that is covered, in zones, from 0 to 1.

    Args:
        x: distance past the corner, in zones, from -1 (before it) to 1, shape (k,).
    """
    t = (x + 1) / 2
    return np.asarray(t**3 * (2 - t))


def _add_motions(left: Vector, corner: Vector, entered: Vector) -> Vector:
    """Add the motion that ends in a corner and the motion that begins there, at the same k times.

    Args:
        left: postures (k, n) or poses (k, 4, 4) of the first motion.
        corner: posture (n,) or pose (4, 4) of the corner.
        entered: postures or poses of the second motion, of the same shape.

    Returns:
        Postures or poses, of the same shape.
    """
    is_posture = left.ndim == 2
    # Both are measured from the corner: left - corner + entered - corner + corner.
    if is_posture:
        return left + entered - corner
    positions = left[:, :3, 3] + entered[:, :3, 3] - corner[:3, 3]
    # The same for rotations: the inverse of the corner's orientation is its transpose.
    rotations = left[:, :3, :3] @ corner[:3, :3].T @ entered[:, :3, :3]
    return stack_poses(positions, rotations)


PATH_TOLERANCE = 2e-5
"""Largest distance of the tool from its line or arc between two points [m]."""

# Least count of points of a path, and of a motion: a spline of degree five needs six.
_LEAST_POINTS = 6
_MOST_POINTS = 5000  # largest count of points that are added to a path
_SMALL_TURN = 0.2  # turn from one point to the next that the incremental solver follows whatever its limit is [rad]
_JUMP = 0.5  # motion between two points that may be a jump [rad or m]
_SHRINKS = 0.8  # a motion that becomes shorter than this part if the points double is no jump: a continuous one halves


@dataclass(frozen=True)
class Segment:
    """Postures on a path from rest to rest: to one target, or to several that are passed within zones.

    Attributes:
        parts: parts of the path, from 0 to 1, shape (k,).
        postures: positions of the axes there, shape (k, n) [rad or m].
        length: length of the path of the tool [m].
        passes: parts of the path at which the targets are, shape (m,).
    """

    parts: Vector
    postures: Vector
    length: float
    passes: Vector

    @property
    def end(self) -> Vector:
        """Last posture, shape (n,) [rad or m]."""
        return np.asarray(self.postures[-1])


def joint_way(chain: Chain, start: Vector, end: Vector) -> Way:
    """Straight path of the axes between two postures (n,) [rad or m].

    Args:
        chain: the axes, for the length of the tool's path.
        start: posture at the start.
        end: posture at the end.
    """

    def curve(parts: Vector) -> Vector:
        """Postures (k, n) at parts (k,) of the path."""
        return np.asarray(start + parts[:, np.newaxis] * (end - start))

    return Way(curve, tool_length(chain, curve(np.linspace(0.0, 1.0, _LEAST_POINTS + 1))))


def joint_segment(way: Way, *, points: int) -> Segment:
    """Sample a path of the axes at its start and at evenly spaced points.

    Args:
        way: the path, whose curve gives postures.
        points: count of points behind the start. At least 6 are taken, as the spline through them needs.
    """
    parts = np.linspace(0.0, 1.0, max(points, _LEAST_POINTS) + 1)
    return Segment(parts, way.curve(parts), way.length, way.passes)


def pose_segment(solver: Solver, way: Way, start: Vector, *, points: int, target: str) -> Segment:
    """Find postures that lead the tool along a path of poses.

    Points are added until the tool is within :data:`PATH_TOLERANCE` of the path also half-way between them. If the
    solver does not follow the path even at the points, because it may stray or ignores a part of the pose, none are
    added.

    Args:
        solver: solver of the inverse kinematics. The incremental solver may leave the path, past singular postures, by
            its distance `stray`, if it comes to the end.
        way: the path of poses.
        start: posture at the start of the path, shape (n,) [rad or m].
        points: least count of points on the path, by which messages name a part of it.
        target: name of the target for messages.

    Raises:
        Unreachable: no posture reaches a point.
        BrokenPath: no continuous motion joins the points.
    """
    chain = solver.chain
    poses = way.curve
    stray = 0.0
    count = max(points, _LEAST_POINTS)
    # This solver follows turns only in small steps: a large turn gets more points.
    if isinstance(solver, IncrementalSolver):
        stray = solver.stray
        first, last = poses(np.array([0.0, 1.0]))
        turn = turned_by(first[:3, :3], last[:3, :3])
        count = max(count, int(np.ceil(turn / _SMALL_TURN)))
    parts = np.linspace(0.0, 1.0, count + 1)
    targets = poses(parts)
    solutions = solver.solve(targets[1:], start)
    has_arrived = solutions.reached[-1] and (solutions.position_error <= stray).all()
    if not has_arrived:
        _require(solutions, parts[1:], targets[1:], points, target)
    postures = np.vstack([start, solutions.positions])
    # Where the solver does not follow the path, more points do not help.
    follows_path = _largest_distance(chain, postures, targets) < PATH_TOLERANCE
    jump = np.inf  # largest motion of an axis between two points [rad or m]
    while follows_path:
        last_jump = jump
        jump = float(np.abs(np.diff(postures, axis=0)).max())
        # A continuous motion between two points halves when the points double. A jump stays as large.
        is_jump = jump > _JUMP and jump > _SHRINKS * last_jump
        if is_jump or len(parts) > _MOST_POINTS:
            raise _broken_path(chain, postures, parts, points, target)
        between = (parts[1:] + parts[:-1]) / 2
        # The spline predicts the posture half-way. If the tool is on the path there, no more points are needed.
        guesses = np.clip(free_spline(parts, postures)(between), chain.lower, chain.upper)
        desired = poses(between)
        if _largest_distance(chain, guesses, desired) < PATH_TOLERANCE:
            break
        # From here on, the count of points doubles: the new ones are put between the old ones.
        solutions = solver.solve(desired, guesses)
        _require(solutions, between, desired, points, target)
        all_parts = np.concatenate([parts, between])
        order = np.argsort(all_parts, kind="stable")
        parts = all_parts[order]
        postures = np.vstack([postures, solutions.positions])[order]
    return Segment(parts, postures, way.length, way.passes)


def tool_length(chain: Chain, postures: Vector) -> float:
    """Length of the path of the tool through postures (k, n) [rad or m], by the chords between them [m]."""
    positions = chain.forward(postures)[:, :3, 3]
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())


class PathPoint(NamedTuple):
    """A point on the way to a target, for error messages.

    Attributes:
        number: number of the point, counted from 1.
        name: name of the point, such as "point 3 of 30 on the way to targets[1]".
    """

    number: int
    name: str


def named_point(part: float, points: int, target: str) -> PathPoint:
    """Name the point by which error messages describe a place on the way: the point there, or else the next one.

    Point i of the way, counted from 1, is at the fraction i / points. The last one is the target.

    Args:
        part: the place as a fraction of the way from the last target to this one, from 0 to 1.
        points: count of points on the way to the target.
        target: name of the target.
    """
    # A place that is beyond a point only by rounding belongs to this point. No point is at the beginning, 0: it
    # belongs to point 1.
    number = max(int(np.ceil(part * points - 1e-9)), 1)
    return PathPoint(
        number,
        message(
            "programs.point_on_way",
            "point {number} of {points} on the way to {target}",
            number=number,
            points=points,
            target=target,
        ),
    )


def _largest_distance(chain: Chain, postures: Vector, targets: Vector) -> float:
    """Largest distance of the tool in postures (k, n) from the positions of targets (k, 4, 4) [m]."""
    return float(
        np.linalg.norm(chain.forward(postures)[:, :3, 3] - targets[:, :3, 3], axis=1).max()
    )


def _require(
    solutions: Solutions, parts: Vector, targets: Vector, points: int, target: str
) -> None:
    """Check that a solver reached all poses of some points on a path.

    Args:
        solutions: result of the solver, for the poses in their order.
        parts: parts of the path at which the poses are, from 0 to 1, shape (k,).
        targets: the poses, shape (k, 4, 4).
        points: count of points on the path for messages.
        target: name of the target for messages.

    Raises:
        Unreachable: the solver missed a pose. The message names the first one, see :func:`named_point`.
    """
    if solutions.reached.all():
        return
    missed = solutions.first_missed
    number, name = named_point(float(parts[missed]), points, target)
    # The user has given the position of the target itself: only other points need theirs.
    if parts[missed] == 1.0:
        where = target
    else:
        place = ", ".join(f"{value:.4g}" for value in targets[missed, :3, 3])
        where = message("programs.target_at_place", "{name} (at {place} m)", name=name, place=place)
    raise solutions.unreachable(missed, where, index=number - 1)


def _broken_path(
    chain: Chain, postures: Vector, parts: Vector, points: int, target: str
) -> BrokenPath:
    """Make the error for the largest jump of an axis between two postures of a path that follow each other.

    Args:
        chain: the axes.
        postures: postures on the path, shape (k, n) [rad or m].
        parts: parts of the path at which they are, from 0 to 1, shape (k,).
        points: count of points on the path, by which the message names the posture before the jump.
        target: name of the target for the message.
    """
    jumps = np.abs(np.diff(postures, axis=0))
    before, axis = np.unravel_index(int(np.argmax(jumps)), jumps.shape)
    number, name = named_point(float(parts[before]), points, target)
    jump = float(jumps[before, axis])
    shown = angle(jump) if chain.revolute[axis] else compound("{jump:.3g} m", jump=jump)
    return BrokenPath(name, chain.names[axis], point=number, jump=jump, shown=shown)


_DEGREE = 5  # of all splines: position, velocity and acceleration are smooth
_FINER = 1.5  # how many times as many points a motion has as its path


def free_spline(parts: Vector, postures: Vector) -> BSpline:
    """Spline of degree five through postures (k, n) at parts (k,), without conditions on its ends. k is at least 6."""
    result: BSpline = make_interp_spline(parts, postures, k=_DEGREE)
    return result


class EndSlopes(NamedTuple):
    """Derivatives at an end of a motion.

    Attributes:
        velocity: first derivative, shape (n,).
        acceleration: second derivative, shape (n,).
    """

    velocity: Vector
    acceleration: Vector


class Slopes(NamedTuple):
    """Derivatives at both ends of a motion."""

    first: EndSlopes
    last: EndSlopes


def spline(times: Vector, postures: Vector, ends: Slopes | None = None) -> BSpline:
    """Spline of degree five through postures at times.

    Args:
        times: times, shape (k,) [s].
        postures: postures, shape (k, n) [rad or m].
        ends: velocities and accelerations at both ends. If it is None, the spline is at rest there.
    """
    if ends is None:
        rest_slopes = EndSlopes(np.zeros(postures.shape[1]), np.zeros(postures.shape[1]))
        ends = Slopes(rest_slopes, rest_slopes)
    # For each end a list of the order of a derivative and its value. The type stubs know names of conditions only.
    conditions: Any = tuple([(1, end.velocity), (2, end.acceleration)] for end in ends)
    result: BSpline = make_interp_spline(times, postures, k=_DEGREE, bc_type=conditions)
    return result


@dataclass(frozen=True)
class Stretch:
    """A motion: the spline through postures at times.

    Attributes:
        times: times, shape (k,) [s].
        postures: positions of the axes, shape (k, n) [rad or m].
        ends: velocities and accelerations at both ends. If it is None, the motion is from rest to rest.
    """

    times: Vector
    postures: Vector
    ends: Slopes | None = None

    def of_axes(self, axes: slice) -> "Stretch":
        """Motion of some of the axes, given by a slice of their indices."""
        ends = None
        if self.ends is not None:
            own_ends = [EndSlopes(end.velocity[axes], end.acceleration[axes]) for end in self.ends]
            ends = Slopes(*own_ends)
        return Stretch(self.times, self.postures[:, axes], ends)

    def at(self, begin: float, factor: float = 1.0) -> "Stretch":
        """The same motion at other times, also of its velocities and accelerations at the ends.

        Args:
            begin: time that is added to all times [s].
            factor: how many times as long it takes. The times are multiplied by it first.
        """
        ends = None
        if self.ends is not None:
            slower_ends = [
                EndSlopes(end.velocity / factor, end.acceleration / factor**2) for end in self.ends
            ]
            ends = Slopes(*slower_ends)
        return Stretch(begin + factor * self.times, self.postures, ends)


def by_law(parts: Vector, postures: Vector, law: TimeLaw) -> tuple[Stretch, ...]:
    r"""Make motions of a path and a law of time: one for each polynomial of the law.

    A single spline over the whole law would smooth the jumps of acceleration or jerk between two polynomials. With the
    path q(s) and the law s(t), the derivatives at the ends of each motion are
    :math:`\dot q = q' \dot s` and :math:`\ddot q = q'' \dot s^2 + q' \ddot s`.

    Args:
        parts: parts of the path, from 0 to 1, shape (k,).
        postures: postures at these parts, shape (k, n) [rad or m].
        law: the law of time.

    Returns:
        The motions, one after the other, from the time 0 of the law on.
    """
    path = free_spline(parts, postures)
    slope = path.derivative(1)
    curvature = path.derivative(2)
    motions = []
    for polynomial, (begin, end) in enumerate(pairwise(law.breaks)):
        # A polynomial that covers a larger part of the path needs more points. Values of the law of this polynomial are
        # asked for by its number, because two polynomials have different accelerations where they meet.
        share = float(np.ptp(law.at([begin, end], polynomial)))
        times = np.linspace(begin, end, _LEAST_POINTS + int(_FINER * share * len(parts)))
        covered = np.clip(law.at(times, polynomial, 0), 0.0, 1.0)
        rate = law.at(times, polynomial, 1)
        rate_change = law.at(times, polynomial, 2)
        ends = []
        for index in (0, -1):  # the first and the last time
            velocity = slope(covered[index]) * rate[index]
            acceleration = (
                curvature(covered[index]) * rate[index] ** 2
                + slope(covered[index]) * rate_change[index]
            )
            ends.append(EndSlopes(velocity, acceleration))
        motions.append(Stretch(times, path(covered), Slopes(*ends)))
    return tuple(motions)


def rest(posture: Vector, begin: float, end: float) -> Stretch:
    """Rest in a posture (n,) [rad or m] from one time to another [s]."""
    return Stretch(np.array([begin, end]), np.array([posture, posture]))


def trajectory(stretches: Sequence[Stretch]) -> Trajectory:
    """Positions of the axes as a function of time, of shape (n, 1) [rad or m], for one or several motions.

    The motions follow each other without a gap in time.
    """
    curves = []
    for stretch in stretches:
        fitted = spline(stretch.times, stretch.postures, stretch.ends)
        basis = BsplineBasis(_DEGREE + 1, fitted.t.tolist())
        curves.append(BsplineTrajectory(basis, list(fitted.c[:, :, np.newaxis])))
    return curves[0] if len(curves) == 1 else CompositeTrajectory(curves)


def until(stretches: tuple[Stretch, ...], posture: Vector, end: float) -> tuple[Stretch, ...]:
    """Add a rest behind motions, so that they last until a time.

    Args:
        stretches: the motions. There may be none.
        posture: posture of the rest if there are no motions, shape (n,) [rad or m].
        end: time at which the rest ends [s]. If it is not after the motions, these are returned unchanged.
    """
    # Without motions the robot rests in the given posture from the start.
    begin = 0.0
    if stretches:
        begin = float(stretches[-1].times[-1])
        posture = stretches[-1].postures[-1]
    if begin >= end:
        return stretches
    return (*stretches, rest(posture, begin, end))
