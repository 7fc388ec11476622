"""Blocks of a signal flow that have no states, and the base class of all blocks of a signal flow.

A signal flow is a net of small blocks, as in Simulink. Each block computes its output y from its inputs u, at a time t.
The equations are evaluated in two ways: with numbers, and with symbolic expressions of Drake, of which a system is made
that calls no Python while it is stepped. An expression has no value yet, so equations branch by `choose`, `minimum` and
`maximum`, not by ``if``.
"""

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

# Functions that Python's `math` and Drake's `math` have under the same name.
_COMMON_FUNCTIONS = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "sqrt",
                     "floor", "ceil")  # fmt: skip
# The sum of this and a number is an expression: Drake's functions do not take a number together with an expression.
_ZERO = Expression(0.0)


def choose(condition: Any, yes: Any, no: Any) -> Any:
    """Choose the value ``yes`` if a condition holds, else ``no``.

    The condition is a truth value, or a formula of Drake. A formula has no truth value yet, so the result is then an
    expression that contains both values.
    """
    if isinstance(condition, Formula):
        return if_then_else(condition, _ZERO + yes, _ZERO + no)
    return yes if condition else no


def minimum(first: Any, second: Any) -> Any:
    """Smaller one of two numbers or expressions."""
    return drake.min(first, second) if _has_expression(first, second) else min(first, second)


def maximum(first: Any, second: Any) -> Any:
    """Larger one of two numbers or expressions."""
    return drake.max(first, second) if _has_expression(first, second) else max(first, second)


def _has_expression(*values: Any) -> bool:
    """Whether any of the values is a symbolic expression."""
    return any(isinstance(value, Expression) for value in values)


def _find_function(name: str) -> Callable[..., Any]:
    """Make one function, for numbers and expressions alike, of those that `math` and Drake call by this name."""
    of_numbers = getattr(math, name)
    of_expressions = getattr(drake, name)

    def function(*values: Any) -> Any:
        """Compute the function of numbers, or of arguments of which at least one is an expression."""
        if _has_expression(*values):
            return of_expressions(*[_ZERO + value for value in values])
        return of_numbers(*values)

    return function


def power(base: Any, exponent: Any) -> Any:
    """Compute a power. Zero to a negative power is infinite, as in Drake, where Python would raise an error."""
    if _has_expression(base, exponent):
        return drake.pow(_ZERO + base, _ZERO + exponent)
    return math.inf if base == 0 and exponent < 0 else math.pow(base, exponent)


def _sign(value: Any) -> Any:
    """Sign of a value: 1, 0 or -1."""
    return choose(value > 0, 1.0, choose(value < 0, -1.0, 0.0))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: _find_function(name) for name in _COMMON_FUNCTIONS},
    "pow": power,
    "abs": abs,
    "min": minimum,
    "max": maximum,
    "sign": _sign,
}
"""Functions of the block ``function``, by name. They take numbers and expressions alike."""


Sum = str | dict[str, Number]
"""A sum of signals: the name of one signal, or names with factors. ``one`` is the constant 1, ``time`` the time [s]."""
Row = tuple[Number, ...]
"""A row of a matrix, or a vector."""


class FlowBlock(Strict, NetBlock):
    """A block of a signal flow: the section that describes it in a station file, and its equations.

    A subclass is a kind of block. Its method ``_output(t, x, u)`` computes the output from the time t [s], the states x
    and the inputs u. A kind with states also has the properties ``start``, the states at the start, and the method
    ``state_update(x, u)``: the derivatives of the states, or their next values if the block is sampled, that is, if it
    has a period. A sampled block holds its output between samples.

    Attributes:
        kind: name of the kind in a station file.
        takes: smallest and largest count of inputs.
    """

    takes: ClassVar[tuple[int, int]] = (1, 1)  # of most kinds

    kind: str
    of: Sum | tuple[Sum, ...] = ()
    """Inputs of the block, each a signal or a sum of signals with factors."""
    period: NotNegative = 0.0
    """Time between samples [s]; 0 for a block that is continuous."""

    @property
    def inputs(self) -> tuple[Sum, ...]:
        """Inputs of the block in order. A block with one input may give it without a list."""
        # A sum is a text or a mapping, so a tuple can only be the list of all inputs.
        return self.of if isinstance(self.of, tuple) else (self.of,)

    @property
    def law(self) -> "FlowBlock":
        """Block with the equations: the block itself, or an equivalent of another kind, which has the same output."""
        return self

    @property
    def edges(self) -> Sequence[float]:
        """Times at which the output jumps, whatever the inputs do [s]. A solver's step must end there."""
        return ()

    def check(self, key: str) -> None:
        """Check the count of inputs.

        Args:
            key: key of the block, for errors.

        Raises:
            InvalidParameter: there are fewer or more inputs than `takes` allows.
        """
        fewest, most = self.takes
        if not fewest <= len(self.inputs) <= most:
            # The largest counts of blocks with several inputs only exclude mistakes: they need not be named.
            expected = (
                str(fewest)
                if fewest == most
                else message("parts.inputs_or_more", "{fewest} or more", fewest=fewest)
            )
            raise InvalidParameter(words_for_input_count(key), len(self.inputs), expected)


