"""The parts of a move, each from rest to rest: its way, through zones, and postures on it that a spline keeps to.

A Cartesian part is solved at a few points, joined by a spline, and looked at half-way between them; where the tool
would leave its line or arc, points are put in between until it does not.

The part of the way at a part of the time is that of :func:`~simrob_drake.blocks.references.smooth`, or of a law that
cruises; what depends on it smoothly is interpolated.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple, cast

import numpy as np
from pydrake.math import BsplineBasis
from pydrake.trajectories import BsplineTrajectory, CompositeTrajectory, Trajectory
from scipy.interpolate import BSpline, make_interp_spline

from simrob_drake.base.arguments import positive
from simrob_drake.base.errors import InvalidParameter, angle, quoted
from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import stacked, turned_by
from simrob_drake.base.messages import compound, message
from simrob_drake.blocks.cruise import TimeLaw
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.incremental import IncrementalSolver
from simrob_drake.kinematics.solver import Solutions, Solver
from simrob_drake.programs.errors import BrokenPath

_LARGEST = 200  # mm, of RAPID's zones
_SMALLEST = 3e-4  # m: z0
_KNOWN = message(
    "programs.known_zones",
    "'fine', 'z0' to 'z{largest}' for so many millimetres, or a number from {smallest:g} [m]",
    largest=_LARGEST,
    smallest=_SMALLEST,
)
_TOO_WIDE = 1 + 1e-9

Curve = Callable[[Vector], Vector]  # gives postures (k, n), or poses (k, 4, 4), at parts (k,) of a way


@dataclass(frozen=True)
class Way:
    """A way to one target, or past several: where it leads at its parts, how long it is [m], where the targets are."""

    curve: Curve
    length: float
    passes: Vector = field(default_factory=lambda: np.ones(1))


def zone_size(zone: object) -> float:
    """Return how far from a target a zone begins [m]; 0 for ``fine``; raises InvalidParameter: no zone."""
    if not isinstance(zone, str):
        size = positive(zone, "zone", "m")
        if size < _SMALLEST:
            raise InvalidParameter("zone", zone, _KNOWN)
        return size
    if zone == "fine":
        return 0.0
    number = re.fullmatch(r"z(\d{1,3})", zone)
    if number is None or int(number[1]) > _LARGEST:
        raise InvalidParameter("zone", quoted(zone), _KNOWN)
    return max(int(number[1]) / 1e3, _SMALLEST)


def through_zones(ways: Sequence[Way], zone: float) -> Way:
    """Return ways to one target each as one that passes their targets within zones [m], as RAPID's are.

    Two ways that meet are laid over each other within the zone: what is left of the first, and what is gone of the
    second. Of the distance x before (negative) or behind the corner, in zones, :math:`g(x) = 2 t^3 - t^4` with :math:`t
    = (x + 1) / 2` is gone of the second and :math:`g(-x)` left of the first, so that place, direction and curvature go
    on without a jump: :math:`g'` rises from 0 to 1, and :math:`g(x) - g(-x) = x`. Raises InvalidParameter: a zone
    larger than half of a way that leads into or out of it.
    """
    ends = np.cumsum([way.length for way in ways])
    for index, pair in enumerate(pairwise(ways)):
        most = min(way.length for way in pair) / 2
        if zone > most * _TOO_WIDE:
            expected = message(
                "programs.largest_zone",
                "at most {most:.4g} mm at targets[{index}]: half of the shorter way that meets there",
                most=1e3 * most,
                index=index,
            )
            raise InvalidParameter("zone", compound("{zone:.4g} mm", zone=1e3 * zone), expected)

    def curve(parts: Vector) -> Vector:
        gone = parts * ends[-1]
        number = np.minimum(np.searchsorted(ends, gone), len(ways) - 1)
        shares = [(way, gone[number == row] - ends[row]) for row, way in enumerate(ways)]  # parts rise
        found = np.concatenate([_on(way, short_of) for way, short_of in shares if short_of.size])
        for corner, (before, after) in zip(ends, pairwise(ways), strict=False):
            near = np.abs(gone - corner) < zone
            if near.any():
                x = (gone[near] - corner) / zone
                left, entered = _on(before, -zone * _gone(-x)), _on(after, zone * _gone(x) - after.length)
                found[near] = _laid_over(left, before.curve(np.ones(1))[0], entered)
        return found

    return Way(curve, float(ends[-1]), ends / ends[-1])


def _on(way: Way, short_of: Vector) -> Vector:
    """Return where a way leads at distances (k,) before its end, which are negative [m]."""
    return way.curve(np.clip(1 + short_of / way.length, 0.0, 1.0))


def _gone(x: Vector) -> Vector:
    t = (x + 1) / 2
    return np.asarray(t**3 * (2 - t))


def _laid_over(left: Vector, corner: Vector, entered: Vector) -> Vector:
    """Return what two motions (k, ...) through a corner make together."""
    if left.ndim == 2:
        return left + entered - corner
    places = left[:, :3, 3] + entered[:, :3, 3] - corner[:3, 3]
    return stacked(places, left[:, :3, :3] @ corner[:3, :3].T @ entered[:, :3, :3])


PATH_TOLERANCE = 2e-5  # how far the tool may be from its line or arc between two points [m]

_LEAST_POINTS = 8
_MOST_POINTS = 5000
_SMALL_TURN = 0.2  # rad from one point to the next that the incremental solver follows whatever its limit is
_JUMP = 0.5  # rad or m between points above which a motion that does not shrink with more points counts as a jump
_SHRINKS = 0.8  # a continuous motion between points halves when their number doubles


@dataclass(frozen=True)
class Segment:
    """Postures on the way to one target, or to several that are passed within zones."""

    parts: Vector  # of its way, from 0 to 1, shape (k,)
    postures: Vector  # there, shape (k, n) [rad or m]
    length: float  # of the tool's way [m]
    passes: Vector  # the parts at which targets are

    @property
    def end(self) -> Vector:
        """Where it ends, shape (n,)."""
        return np.asarray(self.postures[-1])


def joint_way(chain: Chain, start: Vector, end: Vector) -> Way:
    """Return the straight way in the space of the joints between two postures (n,)."""

    def curve(parts: Vector) -> Vector:
        return np.asarray(start + parts[:, np.newaxis] * (end - start))

    return Way(curve, tool_length(chain, curve(np.linspace(0.0, 1.0, _LEAST_POINTS + 1))))


def joint_segment(way: Way, *, points: int) -> Segment:
    """Return the postures of a way in the space of the joints."""
    parts = np.linspace(0.0, 1.0, max(points, _LEAST_POINTS) + 1)
    return Segment(parts, way.curve(parts), way.length, way.passes)


def pose_segment(solver: Solver, way: Way, start: Vector, *, points: int, target: str) -> Segment:
    """Return postures, ``points`` at least, that lead the tool from a posture (n,) along a ``way`` of poses (k, 4, 4).

    Raises Unreachable: a point that no posture reaches; the incremental solver may ``stray`` on the way, past singular
    postures, as far as it says, if it comes to the end; BrokenPath: points that no continuous motion joins.
    """
    chain, poses = solver.chain, way.curve
    stray = solver.stray if isinstance(solver, IncrementalSolver) else 0.0
    count = max(points, _LEAST_POINTS)
    if isinstance(solver, IncrementalSolver):  # it follows small turns only
        first, last = poses(np.array([0.0, 1.0]))
        count = max(count, int(np.ceil(turned_by(first[:3, :3], last[:3, :3]) / _SMALL_TURN)))
    parts = np.linspace(0.0, 1.0, count + 1)
    targets = poses(parts)
    solutions = solver.solve(targets[1:], start)
    if not (solutions.reached[-1] and (solutions.position_error <= stray).all()):
        _require(solutions, parts[1:], targets[1:], points, target)
    postures = np.vstack([start, solutions.positions])
    exact = _away(chain, postures, targets) < PATH_TOLERANCE  # else the solver was asked for something else
    jump = np.inf
    while exact:
        last_jump, jump = jump, float(np.abs(np.diff(postures, axis=0)).max())
        if (jump > _JUMP and jump > _SHRINKS * last_jump) or len(parts) > _MOST_POINTS:
            raise _broken(chain, postures, parts, points, target)
        between = (parts[1:] + parts[:-1]) / 2
        guesses = np.clip(free_spline(parts, postures)(between), chain.lower, chain.upper)
        desired = poses(between)
        if _away(chain, guesses, desired) < PATH_TOLERANCE:
            break
        solutions = solver.solve(desired, guesses)
        _require(solutions, between, desired, points, target)
        order = np.argsort(np.concatenate([parts, between]), kind="stable")
        parts, postures = np.concatenate([parts, between])[order], np.vstack([postures, solutions.positions])[order]
    return Segment(parts, postures, way.length, way.passes)


def tool_length(chain: Chain, postures: Vector) -> float:
    """Return how far the tool goes from posture to posture (k, n), by chords [m]."""
    places = chain.forward(postures)[:, :3, 3]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


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

    Point i of the way, counted from 1, is at the fraction i / points.

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


def _away(chain: Chain, postures: Vector, targets: Vector) -> float:
    """Return the largest distance of the tool from targets (k, 4, 4), with postures (k, n) [m]."""
    return float(np.linalg.norm(chain.forward(postures)[:, :3, 3] - targets[:, :3, 3], axis=1).max())


def _require(solutions: Solutions, parts: Vector, targets: Vector, points: int, target: str) -> None:
    """Check that a solver reached the poses (k, 4, 4) at all parts (k,) of a way, from 0 to 1.

    Raises:
        Unreachable: it did not; the error names the first such point, see :func:`named_point`.
    """
    if solutions.reached.all():
        return
    row = solutions.first_missed
    number, name = named_point(float(parts[row]), points, target)
    place = ", ".join(f"{value:.4g}" for value in targets[row, :3, 3])
    raise solutions.unreachable(
        row,
        target
        if parts[row] == 1.0
        else message("programs.target_at_place", "{name} (at {place} m)", name=name, place=place),
        index=number - 1,
    )


def _broken(chain: Chain, postures: Vector, parts: Vector, points: int, target: str) -> BrokenPath:
    jumps = np.abs(np.diff(postures, axis=0))
    row, axis = np.unravel_index(int(np.argmax(jumps)), jumps.shape)
    number, name = named_point(float(parts[row]), points, target)
    jump = float(jumps[row, axis])
    shown = angle(jump) if chain.revolute[axis] else compound("{jump:.3g} m", jump=jump)
    return BrokenPath(name, chain.names[axis], point=number, jump=jump, shown=shown)


_DEGREE = 5
_LEAST_POINTS, _FINER = 6, 1.5  # of a motion: its points, and how many times as dense as those of its way


def free_spline(parts: Vector, postures: Vector) -> BSpline:
    """Return the spline of degree five through postures (k, n) at parts (k,), its ends as they come."""
    result: BSpline = make_interp_spline(parts, postures, k=_DEGREE)
    return result


Slopes = tuple[Vector, Vector]  # first and second derivative at an end of a curve, each of shape (n,)


def spline(times: Vector, postures: Vector, ends: tuple[Slopes, Slopes] | None = None) -> BSpline:
    """Return the spline of degree five through postures (k, n) at times (k,) [s], at rest at both ends unless told."""
    rest = np.zeros(postures.shape[1])
    conditions: Any = [list(enumerate(slopes, 1)) for slopes in ends or ((rest, rest),) * 2]  # the stubs know words
    result: BSpline = make_interp_spline(times, postures, k=_DEGREE, bc_type=tuple(conditions))
    return result


@dataclass(frozen=True)
class Stretch:
    """A motion: the spline through postures (k, n) [rad or m] at times (k,) [s], with slopes at its ends.

    Without slopes it goes from rest to rest.
    """

    times: Vector
    postures: Vector
    ends: tuple[Slopes, Slopes] | None = None

    def of_axes(self, axes: slice) -> "Stretch":
        """Return the motion of some of the axes."""
        ends = None if self.ends is None else tuple((speed[axes], push[axes]) for speed, push in self.ends)
        return Stretch(self.times, self.postures[:, axes], cast(tuple[Slopes, Slopes] | None, ends))

    def at(self, begin: float, factor: float = 1.0) -> "Stretch":
        """Return the same motion later by ``begin`` [s], its times multiplied by ``factor``."""
        ends = None
        if self.ends is not None:
            first, last = ((speed / factor, push / factor**2) for speed, push in self.ends)
            ends = first, last
        return Stretch(begin + factor * self.times, self.postures, ends)


def by_law(parts: Vector, postures: Vector, law: TimeLaw) -> tuple[Stretch, ...]:
    """Return the motions by which a way is gone that leads through postures (k, n) at its parts (k,), from 0 to 1.

    Each is that of one polynomial of the law: no spline smoothes the acceleration or jerk that jumps between two.
    """
    way = free_spline(parts, postures)
    slope, bend = way.derivative(1), way.derivative(2)
    motions = []
    for piece, (begin, end) in enumerate(pairwise(law.breaks)):
        share = float(np.ptp(law.at([begin, end], piece)))
        times = np.linspace(begin, end, _LEAST_POINTS + int(_FINER * share * len(parts)))
        gone, speed, push = (law.at(times, piece, order) for order in range(3))
        gone = np.clip(gone, 0.0, 1.0)
        ends = [(slope(gone[k]) * speed[k], bend(gone[k]) * speed[k] ** 2 + slope(gone[k]) * push[k]) for k in (0, -1)]
        motions.append(Stretch(times, way(gone), (ends[0], ends[1])))
    return tuple(motions)


def rest(posture: Vector, begin: float, end: float) -> Stretch:
    """Return the motion that stays at a posture (n,) from one time to another [s]."""
    return Stretch(np.array([begin, end]), np.array([posture, posture]))


def trajectory(stretches: Sequence[Stretch]) -> Trajectory:
    """Return the trajectory of shape (n, 1) of motions that follow each other without a gap in time."""
    curves = []
    for stretch in stretches:
        fitted = spline(stretch.times, stretch.postures, stretch.ends)
        basis = BsplineBasis(_DEGREE + 1, fitted.t.tolist())
        curves.append(BsplineTrajectory(basis, list(fitted.c[:, :, np.newaxis])))
    return curves[0] if len(curves) == 1 else CompositeTrajectory(curves)


def until(stretches: tuple[Stretch, ...], posture: Vector, end: float) -> tuple[Stretch, ...]:
    """Return motions with a rest behind them, so that they last until ``end`` [s]."""
    begin = float(stretches[-1].times[-1]) if stretches else 0.0
    if begin >= end:
        return stretches
    return (*stretches, rest(stretches[-1].postures[-1] if stretches else posture, begin, end))
