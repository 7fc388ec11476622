"""What a walking robot does, seen from the foot that stands, and slopes that feet tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Measured:
    """What a robot does, seen from the foot that stands.

    Attributes:
        com, xi: centre of mass and divergent component [m].
        lean, pitch: of the trunk, to the right and ahead [rad].
        heading: where the trunk looks in the world [rad].
        slope: of the soles that stand, ahead and to the left [1].
        touches: whether the swinging foot touches, or both feet of a pair.
        down: which feet of a pair that swings feel the ground.
        hangs: which of those that stand do not.
    """

    com: complex
    xi: complex
    lean: float
    pitch: float
    heading: float
    slope: complex
    touches: bool
    down: tuple[bool, ...] = ()
    hangs: tuple[bool, ...] = ()


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
