"""What the kinds of block share that a signal flow is made of."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import pydrake.math as drake
from pydantic import model_validator
from pydrake.symbolic import Expression, Formula, if_then_else

from simrob_drake.errors import InvalidParameter
from simrob_drake.sections import NotNegative, Number, Strict

_SAME = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "floor",
         "ceil", "pow")  # fmt: skip

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


FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: _of(name) for name in _SAME},
    "abs": abs,
    "min": least,
    "max": largest,
    "sign": lambda value: chosen(value > 0, 1.0, chosen(value < 0, -1.0, 0.0)),
}
"""The functions that a block can be, by name."""


Sum = str | dict[str, Number]
"""A signal by its name, or several with their factors; ``one`` is 1 and ``time`` the time [s]."""
Row = tuple[Number, ...]
Values = Sequence[float]


class FlowBlock(Strict):
    """A block of a signal flow: its key ``kind``, what it takes, and its equation.

    That is ``output(t, x, u)`` by the time [s], its states and its inputs, and of one that has states, ``following``:
    their derivatives, or with a ``period`` their next values. A sampled block holds its output between samples. Both
    are equations of numbers and of symbolic expressions alike.
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
            expected = f"{fewest} inputs" if fewest == most else f"{fewest} inputs or more"
            raise InvalidParameter(f"{key}.of", f"{len(self.inputs)} inputs", expected)

    @property
    def start(self) -> Values:
        """Its states at the start."""
        return ()

    @property
    def fed_through(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return True

    @property
    def repeats(self) -> int:
        """How often an input stands in its equation."""
        return 2

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output, by element."""
        raise NotImplementedError

    def following(self, x: Values, u: Values) -> Values:
        """Return the derivatives of its states, or their next values."""
        return ()


class Bounded(FlowBlock):
    """Of a lower and an upper bound."""

    lower: Number | None = None
    """The least value; none unless given."""
    upper: Number | None = None
    """The largest value; none unless given."""

    @model_validator(mode="after")
    def _ordered(self) -> Bounded:
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise ValueError(f"lower ({self.lower:g}) is above upper ({self.upper:g})")
        return self

    def clipped(self, u: float) -> float:
        """Return the nearest value within the bounds."""
        above = u if self.lower is None else largest(u, self.lower)
        return above if self.upper is None else least(above, self.upper)
