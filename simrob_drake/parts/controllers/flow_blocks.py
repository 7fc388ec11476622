"""Blocks of a signal flow that remember nothing: each is its equation."""

from __future__ import annotations

import math
import operator
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.controllers.flow_block import Bounded, FlowBlock, Row, Values
from simrob_drake.quantities import Instant
from simrob_drake.yaml_files import Number


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
    """How the input is compared with the threshold, or with a second input."""
    threshold: Number = 0.0
    """What it is compared with."""

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return (float(_COMPARED[self.operator](u[0], self.threshold)),)


class Logic(FlowBlock):
    """y = 1 where all, any, none, not all or an odd number of its inputs are not 0, else 0."""

    takes = 1, 100
    kind: Literal["logic"]
    operator: Literal["and", "or", "nor", "nand", "xor", "not"]
    """How the inputs are joined."""

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
    """How the second input is compared with the threshold."""
    threshold: Number = 0.0
    """What it is compared with."""

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
    """Which function it is."""

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
    """When it steps [s]."""
    before: Number = 0.0
    """Its value before."""
    after: Number = 1.0
    """Its value from then on."""

    @property
    def edges(self) -> Sequence[float]:
        """When it steps [s]."""
        return (self.time,)

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return (self.after if t >= self.time else self.before,)
