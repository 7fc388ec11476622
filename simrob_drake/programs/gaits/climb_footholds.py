"""Choice of the footholds of a climb: where the feet of the next stride go, on ground with stairs, gaps and thresholds.

Positions are in the frame of the climb: x ahead from the middle of the feet at its start, y to the left. The goal is a
distance ahead. There are two choices, with the same methods `height` and `next`:

* :class:`SoleFootholds`, for two feet that are soles. They go side by side along a *profile* of the ground, which
  consists of *treads*, level stretches such as the steps of stairs. A sole may stick out over the edge of a tread by a
  part of its length, so that a stride over an edge is shorter than the sole.
* :class:`BallFootholds`, for four feet that are balls. Each goes where it would on level ground, or near there.

A *riser* is a step of the ground up or down, such as the front of a stair.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.programs.gaits.climb import Climb
from simrob_drake.programs.gaits.walker import Foot
from simrob_drake.walking.height_map import CELL, HeightMap
from simrob_drake.walking.height_map import Places as Shifts

FootPositions = Mapping[str, Vector]
"""Ahead [m], left [m] and turn to the left [rad] of each foot, by its name, shape (3,)."""
GroundHeight = Callable[[Vector], Vector]
"""Function that gives the height of the ground, (m,) [m], at positions ahead and to the left, (m, 2) [m]."""

SAMPLE = 0.002
"""Distance between the positions at which the ground is sampled along the way [m]."""
LEAST_STRIDE = 0.012
"""A shorter distance is not worth a stride: closer to the goal than this, a foot counts as there [m]."""

_UNEVENNESS = 0.004  # largest height difference within a tread [m]
_WIDEST_GAP = 1.0  # longest distance between two treads that are joined by one stride, in lengths of a sole [1]

# How far the profile goes beyond the positions of the soles, because soles stick out [m].
_PROFILE_BEHIND = 0.3
_PROFILE_AHEAD = 0.5

_SIDE_CORRECTION = 0.02  # largest sideways error that one stride corrects [m]
_BALL_UNEVENNESS = 0.015  # largest height difference of the ground under a ball [m]
_BALL_HALF = 0.02  # half the side of the square under a ball that has to be even [m]


@dataclass(frozen=True)
class Tread:
    """A level stretch of the ground.

    Attributes:
        begin: position where it begins [m].
        end: position where it ends [m].
        height: height of the ground [m].
    """

    begin: float
    end: float
    height: float


@dataclass(frozen=True)
class StridePlan:
    """A stride of both soles, which then stand side by side.

    Attributes:
        position: position of their middles after the stride [m].
        height: height of the ground there [m].
        over: height of the highest ground on the way there [m].
    """

    position: float
    height: float
    over: float


@dataclass(frozen=True)
class SoleMargins:
    """Limits of how a sole may stand on a tread.

    Attributes:
        half: half the length of the sole [m].
        margin: least distance from a riser before the toe, or behind the heel [m].
        overhang: longest part that may stick out over an edge below which the ground is lower [m].
    """

    half: float
    margin: float
    overhang: float


class GroundProfile:
    """Heights of the ground along the way of two soles.

    Attributes:
        treads: the level stretches, in their order along the way.
    """

    def __init__(self, along: Vector, heights: Vector) -> None:
        """Find the treads.

        Args:
            along: positions along the way at equal distances, shape (m,) [m].
            heights: heights of the ground there at k positions across the soles, shape (m, k) [m].
        """
        self._along = along
        # A sole stands on the highest ground across its width.
        self._highest = heights.max(axis=1)
        is_level_across = np.ptp(heights, axis=1) <= _UNEVENNESS
        # A new run begins where the ground rises or falls by a riser, or where it begins or ceases to be level across.
        has_riser = np.abs(np.diff(self._highest)) > _UNEVENNESS
        # Indices of the positions after which a new run begins.
        breaks = np.flatnonzero((np.diff(is_level_across) != 0) | has_riser)
        self.treads = []
        for run in np.split(np.arange(len(along)), breaks + 1):
            run_heights = self._highest[run]
            # All positions of a run are level across, or none is. The second condition excludes ramps, which rise
            # without any riser.
            if is_level_across[run[0]] and np.ptp(run_heights) <= _UNEVENNESS:
                tread = Tread(
                    begin=float(along[run[0]]),
                    end=float(along[run[-1]]),
                    height=float(np.median(run_heights)),
                )
                self.treads.append(tread)

    def tread(self, position: float) -> Tread | None:
        """Find the tread at a position [m].

        Returns None if no tread contains the position: the ground is not level there, the profile does not go so far,
        or the position is between the last sample of one tread and the first one of the next.
        """
        return next((tread for tread in self.treads if tread.begin <= position <= tread.end), None)

    def next_stride(
        self, position: float, sole: SoleMargins, longest: float, distance: float
    ) -> StridePlan | None:
        """Plan the next stride of both soles.

        Args:
            position: position of the middles of the soles [m].
            sole: size of the soles, and how they may stand.
            longest: longest stride on one level [m]. A stride to another tread is as long as it has to be.
            distance: position of the goal [m].

        Returns:
            The stride. It is None if the soles are at the goal or on no tread, or if they cannot go farther ahead on
            this tread and there is none ahead on which they fit.
        """
        here = self.tread(position)
        if here is None or is_at_goal(position, distance):
            return None
        later = [tread for tread in self.treads if tread.begin > here.end]
        following = next((tread for tread in later if self._fits(here, tread, sole)), None)
        # First as far ahead on this tread as its edge or the goal allows, so that the stride over the edge is short.
        front = min(self._last_toe(here, following, sole) - sole.half, distance)
        if front - position > LEAST_STRIDE:
            return StridePlan(min(position + longest, front), here.height, here.height)
        if following is None:
            return None
        # Now over the edge, to the first position on the next tread: its middle is half a sole ahead of the heels.
        over = max(self._highest_between(here, following), here.height, following.height)
        goal = self._first_heel(here, following, sole) + sole.half
        return StridePlan(goal, following.height, over)

    def _fits(self, here: Tread, there: Tread, sole: SoleMargins) -> bool:
        """Whether a sole can step from one tread to a later one, and whether it has enough space there.

        Args:
            here: the tread on which the sole stands.
            there: the later tread.
            sole: size of the soles, and how they may stand.
        """
        length = 2 * sole.half
        if there.begin - here.end > _WIDEST_GAP * length:
            return False
        beyond = next((tread for tread in self.treads if tread.begin > there.end), None)
        return self._last_toe(there, beyond, sole) - self._first_heel(here, there, sole) >= length

    def _last_toe(self, here: Tread, following: Tread | None, sole: SoleMargins) -> float:
        """Farthest position of the toes on a tread [m].

        It is beyond the far edge of the tread unless the ground beyond this edge is higher.

        Args:
            here: the tread.
            following: the tread to which the next stride leads; the ground up to it counts. If it is None, all ground
                beyond the tread does.
            sole: size of the soles, and how they may stand.
        """
        highest = self._highest_between(here, following)
        if following is not None:
            highest = max(highest, following.height)
        # Over ground that is lower, or not higher, the toes may stick out; from higher ground they keep a distance.
        is_lower = highest <= here.height + _UNEVENNESS
        return here.end + (sole.overhang if is_lower else -sole.margin)

    def _first_heel(self, here: Tread, there: Tread, sole: SoleMargins) -> float:
        """Rearmost position of the heels on a tread [m].

        It is before the begin of the tread unless the ground there, from the tread `here` on, is higher.

        Args:
            here: the tread from which a stride leads there.
            there: the tread.
            sole: size of the soles, and how they may stand.
        """
        highest = max(self._highest_between(here, there), here.height)
        is_lower = highest <= there.height + _UNEVENNESS
        return there.begin + (-sole.overhang if is_lower else sole.margin)

    def _highest_between(self, here: Tread, there: Tread | None) -> float:
        """Height of the highest ground between two treads [m].

        If the second is None, it is the highest ground beyond the first, as far as the profile goes. The height is
        minus infinity if the profile has no position between them.
        """
        end = np.inf if there is None else there.begin
        is_between = (self._along > here.end) & (self._along < end)
        return float(self._highest[is_between].max(initial=-np.inf))


def is_at_goal(position: float, distance: float) -> bool:
    """Whether feet at a position [m] are at the goal, which is at a distance [m], or nearly there or beyond."""
    return position > distance - LEAST_STRIDE


def profile_ahead(height: GroundHeight, distance: float, across: Vector) -> GroundProfile:
    """Sample the ground from a little behind the origin to a little beyond the goal, and find its treads.

    Args:
        height: height of the ground.
        distance: position of the goal [m].
        across: positions to the left at which the ground is sampled across the soles, shape (k,) [m].
    """
    first = -round(_PROFILE_BEHIND / SAMPLE)
    last = round((distance + _PROFILE_AHEAD) / SAMPLE)
    along = np.arange(first, last + 1, dtype=float) * SAMPLE
    grid = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1)
    heights = height(grid.reshape(-1, 2)).reshape(len(along), len(across))
    return GroundProfile(along, heights)


@dataclass(frozen=True)
class FootGoals:
    """Footholds of a stride.

    Attributes:
        goals: positions and turns of the feet after the stride, by foot.
        heights: heights of the ground there, by foot [m].
        over: height of the highest ground on the way [m].
    """

    goals: FootPositions
    heights: Mapping[str, float]
    over: float


class SoleFootholds:
    """Footholds of two soles, which stand side by side on one tread after each stride."""

    def __init__(
        self, gait: Climb, feet: Mapping[str, Foot], height: GroundHeight, distance: float
    ) -> None:
        """Sample the ground ahead.

        Args:
            gait: parameters of the climb.
            feet: the two feet by name.
            height: height of the ground.
            distance: position of the goal [m].
        """
        self._gait = gait
        self._feet = feet
        self._distance = distance
        self._half = max(float(foot.half[0]) for foot in feet.values())
        # At the middle and at both sides of each sole.
        across = []
        for foot in feet.values():
            middle = foot.home[1] + foot.side * gait.widen
            across += [middle + side * foot.half[1] for side in (-1, 0, 1)]
        self._ground = profile_ahead(height, distance, np.array(across))

    def height(self, position: Vector) -> float:
        """Height of the tread at a position of a foot, (3,), [m]. Only the position ahead counts.

        Raises:
            InvalidParameter: there is no tread, see :meth:`GroundProfile.tread`.
        """
        tread = self._ground.tread(position[0])
        if tread is None:
            raise InvalidParameter(
                message("programs.place_of_foot", "position of a foot"),
                message("programs.place_ahead", "{place:.2f} m ahead", place=position[0]),
                message("programs.on_level_ground", "on level ground"),
            )
        return tread.height

    def next(self, positions: FootPositions) -> FootGoals | None:
        """Choose the footholds of the next stride.

        Args:
            positions: current positions of the feet.

        Returns:
            The footholds, or None if the feet are at the goal.

        Raises:
            InvalidParameter: the feet are not at the goal, and the one that is farther ahead is on no tread, or there
                is no tread ahead on which the soles fit.
        """
        # The soles may have slipped apart; the stride is planned from the one that is farther ahead.
        position = max(float(foot_position[0]) for foot_position in positions.values())
        sole = SoleMargins(self._half, self._gait.margin, self._gait.overhang)
        stride = self._ground.next_stride(position, sole, self._gait.stride, self._distance)
        if stride is None:
            if is_at_goal(position, self._distance):
                return None
            lacks = message(
                "programs.level_for_sole",
                "level place as long as a sole ({length:.3g} m)",
                length=2 * self._half,
            )
            raise _no_foothold(self._distance, position, lacks)
        sideways = _corrected_sideways(
            np.mean([foot_position[1] for foot_position in positions.values()])
        )
        goals = {}
        for name, foot in self._feet.items():
            left = sideways + foot.home[1] + foot.side * self._gait.widen
            goals[name] = np.array([stride.position, left, 0.0])
        return FootGoals(goals, dict.fromkeys(positions, stride.height), stride.over)


class BallFootholds:
    """Footholds of four feet that are balls.

    Each foot goes where it would on level ground, or near there if the ground is not even there.
    """

    def __init__(
        self, gait: Climb, feet: Mapping[str, Foot], height: GroundHeight, distance: float
    ) -> None:
        """Prepare a height map of the ground.

        Args:
            gait: parameters of the climb.
            feet: the four feet by name.
            height: height of the ground.
            distance: position of the goal [m].
        """
        self._gait = gait
        self._distance = distance
        self._height = height
        # The map gives points (m, 3), of which only the horizontal position counts here.
        self._map = HeightMap(lambda points: height(points[:, :2]), _BALL_HALF)
        # Position of each foot from the middle of the feet on level ground, shape (2,) [m].
        middle = np.mean([foot.home[:2] for foot in feet.values()], axis=0)
        self._homes = {
            name: foot.home[:2] - middle + [0, foot.side * gait.widen]
            for name, foot in feet.items()
        }

    def height(self, position: Vector) -> float:
        """Height of the ground at a position of a foot, (3,), [m]."""
        return float(self._height(position[np.newaxis, :2])[0])

    def next(self, positions: FootPositions) -> FootGoals | None:
        """Choose the footholds of the next stride.

        Args:
            positions: current positions of the feet.

        Returns:
            The footholds, or None if the feet are at the goal, or as near to it as the ground allows.

        Raises:
            InvalidParameter: one of the feet has no foothold nearby that is even enough and within the step height
                `rise`, or the four footholds bring the robot no farther although the goal is farther ahead.
        """
        middle = np.mean([position[:2] for position in positions.values()], axis=0)
        if is_at_goal(middle[0], self._distance):
            return None
        ahead = min(middle[0] + self._gait.stride, self._distance)
        aim = np.array([ahead, _corrected_sideways(middle[1])])
        goals = {
            name: self._find_foothold(name, aim + home, positions[name])
            for name, home in self._homes.items()
        }
        # No progress: uneven ground has kept the feet near where they are.
        reached = np.mean([goal[0] for goal in goals.values()])
        if reached < middle[0] + LEAST_STRIDE:
            if aim[0] < self._distance:
                lacks = message(
                    "programs.even_places_ahead", "even places for the feet farther ahead"
                )
                raise _no_foothold(self._distance, float(middle[0]), lacks)
            return None  # the goal itself is uneven
        heights = {name: self.height(goal) for name, goal in goals.items()}
        # The ground under the straight lines on which the feet swing.
        count = 1 + round(self._gait.stride / SAMPLE)
        ways = [np.linspace(positions[name][:2], goal[:2], count) for name, goal in goals.items()]
        highest = float(self._height(np.concatenate(ways)).max())
        return FootGoals(goals, heights, highest)

    def _find_foothold(self, name: str, desired: Vector, current: Vector) -> Vector:
        """Find the foothold of a foot: the desired position if it is even, or else the best one near it.

        The best one has the least cost of the distance from there, of unevenness, and of steps that are too high; see
        :meth:`HeightMap.shift`.

        Args:
            name: name of the foot, for the error message.
            desired: desired position, shape (2,) [m].
            current: current position and turn of the foot, shape (3,).

        Returns:
            Position and turn, shape (3,). The turn is 0: the foot shall look along the path.

        Raises:
            InvalidParameter: at all positions nearby the ground is not even enough, too high or too low.
        """
        level = self.height(current)
        rise = self._gait.rise
        # The middle and the sides of a square under the ball, smaller by half a cell of the map, in which the
        # positions are rounded.
        across = (_BALL_HALF - CELL / 2) * np.array([-1, 0, 1])
        square = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)

        def is_allowed(shifts: Shifts) -> npt.NDArray[np.bool_]:
            """Whether the ground at the desired position, moved by each of some shifts, is even and in reach.

            A shift is a complex number: its real part is ahead, its imaginary part to the left [m].
            """
            centres = desired + np.stack([shifts.real, shifts.imag], axis=-1)[..., np.newaxis, :]
            points = (centres + square).reshape(-1, 2)
            heights = self._height(points).reshape(*shifts.shape, len(square))
            is_even = np.ptp(heights, axis=-1) <= _BALL_UNEVENNESS
            is_in_reach = np.abs(heights - level).max(axis=-1) <= rise
            return np.asarray(is_even & is_in_reach)

        # The best shift that is allowed, with no shift before. The map returns no shift as well if none is allowed.
        shift = self._map.shift([complex(*desired)], 0j, is_allowed, level, rise)
        if not is_allowed(np.array([shift])).all():
            lacks = message(
                "programs.even_place_for_foot",
                "even place for {name} within {rise:g} m of height (rise)",
                name=name,
                rise=rise,
            )
            raise _no_foothold(self._distance, float(current[0]), lacks)
        return np.array([desired[0] + shift.real, desired[1] + shift.imag, 0.0])


Footholds = SoleFootholds | BallFootholds
"""Choice of the footholds of a climb."""


def _corrected_sideways(sideways: float) -> float:
    """Sideways position after a stride [m]. It is closer to 0 by at most the correction of one stride."""
    return float(sideways - np.clip(sideways, -_SIDE_CORRECTION, _SIDE_CORRECTION))


def _no_foothold(distance: float, position: float, lacks: str) -> InvalidParameter:
    """Make the error for ground without footholds before the goal.

    Args:
        distance: position of the goal [m].
        position: position from which no stride leads on [m].
        lacks: what the ground lacks, for the message.
    """
    expected = message(
        "programs.ground_beyond",
        "at most {place:.2f} m: the ground beyond has no {lacks}",
        place=position,
        lacks=lacks,
    )
    return InvalidParameter("distance", compound("{distance:g} m", distance=distance), expected)
