"""Blocks of a signal flow with states: integrators, linear systems, delays, the PID controller.

A block computes its output y from its states x and its inputs u, at a time t. ``start`` has the states at the start of
a run. A block without a ``period`` is continuous, and ``state_update`` computes the derivatives dx/dt. A block with a
period is sampled, and ``state_update`` computes the next states x[k+1] from those of sample k. All equations hold for
numbers and for symbolic expressions of Drake, so they branch on values by `choose`, `minimum` and `maximum`.
"""

import operator
from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import message
from simrob_drake.base.sections import NotNegative, Number, Positive
from simrob_drake.blocks.written_net import Values
from simrob_drake.parts.controllers.flow_blocks import (
    Bounded,
    FlowBlock,
    Row,
    choose,
    maximum,
    minimum,
    words_for_input_count,
)


class Integrator(Bounded, FlowBlock):
    """y = ∫ u dt; at a bound it waits until u leads back. Sampled: y[k+1] = y[k] + period u[k]."""

    delays: ClassVar[bool] = True
    kind: Literal["integrator"]
    initial: Number = 0.0
    """Value at the start."""

    @property
    def start(self) -> Values:
        """State at the start: the initial value of the integral, limited to the bounds."""
        return (self.clip(self.initial),)

    def _output(self, t: float, x: Values, u: Values) -> Values:
        # A solver's step may end a little beyond a bound.
        return (self.clip(x[0]),)

    def state_update(self, x: Values, u: Values) -> Values:
        """Compute the derivative of the integral, or if sampled its next value."""
        if self.period:
            return (self.clip(x[0] + self.period * u[0]),)
        rate: Any = u[0]
        # At a bound, only a rate that leads back is left.
        if self.upper is not None:
            rate = choose(x[0] < self.upper, rate, minimum(rate, 0.0))
        if self.lower is not None:
            rate = choose(x[0] > self.lower, rate, maximum(rate, 0.0))
        return (rate,)


class StateSpace(FlowBlock):
    """dx/dt = A x + B u, y = C x + D u; sampled: x[k+1] in place of dx/dt."""

    takes = 1, 100
    kind: Literal["state_space"]
    A: tuple[Row, ...]
    """Rows of the matrix A, states by states."""
    B: tuple[Row, ...]
    """Rows of the matrix B, states by inputs."""
    C: tuple[Row, ...]
    """Rows of the matrix C, outputs by states."""
    D: tuple[Row, ...]
    """Rows of the matrix D, outputs by inputs."""
    initial: Row = ()
    """State at the start; 0 if it is left out."""

    @model_validator(mode="after")
    def _check_sizes(self) -> "StateSpace":
        """Check that the matrices and the initial state have sizes that fit. A has as many rows as there are states.

        Raises:
            ValueError: a matrix or the initial state has another size.
        """
        states = len(self.A)
        inputs = len(self.inputs)
        outputs = len(self.C)
        shapes = {
            "A": (states, states),
            "B": (states, inputs),
            "C": (outputs, states),
            "D": (outputs, inputs),
        }
        for name, (rows, columns) in shapes.items():
            matrix = getattr(self, name)
            has_columns = all(len(row) == columns for row in matrix)
            if len(matrix) != rows or not has_columns:
                raise ValueError(
                    message(
                        "parts.matrix_size",
                        "{name} must be {rows} × {columns}, for {inputs} {inputs:input|inputs}, "
                        "{states} {states:state|states} and {outputs} {outputs:output|outputs}",
                        name=name,
                        rows=rows,
                        columns=columns,
                        inputs=inputs,
                        states=states,
                        outputs=len(self.C),
                    )
                )
        # An initial state that is left out is an empty one, and means zeros.
        if len(self.initial) not in (0, states):
            raise ValueError(
                message(
                    "parts.initial_size",
                    "initial must contain {states} {states:number|numbers}, one for each state",
                    states=states,
                )
            )
        return self

    @property
    def size(self) -> int:
        """Count of elements of the output: one for each row of C."""
        return len(self.C)

    @property
    def start(self) -> Values:
        """States at the start."""
        return self.initial or (0.0,) * len(self.A)

    @property
    def has_feedthrough(self) -> bool:
        """Whether the output depends on the inputs at the same time: whether D has an entry that is not 0."""
        return any(any(row) for row in self.D)

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return _add_products(self.C, x, self.D, u)

    def state_update(self, x: Values, u: Values) -> Values:
        """Compute the derivatives of the states, or if sampled their next values: A x + B u."""
        return _add_products(self.A, x, self.B, u)


