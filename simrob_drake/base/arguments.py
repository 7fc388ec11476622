"""Checks of arguments that users pass in Python: numbers, times, classes of objects; and Drake's own refusals.

Each check returns the argument in the type that the package computes with, or raises an error that names the argument
and says what would be right.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from simrob_drake.base.errors import InvalidParameter, SimrobError, quote_value
from simrob_drake.base.messages import message

Kind = TypeVar("Kind")

SHORTEST = 1e-6
"""Smallest duration of anything in a station [s]."""

LONGEST = 1e9
"""Largest duration and latest time in a station [s]. Adding SHORTEST to it gives another number in float64."""

_SMALLEST_FLOAT = 1e-308
"""Smallest positive number that is accepted: smaller ones have fewer digits in float64."""

_LARGEST_FLOAT = 1e308
"""Largest number that is accepted, close to the largest of float64. So infinity is refused."""


class DrakeRefused(SimrobError):
    """Raised when a check of Drake itself fails, for a fault that no check of this package finds."""


@contextmanager
def drake_asserts() -> Iterator[None]:
    """Context manager, and decorator, that turns Drake's failed assertions into errors.

    In Python, a failed assertion of Drake arrives as a SystemExit, with a text such as "Failure at FILE in FUNCTION:
    condition '...' failed.".

    Raises:
        DrakeRefused: an assertion failed in the body.
    """
    try:
        yield
    except SystemExit as problem:
        # Any other SystemExit is an order to end the process, such as sys.exit of a user's block.
        place, separator, condition = str(problem).partition(" in ")
        is_assertion = bool(separator) and place.startswith("Failure at")
        if not is_assertion:
            raise
        raise DrakeRefused(
            message(
                "base.drake_refuses", "a check of Drake fails: {condition}", condition=condition
            )
        ) from problem


def number(value: object, name: str) -> float:
    """Check a number.

    Args:
        value: the argument.
        name: its name, for the error.

    Raises:
        InvalidParameter: it is no number, or not finite.
    """
    expected = message("base.a_number", "a finite number")
    return _number_between(value, name, -_LARGEST_FLOAT, _LARGEST_FLOAT, expected)


def positive(value: object, name: str, unit: str) -> float:
    """Check a positive number.

    Args:
        value: the argument.
        name: its name, for the error.
        unit: its unit, for the error.

    Raises:
        InvalidParameter: it is no number, or not positive and finite.
    """
    expected = message("base.a_positive_number", "a positive number [{unit}]", unit=unit)
    return _number_between(value, name, _SMALLEST_FLOAT, _LARGEST_FLOAT, expected)


def seconds(value: object, name: str = "duration") -> float:
    """Check a duration [s].

    Args:
        value: the argument.
        name: its name, for the error.

    Raises:
        InvalidParameter: it is no number, shorter than SHORTEST, or longer than LONGEST.
    """
    expected = message(
        "base.a_positive_time",
        "a positive time [s], {shortest:g} to {longest:g}",
        shortest=SHORTEST,
        longest=LONGEST,
    )
    return _number_between(value, name, SHORTEST, LONGEST, expected)


def _number_between(value: object, name: str, least: float, most: float, expected: str) -> float:
    """Check a number of Python or NumPy between two bounds, both included.

    Args:
        value: the argument.
        name: its name, for the error.
        least: the lower bound.
        most: the upper bound.
        expected: what would be right, for the error.

    Raises:
        InvalidParameter: it is no number, or outside of the bounds, as NaN is.
    """
    # Python counts True and False as integers.
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InvalidParameter(name, quote_value(value), expected)
    # NaN fails both comparisons, so it is refused here, too.
    if not least <= value <= most:
        raise InvalidParameter(name, quote_value(value), expected)
    # A NumPy scalar would make all later arithmetic slower, and JSON refuses it.
    return float(value)


def whole(value: object, name: str, least: int, most: int) -> int:
    """Check an integer between two bounds, both included.

    Args:
        value: the argument.
        name: its name, for the error.
        least: the lower bound.
        most: the upper bound.

    Raises:
        InvalidParameter: it is no integer, or outside of the bounds.
    """
    expected = message(
        "base.a_whole_number", "a whole number, {least} to {most}", least=least, most=most
    )
    # Python counts True and False as integers.
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise InvalidParameter(name, quote_value(value), expected)
    if not least <= value <= most:
        raise InvalidParameter(name, quote_value(value), expected)
    return int(value)


def truth(value: object, name: str) -> bool:
    """Check a boolean. Other objects are refused, since Python's truth of them may not be what the user meant.

    Args:
        value: the argument.
        name: its name, for the error.

    Raises:
        InvalidParameter: it is neither True nor False.
    """
    return bool(
        instance(value, name, (bool, np.bool_), message("base.true_or_false", "True or False"))
    )


def instance(
    value: object, name: str, kind: type[Kind] | tuple[type[Kind], ...], expected: str
) -> Kind:
    """Check the class of an object.

    Args:
        value: the argument.
        name: its name, for the error.
        kind: the class, or several classes.
        expected: what would be right, for the error.

    Raises:
        InvalidParameter: it is of another class.
    """
    if not isinstance(value, kind):
        raise InvalidParameter(name, quote_value(value), expected)
    return value


def as_path(value: object, name: str) -> Path:
    """Check a path, given as a text or a Path.

    Args:
        value: the argument.
        name: its name, for the error.

    Raises:
        InvalidParameter: it is something else, or has characters that cannot be printed.
    """
    if not isinstance(value, (str, Path)):
        raise InvalidParameter(name, quote_value(value), message("base.a_path", "a path"))
    # Results, reports and links have the path as text: a line feed or a control character in it would spoil them.
    path = Path(value)
    if not str(path).isprintable():
        raise InvalidParameter(
            name,
            repr(str(path)),
            message("base.a_printable_path", "a path of printable characters"),
        )
    return path


def plain(value: Any) -> Any:
    """Convert NumPy's numbers and arrays in a value to Python's own numbers and lists.

    Mappings, lists and tuples are converted at all levels. Tuples become lists, and keys of mappings texts. Other
    objects stay as they are.
    """
    # tolist() gives a Python number for an array without dimensions, and for a scalar of NumPy.
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(part) for part in value]
    return value
