"""Where feet go next on the ground ahead: both soles onto the next tread, or each of four feet onto even ground."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.programs.gaits.climb import Climb
from simrob_drake.programs.gaits.treads import AT_ONCE, SAMPLE, SoleMargins, profile_ahead
from simrob_drake.programs.gaits.walker import Foot
from simrob_drake.walking.height_map import CELL, HeightMap
from simrob_drake.walking.height_map import Places as Shifts

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
            raise InvalidParameter("place of a foot", f"{place[0]:.2f} m ahead", "on level ground")
        return tread.height

    def next(self, places: Places) -> FootGoals | None:
        """Return both soles' stride to a place; None at the goal; raises InvalidParameter: it lies beyond treads."""
        place = max(float(each[0]) for each in places.values())
        sole = SoleMargins(self._half, self._gait.margin, self._gait.overhang)
        stride = self._ground.next_stride(place, sole, self._gait.stride, self._distance)
        if stride is None:
            if not self._ground.reaches(place, self._distance):
                raise _ends(self._distance, place, f"level place as long as a sole ({2 * self._half:.3g} m)")
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
                raise _ends(self._distance, float(middle[0]), "even places for the feet farther ahead")
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
            raise _ends(self._distance, float(now[0]), f"even place for {name} within {rise:g} m of height (rise)")
        return np.array([wish[0] + shift.real, wish[1] + shift.imag, 0.0])


Footholds = SoleFootholds | BallFootholds  # chooses where feet go


def _kept_aside(aside: float) -> float:
    """Return how far aside the next stride ends [m]: it makes good what it can."""
    return float(aside - np.clip(aside, -_ASIDE, _ASIDE))


def _ends(distance: float, place: float, lacks: str) -> InvalidParameter:
    expected = f"at most {place:.2f} m: the ground beyond has no {lacks}"
    return InvalidParameter("distance", f"{distance:g} m", expected)