def _add_products(first: Sequence[Row], x: Values, second: Sequence[Row], u: Values) -> Values:
    """Compute first x + second u, for two matrices that are given by their rows."""
    # One sum of products for each row: [first second] (x, u)
    vector = [*x, *u]
    rows = [(*left, *right) for left, right in zip(first, second, strict=True)]
    return [sum(map(operator.mul, row, vector)) for row in rows]


class TransferFunction(FlowBlock):
    """y(s) / u(s) = numerator / denominator, coefficients of falling powers of s, or of z if it is sampled."""

    kind: Literal["transfer_function"]
    numerator: Row = Field(min_length=1)
    """Coefficients, that of the highest power first."""
    denominator: Row = Field(min_length=1)
    """Coefficients, that of the highest power first."""

    @model_validator(mode="after")
    def _check_powers(self) -> "TransferFunction":
        """Check that the denominator has its highest power, and the numerator no higher one.

        Raises:
            ValueError: the denominator begins with 0, or the numerator has a higher power.
        """
        # All coefficients are divided by the first one.
        if not self.denominator[0]:
            raise ValueError(
                message(
                    "parts.denominator_begins_with_zero",
                    "denominator begins with 0; the coefficient of its highest power must not be 0",
                )
            )
        # Zeros in front of the numerator do not count: they are no higher powers.
        if len(np.trim_zeros(self.numerator, "f")) > len(self.denominator):
            raise ValueError(
                message(
                    "parts.numerator_of_higher_power",
                    "numerator has a higher degree than denominator; a transfer function must be proper",
                )
            )
        return self

    @cached_property
    def law(self) -> FlowBlock:
        """Equivalent block of the kind `StateSpace`, whose states are 0 at the start.

        It is the controllable canonical form. With the denominator s^n + a_1 s^(n-1) + ... + a_n and the numerator
        b_0 s^n + b_1 s^(n-1) + ... + b_n, both divided by the leading coefficient of the denominator:

            dx_1/dt = -a_1 x_1 - ... - a_n x_n + u,   dx_i/dt = x_(i-1) for i = 2 ... n,
            y = (b_1 - b_0 a_1) x_1 + ... + (b_n - b_0 a_n) x_n + b_0 u.
        """
        leading, *others = self.denominator
        order = len(others)
        # Zeros in front give the numerator as many coefficients as the denominator, n + 1.
        padded_numerator = [0.0] * (order + 1) + list(np.trim_zeros(self.numerator, "f"))
        scaled_numerator = [coefficient / leading for coefficient in padded_numerator[-order - 1 :]]
        a = [coefficient / leading for coefficient in others]
        b_0 = scaled_numerator[0]
        b = scaled_numerator[1:]

        identity = np.eye(order)
        first_row = [-a_i for a_i in a]
        shift_rows = identity[:-1].tolist()
        # Without states, there is no first row either.
        matrices = {
            "A": [first_row, *shift_rows][:order],
            "B": identity[:, :1].tolist(),
            "C": [[b_i - b_0 * a_i for b_i, a_i in zip(b, a, strict=True)]],
            "D": [[b_0]],
        }
        return StateSpace.model_validate(
            {"kind": "state_space", "of": self.of, "period": self.period, **matrices}
        )


class RateLimiter(FlowBlock):
    """y follows u with a limited slope: dy/dt = (u - y) / lag within the bounds.

    While the slope is limited, y is late by nothing else; near u it is late by ``lag``. Sampled, without a lag: y[k] is
    the value nearest to u[k] whose difference from y[k-1] is within the bounds times the period.
    """

    kind: Literal["rate_limiter"]
    rising: NotNegative
    """Largest slope upwards [1/s]."""
    falling: NotNegative
    """Largest slope downwards [1/s]."""
    lag: Positive = 1e-3
    """Time by which the output is late while it follows [s]; also a bound for the steps of an explicit solver."""
    initial: Number = 0.0
    """Value at the start."""

    @property
    def start(self) -> Values:
        """State at the start: the output."""
        return (self.initial,)

    @property
    def has_feedthrough(self) -> bool:
        """Whether the output depends on the input at the same time: only if it is sampled."""
        return self.period > 0

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return self.state_update(x, u) if self.period else x

    def state_update(self, x: Values, u: Values) -> Values:
        """Compute the derivative of the output, or if sampled its next value."""
        difference = u[0] - x[0]
        # Sampled, y reaches u within one sample if the bounds allow it. The continuous y approaches u exponentially.
        if self.period:
            return (x[0] + self._limit(difference, duration=self.period),)
        return (self._limit(difference / self.lag, duration=1.0),)

    def _limit(self, change: Any, duration: float) -> Any:
        """Limit a change of the output to what the largest slopes allow in a duration [s].

        For a duration of 1, the change is a slope [1/s].
        """
        not_too_low = maximum(change, -self.falling * duration)
        return minimum(not_too_low, self.rising * duration)


