"""Blocks of a signal flow that remember nothing: what all blocks share, and each with its equation."""

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
import pydrake.math as drake
from pydantic import Field, model_validator
from pydrake.symbolic import Expression, Formula, if_then_else

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Instant, NotNegative, Number, Strict
from simrob_drake.blocks.written_net import NetBlock, Values

_SAME = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "floor",
         "ceil")  # fmt: skip

_ZERO = Expression(0.0)


def chosen(condition: Any, yes: Any, no: Any) -> Any:
    """Return one of two values, by whether a condition holds."""
    if isinstance(condition, Formula):
        return if_then_else(condition, _ZERO + yes, _ZERO + no)
    return yes if condition else no


def least(first: Any, second: Any) -> Any:
    """Return the smaller of two values."""
    return drake.min(first, second) if _symbolic(first, second) else min(first, second)


def largest(first: Any, second: Any) -> Any:
    """Return the larger of two values."""
    return drake.max(first, second) if _symbolic(first, second) else max(first, second)


def _symbolic(*values: Any) -> bool:
    return any(isinstance(value, Expression) for value in values)


def _of(name: str) -> Callable[..., Any]:
    numeric, symbolic = getattr(math, name), getattr(drake, name)
    return lambda *values: symbolic(*(_ZERO + value for value in values)) if _symbolic(*values) else numeric(*values)


def power(base: Any, exponent: Any) -> Any:
    """Return a power, infinite where 0 has a negative exponent."""
    if _symbolic(base, exponent):
        return drake.pow(_ZERO + base, _ZERO + exponent)
    return math.inf if base == 0 and exponent < 0 else math.pow(base, exponent)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: _of(name) for name in _SAME},
    "pow": power,
    "abs": abs,
    "min": least,
    "max": largest,
    "sign": lambda value: chosen(value > 0, 1.0, chosen(value < 0, -1.0, 0.0)),
}
"""The functions that a block can be, by name."""


Sum = str | dict[str, Number]
"""A signal by its name, or several with their factors; ``one`` is 1 and ``time`` the time [s]."""
Row = tuple[Number, ...]


class FlowBlock(Strict, NetBlock):
    """A block of a signal flow: its key ``kind``, what it takes, and its equation.

    That is ``_output`` by the time [s], its states and its inputs, and of one that has states, ``state_update``: their
    derivatives, or with a ``period`` their next values. A sampled block holds its output between samples. Both
    are equations of numbers and of symbolic expressions alike.
    """

    takes: ClassVar[tuple[int, int]] = (1, 1)  # how few and how many inputs there may be

    kind: str
    of: Sum | tuple[Sum, ...] = ()
    """Its inputs, each a signal or a sum of signals with factors."""
    period: NotNegative = 0.0
    """Between samples [s], of a block that has states; 0 of one that is continuous."""

    @property
    def inputs(self) -> tuple[Sum, ...]:
        """Its inputs in order."""
        return self.of if isinstance(self.of, tuple) else (self.of,)

    @property
    def law(self) -> "FlowBlock":
        """The block that computes it: itself, or one that is the same."""
        return self

    @property
    def edges(self) -> Sequence[float]:
        """Times at which its output jumps by itself [s]."""
        return ()

    def check(self, key: str) -> None:
        """Check how many inputs it has; raises InvalidParameter: too few or too many."""
        fewest, most = self.takes
        if not fewest <= len(self.inputs) <= most:
            expected = (
                message("parts.count_of_inputs", "{fewest} inputs", fewest=fewest)
                if fewest == most
                else message("parts.inputs_or_more", "{fewest} inputs or more", fewest=fewest)
            )
            raise InvalidParameter(
                f"{key}.of", message("parts.given_inputs", "{count} inputs", count=len(self.inputs)), expected
            )


class Bounded(Strict):
    """Of a lower and an upper bound."""

    lower: Number | None = None
    """The least value; none unless given."""
    upper: Number | None = None
    """The largest value; none unless given."""

    @model_validator(mode="after")
    def _ordered(self) -> "Bounded":
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise ValueError(
                message(
                    "parts.lower_above_upper",
                    "lower ({lower:g}) is above upper ({upper:g})",
                    lower=self.lower,
                    upper=self.upper,
                )
            )
        return self

    def clipped(self, u: float) -> float:
        """Return the nearest value within the bounds."""
        above = u if self.lower is None else largest(u, self.lower)
        return above if self.upper is None else least(above, self.upper)


class Sums(FlowBlock):
    """Sums of signals: y = Σ k u for each of its inputs."""

    takes = 1, 10_000
    kind: Literal["sum"]

    @property
    def size(self) -> int:
        """One for each input."""
        return len(self.inputs)

    @property
    def input_repetitions(self) -> int:
        """How often an input stands in its equation."""
        return 1

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return u


class Product(FlowBlock):
    """Inputs multiplied, and divided by those at ``divides``; a division by 0 is infinite."""

    takes = 1, 100
    kind: Literal["product"]
    divides: tuple[int, ...] = ()
    """Places of the inputs that divide, from 0."""

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (math.prod(power(part, -1) if place in self.divides else part for place, part in enumerate(u)),)


