"""A careful stride: one foot after the other goes up, ahead and down, the weight over what stands; and where to.

Strides take a robot over stairs, gaps and thresholds, one after the other, each planned from where its feet have come
to stand. Soles with edges may stand over an edge of the ground by a part of their length, as on stairs; so a stride
over an edge is shorter than the sole. On four legs the weight is over the other three feet.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.files import ROBOT_FILE
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.sections import NotNegative, Number, Positive
from simrob_drake.blocks.references import smooth
from simrob_drake.programs.gaits.biped import SIDES
from simrob_drake.programs.gaits.motion import JointMotion, Pace, SolvedGait
from simrob_drake.programs.gaits.phases import GaitPlan, Phase, gait_plan
from simrob_drake.programs.gaits.quadruped import CRAWL_ORDER, moved_inside
from simrob_drake.programs.gaits.walker import Foot, Walker
from simrob_drake.programs.gaits.whole_body import WholeBody
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.walking.height_map import CELL, HeightMap
from simrob_drake.walking.height_map import Places as Shifts

SAMPLE = 0.002  # m between the places that are looked at, along the way
_LEVEL = 0.004  # m that a tread is uneven at most
AT_ONCE = 0.012  # m; a shorter way is not worth a stride

_FARTHEST = 1.0  # soles that fit between two treads of which one leads to the other


@dataclass(frozen=True)
class Tread:
    """A level stretch of the way."""

    begin: float  # along the way [m]
    end: float
    height: float  # [m]


@dataclass(frozen=True)
class StridePlan:
    """Where both soles go next."""

    place: float  # of their middles, along the way [m]
    height: float  # of the ground there [m]
    over: float  # the highest ground on the way there [m]


@dataclass(frozen=True)
class SoleMargins:
    """How a sole may stand on a tread."""

    half: float  # of its length [m]
    margin: float  # from a riser that is before its toe, or behind its heel [m]
    overhang: float  # over an edge below which the ground is lower [m]


class GroundProfile:
    """The ground on the way ahead, as far as soles feel it."""

    def __init__(self, along: Vector, heights: Vector) -> None:
        """Take heights (m, k) [m] of the ground across the soles at places (m,) along the way [m], in steps alike."""
        self._along, self._highest = along, heights.max(axis=1)
        level = np.ptp(heights, axis=1) <= _LEVEL
        breaks = (np.diff(level) != 0) | (np.abs(np.diff(self._highest)) > _LEVEL)
        runs = np.split(np.arange(len(along)), np.flatnonzero(breaks) + 1)
        self.treads = [
            Tread(float(along[run[0]]), float(along[run[-1]]), float(np.median(self._highest[run])))
            for run in runs
            if level[run[0]] and np.ptp(self._highest[run]) <= _LEVEL
        ]

    def tread(self, place: float) -> Tread | None:
        """Return the tread at a place [m]; None where the ground is not level."""
        return next((each for each in self.treads if each.begin <= place <= each.end), None)

    def next_stride(self, place: float, sole: SoleMargins, longest: float, distance: float) -> StridePlan | None:
        """Return where soles go from a place [m], in strides on one level of a length [m] at most.

        None: they stand at the distance [m], or there is nothing to stand on before it.
        """
        here = self.tread(place)
        if here is None or self.reaches(place, distance):
            return None
        after = next((each for each in self.treads if each.begin > here.end and self._fits(here, each, sole)), None)
        front = min(self._toe(here, after, sole) - sole.half, distance)
        if front - place > AT_ONCE:
            return StridePlan(min(place + longest, front), here.height, here.height)
        if after is None:
            return None
        over = max(self._between(here, after), here.height, after.height)
        return StridePlan(self._heel(here, after, sole) + sole.half, after.height, over)

    def reaches(self, place: float, distance: float) -> bool:
        """Tell whether soles at a place stand at the distance [m]."""
        return place > distance - AT_ONCE

    def _fits(self, here: Tread, there: Tread, sole: SoleMargins) -> bool:
        if there.begin - here.end > _FARTHEST * 2 * sole.half:
            return False
        beyond = next((each for each in self.treads if each.begin > there.end), None)
        return self._toe(there, beyond, sole) - self._heel(here, there, sole) >= 2 * sole.half

    def _toe(self, here: Tread, after: Tread | None, sole: SoleMargins) -> float:
        """Return how far toes may go on a tread [m], from which the next stride leads to another one."""
        ahead = self._between(here, after) if after is None else max(self._between(here, after), after.height)
        return here.end + (sole.overhang if ahead <= here.height + _LEVEL else -sole.margin)

    def _heel(self, here: Tread, there: Tread, sole: SoleMargins) -> float:
        """Return where heels may stand first on a tread [m] to which a stride from here leads."""
        behind = max(self._between(here, there), here.height)
        return there.begin + (-sole.overhang if behind <= there.height + _LEVEL else sole.margin)

    def _between(self, here: Tread, there: Tread | None) -> float:
        """Return the highest ground between two treads [m], or as far behind the first as is known."""
        rows = (self._along > here.end) & (self._along < (np.inf if there is None else there.begin))
        return float(self._highest[rows].max(initial=-np.inf))


def profile_ahead(height: Callable[[Vector], Vector], distance: float, across: Vector) -> GroundProfile:
    """Return the way for a distance [m], seen by rows of places across it (k,) [m] to the left.

    ``height`` tells that of the ground, (m,) [m], at places ahead and to the left (m, 2) [m].
    """
    along = np.arange(-round(0.3 / SAMPLE), round((distance + 0.5) / SAMPLE) + 1, dtype=float) * SAMPLE
    grid = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1)
    return GroundProfile(along, height(grid.reshape(-1, 2)).reshape(len(along), len(across)))


Place = tuple[Number, Number, Number, Number]  # of a sole: ahead, left, up [m] and turn [rad]

_UP, _DOWN = 0.35, 0.35  # parts of a swing in which the foot goes up, and down
_AHEAD = (0.25, 0.8)  # from when to when of it the foot goes ahead
_CARRIED = (0.1, 0.9)  # from when to when of a swing the trunk goes up


class Climb(SolvedGait):
    """All feet a stride ahead, one after the other, on ground that may rise and fall between them."""

    section: ClassVar[str] = "climbs"
    usual: ClassVar[str] = "climb"

    start: Mapping[str, Place] | None = None
    """Where the soles stand at first, by foot; side by side unless given. The lowest is at the height 0."""
    goals: Mapping[str, Place] | None = None
    """Where they go; `stride` ahead unless given."""
    over: NotNegative = 0.0
    """The highest ground on the way, over the lowest sole at first [m]."""
    turned: Number = 0.0
    """The turn of the trunk at first, to the left [rad]; it ends at 0."""
    stride: Positive = 0.1
    """The longest way of a foot on one level [m]."""
    lift: Positive = 0.03
    """How high the soles pass over the ground [m]."""
    step_time: Pace = 1.2
    """From one footfall to the next [s]."""
    double_support: Positive = 0.4
    """Part of a step in which all feet stand."""
    settle: Pace = 0.8
    """Time to shift the weight from the foot that goes first, and to all of them again [s]."""
    zmp_inward: Number = 0.0
    """How far inside of the middle of a standing foot the zero-moment point goes, on two legs [m]."""
    inside: Positive = 0.04
    """How far inside of the triangle of three standing feet it stays, on four [m]."""
    margin: NotNegative = 0.02
    """What toes keep from a riser, and heels from one that they have come down [m]."""
    overhang: NotNegative = 0.035
    """By how much a sole with edges may stand over an edge below which the ground is lower [m]."""
    rise: Positive = 0.06
    """How far a foot of four steps up or down at most [m]."""
    rest: NotNegative = 0.0
    """Time to stand at the end [s]."""

    def plan(self, walker: Walker, steps: int = 0, amplitude: float = 1.0) -> JointMotion:
        """Return its motion; raises InvalidParameter: a robot of other legs, or whose feet cannot be level."""
        feet = {foot.name: foot for foot in walker.feet(self.feet)}
        two = sorted(feet) == sorted(SIDES) and all(len(foot.axes) == 6 for foot in feet.values())
        if not two and sorted(feet) != sorted(CRAWL_ORDER):
            expected = message(
                "programs.legs_to_climb", "one with two legs of six joints, or with four legs, to climb so"
            )
            raise InvalidParameter(
                message("base.robot_called", "robot {name}", name=walker.model.name),
                message("programs.count_of_feet", "one with {count} feet", count=len(feet)),
                expected,
            )
        return WholeBody(walker, self, self._gait_plan(feet)).solve()[0]

    def check_feet(self, model: RobotModel, worn: str | None, key: str) -> None:
        """Check that the feet can stand on steps, on which soles of two legs stand with their edges."""
        if has_edges(model, worn):
            return
        assert model.feet is not None  # a robot without feet has no climb
        edged = [name for name in model.feet.contacts if has_edges(model, name)]
        if edged:
            choices = join_texts([f"--set {key}={name}" for name in edged], message("base.or", " or "))
            expected = message(
                "programs.soles_with_edges",
                "soles with edges (boxes), which may stand over those of stairs: {choices}",
                choices=choices,
            )
        else:
            expected = message(
                "programs.describe_soles",
                "soles with edges, which may stand over those of stairs: give the robot boxes under feet.contacts in "
                "its {file}",
                file=ROBOT_FILE,
            )
        raise InvalidParameter(message("programs.feet_of", "feet of {model}", model=model.name), str(worn), expected)

    def _gait_plan(self, feet: Mapping[str, Foot]) -> GaitPlan:
        """Return what feet, trunk and zero-moment point do."""
        order = SIDES if len(feet) == len(SIDES) else CRAWL_ORDER
        at = {name: np.array(self.start[name] if self.start else self._home(feet[name])) for name in order}
        goals = {
            name: np.array(self.goals[name]) if self.goals else at[name] + [self.stride, 0, 0, 0] for name in order
        }
        swing, all_stand = (1 - self.double_support) * self.step_time, self.double_support * self.step_time
        phases, begins, now = list[Phase](), dict[str, float](), dict(at)
        for name in order:
            shift = all_stand if phases else self.settle
            begins[name] = sum(phase.duration for phase in phases) + shift
            under = self._under({foot: now[foot][:2] for foot in order if foot != name}, now, feet)
            phases += [Phase(shift, under, shift), Phase(swing, under, 0.0)]
            now[name] = goals[name]
        phases.append(Phase(self.settle + self.rest, _middle(goals), self.settle))
        way = gait_plan({name: place[[0, 1, 3]] for name, place in at.items()}, _middle(at), phases)
        times = way.times
        shares = {name: _share(times, begins[name], swing) for name in order}
        paths = {name: self._swung(shares[name], at[name], goals[name]) for name in order}
        standing = {name: (share <= 0) | (share >= 1) for name, share in shares.items()}
        heading = self.turned * (1.0 - smooth(_share(times, 0.0, begins[order[-1]] + swing)))
        ground = self._ground(times, begins, swing, at, goals)
        return replace(way, feet=paths, heading=heading, ground=ground, standing=standing)

    def _home(self, foot: Foot) -> Place:
        """Return where a foot stands unless a start is given; those of two are side by side."""
        ahead = 0.0 if foot.name in SIDES else float(foot.home[0])
        return ahead, float(foot.home[1]) + foot.side * self.widen, 0.0, 0.0

    def _under(self, standing: Mapping[str, Vector], now: Mapping[str, Vector], feet: Mapping[str, Foot]) -> Vector:
        """Return where the weight is while those feet stand, shape (2,) [m]."""
        if len(standing) == 1:
            ((name, place),) = standing.items()
            return place - [0.0, feet[name].side * self.zmp_inward]
        return moved_inside(_middle(now), np.array(list(standing.values())), self.inside)

    def _swung(self, share: Vector, start: Vector, goal: Vector) -> Vector:
        """Return the places (m, 4) of a sole at shares (m,) of its swing: up, ahead, and down."""
        top = max(start[2], goal[2], self.over) + self.lift
        path = start + np.outer(smooth(_share(share, _AHEAD[0], _AHEAD[1] - _AHEAD[0])), goal - start)
        up, down = smooth(_share(share, 0.0, _UP)), smooth(_share(share, 1.0 - _DOWN, _DOWN))
        path[:, 2] = start[2] + (top - start[2]) * up - (top - goal[2]) * down
        return path

    def _ground(
        self, times: Vector, begins: Mapping[str, float], swing: float, at: Mapping[str, Vector],
        goals: Mapping[str, Vector],
    ) -> Vector:  # fmt: skip
        """Return heights (m,) over which the trunk is carried: it sinks before a foot does, and rises with the last.

        On two feet it is the lower one, on four their mean.
        """
        level = min if len(at) == len(SIDES) else np.mean
        now = {name: place[2] for name, place in at.items()}
        last = float(level(list(now.values())))
        heights, before = np.full(len(times), last), self.settle
        for name, begin in begins.items():
            now[name] = goals[name][2]
            change = float(level(list(now.values()))) - last
            if change > 0:
                share = _share(times, begin + _CARRIED[0] * swing, (_CARRIED[1] - _CARRIED[0]) * swing)
            else:
                share = _share(times, begin - before, before)
            heights, last, before = (
                heights + change * smooth(share),
                last + change,
                self.double_support * self.step_time,
            )
        return heights


def has_edges(model: RobotModel, worn: str | None) -> bool:
    """Check whether the feet of a robot can stand on steps: two soles need edges, balls of four feet do not.

    Args:
        model: the robot; it has feet.
        worn: the kind of feet that it wears; None for its usual ones.
    """
    assert model.feet is not None  # or it had no gait
    feet = model.feet.kind(worn)
    return len(feet.links) != len(SIDES) or bool(feet.boxes)


def _middle(places: Mapping[str, Vector]) -> Vector:
    """Return the middle of feet, shape (2,) [m]."""
    return np.asarray(np.mean([place[:2] for place in places.values()], axis=0))


def _share(times: Vector, begin: float, length: float) -> Vector:
    """Return which part of a stretch of time has gone by, 0 before it and 1 after it."""
    return np.clip((times - begin) / length, 0.0, 1.0)


Places = Mapping[str, Vector]  # of feet, by name: ahead, left [m] and turn [rad], in the frame of the way
Height = Callable[[Vector], Vector]  # gives that of the ground (m,) [m] at places ahead and to the left (m, 2) [m]

_ASIDE = 0.02  # m that a stride makes good, at most, of what the last ones went aside
_EVEN = 0.015  # m that the ground under a ball of a foot is uneven at most
_ROUND = 0.02  # half of the square under a ball that has to be even [m]


@dataclass(frozen=True)
class FootGoals:
    """Where feet go."""

    goals: Places
    heights: Mapping[str, float]  # of the ground there [m]
    over: float  # the highest ground on the way [m]


class SoleFootholds:
    """Of two soles, which stand side by side on one tread."""

    def __init__(self, gait: Climb, feet: Mapping[str, Foot], height: Height, distance: float) -> None:
        """Look ahead for a distance [m]."""
        self._gait, self._feet, self._distance = gait, feet, distance
        self._half = max(float(foot.half[0]) for foot in feet.values())
        across = [
            foot.home[1] + foot.side * gait.widen + part * foot.half[1] for foot in feet.values() for part in (-1, 0, 1)
        ]
        self._ground = profile_ahead(height, distance, np.array(across))

    def height(self, place: Vector) -> float:
        """Return that of the tread at a place of a foot, (3,) [m]; raises InvalidParameter: the ground is not level."""
        tread = self._ground.tread(place[0])
        if tread is None:
            raise InvalidParameter(
                message("programs.place_of_foot", "place of a foot"),
                message("programs.place_ahead", "{place:.2f} m ahead", place=place[0]),
                message("programs.on_level_ground", "on level ground"),
            )
        return tread.height

    def next(self, places: Places) -> FootGoals | None:
        """Return both soles' stride to a place; None at the goal; raises InvalidParameter: it lies beyond treads."""
        place = max(float(each[0]) for each in places.values())
        sole = SoleMargins(self._half, self._gait.margin, self._gait.overhang)
        stride = self._ground.next_stride(place, sole, self._gait.stride, self._distance)
        if stride is None:
            if not self._ground.reaches(place, self._distance):
                raise _ends(
                    self._distance,
                    place,
                    message(
                        "programs.level_for_sole",
                        "level place as long as a sole ({length:.3g} m)",
                        length=2 * self._half,
                    ),
                )
            return None
        aside, goals = _kept_aside(np.mean([each[1] for each in places.values()])), dict[str, Vector]()
        for name, foot in self._feet.items():
            goals[name] = np.array([stride.place, aside + foot.home[1] + foot.side * self._gait.widen, 0.0])
        return FootGoals(goals, dict.fromkeys(places, stride.height), stride.over)