class ZeroOrderHold(FlowBlock):
    """y[k] = u[k], held until the next sample."""

    kind: Literal["hold"]
    period: Positive
    """Time between samples [s]."""

    def _output(self, t: float, x: Values, u: Values) -> Values:
        # The net holds the output of each sampled block between samples.
        return u


class Delay(FlowBlock):
    """y[k] = u[k - steps]."""

    delays: ClassVar[bool] = True
    kind: Literal["delay"]
    period: Positive
    """Time between samples [s]. The output is late by this time, times the steps."""
    steps: int = Field(default=1, ge=1, le=10_000)
    """Count of samples by which the output is late."""
    initial: Number = 0.0
    """Value at the start."""

    @property
    def start(self) -> Values:
        """States at the start: the inputs of the last samples, the oldest first."""
        return (self.initial,) * self.steps

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return x[:1]

    def state_update(self, x: Values, u: Values) -> Values:
        """Compute the next states: drop the oldest input, and append the present one."""
        return [*x[1:], u[0]]


Weight = Annotated[Number, Field(ge=0, le=1)]
"""Weight of the backward Euler method in an integration, from 0 to 1; forward Euler has the rest."""


class Pid(Bounded, FlowBlock):
    """y = p e + i ∫ e dt + d s N / (s + N) e, within bounds.

    It has one input, the error, or three: the errors of its proportional, integral and derivative part. For a
    derivative of the measurement alone, the third is the negative measurement. If it is sampled, ``1/s`` is the period
    times 1/(z-1), z/(z-1) or the mean of both, for a weight of 0, 1 or 0.5.
    """

    # With the integral part x_i and the filter's state x_d, each of which exists only if its gain is not 0:
    #   dx_i/dt = i e,   dx_d/dt = derivative part = N (d e - x_d),   y = clip(p e + x_i + N (d e - x_d)).
    # Sampled with the period T, and w the weight of x_i or x_d:
    #   x_i[k+1] = x_i + T i e,                           integral part   = x_i + w T i e,
    #   x_d[k+1] = x_d + T derivative part,               derivative part = N (d e - x_d) / (1 + N w T),
    # or without a filter
    #   x_d[k+1] = d e,                                   derivative part = (d e - x_d) / T.

    takes = 1, 3  # 2 are refused by check()
    kind: Literal["pid"]
    p: Number = 0.0
    """Gain of the error."""
    i: Number = 0.0
    """Gain of the integral of the error."""
    d: Number = 0.0
    """Gain of the derivative of the error."""
    filter: Positive | None = None
    """N, the cut-off of the derivative's filter [rad/s]; needed with ``d`` unless the block is sampled."""
    integration_initial: Number = 0.0
    """Integral part at the start."""
    filtering_initial: Number = 0.0
    """State of the derivative's filter at the start: d times the error before the start."""
    integration_weight: Weight = 0.0
    """Method of the integral if sampled: 0 forward Euler, 1 backward Euler, 0.5 trapezoidal."""
    filtering_weight: Weight = 0.0
    """Method of the derivative's filter if sampled, as for the integral."""
    anti_windup: Literal["none", "clamping", "back_calculation"] = "none"
    """Method that keeps the integral from growing beyond the bounds."""
    back_calculation: NotNegative = Field(default=1.0)
    """Gain by which the integral is led back from beyond the bounds [1/s]."""

    def check(self, key: str) -> None:
        """Check the count of inputs and the derivative's filter.

        Args:
            key: key of the block, for errors.

        Raises:
            InvalidParameter: the block has neither one nor three inputs, or has a derivative, but no filter and no
                period.
        """
        if len(self.inputs) == 2:
            raise InvalidParameter(
                words_for_input_count(key),
                2,
                message(
                    "parts.one_or_three_inputs",
                    "1, or 3 for the errors of the proportional, integral and derivative part",
                ),
            )
        super().check(key)
        # A continuous block cannot differentiate: without a filter, it has no state from which the slope follows.
        if self.d and self.filter is None and not self.period:
            raise InvalidParameter(
                f"{key}.filter",
                None,
                message(
                    "parts.filter_cutoff",
                    "the cut-off frequency of the derivative's filter [rad/s]",
                ),
            )

    @property
    def start(self) -> Values:
        """States at the start: the integral part if there is a gain i, the filter's state if there is a gain d."""
        states = []
        if self.i:
            states.append(self.integration_initial)
        if self.d:
            states.append(self.filtering_initial)
        return states

    def _output(self, t: float, x: Values, u: Values) -> Values:
        return (self.clip(self._unbounded_output(x, u)),)

    def state_update(self, x: Values, u: Values) -> Values:
        """Compute the derivatives of the states, or if sampled their next values, in the order of ``start``."""
        # x[0] is the integral part if there is a gain i; x[-1] is the filter's state if there is a gain d.
        new_values: list[Any] = []
        if self.i:
            rate = self._integral_rate(x, u)
            new_values.append(x[0] + self.period * rate if self.period else rate)
        if self.d:
            new_values.append(self._filter_update(x, u))
        return new_values

    def _filter_update(self, x: Values, u: Values) -> Any:
        """Compute the derivative of the filter's state, or if sampled its next value."""
        # Only a sampled block may have no filter. Then the next state is d e of this sample, which the next sample
        # subtracts from its own.
        if self.filter is None:
            return self.d * u[-1]
        rate = self._derivative_part(x, u)
        return x[-1] + self.period * rate if self.period else rate

    def _unbounded_output(self, x: Values, u: Values) -> Any:
        """Compute the output without bounds."""
        output = self.p * u[0]
        if self.i:
            # The last term, w T i e, is what the present sample adds at once. Without a period it is 0.
            output = (
                output
                + x[0]
                + self.integration_weight * self.period * self.i * self._integral_error(u)
            )
        if self.d:
            output = output + self._derivative_part(x, u)
        return output

    def _integral_error(self, u: Values) -> Any:
        """Input of the integral part: the only one of one input, the middle one of three."""
        return u[len(u) // 2]

    def _derivative_part(self, x: Values, u: Values) -> Any:
        """Compute the part of the output that is d times the filtered derivative of its error, the last input."""
        difference = self.d * u[-1] - x[-1]
        if self.filter is None:
            return difference / self.period
        # The denominator solves the backward Euler step of the filter; it is 1 without a period.
        return self.filter * difference / (1 + self.filter * self.filtering_weight * self.period)

    def _integral_rate(self, x: Values, u: Values) -> Any:
        """Compute the derivative of the integral part x_i [unit of y per second].

        It is i e. The method ``anti_windup`` changes it while the output without bounds is beyond a bound.
        """
        rate = self.i * self._integral_error(u)
        if self.anti_windup == "none":
            return rate
        unbounded = self._unbounded_output(x, u)
        excess = unbounded - self.clip(unbounded)
        if self.anti_windup == "back_calculation":
            return rate - self.back_calculation * excess
        # Clamping: the integral stops if it would grow further beyond the bound. If it is continuous, it slows down
        # within a narrow band, since a derivative that jumps to 0 makes the solver switch to and fro in tiny steps.
        remaining_share = (
            0.0 if self.period else maximum(0.0, 1.0 - abs(excess) / self._clamping_band)
        )
        return choose(excess * rate > 0, remaining_share * rate, rate)

    @cached_property
    def _clamping_band(self) -> float:
        """Width of the band beyond the bounds within which a continuous integral slows down to a stop.

        It is a thousandth of the range between the bounds. If there is only one bound, or if they are equal, it is a
        thousandth of the bound's magnitude, or 0.001 if the bound is 0. It is 1 without bounds, where it has no effect.
        """
        bounds = [bound for bound in (self.lower, self.upper) if bound is not None]
        if not bounds:
            return 1.0
        # The first of these that is not 0: the range (0 for one bound, or for equal ones), the bound, 1.
        size = (bounds[-1] - bounds[0]) or abs(bounds[0]) or 1.0
        return 1e-3 * size
