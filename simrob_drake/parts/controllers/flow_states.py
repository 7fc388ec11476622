"""Blocks of a signal flow that remember: integrators, linear systems, delays, the PID controller."""

import operator
from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import message
from simrob_drake.base.sections import NotNegative, Number, Positive
from simrob_drake.blocks.written_net import Values
from simrob_drake.parts.controllers.flow_blocks import Bounded, FlowBlock, Row, chosen, largest, least


class Integrator(Bounded, FlowBlock):
    """y = ∫ u dt; at a bound it waits until u leads back. Sampled: y[k+1] = y[k] + period u[k]."""

    delays: ClassVar[bool] = True
    kind: Literal["integrator"]
    initial: Number = 0.0
    """Its value at the start."""

    @property
    def start(self) -> Values:
        """Its states at the start."""
        return (self.clipped(self.initial),)

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (self.clipped(x[0]),)

    def state_update(self, x: Values, u: Values) -> Values:
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
    def _fits(self) -> "StateSpace":
        states, inputs, outputs = len(self.A), len(self.inputs), len(self.C)
        shapes = {"A": (states, states), "B": (states, inputs), "C": (outputs, states), "D": (outputs, inputs)}
        for name, (rows, columns) in shapes.items():
            matrix = getattr(self, name)
            if len(matrix) != rows or any(len(row) != columns for row in matrix):
                raise ValueError(
                    message(
                        "parts.matrix_size",
                        "{name} must be {rows} × {columns}, for {inputs} inputs and {states} states",
                        name=name,
                        rows=rows,
                        columns=columns,
                        inputs=inputs,
                        states=states,
                    )
                )
        if len(self.initial) not in (0, states):
            raise ValueError(
                message("parts.initial_size", "initial must be {states} numbers, one for each state", states=states)
            )
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
    def has_feedthrough(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return any(map(any, self.D))

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return _rows(self.C, x, self.D, u)

    def state_update(self, x: Values, u: Values) -> Values:
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
    def _proper(self) -> "TransferFunction":
        if not self.denominator[0]:
            raise ValueError(
                message(
                    "parts.denominator_begins_with_zero",
                    "denominator begins with 0: its first coefficient is that of the highest power",
                )
            )
        if len(np.trim_zeros(self.numerator, "f")) > len(self.denominator):
            raise ValueError(
                message(
                    "parts.numerator_of_higher_power",
                    "numerator is of a higher power than denominator, which no system with states has",
                )
            )
        return self

    @cached_property
    def law(self) -> FlowBlock:
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
        return StateSpace.model_validate({"kind": "state_space", "of": self.of, "period": self.period, **matrices})


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
    def has_feedthrough(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return self.period > 0

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return self.state_update(x, u) if self.period else x

    def state_update(self, x: Values, u: Values) -> Values:
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

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return u


class Delay(FlowBlock):
    """y[k] = u[k - steps]."""

    delays: ClassVar[bool] = True
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

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return x[:1]

    def state_update(self, x: Values, u: Values) -> Values:
        """Return what becomes of its states."""
        return [*x[1:], u[0]]


def _rows(first: Sequence[Row], x: Values, second: Sequence[Row], u: Values) -> Values:
    """Return the sum of two matrices times two vectors."""
    both = [*x, *u]
    return [sum(map(operator.mul, (*left, *right), both)) for left, right in zip(first, second, strict=True)]


Weight = Annotated[Number, Field(ge=0, le=1)]


class Pid(Bounded, FlowBlock):
    """y = p e + i ∫ e dt + d s N / (s + N) e, within bounds.

    Of one input, the error, or of three: the errors of its proportional, integral and derivative part. So a derivative
    of the measurement alone takes the negative measurement as its third. Sampled, ``1/s`` is the period times 1/(z-1),
    z/(z-1) or the mean of both, by a weight of 0, 1 or 0.5.
    """

    takes = 1, 3
    kind: Literal["pid"]
    p: Number = 0.0
    """Gain of the error."""
    i: Number = 0.0
    """Gain of its integral."""
    d: Number = 0.0
    """Gain of its derivative."""
    filter: Positive | None = None
    """N, the cut-off of the derivative's filter [rad/s]; needed with ``d`` unless it is sampled."""
    integration_initial: Number = 0.0
    """The integral part at the start."""
    filtering_initial: Number = 0.0
    """The state of the derivative's filter at the start, d times the error that it takes for the last."""
    integration_weight: Weight = 0.0
    """0 forward Euler, 1 backward Euler, 0.5 trapezoidal."""
    filtering_weight: Weight = 0.0
    """The same, of the filter."""
    anti_windup: Literal["none", "clamping", "back_calculation"] = "none"
    """What keeps the integral from growing beyond the bounds."""
    back_calculation: NotNegative = Field(default=1.0)
    """Gain by which the integral is led back from beyond the bounds [1/s]."""

    def check(self, key: str) -> None:
        """Check its inputs and its derivative's filter; raises InvalidParameter: two inputs, or without a filter."""
        if len(self.inputs) == 2:
            raise InvalidParameter(
                f"{key}.of",
                message("parts.two_inputs", "2 inputs"),
                message("parts.one_or_three_inputs", "1, or 3: of the proportional, integral and derivative part"),
            )
        super().check(key)
        if self.d and self.filter is None and not self.period:
            raise InvalidParameter(
                f"{key}.filter", None, message("parts.filter_cutoff", "the cut-off of the derivative's filter [rad/s]")
            )

    @property
    def start(self) -> Values:
        """The integral part and the filter's state at the start, those of them that it has."""
        return [own for own, has in ((self.integration_initial, self.i), (self.filtering_initial, self.d)) if has]

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (self.clipped(self._free(x, u)),)

    def state_update(self, x: Values, u: Values) -> Values:
        """Return what becomes of its states."""
        changes = []
        if self.i:
            changes.append(self._windup(self.i * u[len(u) // 2], self._free(x, u)))
        if self.d:
            changes.append(self._derivative(x, u) if self._filtered else self.d * u[-1])
        if not self.period:
            return changes
        follow = [own + self.period * change for own, change in zip(x, changes, strict=True)]
        if self.d and not self._filtered:
            follow[-1] = self.d * u[-1]
        return follow

    @cached_property
    def _filtered(self) -> bool:
        return self.filter is not None

    def _free(self, x: Values, u: Values) -> float:
        """Return the output without bounds."""
        total = self.p * u[0]
        if self.i:
            total = total + x[0] + self.integration_weight * self.period * self.i * u[len(u) // 2]
        return total + self._derivative(x, u) if self.d else total

    def _derivative(self, x: Values, u: Values) -> float:
        behind = self.d * u[-1] - x[-1]
        if self.filter is None:
            return behind / self.period
        return self.filter * behind / (1 + self.filter * self.filtering_weight * self.period)

    def _windup(self, rate: float, free: float) -> float:
        """Return how fast the integral part grows."""
        beyond = free - self.clipped(free)
        if self.anti_windup == "back_calculation":
            return rate - self.back_calculation * beyond
        if self.anti_windup != "clamping":
            return rate
        left = 0.0 if self.period else largest(0.0, 1.0 - abs(beyond) / self._band)
        slowed: float = chosen(beyond * rate > 0, left * rate, rate)
        return slowed

    @cached_property
    def _band(self) -> float:
        """Within which beyond the bounds a continuous integral comes to a stop: one that stops at once chatters."""
        ends = [bound for bound in (self.lower, self.upper) if bound is not None]
        return 1e-3 * ((ends[-1] - ends[0]) or abs(ends[0]) or 1.0) if ends else 1.0
