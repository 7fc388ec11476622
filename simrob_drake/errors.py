"""The errors that users meet: each message says what is wrong, where, and what would be right, in one line."""

import difflib
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

_LONGEST = 2000  # letters of a message: lists of what is known are long, too, but what a user gave may be a megabyte


class SimrobError(ValueError):
    """Base of every error that a user's input can cause."""

    def __init__(self, message: str = "") -> None:
        super().__init__(shortened(message, _LONGEST))


class InvalidParameter(SimrobError):
    """A value that a block, a function or a station cannot take."""

    def __init__(self, name: str, value: object, expected: str) -> None:
        """Say that parameter ``name`` has ``value`` where ``expected`` would be right."""
        super().__init__(f"{name} is {shown(value)}; it must be {expected}")


class UnknownName(SimrobError):
    """A name that stands for nothing here; the message proposes the nearest known one."""

    def __init__(self, kind: str, name: object, known: Iterable[str]) -> None:
        """Say that no ``kind`` is called ``name``, with what is known."""
        super().__init__(f"there is no {kind} '{shown(name)}'{nearest(name, known)}")


class InvalidConfig(SimrobError):
    """A station's or a robot's configuration with an entry that cannot be.

    Attributes:
        key: under which the problem lies; empty if that is not told apart.
        problem: what it is, and what would be right.
    """

    def __init__(self, where: Path | str, key: str, problem: str) -> None:
        """Say in which file (or override) and under which key the problem lies."""
        self.key, self.problem = key, problem
        super().__init__(_located(where, key, problem))


class InvalidModel(SimrobError):
    """A URDF that cannot be simulated as it is; the message names the file and the element."""

    def __init__(self, where: Path | str, element: str, problem: str) -> None:
        """Say in which file and element the problem lies."""
        super().__init__(_located(where, element, problem))
        self.problem = problem


class UnsupportedSolver(SimrobError):
    """A solver setting that this station, or the place where it stands, cannot take."""


class OutputError(SimrobError):
    """Results that cannot be written where the user asked."""


class VerdictError(SimrobError):
    """A run with warnings, or one that came to no end of its own, whose caller asked for ``strict``.

    Attributes:
        result: the run.
    """

    def __init__(self, message: str, result: object) -> None:
        """Say what became of the run ``result``."""
        super().__init__(message)
        self.result = result


def nearest(name: object, known: Iterable[str]) -> str:
    """Return "; did you mean 'x'?" or the list of known names, ready to be appended to a message."""
    names = sorted(set(known))
    close = difflib.get_close_matches(shown(name), names, n=1, cutoff=0.6)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; known: {', '.join(names)}" if names else ""


def _located(where: Path | str, what: str, problem: str) -> str:
    place, what = shortened(str(where), 1000), shortened(what, 200)
    named = place.split(" ", 1)[-1].lstrip("-") == what  # by what an override or an option is called
    return ": ".join(part for part in (place, "" if named else what, problem) if part)


def one_of(kind: str, name: object, known: Iterable[str]) -> str:
    """Return a name that is one of the known ones; raises UnknownName: it is not, or is no text."""
    names = list(known)
    if not isinstance(name, str) or name not in names:
        raise UnknownName(kind, name, names)
    return name


def shown(value: object) -> str:
    """Return a value as messages show it: on one line, cut if it is long. The file name of a long path stays whole."""
    if isinstance(value, Path):
        return _shortened_path(value)
    return shortened(value) if isinstance(value, str) else quoted(value)


def _shortened_path(path: Path, length: int = 80) -> str:
    """Return a path on one line. If it is long, the folders at its beginning are cut, not the name of the file."""
    text = shortened(str(path), length=1000)
    return text if len(text) <= length else "…" + text[len(text) - length + 1 :]


def quoted(value: object) -> str:
    """Return any value likewise, but texts in quotes."""
    try:
        return shortened(repr(value))
    except ValueError:
        return "a number of more digits than can be shown"


def angle(value: float) -> str:
    """Return an angle [rad] as messages show it: in degrees, too."""
    return f"{value:.3g} rad ({math.degrees(value):.3g} deg)"


def shortened(value: str, length: int = 80) -> str:
    """Return a text on one line, cut where it is long, without what would steer a terminal."""
    head = " ".join(value[: 100 * length].split())
    text = "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in head)
    whole = len(text) <= length and len(value) <= 100 * length
    return text if whole else text[: length - 1] + "…"


def counted(count: int, thing: str) -> str:
    """Return how many things there are, in words of messages."""
    plural = thing if thing.endswith("s") else f"{thing[:-1]}ies" if thing.endswith(("dy", "ry", "ly")) else f"{thing}s"
    return f"{count} {thing if count == 1 else plural}"


def listed(names: Sequence[str], most: int = 3) -> str:
    """Return names in a row, of many the first ones."""
    rest = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + rest
