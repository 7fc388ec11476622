"""The PID controller of a signal flow, as Simulink's block is: filtered derivative, limits, anti-windup."""

from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.controllers.flow_block import Bounded, Values, chosen, largest
from simrob_drake.sections import NotNegative, Number, Positive

Weight = Annotated[Number, Field(ge=0, le=1)]


class Pid(Bounded):
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
        """Check its inputs, and that its derivative has a filter.

        Raises:
            InvalidParameter: two inputs, or a derivative that no computer can take.
        """
        if len(self.inputs) == 2:
            raise InvalidParameter(
                f"{key}.of", "2 inputs", "1, or 3: of the proportional, integral and derivative part"
            )
        super().check(key)
        if self.d and self.filter is None and not self.period:
            raise InvalidParameter(f"{key}.filter", None, "the cut-off of the derivative's filter [rad/s]")

    @property
    def start(self) -> Values:
        """The integral part and the filter's state at the start, those of them that it has."""
        return [own for own, has in ((self.integration_initial, self.i), (self.filtering_initial, self.d)) if has]

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output."""
        return (self.clipped(self._free(x, u)),)

    def following(self, x: Values, u: Values) -> Values:
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