def words_for_input_count(key: str) -> str:
    """Words for the count of a block's inputs, for errors.

    Args:
        key: key of the block.
    """
    return message("parts.count_of_inputs", "the number of inputs in {key}.of", key=key)


class Bounded(Strict):
    """Keys of a block with a lower and an upper bound, each of which may be left out."""

    lower: Number | None = None
    """Lower bound; none if it is left out."""
    upper: Number | None = None
    """Upper bound; none if it is left out."""

    @model_validator(mode="after")
    def _check_order(self) -> "Bounded":
        """Check that the lower bound is not above the upper one, if both are given.

        Raises:
            ValueError: it is above.
        """
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise ValueError(
                message(
                    "parts.lower_above_upper",
                    "lower is {lower:g}; it must be at most upper, {upper:g}",
                    lower=self.lower,
                    upper=self.upper,
                )
            )
        return self

    def clip(self, value: Any) -> Any:
        """Limit a value to the bounds: a number or an expression."""
        if self.lower is not None:
            value = maximum(value, self.lower)
        if self.upper is not None:
            value = minimum(value, self.upper)
        return value


class Sums(FlowBlock):
    """Sums of signals: y = Σ k u for each of the inputs."""

    takes = 1, 10_000  # so many since one block may have the sums for all axes of a robot
    kind: Literal["sum"]

    @property
    def size(self) -> int:
        """Count of elements of the output: one for each input."""
        return len(self.inputs)

    @property
    def input_repetitions(self) -> int:
        """Count of occurrences of an input in the block's equation."""
        return 1

    def _output(self, t: float, x: Values, u: Values) -> Values:
        # The net adds up the signals of each input before it calls a block, so nothing is left to do.
        return u


class Product(FlowBlock):
    """Product of the inputs, divided by the inputs that ``divides`` lists; a division by 0 is infinite."""

    takes = 1, 100
    kind: Literal["product"]
    divides: tuple[int, ...] = ()
    """Indices of the inputs that divide, from 0."""

    def _output(self, t: float, x: Values, u: Values) -> Values:
        """Compute the product of the inputs; those with an index in ``divides`` are inverted before."""
        # x^-1 instead of a division, which Python refuses for 0.
        factors = [
            power(value, -1) if index in self.divides else value for index, value in enumerate(u)
        ]
        return (math.prod(factors),)


class Saturation(Bounded, FlowBlock):
    """y = u within bounds; beyond a bound, y is the bound."""

    kind: Literal["saturation"]

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (self.clip(u[0]),)


class DeadZone(Bounded, FlowBlock):
    """y = 0 between the bounds; beyond a bound, y is u minus the bound."""

    kind: Literal["dead_zone"]

    def _output(self, t: float, x: Values, u: Values) -> Values:
        # clip(u) is u itself between the bounds, and the bound beyond it.
        return (u[0] - self.clip(u[0]),)


class Lookup(FlowBlock):
    """Straight lines between points; beyond them the last line goes on, or with ``clip`` the last value."""

    kind: Literal["lookup"]
    points: Row = Field(min_length=2)
    """Values of u, rising."""
    values: Row
    """Value of y at each point."""
    clip: bool = False
    """Whether y keeps the last value beyond the points."""

    @model_validator(mode="after")
    def _check_points(self) -> "Lookup":
        """Check that the points rise and that each has a value.

        Raises:
            ValueError: they do not rise, or the counts of points and values differ.
        """
        # Two points at the same u would divide by zero.
        if len(self.values) != len(self.points) or any(np.diff(self.points) <= 0):
            raise ValueError(
                message(
                    "parts.points_must_rise",
                    "points must increase, and values must have an entry for each point",
                )
            )
        return self

    @property
    def input_repetitions(self) -> int:
        """Count of occurrences of an input in the block's equation: a condition and a line for each point."""
        return 2 * len(self.points)

    def _output(self, t: float, x: Values, u: Values) -> Values:
        """Interpolate at the input; beyond the points, extrapolate, or keep the last value with ``clip``."""
        within = u[0]
        if self.clip:
            # The interpolation has the first and the last value at these ends.
            within = minimum(maximum(u[0], self.points[0]), self.points[-1])
        return (self._interpolate(0, len(self.points) - 1, within),)

    def _interpolate(self, first: int, last: int, u: Any) -> Any:
        """Compute y at u by bisection, among the points with the indices ``first`` to ``last``.

        The function calls itself for both halves, as u may be an expression, which cannot be compared yet. Each
        evaluation of the resulting expression then passes as many conditions as the logarithm of the count of points.
        """
        if last - first == 1:
            return self._line_to(last, u)
        middle = (first + last) // 2
        below = self._interpolate(first, middle, u)
        above = self._interpolate(middle, last, u)
        return choose(u < self.points[middle], below, above)

    def _line_to(self, right: int, u: Any) -> Any:
        """Compute y at u on the line to a point, given by its index, from the point before."""
        left = right - 1
        # Below the first and above the last point, the outermost lines go on.
        slope = (self.values[right] - self.values[left]) / (self.points[right] - self.points[left])
        return self.values[left] + slope * (u - self.points[left])