class Saturation(Bounded, FlowBlock):
    """y = u within bounds, and a bound beyond."""

    kind: Literal["saturation"]

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (self.clipped(u[0]),)


class DeadZone(Bounded, FlowBlock):
    """y = 0 between the bounds, and how far u lies beyond them outside."""

    kind: Literal["dead_zone"]

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (u[0] - self.clipped(u[0]),)


class Lookup(FlowBlock):
    """Straight lines between points; beyond them the last line goes on, or with ``clip`` the last value."""

    kind: Literal["lookup"]
    points: Row = Field(min_length=2)
    """Values of u, rising."""
    values: Row
    """Values of y there."""
    clip: bool = False
    """Keep the last value beyond the points."""

    @model_validator(mode="after")
    def _rising(self) -> "Lookup":
        if len(self.values) != len(self.points) or any(np.diff(self.points) <= 0):
            raise ValueError(message("parts.points_must_rise", "points must rise, and values be as many"))
        return self

    @property
    def input_repetitions(self) -> int:
        """How often an input stands in its equation."""
        return 2 * len(self.points)

    def _output(self, t: float, x: Values, u: Values) -> Values:
        within = least(largest(u[0], self.points[0]), self.points[-1]) if self.clip else u[0]
        return (self._between(0, len(self.points) - 1, within),)

    def _between(self, first: int, last: int, u: float) -> float:
        """Return the line that holds, of those between two points."""
        if last - first == 1:
            return self._line(last, u)
        middle = (first + last) // 2
        found: float = chosen(u < self.points[middle], self._between(first, middle, u), self._between(middle, last, u))
        return found

    def _line(self, right: int, u: float) -> float:
        """Return the line to a point from the one before."""
        begin, low = self.points[right - 1], self.values[right - 1]
        return low + (self.values[right] - low) / (self.points[right] - begin) * (u - begin)


_COMPARED: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
Operator = Literal["<", "<=", ">", ">=", "==", "!="]


class Compare(FlowBlock):
    """y = 1 where u is less than (or whatever is said) the threshold, else 0."""

    kind: Literal["compare"]
    operator: Operator
    """How the input is compared with the threshold, or with a second input."""
    threshold: Number = 0.0
    """What it is compared with."""

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (chosen(_COMPARED[self.operator](u[0], self.threshold), 1.0, 0.0),)


class Logic(FlowBlock):
    """y = 1 where all, any, none, not all or an odd number of its inputs are not 0, else 0."""

    takes = 1, 100
    kind: Literal["logic"]
    operator: Literal["and", "or", "nor", "nand", "xor", "not"]
    """How the inputs are joined."""

    def _output(self, t: float, x: Values, u: Values) -> Values:
        true = [chosen(part != 0, 1.0, 0.0) for part in u]
        all_of, any_of = math.prod(true), 1.0 - math.prod(1.0 - one for one in true)
        odd = (1.0 - math.prod(1.0 - 2.0 * one for one in true)) / 2.0
        joined = {
            "and": all_of,
            "nand": 1.0 - all_of,
            "or": any_of,
            "nor": 1.0 - any_of,
            "not": 1.0 - any_of,
            "xor": odd,
        }
        return (joined[self.operator],)


class Switch(FlowBlock):
    """y = the first input where the second meets the threshold, else the third."""

    takes = 3, 3
    kind: Literal["switch"]
    operator: Operator = ">="
    """How the second input is compared with the threshold."""
    threshold: Number = 0.0
    """What it is compared with."""

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (chosen(_COMPARED[self.operator](u[1], self.threshold), u[0], u[2]),)


class MathFunction(FlowBlock):
    """y = f(u), or f(u, v) of two."""

    takes = 1, 2
    kind: Literal["function"]
    function: Literal[
        "abs", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "floor",
        "ceil", "sign", "atan2", "min", "max", "pow",
    ]  # fmt: skip
    """Which function it is."""

    def check(self, key: str) -> None:
        """Check how many inputs it has."""
        count = 2 if self.function in ("atan2", "min", "max", "pow") else 1
        if len(self.inputs) != count:
            raise InvalidParameter(
                f"{key}.of",
                message("parts.given_inputs", "{count} inputs", count=len(self.inputs)),
                message("parts.as_function_takes", "{count}, as {function} takes", count=count, function=self.function),
            )

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (FUNCTIONS[self.function](*u),)


class Step(FlowBlock):
    """y = ``before``, and ``after`` from a time on."""

    takes = 0, 0
    kind: Literal["step"]
    time: Instant
    """When it steps [s]."""
    before: Number = 0.0
    """Its value before."""
    after: Number = 1.0
    """Its value from then on."""

    @property
    def edges(self) -> Sequence[float]:
        """When it steps [s]."""
        return (self.time,)

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (chosen(t >= self.time, self.after, self.before),)


class Input(FlowBlock):
    """An input of the station, ``<controller>.<block>``: 0 until something drives it."""

    takes = 0, 0
    kind: Literal["input"]
