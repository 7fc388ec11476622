"""Blocks of a signal flow that remember: integrators, linear systems, delays."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.parts.controllers.flow_block import Bounded, FlowBlock, Row, Values, chosen, largest, least
from simrob_drake.sections import NotNegative, Number, Positive


class Integrator(Bounded):
    """y = ∫ u dt; at a bound it waits until u leads back. Sampled: y[k+1] = y[k] + period u[k]."""

    kind: Literal["integrator"]
    initial: Number = 0.0
    """Its value at the start."""

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
        rate = u[0]
        if self.upper is not None:
            rate = chosen(x[0] < self.upper, rate, least(rate, 0.0))
        if self.lower is not None:
            rate = chosen(x[0] > self.lower, rate, largest(rate, 0.0))
        return (rate,)


class StateSpace(FlowBlock):
    """dx/dt = A x + B u, y = C x + D u; sampled: x[k+1] in place of dx/dt."""

    takes = 1, 100
    kind: Literal["state_space"]
    A: tuple[Row, ...]
    """States by states, in rows."""
    B: tuple[Row, ...]
    """States by inputs."""
    C: tuple[Row, ...]
    """Outputs by states."""
    D: tuple[Row, ...]
    """Outputs by inputs."""
    initial: Row = ()
    """State at the start; 0 unless given."""

    @model_validator(mode="after")
    def _fits(self) -> StateSpace:
        states, inputs, outputs = len(self.A), len(self.inputs), len(self.C)
        shapes = {"A": (states, states), "B": (states, inputs), "C": (outputs, states), "D": (outputs, inputs)}
        for name, (rows, columns) in shapes.items():
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
    """Coefficients, of the highest power first."""
    denominator: Row = Field(min_length=1)
    """Coefficients, of the highest power first."""

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
        lead, *rest = self.denominator
        size = len(rest)
        numerator = [0.0] * size + list(np.trim_zeros(self.numerator, "f"))
        through, *above = [figure / lead for figure in numerator[-size - 1 :]]
        below = [figure / lead for figure in rest]
        matrices = {
            "A": [[-figure for figure in below], *np.eye(size)[:-1].tolist()][:size],
            "B": np.eye(size)[:, :1].tolist(),
            "C": [[figure - through * other for figure, other in zip(above, below, strict=True)]],
            "D": [[through]],
        }
        return StateSpace.model_validate({"kind": "state_space", "of": self.of, **matrices})

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
    """Its value at the start."""

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
        step = least(largest(behind, -self.falling * slope), self.rising * slope)
        return (x[0] + step if self.period else step,)


class ZeroOrderHold(FlowBlock):
    """y[k] = u[k], held until the next sample."""

    kind: Literal["hold"]
    period: Positive
    """Between samples [s]."""

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return u


class Delay(FlowBlock):
    """y[k] = u[k - steps]."""

    kind: Literal["delay"]
    period: Positive
    """Between samples [s]: by so much, times the steps, it is late."""
    steps: int = Field(default=1, ge=1, le=10_000)
    """How many samples it is late."""
    initial: Number = 0.0
    """Its value at the start."""

    @property
    def start(self) -> Values:
        """The inputs that are still to come out, the oldest first."""
        return (self.initial,) * self.steps

    @property
    def fed_through(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return False

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return x[:1]

    def following(self, x: Values, u: Values) -> Values:
        """Return what becomes of its states."""
        return [*x[1:], u[0]]


def _rows(first: Sequence[Row], x: Values, second: Sequence[Row], u: Values) -> Values:
    """Return the sum of two matrices times two vectors."""
    both = [*x, *u]
    return [sum(map(operator.mul, (*left, *right), both)) for left, right in zip(first, second, strict=True)]
