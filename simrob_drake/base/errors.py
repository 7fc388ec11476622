"""Errors for users, and functions that format their messages.

Each message says what is wrong, where, and what would be right, in one line.
"""

import difflib
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simrob_drake.base.messages import Message, compound, join_texts, message, one_line
from simrob_drake.base.renaming import former_names_of

_LONGEST = 2000
"""Largest length of a message. Lists of known names are long, but a value that a user gives may be a megabyte."""


class SimrobError(ValueError):
    """Base class of all errors that a user's input can cause.

    Attributes:
        message: the message in one line; a :class:`~simrob_drake.base.messages.Message`, if other languages have it.
    """

    def __init__(self, message: str = "") -> None:
        """Create the error.

        Args:
            message: the message. It becomes one line, and a very long one is cut at its end.
        """
        # One line without control characters: a log has one entry for each error, whatever the user's input contains.
        self.message = shorten(message, _LONGEST)
        super().__init__(self.message)

    def put_in_front(self, place: str) -> None:
        """Begin the message with the place to which the error belongs, such as the name of a move, and a colon."""
        self.message = shorten(
            compound("{place}: {problem}", place=place, problem=self.message), _LONGEST
        )
        self.args = (self.message,)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the error without calling the initializer of its class, whose arguments are not kept."""
        return _restored_error, (type(self), self.args, self.__dict__)


def _restored_error(
    kind: type[SimrobError], arguments: tuple[Any, ...], attributes: dict[str, Any]
) -> SimrobError:
    """Create an error from a pickle.

    Args:
        kind: class of the error.
        arguments: arguments of the exception, which are its English text.
        attributes: attributes of the error.
    """
    # The initializer would make the message again, from arguments that the pickle does not have.
    error = kind.__new__(kind, *arguments)
    error.args = arguments
    error.__dict__.update(attributes)
    return error


class InvalidParameter(SimrobError):
    """Raised when a block, a function or a station gets an invalid value."""

    def __init__(self, name: str, value: object, expected: str) -> None:
        """Create the error.

        Args:
            name: name of the parameter.
            value: its invalid value.
            expected: what would be right, such as "a positive time [s]". It completes the words "it must be".
        """
        super().__init__(
            message(
                "base.invalid_parameter",
                "{name} is {value}; it must be {expected}",
                name=name,
                value=format_value(value),
                expected=expected,
            )
        )


class Unsuitable(InvalidParameter):
    """Raised when something is given where it cannot serve, whatever its value. The message is a problem and a remedy.

    :class:`InvalidParameter` says which value would be right. Here none is, such as a duration for a program.
    """

    def __init__(self, name: str, problem: str, remedy: str = "") -> None:
        """Create the error.

        Args:
            name: name of the parameter.
            problem: why it cannot serve here, such as "the world has no frames".
            remedy: what to do, as a command. If it is empty, the command is to leave the parameter out.
        """
        # The base class would add "it must be": its initializer is left out.
        command = remedy or message("base.leave_out", "leave it out")
        SimrobError.__init__(
            self,
            compound("{name}: {problem}; {remedy}", name=name, problem=problem, remedy=command),
        )


class UnknownName(SimrobError):
    """Raised when nothing has a given name. The message proposes the nearest known name, or lists all of them."""

    def __init__(self, kind: str, name: object, known: Iterable[str]) -> None:
        """Create the error.

        Args:
            kind: what the name should stand for, such as "robot".
            name: the unknown name.
            known: all known names.
        """
        super().__init__(
            message(
                "base.unknown_name",
                "there is no {kind} '{name}'{suggestion}",
                kind=kind,
                name=format_value(name),
                suggestion=nearest(name, known),
            )
        )


class UnknownKey(UnknownName, KeyError):
    """Raised when a mapping has no entry of a name. It is a KeyError, too, as Python's mappings raise."""

    def __init__(self, kind: str, name: object, known: Iterable[str], *, remedy: str = "") -> None:
        """Create the error.

        Args:
            kind: what the name should stand for, such as "output".
            name: the unknown name.
            known: all known names.
            remedy: how to get an entry of this name, to be appended to the message; empty if there is no way.
        """
        super().__init__(kind, name, known)
        # The base class has made the message without a remedy, so the remedy is appended afterwards.
        self.message = shorten(
            compound("{problem}{remedy}", problem=self.message, remedy=remedy), _LONGEST
        )
        self.args = (self.message,)

    def __str__(self) -> str:
        """The message, without the quotes in which a KeyError shows its key."""
        return str(self.message)


