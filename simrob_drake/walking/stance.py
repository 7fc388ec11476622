"""How the feet of a robot stand about each other, and the slopes that they tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.walking.body import Body
from simrob_drake.walking.parameters import WalkingParameters


@dataclass(frozen=True)
class StanceFeet:
    """The feet of a robot in two groups that stand and swing in turn, 0 the right one, 1 the left one.

    Attributes:
        groups: the feet of each group, by their places.
        about: where they stand about the middle of their group [m].
        planes: what each counts for the slope of its group [1/m].
        half: how far the middles of the groups are to the side of the robot's [m].
        rolls: how much further than its legs go a robot gets because its feet roll meanwhile.
    """

    groups: Sequence[Sequence[int]]
    about: Sequence[Sequence[complex]]
    planes: Sequence[Sequence[complex]]
    half: float
    rolls: float

    @classmethod
    def of(cls, body: Body, parameters: WalkingParameters, groups: Sequence[Sequence[int]]) -> StanceFeet:
        """Return the stance of a robot; ``groups`` are its feet that stand together, the right ones first."""
        homes = [complex(*home[:2]) + 1j * math.copysign(parameters.widen, home[1]) for home in body.homes]
        middles = [sum(homes[foot] for foot in group) / len(group) for group in groups]
        about = [[homes[foot] - middle for foot in group] for group, middle in zip(groups, middles, strict=True)]
        rolls = 1.0 + body.over / (parameters.bearing.height - body.over)
        return cls(groups, about, [planes(each) for each in about], 0.5 * (middles[1] - middles[0]).imag, rolls)

    def omega(self, height: float) -> float:
        """Return that of the pendulum [1/s]: its point comes after it where feet are balls, and it falls slower."""
        return math.sqrt(STANDARD_GRAVITY / (height * self.rolls))


def uphill(slope: complex, place: complex) -> float:
    """Return how much higher a place is on a slope than its origin [m]."""
    return (slope.conjugate() * place).real


def planes(places: Sequence[complex]) -> list[complex]:
    """Return what each of some places counts for the slope of the plane, or the line, through them [1/m]."""
    ahead, left = np.linalg.pinv([(place.real, place.imag) for place in places]).tolist()
    return [complex(*parts) for parts in zip(ahead, left, strict=True)]


def sloped(plane: Sequence[complex], ways: Sequence[float]) -> complex:
    """Return the slope of a plane or line through feet that are raised by so much [m]."""
    return sum((part * way for part, way in zip(plane, ways, strict=True)), 0j)
