r"""The law of an objective, said once for plain numbers and for expressions that Drake evaluates without Python.

With the error e of a quantity against what is asked for, which goes to its targets one after the other,

.. math:: u = \mathrm{clip}\bigl(k_p e + x\bigr), \qquad \dot x = k_i e,

where x stands still while u is at its limit, or at its fastest, and e would drive it on.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from pydrake import symbolic
from pydrake.systems.primitives import SymbolicVectorSystem

MEMORY = ("integral", "asked", "effort", "number", "held", "begun")
"""What the law remembers: x, what is asked for, u, the number of the target, how long it has been asked for [s], and
whether there was a sample before; all zero at the start."""


class Maths(NamedTuple):
    """What the law is made of beside sums and products."""

    least: Callable[[Any, Any], Any]
    most: Callable[[Any, Any], Any]
    choose: Callable[[Any, Any, Any], Any]
    """The second where the first is true, else the third."""


PLAIN = Maths(min, max, lambda condition, one, other: one if condition else other)
SYMBOLIC = Maths(symbolic.min, symbolic.max, symbolic.if_then_else)


@dataclass(frozen=True, kw_only=True)
class PiLaw:
    """How far an axis of weight 1 moves.

    Attributes:
        period: between samples [s].
        targets: values of the quantity, one after the other.
        hold: how long each is asked for, from when its ramp ends [s].
        speed: of what is asked for, on its way there [1/s].
        gains: kp [rad per unit] and ki [rad/s per unit].
        limit: how far it moves [rad].
        fastest: how fast [rad/s].
    """

    period: float
    targets: Sequence[float]
    hold: float = math.inf
    speed: float = math.inf
    gains: tuple[float, float]
    limit: float
    fastest: float

    def next(self, measured: Any, memory: Mapping[str, Any], maths: Maths) -> tuple[dict[str, Any], Any]:
        """Return the memory after a sample, by names, and the target: of numbers or of expressions, as the maths is."""
        least, most, choose = maths
        number, held, setpoint, before = (memory[name] for name in ("number", "held", "asked", "effort"))
        if len(self.targets) > 1:
            due = held >= self.hold
            number = choose(due, least(number + 1.0, len(self.targets) - 1.0), number)
            held = choose(due, 0.0, held)
        target = self.targets[0]
        for place, value in enumerate(self.targets[1:], 1):
            target = choose(number >= place, value, target)
        if math.isinf(self.speed):
            setpoint = target
        else:
            step, setpoint = self.speed * self.period, choose(memory["begun"] > 0.5, setpoint, measured)
            setpoint = least(most(target, setpoint - step), setpoint + step)
        held = choose(setpoint == target, held + self.period, 0.0)
        error, (kp, ki), step = setpoint - measured, self.gains, self.fastest * self.period
        grown = memory["integral"] + ki * error * self.period
        desired = kp * error + grown
        effort = least(least(most(most(desired, before - step), -self.limit), before + step), self.limit)
        integral = choose((desired - effort) * error <= 0, grown, memory["integral"])  # else it would wind up
        values = (integral, setpoint, effort, number, held, 1.0)
        return dict(zip(MEMORY, values, strict=True)), target

    def system(self) -> SymbolicVectorSystem:
        """Return it as a block of Drake's: in the quantity (1), out u and e (2)."""
        measured, error = symbolic.Variable("measured"), symbolic.Variable("error")
        memory = {name: symbolic.Variable(name) for name in MEMORY}
        known = {name: symbolic.Expression(variable) for name, variable in memory.items()}
        new, _ = self.next(symbolic.Expression(measured), known, SYMBOLIC)
        zero = symbolic.Expression(0.0)
        dynamics = [zero + value for value in (*new.values(), new["asked"] - measured)]
        return SymbolicVectorSystem(
            input=[measured],
            state=[*memory.values(), error],
            dynamics=dynamics,
            output=[known["effort"], symbolic.Expression(error)],
            time_period=self.period,
        )
