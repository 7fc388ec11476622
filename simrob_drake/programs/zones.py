"""Zones, as RAPID's: how near to a target a motion may leave the way there for the way to the next.

Two ways that meet are laid over each other within the zone: what is left of the first, and what is gone of the second.
Of the distance x before (negative) or behind the corner, in zones, :math:`g(x) = 2 t^3 - t^4` with
:math:`t = (x + 1) / 2` is gone of the second and :math:`g(-x)` left of the first, so that place, direction and
curvature go on without a jump: :math:`g'` rises from 0 to 1, and :math:`g(x) - g(-x) = x`.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from simrob_drake.arguments import positive
from simrob_drake.errors import InvalidParameter, quoted
from simrob_drake.frames import Vector
from simrob_drake.interpolation import stacked

_LARGEST = 200  # mm, of RAPID's zones
_SMALLEST = 3e-4  # m: z0
_KNOWN = f"'fine', 'z0' to 'z{_LARGEST}' for so many millimetres, or a number from {_SMALLEST:g} [m]"
_TOO_WIDE = 1 + 1e-9

Curve = Callable[[Vector], Vector]
"""Gives postures (k, n), or poses (k, 4, 4), at parts (k,) of a way."""


@dataclass(frozen=True)
class Way:
    """A way to one target, or past several: where it leads at its parts, how long it is [m], where the targets are."""

    curve: Curve
    length: float
    passes: Vector = field(default_factory=lambda: np.ones(1))


def zone_size(zone: object) -> float:
    """Return how far from a target a zone begins [m]; 0 for ``fine``.

    Raises:
        InvalidParameter: no zone.
    """
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
    """Return ways to one target each as one that passes their targets within zones [m].

    Raises:
        InvalidParameter: a zone larger than half of a way that leads into or out of it.
    """
    ends = np.cumsum([way.length for way in ways])
    for index, pair in enumerate(pairwise(ways)):
        most = min(way.length for way in pair) / 2
        if zone > most * _TOO_WIDE:
            expected = f"at most {1e3 * most:.4g} mm at targets[{index}]: half of the shorter way that meets there"
            raise InvalidParameter("zone", f"{1e3 * zone:.4g} mm", expected)

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
