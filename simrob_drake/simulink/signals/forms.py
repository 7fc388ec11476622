"""What a signal is made of: a sum of joint positions and speeds, inputs, sources and constants, each with a factor.

Linear blocks keep such sums exact through any number of levels, so a control law is recognised by what it computes and
not by how it is drawn. What no sum can tell (a saturation, an integral, a MATLAB Function) becomes a term of its own.
"""

from dataclasses import dataclass
from typing import Any, Literal

from simrob_drake.simulink.mechanics.joints import Freedom
from simrob_drake.simulink.model.nodes import Node

TermKind = Literal[
    "one", "q", "w", "a", "t", "input", "source", "sat", "integral", "block", "distance", "sensed", "open"
]


@dataclass(frozen=True)
class Term:
    """One thing that a signal depends on.

    Attributes:
        kind: ``one`` (a constant), ``q``, ``w``, ``a``, ``t`` (position, speed, acceleration, effort of a joint),
            ``input`` (of the model), ``source`` (a function of time), ``sat``, ``integral``, ``block`` (what
            else is computed), ``distance``, ``sensed`` (a part of what a Transform Sensor tells), or ``open``.
        of: the degree of freedom, or the block.
        index: which element of the block's output.
    """

    kind: TermKind
    of: Freedom | Node | None = None
    index: int = 0


Form = dict[Term, float]
"""A sum of terms with their factors."""

Signal = list[Form]
"""A vector signal, a form for each element."""

ONE = Term("one")


def constant(value: float) -> Form:
    """Return a form that is a number."""
    return {ONE: value} if value else {}


def added(*parts: tuple[float, Form]) -> Form:
    """Return a sum of forms, each with a factor."""
    total: Form = {}
    for factor, form in parts:
        for term, value in form.items():
            total[term] = total.get(term, 0.0) + factor * value
    return {term: value for term, value in total.items() if value != 0.0}


def as_constant(form: Form) -> float | None:
    """Return the value of a form that depends on nothing, else None."""
    return form.get(ONE, 0.0) if all(term == ONE for term in form) else None


@dataclass(frozen=True)
class Limits:
    """Of a saturation, by element."""

    lower: float
    upper: float
    inner: Any


def scaled(signal: Signal, factor_: float) -> Signal:
    """Return a signal times a number."""
    return [added((factor_, form)) for form in signal]


def same_size(node: Node, signals: list[Signal]) -> list[Signal]:
    """Spread scalars over vectors.

    Raises:
        InvalidModel: vectors of different lengths.
    """
    size = max(len(signal) for signal in signals)
    if any(len(signal) not in (1, size) for signal in signals):
        lengths = ", ".join(str(len(signal)) for signal in signals)
        raise node.refusal(f"its inputs have {lengths} elements; they must be equally long, or scalars")
    return [spread(signal, size) for signal in signals]


def spread(signal: Signal, size: int) -> Signal:
    """Let a scalar stand for all elements; one of the model's inputs of unknown width grows to the width asked for."""
    if len(signal) == size or len(signal) != 1:
        return signal
    terms = list(signal[0].items())
    if len(terms) == 1 and terms[0][0].kind == "input" and isinstance(terms[0][0].of, Node):
        inport = terms[0][0].of
        if inport.text("PortDimensions", "-1") in ("-1", ""):
            return [{Term("input", inport, index): terms[0][1]} for index in range(size)]
    return signal * size
