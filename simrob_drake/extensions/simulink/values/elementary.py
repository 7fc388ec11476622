"""MATLAB's elementary functions, which act on each element of their arguments, and its constants."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector


class IntegerRange(NamedTuple):
    """Smallest and largest number of an integer type."""

    least: float
    most: float


INTEGERS: dict[str, IntegerRange] = {}
"""Ranges of MATLAB's integer types, by name, such as ``int8``. A conversion rounds to the nearest integer and then
limits it to the range."""
for _bits in (8, 16, 32, 64):
    INTEGERS[f"int{_bits}"] = IntegerRange(-(2.0 ** (_bits - 1)), 2.0 ** (_bits - 1) - 1)
for _bits in (8, 16, 32, 64):
    # Rounding keeps the sign of small negative numbers, and so does this limit: -0.3 and -3 both become -0.
    INTEGERS[f"uint{_bits}"] = IntegerRange(-0.0, 2.0**_bits - 1)


def round_away(value: Vector) -> Vector:
    """Round to the nearest integer, and halves away from zero, as MATLAB does; NumPy rounds halves to even."""
    return np.asarray(np.sign(value) * np.floor(np.abs(value) + 0.5))


def _in_degrees(function: Callable[..., Any]) -> Callable[[Any], Any]:
    """Make a trigonometric function take its angle in degrees."""
    return lambda angle: function(np.deg2rad(angle))


def _to_degrees(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make an inverse trigonometric function return its angle in degrees."""
    return lambda *arguments: np.rad2deg(function(*arguments))


def _to_integer(limits: IntegerRange) -> Callable[[Any], Any]:
    """Make the function that converts to an integer type; NaN becomes 0."""
    return lambda value: np.clip(round_away(np.nan_to_num(value)), limits.least, limits.most)


_SAME_NAME_IN_NUMPY = (
    *("sin", "cos", "tan", "exp", "sqrt", "log", "log10", "log2", "abs"),
    *("floor", "ceil", "sign", "sinh", "cosh", "tanh", "deg2rad", "rad2deg"),
    *("hypot", "isnan", "isinf", "isfinite"),
)

EACH: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in _SAME_NAME_IN_NUMPY},
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "sind": _in_degrees(np.sin),
    "cosd": _in_degrees(np.cos),
    "tand": _in_degrees(np.tan),
    "asind": _to_degrees(np.arcsin),
    "acosd": _to_degrees(np.arccos),
    "atand": _to_degrees(np.arctan),
    "atan2d": _to_degrees(np.arctan2),
    "round": round_away,
    **{name: _to_integer(limits) for name, limits in INTEGERS.items()},
    "fix": np.trunc,
    "mod": np.mod,
    "rem": np.fmod,
    "double": lambda value: value,
    "single": lambda value: value,  # rounding to 32 bits is not simulated
    "logical": lambda value: value != 0,
    "not": lambda value: value == 0,
}
"""The functions, by MATLAB's names."""

CONSTANTS = {
    "pi": np.pi,
    "inf": np.inf,
    "Inf": np.inf,
    "nan": np.nan,
    "NaN": np.nan,
    "eps": np.finfo(float).eps,
    "true": 1.0,
    "false": 0.0,
}
"""Values of the constants, by MATLAB's names."""

ELEMENTARY = EACH.keys() | CONSTANTS.keys()
"""Names of all functions and constants. Models do not use them as names of variables."""