class InvalidConfig(SimrobError):
    """Raised when the configuration of a station or a robot has an invalid entry.

    Attributes:
        key: dotted key of the entry; empty if the problem belongs to no single key.
        problem: what is wrong, and what would be right.
    """

    def __init__(self, where: Path | str, key: str, problem: str) -> None:
        """Create the error.

        Args:
            where: the file, or the name of the override, with the entry.
            key: see the attribute.
            problem: see the attribute.
        """
        super().__init__(_join_location(where, key, problem))
        self.key = key
        self.problem = problem


class InvalidModel(SimrobError):
    """Raised when a robot's or a piece's model cannot be simulated.

    Attributes:
        element: the element of the file; empty if the problem belongs to no single one.
        problem: what is wrong, and what would be right.
    """

    def __init__(self, where: Path | str, element: str, problem: str) -> None:
        """Create the error.

        Args:
            where: the file.
            element: the element of the file, such as ``link 'rod'``.
            problem: see the attribute.
        """
        super().__init__(_join_location(where, element, problem))
        self.element = element
        self.problem = problem


class UnsupportedSolver(SimrobError):
    """Raised when a station, or the diagram that contains it, does not work with the settings of its solver."""


class OutputError(SimrobError):
    """Raised when results cannot be written to the path that the user gave."""


class VerdictError(SimrobError):
    """Raised in strict mode after a run with warnings, or a run that was interrupted or failed.

    Attributes:
        result: result of the run.
    """

    def __init__(self, message: str, result: object) -> None:
        """Create the error.

        Args:
            message: what is wrong with the run.
            result: see the attribute.
        """
        super().__init__(message)
        self.result = result


def nearest(name: object, known: Iterable[str]) -> str:
    """Text that proposes the nearest known name, or lists all known names, to be appended to a message.

    Args:
        name: the unknown name.
        known: the known names. If there are none, the text is empty.
    """
    names = sorted(set(known))
    close = nearest_name(name, names)
    if close is not None:
        return message("base.did_you_mean", "; did you mean '{name}'?", name=close)
    return message("base.known_names", "; known: {names}", names=", ".join(names)) if names else ""


def nearest_name(name: object, known: Iterable[str]) -> str | None:
    """Find the known name that is most like a name. Returns None if none is like it.

    Args:
        name: the unknown name.
        known: the known names.
    """
    names = sorted(set(known))
    text = format_value(name)
    # 0.6 is difflib's own default: three letters in five agree, as in a word with a typing error.
    close = difflib.get_close_matches(text, names, n=1, cutoff=0.6)
    if close:
        return close[0]
    # For difflib a capital and its small letter differ, so that "KP" is not like "kp": all names are compared once more
    # in small letters. Of names that differ in capitals alone, such as "Kp" and "kp", only the last one is compared.
    known_by_lower = {known_name.lower(): known_name for known_name in names}
    close = difflib.get_close_matches(text.lower(), known_by_lower, n=1, cutoff=0.6)
    return known_by_lower[close[0]] if close else None


