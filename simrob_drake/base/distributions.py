"""Distributions of the values of keys, in a station, a gait or a program: uniform, normal, and choices.

Searches, proofs, sweeps and learning tasks read distributions from their files::

    servo.kp: {low: 100, high: 20000, log: true}
    gait.steps: {low: 4, high: 12, integer: true}
    pieces.load.mass: {mean: 1, deviation: 0.1, low: 0.5}
    solver.kind: {values: [continuous, discrete]}
    solver.time_step: {low: 1.0e-3, high: 5.0e-3, when: {solver.kind: discrete}}
    gravity: uniform:1.6:9.8

The last one is a *line of text*, a short form of a section. A *part* of a distribution is a share of all draws, from 0
to 1. The *quantile* of a part is the value up to which this share of the draws lies. The part of a value is a share
with this value as its quantile: the cumulative distribution function, or for a choice the middle of the value's share.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from math import floor, inf
from statistics import NormalDist
from typing import Annotated, Any, NamedTuple, Self, TypeAlias

import numpy as np
from pydantic import (
    Discriminator,
    Field,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    Tag,
    TypeAdapter,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_serializer,
    model_validator,
)

from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Boolean, NotNegative, Number, Strict
from simrob_drake.base.yaml_files import parse_yaml

Values: TypeAlias = dict[str, Any]
"""Values of keys, by their dotted paths."""

_MOST = 10_000
"""Largest count of values of a choice or a grid."""

_FAR = 1e-12
"""A normal distribution is cut off at the values beyond which this share of all draws lies: its ends are infinite."""


class Distribution(Strict, ABC):
    """Values that a key takes, and how often it takes each of them."""

    when: Values = Field(default_factory=dict)
    """Condition: a value, or a list of values, for keys that come before this one. Otherwise this key is unchanged."""
    _text: str = PrivateAttr("")

    @model_serializer(mode="wrap")
    def _as_written(self, handler: SerializerFunctionWrapHandler) -> Any:
        """Content for a file: the line of text from which it was read, or else the keys without default values.

        Args:
            handler: pydantic's function that gives all keys.
        """
        # A line of text goes back to the file as the user wrote it.
        if self._text:
            return self._text
        content = {}
        for key, value in handler(self).items():
            default = type(self).model_fields[key].get_default(call_default_factory=True)
            if value != default:
                content[key] = value
        return content

    @property
    def text(self) -> str:
        """The line of text from which it was read; empty if it was read from a section."""
        return self._text

    @property
    @abstractmethod
    def first(self) -> Any:
        """The value with which a search begins."""

    @abstractmethod
    def quantile(self, part: float) -> Any:
        """Compute the value up to which a share of all draws lies, from 0 to 1."""

    @abstractmethod
    def part(self, value: Any) -> float:
        """Compute a share from 0 to 1 for which :meth:`quantile` gives a value.

        Args:
            value: a value that the distribution has. The result for any other value is not defined.
        """

    @abstractmethod
    def holds(self, value: Any) -> bool:
        """Whether the distribution has this value, which may be any object."""

    @abstractmethod
    def grid(self, count: int) -> list[Any]:
        """List evenly spaced values.

        Args:
            count: count of the values. There are fewer if the distribution has fewer; a choice has all of its values.
        """

    def draw(self, source: np.random.Generator) -> Any:
        """Draw a value at random."""
        return self.quantile(source.random())

    def applies(self, values: Values) -> bool:
        """Whether the condition ``when`` is met, so that the key takes values of this distribution.

        Args:
            values: values of the keys before this one.
        """
        for key, needed in self.when.items():
            choices = needed if isinstance(needed, list) else [needed]
            # A key that was left out itself, because of its own condition, meets no condition.
            if key not in values or values[key] not in choices:
                return False
        return True


def _is_number(value: Any) -> bool:
    """Whether a value is a number. Python counts True and False as numbers, but they are none here."""
    return isinstance(value, int | float) and not isinstance(value, bool)


class _Ends(NamedTuple):
    """Two ends of a range, of values or of parts."""

    low: float
    high: float


class Uniform(Distribution):
    """A range of values, each of which is drawn as often as any other."""

    low: Number
    high: Number
    start: Number | None = None
    """Value with which a search begins. By default it is the middle of the range."""
    log: Boolean = False
    """Whether the logarithm of the value is uniform, so that equal factors are equally frequent."""
    integer: Boolean = False
    """Whether the values are integers, `low` and `high` included."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        """Check that the range contains numbers."""
        if not self.low < self.high:
            raise ValueError(message("base.low_not_below_high", "low must be less than high"))
        if self.log and self.low <= 0:
            raise ValueError(
                message("base.low_not_positive", "low must be positive if log is true")
            )
        if self.start is not None and not self.low <= self.start <= self.high:
            raise ValueError(
                message("base.start_out_of_range", "start must be between low and high")
            )
        numbers = [end for end in (self.low, self.high, self.start) if end is not None]
        if self.integer and any(number % 1 for number in numbers):
            raise ValueError(
                message(
                    "base.range_not_whole",
                    "low, high and start must be integers if integer is true",
                )
            )
        return self

    @property
    def first(self) -> float:
        """The value with which a search begins: ``start``, or the middle."""
        if self.start is None:
            return self.quantile(0.5)
        return int(self.start) if self.integer else self.start

    def quantile(self, part: float) -> float:
        """Compute the value up to which a share of all draws lies, from 0 to 1.

        With the ends a and b and the share p, it is a + (b - a) p, or a (b / a)^p if the logarithm is uniform.

        If the values are integers, the ends are half a number outside of `low` and `high`, and the value is rounded.
        All integers then have the same share, unless the logarithm is uniform.
        """
        # A search may ask for parts slightly beyond the ends.
        part = min(max(float(part), 0.0), 1.0)
        # For integers, these are not `self.low` and `self.high`.
        low, high = self._ends
        value = low * (high / low) ** part if self.log else low + (high - low) * part
        # The last digit of a float may be wrong, so that the value is slightly beyond an end.
        value = min(max(float(value), low), high)
        if not self.integer:
            return value
        # Not Python's round(), which rounds a half to the even number.
        nearest = floor(value + 0.5)
        # The upper end, `self.high` + 0.5, would become `self.high` + 1.
        return int(min(max(nearest, self.low), self.high))

    def part(self, value: Any) -> float:
        """Compute the share from 0 to 1 for which :meth:`quantile` gives a value of the range, before it is rounded."""
        # The equation of `quantile`, solved for the share p.
        low, high = self._ends
        if self.log:
            return float(np.log(value / low) / np.log(high / low))
        return float((value - low) / (high - low))

    def holds(self, value: Any) -> bool:
        """Whether a value is a number of the range."""
        if not _is_number(value) or not self.low <= value <= self.high:
            return False
        return not self.integer or value % 1 == 0

    def grid(self, count: int) -> list[Any]:
        """List evenly spaced values, both ends among them; with a count of 1, the lower end.

        Integers are rounded, and equal ones are listed once. With `log`, the values have equal factors.
        """
        space = np.geomspace if self.log else np.linspace
        values: list[Any] = space(self.low, self.high, count).tolist()
        if not self.integer:
            return values
        # Close values have the same whole number.
        return list(dict.fromkeys(round(value) for value in values))

    @property
    def _ends(self) -> _Ends:
        """Ends of the range of values before they are rounded to integers.

        The range of integers is half a number longer at each end. Each integer then has an interval of length 1 whose
        values are rounded to it; otherwise `low` and `high` would have only half of such an interval.
        """
        if self.integer:
            return _Ends(self.low - 0.5, self.high + 0.5)
        return _Ends(self.low, self.high)


class Normal(Distribution):
    """A normal distribution, perhaps between bounds."""

    mean: Number
    deviation: NotNegative
    """Standard deviation of the distribution without bounds."""
    low: Number | None = None
    high: Number | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        """Check that the mean is within the bounds."""
        if not self._low <= self.mean <= self._high:
            raise ValueError(message("base.mean_out_of_range", "mean must be between low and high"))
        return self

    @property
    def first(self) -> float:
        """The value with which a search begins: the mean."""
        return self.mean

    def quantile(self, part: float) -> float:
        """Compute the value up to which a share of all draws lies, from 0 to 1."""
        # Share of the draws of the distribution without bounds.
        parts = self._parts
        # The bounds cut off the draws below `parts.low` and above `parts.high`; the rest keeps its shape.
        unbounded_part = parts.low + float(part) * (parts.high - parts.low)
        unbounded_part = min(max(unbounded_part, _FAR), 1 - _FAR)
        value = self.mean + self.deviation * NormalDist().inv_cdf(unbounded_part)
        # Rounding may bring the value beyond a bound, most of all where a bound cuts off nearly all draws.
        return min(max(value, self._low), self._high)

    def part(self, value: Any) -> float:
        """Compute the share from 0 to 1 of all draws up to a value within the bounds: the inverse of :meth:`quantile`.

        It is 0.5 for a distribution with a single value.
        """
        parts = self._parts
        # All draws are one value: the mean, or the bound that leaves no other. The quotient below could be 0 / 0.
        if not self.deviation or parts.high <= parts.low:
            return 0.5
        return (self._unbounded_part(value) - parts.low) / (parts.high - parts.low)

    def holds(self, value: Any) -> bool:
        """Whether a value is a number within the bounds."""
        return _is_number(value) and self._low <= value <= self._high

    def grid(self, count: int) -> list[Any]:
        """List the values in the middles of equal shares of all draws."""
        # The ends themselves are infinite, or so rare that they would say little about the distribution.
        return [self.quantile((index + 0.5) / count) for index in range(count)]

    def draw(self, source: np.random.Generator) -> float:
        """Draw a value at random."""
        is_unbounded = self.low is None and self.high is None
        # NumPy's own draws are faster, and not cut off at _FAR.
        return (
            source.normal(self.mean, self.deviation)
            if is_unbounded
            else self.quantile(source.random())
        )

    @property
    def _low(self) -> float:
        """Lower bound; minus infinity if there is none."""
        return -inf if self.low is None else self.low

    @property
    def _high(self) -> float:
        """Upper bound; infinity if there is none."""
        return inf if self.high is None else self.high

    @property
    def _parts(self) -> _Ends:
        """Shares of the draws of the distribution without bounds that lie up to the lower and the upper bound."""
        return _Ends(self._unbounded_part(self._low), self._unbounded_part(self._high))

    def _unbounded_part(self, value: float) -> float:
        """Share of the draws of the distribution without bounds that lie up to a value."""
        # All draws are the mean, and the quotient below would divide by zero.
        if not self.deviation:
            return float(value > self.mean)
        return NormalDist().cdf((value - self.mean) / self.deviation)


class Choice(Distribution):
    """A list of values, each of which is drawn as often as any other. A single value is a constant."""

    values: list[Any] = Field(min_length=1, max_length=_MOST)

    @property
    def first(self) -> Any:
        """The value with which a search begins: the first of the list."""
        return self.values[0]

    def quantile(self, part: float) -> Any:
        """Find the value up to which a share of all draws lies, from 0 to 1, in the order of the list."""
        # The share 1 belongs to the last value, and has an index beyond the list.
        index = int(part * len(self.values))
        return self.values[min(max(index, 0), len(self.values) - 1)]

    def part(self, value: Any) -> float:
        """Compute the middle of the share of all draws that a value has, so that :meth:`quantile` gives it back.

        Raises:
            ValueError: the value is not in the list.
        """
        return (self.values.index(value) + 0.5) / len(self.values)

    def holds(self, value: Any) -> bool:
        """Whether a value is in the list."""
        return value in self.values

    def grid(self, count: int) -> list[Any]:
        """List all values, whatever their count."""
        return list(self.values)


TEXTS = (
    "VALUE,VALUE..., lin:FIRST:LAST:COUNT, log:FIRST:LAST:COUNT, uniform:LOW:HIGH, loguniform:LOW:HIGH, "
    "integer:LOW:HIGH or normal:MEAN:DEVIATION"
)
"""Forms of a line of text, for messages."""

_GRIDS: Mapping[str, Callable[[float, float, int], Vector]] = {
    "lin": np.linspace,
    "log": np.geomspace,
}
"""Functions that make the values of a line ``KIND:FIRST:LAST:COUNT``, by the kind."""

_DRAWN: Mapping[str, Callable[[float, float], Values]] = {
    "uniform": lambda low, high: {"low": low, "high": high},
    "loguniform": lambda low, high: {"low": low, "high": high, "log": True},
    "integer": lambda low, high: {"low": low, "high": high, "integer": True},
    "normal": lambda mean, deviation: {"mean": mean, "deviation": deviation},
}
"""Functions that make the section of a line ``KIND:NUMBER:NUMBER``, by the kind."""


def _section(text: str) -> Values:
    """Convert a line of text to the section that means the same.

    Raises:
        ValueError: the line has none of the forms, or its range is empty. The message is what would be right.
    """
    # A text without a known kind, even one with colons, is a list of values, such as a path of Windows.
    kind, *parameters = text.split(":")
    if kind not in _GRIDS and kind not in _DRAWN:
        return {"values": _values_of_list(text)}
    try:
        numbers = [float(parameter) for parameter in parameters]
    except ValueError as problem:
        raise ValueError(TEXTS) from problem
    # float() reads "nan" and "inf" as numbers, which no range has.
    expected_count = 3 if kind in _GRIDS else 2
    if len(numbers) != expected_count or not np.isfinite(numbers).all():
        raise ValueError(TEXTS)
    if kind in _DRAWN:
        return _section_of_range(kind, numbers[0], numbers[1])
    return {"values": _values_of_grid(kind, numbers[0], numbers[1], numbers[2])}


def _section_of_range(kind: str, first: float, second: float) -> Values:
    """Make the section of a line ``KIND:NUMBER:NUMBER``.

    Args:
        kind: the kind of distribution, a key of ``_DRAWN``.
        first: the lower end, or the mean of a normal distribution.
        second: the upper end, or the deviation of a normal distribution.

    Raises:
        ValueError: the range is empty, or has numbers that the kind cannot have. The message is what would be right.
    """
    is_valid = second >= 0 if kind == "normal" else first < second
    if not is_valid:
        raise ValueError(
            message("base.a_range", "a range with LOW less than HIGH, or a DEVIATION of 0 or more")
        )
    is_not_positive = kind == "loguniform" and first <= 0
    is_not_whole = kind == "integer" and bool(first % 1 or second % 1)
    if is_not_positive or is_not_whole:
        raise ValueError(
            message(
                "base.a_range_for_its_kind",
                "a range of positive numbers for loguniform, and of integers for integer",
            )
        )
    return _DRAWN[kind](first, second)


def _values_of_grid(kind: str, first: float, last: float, count: float) -> list[float]:
    """Compute the values of a line ``KIND:FIRST:LAST:COUNT``, both ends among them.

    Args:
        kind: ``lin`` for equal differences, ``log`` for equal factors.
        first: first value.
        last: last value.
        count: count of the values.

    Raises:
        ValueError: the ends are equal or have no logarithm, or the count is not valid. The message is what would be
            right.
    """
    is_count = 2 <= count <= _MOST and count % 1 == 0
    # A grid may go down, from the larger end to the smaller one, so only equal ends are refused.
    if first == last or not is_count:
        raise ValueError(
            message(
                "base.a_range_with_count",
                "a range with FIRST different from LAST, and a COUNT from 2 to {most}",
                most=_MOST,
            )
        )
    if kind == "log" and min(first, last) <= 0:
        raise ValueError(message("base.a_positive_range", "a range of positive numbers for log"))
    values: list[float] = _GRIDS[kind](first, last, int(count)).tolist()
    return values


def _values_of_list(text: str) -> list[Any]:
    """Read the values of a line ``VALUE,VALUE...``. Each value is one of YAML: a number, a text, or a boolean.

    Raises:
        ValueError: a value cannot be read, or is missing. The message is what would be right.
    """
    try:
        # YAML decides what 1, true and "1" are, in the same way as in a file.
        values: Any = parse_yaml(f"[{text}]", "values")
    except SimrobError as problem:
        raise ValueError(TEXTS) from problem
    # A missing value, as in "1,,2", is null in YAML.
    if not values or None in values:
        raise ValueError(TEXTS)
    return list(values)


def _plain_values(values: Sequence[Any] | Vector) -> list[Any]:
    """List values that a script gives, with numbers of Python in place of those of NumPy, as YAML has them."""
    return [
        value.tolist() if isinstance(value, np.ndarray | np.generic) else value for value in values
    ]


def _read(content: Any, handler: ValidatorFunctionWrapHandler) -> Any:
    """Make a distribution of a section, of a list of values, or of a line of text, which the distribution keeps.

    Args:
        content: the section, the list or the line.
        handler: pydantic's function that makes a distribution of a section.

    Raises:
        ValueError: the line has none of the forms, or pydantic refuses the section.
    """
    if isinstance(content, (list, tuple, range, np.ndarray)):
        return handler({"values": _plain_values(content)})
    if not isinstance(content, str):
        return handler(content)
    try:
        distribution = handler(_section(content))
    except ValueError as problem:
        raise ValueError(message("base.must_be", "must be {problem}", problem=problem)) from problem
    # The section is frozen for users: its private attribute can still be set.
    distribution._text = content
    return distribution


def _kind(content: Any) -> str:
    """Name of the class of distribution that a section describes, by its keys.

    Args:
        content: the section, or a distribution.
    """
    # Pydantic asks for sections of a file, and for distributions that Python code has made.
    keys = set(content) if isinstance(content, Mapping) else set(getattr(content, "__dict__", {}))
    if "values" in keys:
        return "Choice"
    # A section that is neither becomes a Uniform, whose error names the keys that are missing.
    is_normal = bool(keys & {"mean", "deviation"})
    return "Normal" if is_normal else "Uniform"


AnyDistribution = Annotated[
    Annotated[Uniform, Tag("Uniform")]
    | Annotated[Normal, Tag("Normal")]
    | Annotated[Choice, Tag("Choice")],
    Discriminator(_kind),
    WrapValidator(_read, json_schema_input_type=Uniform | Normal | Choice | str),
]
"""A distribution in a file: a section, or a line of text."""


def parse_distribution(option: str, text: str) -> Distribution:
    """Read a distribution from a line of text, such as ``0.5,1,2``, ``log:10:1000:9`` or ``uniform:0.5:2``.

    Args:
        option: name of the option with the line, for the error.
        text: the line, in one of the forms of `TEXTS`.

    Raises:
        InvalidParameter: the line has none of the forms, its range is empty, or its numbers are not possible for its
            kind, such as a negative one that needs a logarithm.
    """
    try:
        _section(text)
    except ValueError as problem:
        raise InvalidParameter(option, text or "nothing", str(problem)) from None
    found: Distribution = TypeAdapter(AnyDistribution).validate_python(text)
    return found
