"""Level ground ahead, tread after tread, and where soles can stand on it: of stairs, gaps, thresholds and tiles."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from simrob_drake.frames import Vector

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
