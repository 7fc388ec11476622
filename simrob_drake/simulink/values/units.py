"""Units of Simscape as factors to SI: ``N*m/(deg/s)``, ``kg/m^3``, ``cm``."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.simulink.values.syntax import Expression, NotUnderstood, parse


class UnknownUnit(ValueError):
    """A text that is no unit known here."""


class Unit(NamedTuple):
    """A unit: how many SI units it is, and the powers of kg, m, s and A in it; angles have none."""

    factor: float
    dimension: tuple[int, ...] = (0, 0, 0, 0)

    def times(self, other: "Unit", power: int = 1) -> "Unit":
        """Return the product with a power of another unit."""
        powers = tuple(one + power * own for one, own in zip(self.dimension, other.dimension, strict=True))
        return Unit(self.factor / other.factor if power == -1 else self.factor * other.factor**power, powers)


_POUND, _FOOT = 0.45359237, 0.3048
_BASES = {name: Unit(1.0, tuple(row)) for name, row in zip(("kg", "m", "s", "A"), np.eye(4, dtype=int).tolist(),
                                                           strict=True)} | {"rad": Unit(1.0)}  # fmt: skip
_DERIVED = {
    "cm": (1e-2, "m"), "mm": (1e-3, "m"), "um": (1e-6, "m"), "km": (1e3, "m"), "in": (0.0254, "m"), "ft": (_FOOT, "m"),
    "deg": (math.pi / 180, "1"), "rev": (2 * math.pi, "1"), "rpm": (math.pi / 30, "1/s"), "Hz": (1.0, "1/s"),
    "g": (1e-3, "kg"), "mg": (1e-6, "kg"), "t": (1e3, "kg"), "tonne": (1e3, "kg"), "lbm": (_POUND, "kg"),
    "slug": (_POUND * STANDARD_GRAVITY / _FOOT, "kg"), "ms": (1e-3, "s"), "min": (60.0, "s"), "hr": (3600.0, "s"),
    "N": (1.0, "kg*m/s^2"), "kN": (1e3, "N"), "mN": (1e-3, "N"), "lbf": (_POUND * STANDARD_GRAVITY, "N"),
    "J": (1.0, "N*m"), "W": (1.0, "J/s"), "Pa": (1.0, "N/m^2"), "gee": (STANDARD_GRAVITY, "m/s^2"),
    "V": (1.0, "W/A"), "Ohm": (1.0, "V/A"), "H": (1.0, "V*s/A"), "F": (1.0, "A*s/V"), "Wb": (1.0, "V*s"),
    **{f"{letter}{name}": (size, name) for letter, size in (("m", 1e-3), ("u", 1e-6), ("n", 1e-9), ("k", 1e3))
       for name in ("V", "A", "Ohm", "H", "F")},
}  # fmt: skip
"""Other units: how many of which they are."""
_LONGEST, _POWERS = 200, range(7)


@lru_cache(maxsize=1000)
def parse_unit(text: str) -> Unit:
    """Return a unit (raises UnknownUnit: the text is none)."""
    try:
        return _unit(parse(text if len(text) <= _LONGEST else ""))
    except (NotUnderstood, ArithmeticError):
        raise UnknownUnit(f"'{text[:40]}' is no unit known here") from None


def _unit(tree: Expression) -> Unit:
    match tree:
        case ("number", (1.0,)):
            return Unit(1.0)
        case ("name", (name,)) if name in _BASES:
            return _BASES[name]
        case ("name", (name,)) if name in _DERIVED:
            factor, of = _DERIVED[name]
            return Unit(factor).times(parse_unit(of))
        case ("binary", ("*" | "/" as sign, left, right)):
            return _unit(left).times(_unit(right), 1 if sign == "*" else -1)
        case ("binary", ("^", base, ("number", (power,)))) if power in _POWERS:
            return Unit(1.0).times(_unit(base), int(power))
        case ("binary", ("^", base, ("unary", ("-", ("number", (power,)))))) if power in _POWERS:
            return Unit(1.0).times(_unit(base), -int(power))
    raise NotUnderstood("is no unit")


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


def plain_unit(unit: str) -> str:
    """Return a unit in letters that programs take: ``N·m/rad²`` is ``N*m/rad^2``."""
    return unit.replace("·", "*").replace("²", "^2").replace("³", "^3")
