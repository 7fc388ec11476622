"""Units of Simscape as factors to SI: ``N*m/(deg/s)``, ``kg/m^3``, ``cm``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

Dimension = tuple[Fraction, Fraction, Fraction]
"""Powers of kg, m and s; angles have none."""


class UnknownUnit(ValueError):
    """A text that is no unit known here."""


@dataclass(frozen=True)
class Unit:
    """A unit: how many SI units it is, and of which dimension."""

    factor: float
    dimension: Dimension

    def __mul__(self, other: Unit) -> Unit:
        return Unit(self.factor * other.factor, _added(self.dimension, other.dimension, 1))

    def __truediv__(self, other: Unit) -> Unit:
        return Unit(self.factor / other.factor, _added(self.dimension, other.dimension, -1))

    def __pow__(self, power: int) -> Unit:
        kg, m, s = self.dimension
        return Unit(self.factor**power, (kg * power, m * power, s * power))


def _added(first: Dimension, second: Dimension, sign: int) -> Dimension:
    return (first[0] + sign * second[0], first[1] + sign * second[1], first[2] + sign * second[2])


def _unit(factor: float, kg: int = 0, m: int = 0, s: int = 0) -> Unit:
    return Unit(factor, (Fraction(kg), Fraction(m), Fraction(s)))


_POUND, _FOOT, _STANDARD_GRAVITY = 0.45359237, 0.3048, 9.80665
_KNOWN = {
    "1": _unit(1.0),
    "m": _unit(1.0, m=1),
    "cm": _unit(1e-2, m=1),
    "mm": _unit(1e-3, m=1),
    "um": _unit(1e-6, m=1),
    "km": _unit(1e3, m=1),
    "in": _unit(0.0254, m=1),
    "ft": _unit(_FOOT, m=1),
    "rad": _unit(1.0),
    "deg": _unit(math.pi / 180),
    "rev": _unit(2 * math.pi),
    "kg": _unit(1.0, kg=1),
    "g": _unit(1e-3, kg=1),
    "mg": _unit(1e-6, kg=1),
    "t": _unit(1e3, kg=1),
    "tonne": _unit(1e3, kg=1),
    "lbm": _unit(_POUND, kg=1),
    "slug": _unit(_POUND * _STANDARD_GRAVITY / _FOOT, kg=1),
    "s": _unit(1.0, s=1),
    "ms": _unit(1e-3, s=1),
    "min": _unit(60.0, s=1),
    "hr": _unit(3600.0, s=1),
    "rpm": _unit(math.pi / 30, s=-1),
    "Hz": _unit(1.0, s=-1),
    "N": _unit(1.0, kg=1, m=1, s=-2),
    "kN": _unit(1e3, kg=1, m=1, s=-2),
    "mN": _unit(1e-3, kg=1, m=1, s=-2),
    "lbf": _unit(_POUND * _STANDARD_GRAVITY, kg=1, m=1, s=-2),
    "J": _unit(1.0, kg=1, m=2, s=-2),
    "W": _unit(1.0, kg=1, m=2, s=-3),
    "Pa": _unit(1.0, kg=1, m=-1, s=-2),
    "gee": _unit(_STANDARD_GRAVITY, m=1, s=-2),
}
_TOKEN = re.compile(r"\s*([A-Za-z]+|\d+|[*/^()-])")


@lru_cache(maxsize=1000)
def parse_unit(text: str) -> Unit:
    """Return a unit.

    Raises:
        UnknownUnit: the text is none.
    """
    tokens: list[str] = []
    place = 0
    text = text.strip()
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None or len(tokens) > 50:
            raise UnknownUnit(f"'{text[:40]}' is no unit")
        tokens.append(match[1])
        place = match.end()
    try:
        unit = _product(tokens)
    except (IndexError, KeyError, ValueError, OverflowError, ZeroDivisionError):
        raise UnknownUnit(f"'{text[:40]}' is no unit known here") from None
    if tokens:
        raise UnknownUnit(f"'{text[:40]}' is no unit")
    return unit


def _product(tokens: list[str]) -> Unit:
    unit = _power(tokens)
    while tokens and tokens[0] in "*/":
        unit = unit * _power(tokens) if tokens.pop(0) == "*" else unit / _power(tokens)
    return unit


def _power(tokens: list[str]) -> Unit:
    word = tokens.pop(0)
    if word == "(":
        unit = _product(tokens)
        if tokens.pop(0) != ")":
            raise ValueError
    else:
        unit = _KNOWN[word]
    if tokens and tokens[0] == "^":
        tokens.pop(0)
        sign = -1 if tokens[0] == "-" and tokens.pop(0) else 1
        power = int(tokens.pop(0))
        if power > 6:
            raise ValueError
        unit = unit ** (sign * power)
    return unit


def factor(text: str, like: str) -> float:
    """Return what one unit is in SI.

    Args:
        text: the unit.
        like: a unit of the dimension that is asked for, such as ``m``.

    Raises:
        UnknownUnit: it is no unit, or one of another dimension.
    """
    unit, target = parse_unit(text), parse_unit(like)
    if unit.dimension != target.dimension:
        raise UnknownUnit(f"the unit {text} does not fit; it must be one like {like}")
    return unit.factor