def _join_location(where: Path | str, what: str, problem: str) -> str:
    """Join the file, the key or element, and the problem, with colons.

    Empty parts are left out, and so is a key that the name of the override or option contains already.
    """
    place = shorten(where if isinstance(where, str) else str(where), 1000)
    part = shorten(what, 200)
    # The name of an override, such as "override servo.kp", or of an option, such as "--duration", contains the key.
    has_key_in_name = place.split(" ", 1)[-1].lstrip("-") == part
    texts = [place, "" if has_key_in_name else part, problem]
    return join_texts([text for text in texts if text], ": ")


def one_of(kind: str, name: object, known: Iterable[str]) -> str:
    """Check that a name is known, and return it.

    Args:
        kind: what the name stands for, such as "robot", for the error.
        name: the name.
        known: the known names.

    Raises:
        UnknownName: the name is not known, or is no text.
    """
    names = list(known)
    if not isinstance(name, str) or name not in names:
        raise UnknownName(kind, name, names)
    return name


def format_value(value: object) -> str:
    """Format a value for a message, on one line. A long text is cut at its end, and a long path at its beginning."""
    if isinstance(value, Path):
        return _shortened_path(value)
    if isinstance(value, str):
        return shorten(value)
    return quote_value(value)


def _shortened_path(path: Path, length: int = 80) -> str:
    """Write a path on one line. The beginning of a long path is cut, so that the name of the file stays.

    Args:
        path: the path.
        length: largest length of the text.
    """
    # Control characters are replaced. Nearly every path is shorter than 1000, so that its end, the file's name, stays.
    text = shorten(str(path), length=1000)
    if len(text) <= length:
        return text
    # One character is the ellipsis.
    end = text[len(text) - length + 1 :]
    return f"…{end}"


def quote_value(value: object) -> str:
    """Format a value as its ``repr``, with quotes around a text, on one line. A long text is cut."""
    try:
        return shorten(repr(value))
    except ValueError:
        # Python refuses to write an integer of more than 4300 digits, since that takes very long.
        return message("base.too_many_digits", "a number with too many digits to be shown")


def angle(value: float) -> str:
    """Format an angle [rad] in radians and degrees."""
    return message(
        "base.angle",
        "{radians:.3g} rad ({degrees:.3g} deg)",
        radians=value,
        degrees=math.degrees(value),
    )


def shorten(value: str, length: int = 80) -> str:
    """Write a text on one line, without control characters, and cut its end if it is long.

    Args:
        value: the text. A :class:`Message` stays one, and is cut at the same length in other languages.
        length: largest length of the result.
    """
    # Other languages need the whole message: it keeps the length as an attribute instead of being cut here.
    if isinstance(value, Message):
        return value.limited_to(length)
    return one_line(value, length)


def format_count(count: int, thing: str) -> str:
    """Format a count with the singular or plural of a noun: "1 body", "2 bodies".

    Args:
        count: the count.
        thing: the noun in the singular.
    """
    if count == 1:
        return f"{count} {thing}"
    if thing.endswith("axis"):
        plural = f"{thing.removesuffix('is')}es"
    # The noun is plural already, or a name that has no plural, such as "PS Abs".
    elif thing.endswith("s"):
        plural = thing
    # Words such as "body", "entry" and "assembly", but not "key".
    elif thing.endswith(("dy", "ry", "ly")):
        plural = f"{thing[:-1]}ies"
    else:
        plural = f"{thing}s"
    return f"{count} {plural}"


def list_names(names: Sequence[str], most: int = 3) -> str:
    """List names, separated by commas. Of many names, only the first ones and a count of the others are listed.

    Args:
        names: the names.
        most: largest count of names that are listed.
    """
    first = join_texts(names[:most], ", ")
    if len(names) <= most:
        return first
    return message(
        "base.names_and_more", "{names} and {count} more", names=first, count=len(names) - most
    )


if not TYPE_CHECKING:
    # The type checker does not see the former names, so that this package cannot use them.
    __getattr__ = former_names_of(
        __name__,
        {
            "shown": "format_value",
            "quoted": "quote_value",
            "shortened": "shorten",
            "counted": "format_count",
            "listed": "list_names",
        },
    )
