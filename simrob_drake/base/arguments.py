"""What callers give in Python, checked at the border: numbers, times, kinds of objects; and Drake's own refusals."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from simrob_drake.base.errors import InvalidParameter, SimrobError, quoted

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
        raise DrakeRefused(f"Drake cannot do that: {condition}") from problem


def number(value: object, name: str) -> float:
    """Return a number; raises InvalidParameter: anything else, what is not finite too."""
    return _between(value, name, -1e308, 1e308, "a number")


def positive(value: object, name: str, unit: str) -> float:
    """Return a positive number; raises InvalidParameter: anything else."""
    return _between(value, name, 1e-308, 1e308, f"a positive number [{unit}]")


def seconds(value: object, name: str = "duration") -> float:
    """Return a duration [s]; raises InvalidParameter: not positive, too small or too large for one."""
    return _between(value, name, SHORTEST, LONGEST, f"a positive time [s], {SHORTEST:g} to {LONGEST:g}")


def _between(value: object, name: str, least: float, most: float, expected: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InvalidParameter(name, quoted(value), expected)
    if not least <= value <= most:
        raise InvalidParameter(name, quoted(value), expected)
    return float(value)


def whole(value: object, name: str, least: int, most: int) -> int:
    """Return a whole number within bounds; raises InvalidParameter: anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not least <= value <= most:
        raise InvalidParameter(name, quoted(value), f"a whole number, {least} to {most}")
    return int(value)


def truth(value: object, name: str) -> bool:
    """Return True or False; raises InvalidParameter: anything else, for its truth may not be what was meant."""
    return bool(instance(value, name, (bool, np.bool_), "True or False"))


def instance(value: object, name: str, kind: type[Kind] | tuple[type[Kind], ...], expected: str) -> Kind:
    """Return an object of a kind; raises InvalidParameter: one of another kind."""
    if not isinstance(value, kind):
        raise InvalidParameter(name, quoted(value), expected)
    return value


def as_path(value: object, name: str) -> Path:
    """Return a path; raises InvalidParameter: something else, or a text that no file system takes."""
    if not isinstance(value, (str, Path)):
        raise InvalidParameter(name, quoted(value), "a path")
    found = Path(value)
    if not str(found).isprintable():
        raise InvalidParameter(name, repr(str(found)), "a path that can be printed")
    return found


def plain(value: Any) -> Any:
    """Return a value with numpy's numbers and arrays as Python's own."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    return [plain(part) for part in value] if isinstance(value, (list, tuple)) else value