class BallFootholds:
    """Of four feet that are balls: each goes where it would on level ground, or near there where that is not even."""

    def __init__(self, gait: Climb, feet: Mapping[str, Foot], height: Height, distance: float) -> None:
        """Look ahead for a distance [m]."""
        self._gait, self._distance, self._height = gait, distance, height
        self._map = HeightMap(lambda points: height(points[:, :2]), _ROUND)
        middle = np.mean([foot.home[:2] for foot in feet.values()], axis=0)
        self._homes = {name: foot.home[:2] - middle + [0, foot.side * gait.widen] for name, foot in feet.items()}

    def height(self, place: Vector) -> float:
        """Return that of the ground beneath a place of a foot, (3,) [m]."""
        return float(self._height(place[np.newaxis, :2])[0])

    def next(self, places: Places) -> FootGoals | None:
        """Return the stride of the feet's middle; None at the goal; raises InvalidParameter: no foothold before it."""
        middle = np.mean([place[:2] for place in places.values()], axis=0)
        if middle[0] > self._distance - AT_ONCE:
            return None
        aim = np.array([min(middle[0] + self._gait.stride, self._distance), _kept_aside(middle[1])])
        goals = {name: self._foothold(name, aim + home, places[name]) for name, home in self._homes.items()}
        if np.mean([goal[0] for goal in goals.values()]) < middle[0] + AT_ONCE:
            if aim[0] < self._distance:
                raise _ends(
                    self._distance,
                    float(middle[0]),
                    message("programs.even_places_ahead", "even places for the feet farther ahead"),
                )
            return None  # the goal itself is uneven
        ways = [np.linspace(places[name][:2], goals[name][:2], 1 + round(self._gait.stride / SAMPLE)) for name in goals]
        heights = {name: self.height(goal) for name, goal in goals.items()}
        return FootGoals(goals, heights, float(self._height(np.concatenate(ways)).max()))

    def _foothold(self, name: str, wish: Vector, now: Vector) -> Vector:
        level, rise = self.height(now), self._gait.rise
        square = (_ROUND - CELL / 2) * np.array([-1, 0, 1])  # the map has rounded the place
        under = np.stack(np.meshgrid(square, square), axis=-1).reshape(-1, 2)

        def holds(shifts: Shifts) -> npt.NDArray[np.bool_]:
            places = wish + np.stack([shifts.real, shifts.imag], axis=-1)[..., np.newaxis, :] + under
            heights = self._height(places.reshape(-1, 2)).reshape(*shifts.shape, len(under))
            return np.asarray((np.ptp(heights, axis=-1) <= _EVEN) & (np.abs(heights - level).max(axis=-1) <= rise))

        shift = self._map.shift([complex(*wish)], 0j, holds, level, rise)
        if not holds(np.array([shift])).all():
            raise _ends(
                self._distance,
                float(now[0]),
                message(
                    "programs.even_place_for_foot",
                    "even place for {name} within {rise:g} m of height (rise)",
                    name=name,
                    rise=rise,
                ),
            )
        return np.array([wish[0] + shift.real, wish[1] + shift.imag, 0.0])


Footholds = SoleFootholds | BallFootholds  # chooses where feet go


def _kept_aside(aside: float) -> float:
    """Return how far aside the next stride ends [m]: it makes good what it can."""
    return float(aside - np.clip(aside, -_ASIDE, _ASIDE))


def _ends(distance: float, place: float, lacks: str) -> InvalidParameter:
    expected = message(
        "programs.ground_beyond", "at most {place:.2f} m: the ground beyond has no {lacks}", place=place, lacks=lacks
    )
    return InvalidParameter("distance", compound("{distance:g} m", distance=distance), expected)
