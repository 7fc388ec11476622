"""Units of Simscape as factors to SI: ``N*m/(deg/s)``, ``kg/m^3``, ``cm``."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.tables import table
from simrob_drake.extensions.simulink.values.syntax import Expression, NotUnderstood, parse


class UnknownUnit(ValueError):
    """A text that is no unit known here."""


class Unit(NamedTuple):
    """A unit: how many SI units it is, and the powers of kg, m, s and A in it; angles have none."""

    factor: float
    dimension: tuple[int, ...] = (0, 0, 0, 0)

    def times(self, other: "Unit", power: int = 1) -> "Unit":
        """Return the product with a power of another unit."""
        powers = tuple(
            one + power * own for one, own in zip(self.dimension, other.dimension, strict=True)
        )
        return Unit(
            self.factor / other.factor if power == -1 else self.factor * other.factor**power, powers
        )


_NAMED = {name: Unit(1.0, tuple(row)) for name, row in zip(("kg", "m", "s", "A"), np.eye(4, dtype=int).tolist(),
                                                           strict=True)} | {"rad": Unit(1.0)}  # fmt: skip
_LONGEST, _POWERS = 200, range(7)


@lru_cache(maxsize=1000)
def parse_unit(text: str) -> Unit:
    """Return a unit (raises UnknownUnit: the text is none)."""
    try:
        return _unit(parse(text if len(text) <= _LONGEST else ""))
    except (NotUnderstood, ArithmeticError):
        raise UnknownUnit(
            message("simulink.no_known_unit", "'{text}' is no unit known here", text=text[:40])
        ) from None


def _unit(tree: Expression, *, counts: bool = False) -> Unit:
    """Return a unit; one that the table has ``counts`` how many of others it is."""
    match tree:
        case ("number", (value,)) if counts or value == 1.0:
            return Unit(value)
        case ("name", (name,)) if name in _NAMED:
            return _NAMED[name]
        case ("name", (name,)) if name in table("units"):
            return _unit(parse(str(table("units")[name])), counts=True)
        case ("binary", ("*" | "/" as sign, left, right)):
            return _unit(left, counts=counts).times(
                _unit(right, counts=counts), 1 if sign == "*" else -1
            )
        case ("binary", ("^", base, ("number", (power,)))) if power in _POWERS:
            return Unit(1.0).times(_unit(base), int(power))
        case ("binary", ("^", base, ("unary", ("-", ("number", (power,)))))) if power in _POWERS:
            return Unit(1.0).times(_unit(base), -int(power))
    raise NotUnderstood(message("simulink.no_unit", "is no unit"))


def factor(text: str, like: str) -> float:
    """Return how many SI units one unit is, such as 0.01 for ``cm``.

    Args:
        text: the unit.
        like: a unit of the dimension that ``text`` must have; its size does not matter.

    Raises:
        UnknownUnit: one of them is no unit, or their dimensions differ.
    """
    unit, target = parse_unit(text), parse_unit(like)
    if unit.dimension != target.dimension:
        raise UnknownUnit(
            message(
                "simulink.unit_does_not_fit",
                "the unit {text} does not fit; it must be one like {like}",
                text=text,
                like=like,
            )
        )
    return unit.factor


def plain_unit(unit: str) -> str:
    """Return a unit in letters that programs take: ``N·m/rad²`` is ``N*m/rad^2``."""
    return unit.replace("·", "*").replace("²", "^2").replace("³", "^3")