# With expressions, the functions give formulas.
_COMPARISONS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
Operator = Literal["<", "<=", ">", ">=", "==", "!="]
"""Name of a comparison."""


class Compare(FlowBlock):
    """y = 1 if the comparison of u with the threshold holds, else 0."""

    kind: Literal["compare"]
    operator: Operator
    """Comparison of the input with the threshold."""
    threshold: Number = 0.0
    """Value with which the input is compared."""

    def _output(self, t: float, x: Values, u: Values) -> Values:
        compare = _COMPARISONS[self.operator]
        return (choose(compare(u[0], self.threshold), 1.0, 0.0),)


class Logic(FlowBlock):
    """y = 1 if the inputs fulfil the operator, else 0. An input is true if it is not 0; ``xor``: an odd number is."""

    takes = 1, 100
    kind: Literal["logic"]
    operator: Literal["and", "or", "nor", "nand", "xor", "not"]
    """Logic operator that joins all inputs; ``not`` and ``nor`` are the same."""

    def _output(self, t: float, x: Values, u: Values) -> Values:
        """Join the truth values of all inputs by the operator; the result is 1 or 0."""
        # With truth values b of 0 and 1, as expressions have no logic operators for numbers:
        # and = Π b, or = 1 - Π (1 - b). Each true input changes the sign of Π (1 - 2 b), which is -1 for an odd number.
        truths = [choose(value != 0, 1.0, 0.0) for value in u]
        all_true = math.prod(truths)
        any_true = 1.0 - math.prod([1.0 - truth for truth in truths])
        odd_true = (1.0 - math.prod([1.0 - 2.0 * truth for truth in truths])) / 2.0
        results = {
            "and": all_true,
            "nand": 1.0 - all_true,
            "or": any_true,
            "nor": 1.0 - any_true,
            "not": 1.0 - any_true,
            "xor": odd_true,
        }
        return (results[self.operator],)


class Switch(FlowBlock):
    """y = the first input if the comparison of the second input with the threshold holds, else the third input."""

    takes = 3, 3  # value if true, compared value, value if false
    kind: Literal["switch"]
    operator: Operator = ">="
    """Comparison of the second input with the threshold."""
    threshold: Number = 0.0
    """Value with which the second input is compared."""

    def _output(self, t: float, x: Values, u: Values) -> Values:
        compare = _COMPARISONS[self.operator]
        return (choose(compare(u[1], self.threshold), u[0], u[2]),)


class MathFunction(FlowBlock):
    """y = f(u), or f(u, v) for a function of two inputs."""

    takes = 1, 2
    kind: Literal["function"]
    function: Literal[
        "abs", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "floor",
        "ceil", "sign", "atan2", "min", "max", "pow",
    ]  # fmt: skip
    """Name of the function."""

    def check(self, key: str) -> None:
        """Check the count of inputs.

        Args:
            key: key of the block, for errors.

        Raises:
            InvalidParameter: the function takes another count.
        """
        # These four functions have two arguments, all others have one.
        needed = 2 if self.function in ("atan2", "min", "max", "pow") else 1
        count = len(self.inputs)
        if count != needed:
            raise InvalidParameter(
                words_for_input_count(key),
                count,
                message(
                    "parts.as_function_takes",
                    "{count} for the function {function}",
                    count=needed,
                    function=self.function,
                ),
            )

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (FUNCTIONS[self.function](*u),)


class Step(FlowBlock):
    """y = ``before`` until a time, and ``after`` from then on."""

    takes = 0, 0
    kind: Literal["step"]
    time: Instant
    """Time of the step [s]."""
    before: Number = 0.0
    """Value before the step."""
    after: Number = 1.0
    """Value after the step."""

    @property
    def edges(self) -> Sequence[float]:
        """Time of the step [s]."""
        return (self.time,)

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (choose(t >= self.time, self.after, self.before),)


class Input(FlowBlock):
    """Input of the station with the name ``<controller>.<block>``. It is 0 if nothing drives it."""

    takes = 0, 0
    kind: Literal["input"]
