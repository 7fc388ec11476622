"""MATLAB's elementary functions, which act on each element of their arguments, and its constants."""

from collections.abc import Callable
from typing import Any

import numpy as np

from simrob_drake.frames import Vector

INTEGERS = {f"{letter}int{bits}": (-(2.0 ** (bits - 1)) * (not letter), 2.0 ** (bits - (not letter)) - 1)
            for letter in ("", "u") for bits in (8, 16, 32, 64)}  # fmt: skip
"""Types of whole numbers: to the nearest of which, from the least to the largest, a number becomes."""


def rounded(value: Vector) -> Vector:
    """Round to the nearest whole number, halves away from zero as MATLAB does."""
    return np.asarray(np.sign(value) * np.floor(np.abs(value) + 0.5))


EACH: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "exp", "sqrt", "log", "log10", "log2", "abs")},
    **{name: getattr(np, name) for name in ("floor", "ceil", "sign", "sinh", "cosh", "tanh", "deg2rad", "rad2deg")},
    **{f"a{name}": getattr(np, f"arc{name}") for name in ("sin", "cos", "tan", "tan2")},
    **{f"{name}d": lambda u, name=name: getattr(np, name)(np.deg2rad(u)) for name in ("sin", "cos", "tan")},
    **{f"a{name}d": lambda *u, name=name: np.rad2deg(getattr(np, f"arc{name}")(*u)) for name in ("sin", "cos", "tan")},
    "atan2d": lambda y, x: np.rad2deg(np.arctan2(y, x)),
    "hypot": np.hypot,
    "round": rounded,
    **{name: lambda u, ends=ends: np.clip(rounded(np.nan_to_num(u)), *ends) for name, ends in INTEGERS.items()},
    "fix": np.trunc,
    "mod": np.mod,
    "rem": np.fmod,
    **dict.fromkeys(("double", "single"), lambda value: value),
    "logical": lambda value: value != 0,
    "not": lambda value: value == 0,
    **{f"is{name}": getattr(np, f"is{name}") for name in ("nan", "inf", "finite")},
}

CONSTANTS = {
    "pi": np.pi, "inf": np.inf, "Inf": np.inf, "nan": np.nan, "NaN": np.nan, "eps": np.finfo(float).eps, "true": 1.0,
    "false": 0.0,
}  # fmt: skip
ELEMENTARY = EACH.keys() | CONSTANTS.keys()  # names that nobody gives a variable
