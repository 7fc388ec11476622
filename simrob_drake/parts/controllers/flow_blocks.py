"""The kinds of block that a signal flow is made of, each with its equation."""

from __future__ import annotations

import math
import operator
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator
from scipy.signal import tf2ss

from simrob_drake.errors import InvalidParameter
from simrob_drake.quantities import Instant, NotNegative, Positive
from simrob_drake.yaml_files import Number, Strict

Sum = str | dict[str, Number]
"""A signal by its name, or several with their factors; ``one`` is 1 and ``time`` the time [s]."""
Row = tuple[Number, ...]
Values = Sequence[float]


class FlowBlock(Strict):
    """A block of a signal flow: its key ``kind``, what it takes, and its equation.

    That is ``output(t, x, u)`` by the time [s], its states and its inputs, and of one that has states, ``following``:
    their derivatives, or with a ``period`` their next values. A sampled block holds its output between samples.
    """

    takes: ClassVar[tuple[int, int]] = (1, 1)
    """How few and how many inputs there may be."""

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
    def size(self) -> int:
        """How many elements its output has."""
        return 1

    @property
    def edges(self) -> Sequence[float]:
        """Times at which its output jumps by itself [s]."""
        return ()

    def check(self, key: str) -> None:
        """Check how many inputs it has.

        Raises:
            InvalidParameter: too few or too many.
        """
        fewest, most = self.takes
        if not fewest <= len(self.inputs) <= most:
            told = f"{fewest} inputs" if fewest == most else f"{fewest} inputs or more"
            raise InvalidParameter(f"{key}.of", f"{len(self.inputs)} inputs", told)

    @property
    def start(self) -> Values:
        """Its states at the start."""
        return ()

    @property
    def fed_through(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return True

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output, by element."""
        raise NotImplementedError

    def following(self, x: Values, u: Values) -> Values:
        """Return the derivatives of its states, or their next values."""
        return ()


class Sums(FlowBlock):
    """Sums of signals: y = Σ k u for each of its inputs."""

    takes = 1, 10_000
    kind: Literal["sum"]

    @property
    def size(self) -> int:
        """One for each input."""
        return len(self.inputs)

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return u


class Product(FlowBlock):
    """Inputs multiplied, and divided by those at ``divides``."""

    takes = 1, 100
    kind: Literal["product"]
    divides: tuple[int, ...] = ()
    """Places of the inputs that divide, from 0."""

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return (math.prod(1 / part if place in self.divides else part for place, part in enumerate(u)),)


class Bounded(FlowBlock):
    """Of a lower and an upper bound."""

    lower: Number | None = None
    upper: Number | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Bounded:
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise ValueError(f"lower ({self.lower:g}) is above upper ({self.upper:g})")
        return self

    def clipped(self, u: float) -> float:
        """Return the nearest value within the bounds."""
        above = u if self.lower is None else max(u, self.lower)
        return above if self.upper is None else min(above, self.upper)


class Saturation(Bounded):
    """y = u within bounds, and a bound beyond."""

    kind: Literal["saturation"]

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return (self.clipped(u[0]),)


class DeadZone(Bounded):
    """y = 0 between the bounds, and how far u lies beyond them outside."""

    kind: Literal["dead_zone"]

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return (u[0] - self.clipped(u[0]),)


class Integrator(Bounded):
    """y = ∫ u dt; at a bound it waits until u leads back. Sampled: y[k+1] = y[k] + period u[k]."""

    kind: Literal["integrator"]
    initial: Number = 0.0

    @property
    def start(self) -> Values:
        """Its states at the start."""
        return (self.clipped(self.initial),)

    @property
    def fed_through(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return False

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return (self.clipped(x[0]),)

    def following(self, x: Values, u: Values) -> Values:
        """Return what becomes of its states."""
        if self.period:
            return (self.clipped(x[0] + self.period * u[0]),)
        up = self.upper is None or x[0] < self.upper
        down = self.lower is None or x[0] > self.lower
        return (u[0] if (up if u[0] > 0 else down) else 0.0,)


class StateSpace(FlowBlock):
    """dx/dt = A x + B u, y = C x + D u; sampled: x[k+1] in place of dx/dt."""

    takes = 1, 100
    kind: Literal["state_space"]
    A: tuple[Row, ...]
    B: tuple[Row, ...]
    C: tuple[Row, ...]
    D: tuple[Row, ...]
    initial: Row = ()
    """State at the start; 0 unless given."""

    @model_validator(mode="after")
    def _fits(self) -> StateSpace:
        states, inputs, outputs = len(self.A), len(self.inputs), len(self.C)
        wanted = {"A": (states, states), "B": (states, inputs), "C": (outputs, states), "D": (outputs, inputs)}
        for name, (rows, columns) in wanted.items():
            matrix = getattr(self, name)
            if len(matrix) != rows or any(len(row) != columns for row in matrix):
                raise ValueError(f"{name} must be {rows} × {columns}, for {inputs} inputs and {states} states")
        if len(self.initial) not in (0, states):
            raise ValueError(f"initial must be {states} numbers, one for each state")
        return self

    @property
    def size(self) -> int:
        """One for each row of C."""
        return len(self.C)

    @property
    def start(self) -> Values:
        """Its states at the start."""
        return self.initial or (0.0,) * len(self.A)

    @property
    def fed_through(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return any(map(any, self.D))

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return _rows(self.C, x, self.D, u)

    def following(self, x: Values, u: Values) -> Values:
        """Return what becomes of its states."""
        return _rows(self.A, x, self.B, u)


class TransferFunction(FlowBlock):
    """y(s) / u(s) = numerator / denominator, coefficients of falling powers of s, or of z where it is sampled."""

    kind: Literal["transfer_function"]
    numerator: Row = Field(min_length=1)
    denominator: Row = Field(min_length=1)

    @model_validator(mode="after")
    def _proper(self) -> TransferFunction:
        if not self.denominator[0]:
            raise ValueError("denominator begins with 0: its first coefficient is that of the highest power")
        if len(np.trim_zeros(self.numerator, "f")) > len(self.denominator):
            raise ValueError("numerator is of a higher power than denominator, which no system with states has")
        return self

    @cached_property
    def _system(self) -> StateSpace:
        """The same with states, which begin at 0."""
        numerator = np.trim_zeros(self.numerator, "f") or (0.0,)
        states = len(self.denominator) - 1
        a, b, c, d = (np.atleast_2d(part) for part in tf2ss(numerator, self.denominator))
        matrices = {"A": a[:states, :states], "B": b[:states], "C": c[:, :states], "D": d}
        given = {name: matrix.tolist() for name, matrix in matrices.items()}
        return StateSpace.model_validate({"kind": "state_space", "of": self.of, **given})

    @property
    def start(self) -> Values:
        """Its states at the start."""
        return self._system.start

    @property
    def fed_through(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return self._system.fed_through

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return self._system.output(t, x, u)

    def following(self, x: Values, u: Values) -> Values:
        """Return what becomes of its states."""
        return self._system.following(x, u)


class RateLimiter(FlowBlock):
    """y follows u with a limited slope: dy/dt = (u - y) / lag within the bounds.

    At the bound it is late by nothing, near u by ``lag``. Sampled, without a lag: y[k] = u[k] within y[k-1] ± bound.
    """

    kind: Literal["rate_limiter"]
    rising: NotNegative
    """Largest slope upwards [1/s]."""
    falling: NotNegative
    """Largest slope downwards [1/s]."""
    lag: Positive = 1e-3
    """Time by which it is late where it follows [s]; also how short the steps of an explicit solver must be."""
    initial: Number = 0.0

    @property
    def start(self) -> Values:
        """Its states at the start."""
        return (self.initial,)

    @property
    def fed_through(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return self.period > 0

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return self.following(x, u) if self.period else x

    def following(self, x: Values, u: Values) -> Values:
        """Return what becomes of its states."""
        behind, slope = u[0] - x[0], self.period or 1.0
        if not self.period:
            behind /= self.lag
        step = min(max(behind, -self.falling * slope), self.rising * slope)
        return (x[0] + step if self.period else step,)


class Delay(FlowBlock):
    """y[k] = u[k-1]."""

    kind: Literal["delay"]
    period: Positive
    initial: Number = 0.0

    @property
    def start(self) -> Values:
        """Its states at the start."""
        return (self.initial,)

    @property
    def fed_through(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return False

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return x

    def following(self, x: Values, u: Values) -> Values:
        """Return what becomes of its states."""
        return u


class Lookup(FlowBlock):
    """Straight lines between points; beyond them the last line goes on, or with ``clip`` the last value."""

    kind: Literal["lookup"]
    points: Row = Field(min_length=2)
    """Values of u, rising."""
    values: Row
    """Values of y there."""
    clip: bool = False

    @model_validator(mode="after")
    def _rising(self) -> Lookup:
        if len(self.values) != len(self.points) or any(np.diff(self.points) <= 0):
            raise ValueError("points must rise, and values be as many")
        return self

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        given = min(max(u[0], self.points[0]), self.points[-1]) if self.clip else u[0]
        right = min(max(bisect_right(self.points, given), 1), len(self.points) - 1)
        begin, low = self.points[right - 1], self.values[right - 1]
        return (low + (self.values[right] - low) / (self.points[right] - begin) * (given - begin),)


_COMPARED: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
Operator = Literal["<", "<=", ">", ">=", "==", "!="]


class Compare(FlowBlock):
    """y = 1 where u is less than (or whatever is said) the threshold, else 0."""

    kind: Literal["compare"]
    operator: Operator
    threshold: Number = 0.0

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return (float(_COMPARED[self.operator](u[0], self.threshold)),)


class Logic(FlowBlock):
    """y = 1 where all, any, none, not all or an odd number of its inputs are not 0, else 0."""

    takes = 1, 100
    kind: Literal["logic"]
    operator: Literal["and", "or", "nor", "nand", "xor", "not"]

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        true = sum(part != 0 for part in u)
        told = {
            "and": true == len(u), "nand": true < len(u), "or": true > 0, "nor": true == 0, "not": true == 0,
            "xor": true % 2 == 1,
        }  # fmt: skip
        return (float(told[self.operator]),)


class Switch(FlowBlock):
    """y = the first input where the second meets the threshold, else the third."""

    takes = 3, 3
    kind: Literal["switch"]
    operator: Operator = ">="
    threshold: Number = 0.0

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return (u[0] if _COMPARED[self.operator](u[1], self.threshold) else u[2],)


class Function(FlowBlock):
    """y = f(u), or f(u, v) of two."""

    takes = 1, 2
    kind: Literal["function"]
    function: Literal[
        "abs", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "floor",
        "ceil", "sign", "atan2", "min", "max", "pow",
    ]  # fmt: skip

    def check(self, key: str) -> None:
        """Check how many inputs it has."""
        wanted = 2 if self.function in ("atan2", "min", "max", "pow") else 1
        if len(self.inputs) != wanted:
            raise InvalidParameter(f"{key}.of", f"{len(self.inputs)} inputs", f"{wanted}, as {self.function} takes")

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        if self.function == "sign":
            return (math.copysign(1.0, u[0]) if u[0] else 0.0,)
        own: dict[str, Callable[..., float]] = {"abs": abs, "min": min, "max": max}
        found = own.get(self.function) or getattr(math, self.function)
        return (float(found(*u)),)


class Step(FlowBlock):
    """y = ``before``, and ``after`` from a time on."""

    takes = 0, 0
    kind: Literal["step"]
    time: Instant
    before: Number = 0.0
    after: Number = 1.0

    @property
    def edges(self) -> Sequence[float]:
        """When it steps [s]."""
        return (self.time,)

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return (self.after if t >= self.time else self.before,)


FlowBlockConfig = Annotated[
    Sums | Product | Saturation | DeadZone | Integrator | StateSpace | TransferFunction | RateLimiter | Delay | Lookup
    | Compare | Logic | Switch | Function | Step,
    Field(discriminator="kind"),
]  # fmt: skip


def _rows(first: Sequence[Row], x: Values, second: Sequence[Row], u: Values) -> Values:
    """Return the sum of two matrices times two vectors."""
    both = [*x, *u]
    return [sum(map(operator.mul, (*left, *right), both)) for left, right in zip(first, second, strict=True)]
