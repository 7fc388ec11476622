"""What the checks of an exercise use: a value that was measured on an answer, and the bounds that it must keep."""

from dataclasses import dataclass
from math import inf, isnan
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simrob_drake.base.errors import InvalidParameter, quote_value
from simrob_drake.base.messages import message


@dataclass(frozen=True)
class Reading:
    """A value that was measured on an answer."""

    value: float  # what was measured, in ``unit``
    unit: str = ""  # of the value and of its bounds; empty for a plain number
    least: float = -inf  # the smallest value with which the point holds
    most: float = inf  # the largest

    @property
    def ok(self) -> bool:
        """Whether the value keeps its bounds; one that is not a number never does."""
        return not isnan(self.value) and self.least <= self.value <= self.most


def at_most(value: float, bound: float, unit: str = "") -> Reading:
    """Return a reading that must not be larger than a bound."""
    return Reading(float(value), unit, most=bound)


def at_least(value: float, bound: float, unit: str = "") -> Reading:
    """Return a reading that must not be smaller than a bound."""
    return Reading(float(value), unit, least=bound)


def between(value: float, least: float, most: float, unit: str = "") -> Reading:
    """Return a reading that must lie between two bounds."""
    return Reading(float(value), unit, least, most)


def near(value: float, right: float, within: float, unit: str = "") -> Reading:
    """Return a reading that must not be farther than ``within`` from the right value."""
    return Reading(float(value), unit, right - within, right + within)


def number(answer: ModuleType, name: str, *arguments: Any) -> float:
    """Return the number that a function of an answer gives; raises InvalidParameter: no function, no finite number."""
    return float(numbers(answer, name, *arguments, shape=())[()])


def numbers(
    answer: ModuleType, name: str, *arguments: Any, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Return the array of a shape, -1 being any length, that a function of an answer gives for arguments.

    Raises InvalidParameter: the answer has no such function, or that returns something else.
    """
    returned = value_of(answer, name, *arguments)
    expected = (
        message("course.numbers_of_shape", "finite numbers of shape {shape}", shape=shape)
        if shape
        else message("course.a_finite_number", "a finite number")
    )
    try:
        array = np.asarray(returned, dtype=float)
    except (TypeError, ValueError) as problem:
        raise InvalidParameter(
            message("course.returned_value", "what {name}() returns", name=name),
            quote_value(returned),
            expected,
        ) from problem
    fits = array.ndim == len(shape) and all(
        b in (-1, a) for a, b in zip(array.shape, shape, strict=True)
    )
    if not fits or not np.isfinite(array).all():
        raise InvalidParameter(
            message("course.returned_value", "what {name}() returns", name=name),
            quote_value(returned),
            expected,
        )
    return array


def value_of(answer: ModuleType, name: str, *arguments: Any) -> Any:
    """Return what a function of an answer gives; raises InvalidParameter: the answer has no such function."""
    function = getattr(answer, name, None)
    if not callable(function):
        raise InvalidParameter(
            message("course.of_the_answer", "{name} of the answer", name=name),
            message("course.missing", "missing")
            if function is None
            else message("course.no_function", "no function"),
            message("course.a_function", "a function"),
        )
    return function(*arguments)
