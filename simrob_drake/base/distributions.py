"""Distributions over keys of a station, a gait or a program: uniform, normal, and choices.

Searches, proofs, sweeps and tasks read them alike::

    servo.kp: {low: 100, high: 20000, log: true}
    gait.steps: {low: 4, high: 12, integer: true}
    pieces.load.mass: {mean: 1, deviation: 0.1, low: 0.5}
    solver.kind: {values: [continuous, discrete]}
    solver.time_step: {low: 1.0e-3, high: 5.0e-3, when: {solver.kind: discrete}}
    gravity: uniform:1.6:9.8
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from math import floor, inf
from statistics import NormalDist
from typing import Annotated, Any, Self

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

Values = dict[str, Any]  # of keys, by dotted paths
_MOST = 10_000
_FAR = 1e-12  # a normal distribution is cut off where so small a part of all draws lies beyond


class Distribution(Strict, ABC):
    """What values a key takes, and how often."""

    when: Values = Field(default_factory=dict)
    """Values of keys before this one, one or a list for each; under others this key is left as it is."""
    _text: str = PrivateAttr("")

    @model_serializer(mode="wrap")
    def _as_written(self, handler: SerializerFunctionWrapHandler) -> Any:
        """Return the line of text that it was read from, or the keys that are not at their defaults."""
        default = {key: field.get_default(call_default_factory=True) for key, field in type(self).model_fields.items()}
        return self._text or {key: value for key, value in handler(self).items() if value != default[key]}

    @property
    def text(self) -> str:
        """The line that it was read from; empty if it was none."""
        return self._text

    @property
    @abstractmethod
    def first(self) -> Any:
        """The value from which a search begins."""

    @abstractmethod
    def quantile(self, part: float) -> Any:
        """Return the value up to which a part of all draws lies, 0 to 1."""

    @abstractmethod
    def part(self, value: Any) -> float:
        """Return which part of all draws lies up to a value, the inverse of :meth:`quantile`."""

    @abstractmethod
    def holds(self, value: Any) -> bool:
        """Whether something is a value that it has."""

    @abstractmethod
    def grid(self, count: int) -> list[Any]:
        """Return values that are evenly spaced, so many unless there are fewer; a choice has as many as it has."""

    def draw(self, source: np.random.Generator) -> Any:
        """Return a value at random."""
        return self.quantile(source.random())

    def applies(self, values: Values) -> bool:
        """Whether the keys before it have the values under which this one is changed."""
        return all(
            key in values and values[key] in (needed if isinstance(needed, list) else [needed])
            for key, needed in self.when.items()
        )


class Uniform(Distribution):
    """Every value of a range as often as any other."""

    low: Number
    high: Number
    start: Number | None = None
    """Where a search begins; in the middle unless given."""
    log: Boolean = False
    """Whether factors count in place of differences: the logarithm is uniform."""
    integer: Boolean = False
    """Whether it has whole numbers alone, `low` and `high` among them."""

    @model_validator(mode="after")
    def _checked(self) -> Self:
        if not self.low < self.high:
            raise ValueError(message("base.low_not_below_high", "low must be below high"))
        if self.log and self.low <= 0:
            raise ValueError(message("base.low_not_positive", "low must be positive where it is logarithmic"))
        if self.start is not None and not self.low <= self.start <= self.high:
            raise ValueError(message("base.start_out_of_range", "start must lie between low and high"))
        if self.integer and any(end is not None and end % 1 for end in (self.low, self.high, self.start)):
            raise ValueError(
                message("base.range_not_whole", "low, high and start must be whole numbers where integer is true")
            )
        return self

    @property
    def first(self) -> float:
        """The value from which a search begins."""
        return self.quantile(0.5) if self.start is None else int(self.start) if self.integer else self.start

    def quantile(self, part: float) -> float:
        """Return the value up to which a part of all draws lies, 0 to 1."""
        part, (low, high) = min(max(float(part), 0.0), 1.0), self._ends
        value = low * (high / low) ** part if self.log else low + (high - low) * part
        value = min(max(float(value), low), high)  # which rounding may pass
        return int(min(max(floor(value + 0.5), self.low), self.high)) if self.integer else value

    def part(self, value: Any) -> float:
        """Return which part of all draws lies up to a value, the inverse of :meth:`quantile`."""
        low, high = self._ends
        return float(np.log(value / low) / np.log(high / low)) if self.log else (value - low) / (high - low)

    def holds(self, value: Any) -> bool:
        """Whether something is a value that it has."""
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number and self.low <= value <= self.high and (not self.integer or value % 1 == 0)

    def grid(self, count: int) -> list[Any]:
        """Return values that are evenly spaced, both ends among them."""
        spaced = (np.geomspace if self.log else np.linspace)(self.low, self.high, count).tolist()
        return list(dict.fromkeys(round(value) for value in spaced)) if self.integer else spaced

    @property
    def _ends(self) -> tuple[float, float]:
        """The ends of what is rounded: each whole number gets its part of the range, the first and the last, too."""
        return (self.low - 0.5, self.high + 0.5) if self.integer else (self.low, self.high)


class Normal(Distribution):
    """Values about a mean, perhaps between bounds."""

    mean: Number
    deviation: NotNegative
    """The standard deviation, before bounds cut anything off."""
    low: Number | None = None
    high: Number | None = None

    @model_validator(mode="after")
    def _checked(self) -> Self:
        if not self._low <= self.mean <= self._high:
            raise ValueError(message("base.mean_out_of_range", "mean must lie between low and high"))
        return self

    @property
    def first(self) -> float:
        """The value from which a search begins: the mean."""
        return self.mean

    def quantile(self, part: float) -> float:
        """Return the value up to which a part of all draws lies, 0 to 1."""
        least, most = self._parts
        within = min(max(least + float(part) * (most - least), _FAR), 1 - _FAR)
        return min(max(self.mean + self.deviation * NormalDist().inv_cdf(within), self._low), self._high)

    def part(self, value: Any) -> float:
        """Return which part of all draws lies up to a value, the inverse of :meth:`quantile`."""
        (least, most), within = self._parts, self._below(value)
        return (within - least) / (most - least) if most > least else 0.5

    def holds(self, value: Any) -> bool:
        """Whether something is a value that it has."""
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number and self._low <= value <= self._high

    def grid(self, count: int) -> list[Any]:
        """Return values between which equal parts of all draws lie."""
        return [self.quantile((place + 0.5) / count) for place in range(count)]

    def draw(self, source: np.random.Generator) -> float:
        """Return a value at random."""
        free = self.low is None and self.high is None
        return source.normal(self.mean, self.deviation) if free else self.quantile(source.random())

    @property
    def _low(self) -> float:
        return -inf if self.low is None else self.low

    @property
    def _high(self) -> float:
        return inf if self.high is None else self.high

    @property
    def _parts(self) -> tuple[float, float]:
        """Which parts of all values without bounds lie up to these."""
        return self._below(self._low), self._below(self._high)

    def _below(self, value: float) -> float:
        return NormalDist().cdf((value - self.mean) / self.deviation) if self.deviation else float(value > self.mean)


class Choice(Distribution):
    """One of some values, each as often as any other; a single one is a constant."""

    values: list[Any] = Field(min_length=1, max_length=_MOST)

    @property
    def first(self) -> Any:
        """The value from which a search begins: the first."""
        return self.values[0]

    def quantile(self, part: float) -> Any:
        """Return the value up to which a part of all draws lies, 0 to 1, in the order in which they stand."""
        return self.values[min(max(int(part * len(self.values)), 0), len(self.values) - 1)]

    def part(self, value: Any) -> float:
        """Return the middle of the part of all draws that a value has."""
        return (self.values.index(value) + 0.5) / len(self.values)

    def holds(self, value: Any) -> bool:
        """Whether something is a value that it has."""
        return value in self.values

    def grid(self, count: int) -> list[Any]:
        """Return all values."""
        return list(self.values)


TEXTS = (
    "VALUE,VALUE..., lin:FIRST:LAST:COUNT, log:FIRST:LAST:COUNT, uniform:LOW:HIGH, loguniform:LOW:HIGH, "
    "integer:LOW:HIGH or normal:MEAN:DEVIATION"
)
"""What a distribution may be written as in one line."""
_GRIDS: Mapping[str, Callable[[float, float, int], Vector]] = {"lin": np.linspace, "log": np.geomspace}
_DRAWN: Mapping[str, Callable[[float, float], Values]] = {
    "uniform": lambda low, high: {"low": low, "high": high},
    "loguniform": lambda low, high: {"low": low, "high": high, "log": True},
    "integer": lambda low, high: {"low": low, "high": high, "integer": True},
    "normal": lambda mean, deviation: {"mean": mean, "deviation": deviation},
}


def _section(text: str) -> Values:
    """Return the section that a line says; raises ValueError: anything else or an empty range, with what it must be."""
    kind, *numbers = text.split(":")
    if kind not in _GRIDS and kind not in _DRAWN:
        return {"values": _listed(text)}
    try:
        first, second, *count = (float(number) for number in numbers)
    except ValueError as problem:
        raise ValueError(TEXTS) from problem
    if not np.isfinite([first, second, *count]).all() or len(count) != (kind in _GRIDS):
        raise ValueError(TEXTS)
    if kind in _DRAWN:
        if second < 0 if kind == "normal" else first >= second:
            raise ValueError(message("base.a_range", "a range: LOW below HIGH, and a deviation that is not negative"))
        if (kind == "loguniform" and first <= 0) or (kind == "integer" and (first % 1 or second % 1)):
            raise ValueError(
                message(
                    "base.a_range_for_its_kind",
                    "a range of positive numbers for loguniform, and of whole ones for integer",
                )
            )
        return _DRAWN[kind](first, second)
    if first == second or not 2 <= count[0] <= _MOST or count[0] % 1:
        raise ValueError(
            message(
                "base.a_range_with_count", "a range of two ends that differ, and a count of 2 to {most}", most=_MOST
            )
        )
    if kind == "log" and min(first, second) <= 0:
        raise ValueError(message("base.a_positive_range", "a range of positive numbers where it is logarithmic"))
    return {"values": _GRIDS[kind](first, second, int(count[0])).tolist()}


def _listed(text: str) -> list[Any]:
    try:
        values: Any = parse_yaml(f"[{text}]", "values")
    except SimrobError as problem:
        raise ValueError(TEXTS) from problem
    if not values or None in values:
        raise ValueError(TEXTS)
    return list(values)


def _read(content: Any, handler: ValidatorFunctionWrapHandler) -> Any:
    """Return a distribution, from a line of text, too, which it keeps."""
    if not isinstance(content, str):
        return handler(content)
    try:
        found = handler(_section(content))
    except ValueError as problem:
        raise ValueError(message("base.must_be", "must be {problem}", problem=problem)) from problem
    found._text = content  # its own
    return found


def _kind(content: Any) -> str:
    """Return which distribution a section is of, by its keys."""
    keys = content if isinstance(content, Mapping) else getattr(content, "__dict__", {})
    return "Choice" if "values" in keys else "Normal" if {"mean", "deviation"} & set(keys) else "Uniform"


AnyDistribution = Annotated[
    Annotated[Uniform, Tag("Uniform")] | Annotated[Normal, Tag("Normal")] | Annotated[Choice, Tag("Choice")],
    Discriminator(_kind),
    WrapValidator(_read, json_schema_input_type=Uniform | Normal | Choice | str),
]
"""A distribution in a file: a section, or a line of text."""


def parsed(option: str, text: str) -> Distribution:
    """Return the distribution that a line says: ``0.5,1,2``, ``log:10:1000:9``, ``uniform:0.5:2`` ... of :data:`TEXTS`.

    Counts of ``lin`` and ``log`` include both ends. Raises InvalidParameter, which calls it ``option``: anything else,
    an empty range, or ends that a logarithm does not take.
    """
    try:
        _section(text)
    except ValueError as problem:
        raise InvalidParameter(option, text or "nothing", str(problem)) from None
    found: Distribution = TypeAdapter(AnyDistribution).validate_python(text)
    return found
