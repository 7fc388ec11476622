"""What callers give in Python, checked at the border: numbers, times, kinds of objects; and Drake's own refusals."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from simrob_drake.base.errors import InvalidParameter, SimrobError, quoted
from simrob_drake.base.messages import message

Kind = TypeVar("Kind")

SHORTEST, LONGEST = 1e-6, 1e9
"""Times that a station knows [s]: of any two, one later by the shortest of all is still a later one."""


class DrakeRefused(SimrobError):
    """Something that only Drake's own checks found out."""


@contextmanager
def drake_asserts() -> Iterator[None]:
    """Tell of Drake's failed assertions, a SystemExit in Python, as errors; a decorator, too; raises DrakeRefused."""
    try:
        yield
    except SystemExit as problem:
        place, found, condition = str(problem).partition(" in ")
        if not (found and place.startswith("Failure at")):
            raise
        raise DrakeRefused(
            message("base.drake_refuses", "Drake cannot do that: {condition}", condition=condition)
        ) from problem


def number(value: object, name: str) -> float:
    """Return a number; raises InvalidParameter: anything else, what is not finite too."""
    return _between(value, name, -1e308, 1e308, message("base.a_number", "a number"))


def positive(value: object, name: str, unit: str) -> float:
    """Return a positive number; raises InvalidParameter: anything else."""
    return _between(
        value, name, 1e-308, 1e308, message("base.a_positive_number", "a positive number [{unit}]", unit=unit)
    )


def seconds(value: object, name: str = "duration") -> float:
    """Return a duration [s]; raises InvalidParameter: not positive, too small or too large for one."""
    return _between(
        value,
        name,
        SHORTEST,
        LONGEST,
        message(
            "base.a_positive_time",
            "a positive time [s], {shortest:g} to {longest:g}",
            shortest=SHORTEST,
            longest=LONGEST,
        ),
    )


def _between(value: object, name: str, least: float, most: float, expected: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InvalidParameter(name, quoted(value), expected)
    if not least <= value <= most:
        raise InvalidParameter(name, quoted(value), expected)
    return float(value)


def whole(value: object, name: str, least: int, most: int) -> int:
    """Return a whole number within bounds; raises InvalidParameter: anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not least <= value <= most:
        raise InvalidParameter(
            name,
            quoted(value),
            message("base.a_whole_number", "a whole number, {least} to {most}", least=least, most=most),
        )
    return int(value)


def truth(value: object, name: str) -> bool:
    """Return True or False; raises InvalidParameter: anything else, for its truth may not be what was meant."""
    return bool(instance(value, name, (bool, np.bool_), message("base.true_or_false", "True or False")))


def instance(value: object, name: str, kind: type[Kind] | tuple[type[Kind], ...], expected: str) -> Kind:
    """Return an object of a kind; raises InvalidParameter: one of another kind."""
    if not isinstance(value, kind):
        raise InvalidParameter(name, quoted(value), expected)
    return value


def as_path(value: object, name: str) -> Path:
    """Return a path; raises InvalidParameter: something else, or a text that no file system takes."""
    if not isinstance(value, (str, Path)):
        raise InvalidParameter(name, quoted(value), message("base.a_path", "a path"))
    found = Path(value)
    if not str(found).isprintable():
        raise InvalidParameter(name, repr(str(found)), message("base.a_printable_path", "a path that can be printed"))
    return found


def plain(value: Any) -> Any:
    """Return a value with numpy's numbers and arrays as Python's own."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    return [plain(part) for part in value] if isinstance(value, (list, tuple)) else value
