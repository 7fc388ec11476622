"""What signals are made of: sums of measured and computed terms, which add and multiply as numbers do.

Linear blocks keep such sums exact through any number of levels, so a law is what it computes, and not how it is drawn.
What no sum can tell (a saturation, an integral, a product of two signals) is a block of a signal flow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from pydantic import TypeAdapter

from simrob_drake.errors import SimrobError
from simrob_drake.parts.controllers.flow_blocks import FlowBlock
from simrob_drake.parts.controllers.signal_flow import FlowBlockConfig
from simrob_drake.simulink.mechanics.joints import Freedom
from simrob_drake.simulink.model.nodes import Node

TermKind = Literal["one", "time", "q", "w", "a", "t", "distance", "sensed", "input", "open", "block"]


@dataclass(frozen=True)
class Term:
    """One thing that a signal depends on."""

    # ``one`` (a constant), ``time``, ``q``, ``w``, ``a``, ``t`` (position, speed, acceleration, effort of a joint),
    # ``distance``, ``sensed`` (a part of what a Transform Sensor measures), ``input`` (of the model), ``open`` (what a
    # block that is not understood gives), or ``block`` (what is computed)
    kind: TermKind
    of: Freedom | Node | Primitive | None = None
    """The degree of freedom, the block of the model, or the block of the flow."""
    index: int = 0  # which element of its output


@dataclass(eq=False)
class Primitive:
    """One block of a signal flow."""

    kind: str  # as in a station's file
    parameters: dict[str, Any] = field(default_factory=dict)  # as in a station's file
    inputs: Callable[[], Iterable[Value]] = tuple
    """Gives its inputs, once all is traced: loops go through blocks with states."""
    node: Node | None = None  # the block of the model that it is, or is a part of
    size: int = 1  # elements of its output
    place: int | None = None  # which element of the block's signal it is; None where there is one only

    @property
    def outputs(self) -> list[Value]:
        """Its output, by element."""
        return [Form({Term("block", self, index): 1.0}) for index in range(self.size)]


class Form:
    """A sum of terms with their factors; a sum that is constant is a plain number instead."""

    __slots__ = ("terms",)

    def __init__(self, terms: Mapping[Term, float]) -> None:
        self.terms = dict(terms)

    def __add__(self, other: Value) -> Value:
        return added((1.0, self), (1.0, other))

    __radd__ = __add__

    def __neg__(self) -> Value:
        return added((-1.0, self))

    def __sub__(self, other: Value) -> Value:
        return self + (-other)

    def __rsub__(self, other: Value) -> Value:
        return -self + other

    def __mul__(self, other: Value) -> Value:
        """Return the product: a sum where the other is a number, else a block."""
        return computed("product", self, other) if isinstance(other, Form) else added((float(other), self))

    __rmul__ = __mul__

    def __truediv__(self, other: Value) -> Value:
        if isinstance(other, Form) or not other:
            return computed("product", self, other, divides=[1])
        return added((1.0 / float(other), self))

    def __rtruediv__(self, other: Value) -> Value:
        return computed("product", other, self, divides=[1])


class Complex(Form):
    """A complex number of signals; what is computed with it must become real again."""

    def __init__(self, real: Value, imag: Value = 0.0) -> None:
        super().__init__({})
        self.real, self.imag = real, imag

    def __add__(self, other: Value) -> Value:
        other = other if isinstance(other, Complex) else Complex(other)
        return Complex(self.real + other.real, self.imag + other.imag)

    def __neg__(self) -> Value:
        return Complex(-self.real, -self.imag)

    def __mul__(self, other: Value) -> Value:
        other = other if isinstance(other, Complex) else Complex(other)
        real, imag = self.real * other.real - self.imag * other.imag, self.real * other.imag + self.imag * other.real
        return Complex(real, imag)

    def __truediv__(self, other: Value) -> Value:
        return other.__rtruediv__(self) if isinstance(other, Complex) else Complex(self.real / other, self.imag / other)

    def __rtruediv__(self, other: Value) -> Value:
        return other * Complex(self.real, -self.imag) / (self.real * self.real + self.imag * self.imag)

    __radd__, __rmul__ = __add__, __mul__


Value: TypeAlias = Form | float  # an element of a signal
Signal: TypeAlias = np.ndarray[Any, np.dtype[np.object_]]  # values in an array of shape (n,), or (r, c) of a matrix

MOST_ELEMENTS = 10_000  # of a signal
PARTS = ("x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz")
"""What a frame sensor measures, in the order of its terms."""
AS_WRITTEN: TypeAdapter[FlowBlock] = TypeAdapter(FlowBlockConfig)
"""What checks a block as it stands in a station's file."""
ONE = Term("one")
TIME = Form({Term("time"): 1.0})


def terms_of(value: Value) -> dict[Term, float]:
    """Return the terms of a value with their factors."""
    if isinstance(value, Form):
        return value.terms
    return {ONE: float(value)} if value else {}


def added(*parts: tuple[float, Value]) -> Value:
    """Return a sum of values, each with a factor."""
    total: dict[Term, float] = {}
    for factor, value in parts:
        for term, own in terms_of(value).items():
            total[term] = total.get(term, 0.0) + factor * own
    terms = {term: own for term, own in total.items() if own != 0.0}
    return Form(terms) if terms.keys() - {ONE} else terms.get(ONE, 0.0)


def evaluated(value: Value, leaf: Callable[[Term], float | None], known: dict[Term, float], time: float = 0.0) -> float:
    """Return what a value is at a time [s], of blocks in the states at their start.

    Args:
        value: the value.
        leaf: gives a term; None of a block that is to be computed.
        known: terms that are known, to which others are added.
        time: when [s].

    Raises:
        RecursionError: a loop.
        ArithmeticError, ValueError: what cannot be computed.
    """
    total = 0.0
    for term, factor in terms_of(value).items():
        if term not in known:
            own = leaf(term)
            if own is None and isinstance(term.of, Primitive):
                inputs = [evaluated(one, leaf, known, time) for one in term.of.inputs()]
                written = {"kind": term.of.kind, **term.of.parameters, **({"of": [{}] * len(inputs)} if inputs else {})}
                block = AS_WRITTEN.validate_python(written).law
                own = float(block.output(time, block.start, inputs)[term.index])
            known[term] = own or 0.0
        total += factor * known[term]
    return total


def of_time(value: Value) -> bool:
    """Tell whether a value depends on time alone."""
    return all(term.kind in ("one", "time", "block") for terms in closure([value]) for term in terms)


def early(value: Value, time: float = 0.0) -> float | None:
    """Return a value of time alone, at a time [s] so early that its states are as at the start; None of others."""
    with suppress(SimrobError, ValueError, ArithmeticError, RecursionError):  # it is told where it is written
        if of_time(value):
            known = {Term("time"): time}
            return evaluated(value, lambda term: None if isinstance(term.of, Primitive) else 1.0, known, time)
    return None


def computed(kind: str, *inputs: Value, **parameters: Any) -> Value:
    """Return what a block of one output makes of its inputs (raises ValueError: complex ones)."""
    if any(isinstance(one, Complex) for one in inputs):
        raise ValueError(f"complex numbers in a {kind}")
    return Primitive(kind, parameters, lambda: inputs).outputs[0]


def signal(values: Iterable[Value]) -> Signal:
    """Return a vector of values."""
    return np.array(list(values), dtype=object)


def flat(values: Signal) -> list[Value]:
    """Return the elements of a signal, column by column."""
    return list(values.ravel(order="F"))


@np.errstate(all="ignore")  # of numbers that it divides, and flags that others left raised
def mapped(function: Callable[..., Value], *signals: Signal) -> Signal:
    """Apply a function of values element by element; scalars are spread."""
    return np.asarray(np.frompyfunc(function, len(signals), 1)(*signals), dtype=object)


def scaled(values: Signal, factor: float) -> Signal:
    """Return a signal times a number."""
    return mapped(lambda value: factor * value, values)


def blocks_in(values: Iterable[Value]) -> Iterator[Primitive]:
    """Return the blocks that values depend on at once."""
    for value in values:
        yield from (term.of for term in terms_of(value) if isinstance(term.of, Primitive))


def name_after(node: Node, values: Iterable[Value]) -> None:
    """Let blocks without a node, and those that they take, be parts of a block of the model."""
    waiting = [block for block in blocks_in(values) if block.node is None]
    while waiting:
        block = waiting.pop()
        if block.node is None:
            block.node = node
            waiting += blocks_in(block.inputs())


def closure(values: Iterable[Value]) -> Iterator[dict[Term, float]]:
    """Return the terms of values, and of all that the blocks in them take."""
    waiting, known = list(values), set[Primitive]()
    while waiting:
        value = waiting.pop()
        yield terms_of(value)
        for block in blocks_in([value]):
            if block not in known:
                known.add(block)
                waiting += block.inputs()


def fitted(node: Node, *signals: Signal) -> list[Signal]:
    """Spread scalars over the shape of the others (raises InvalidModel: shapes that do not fit)."""
    largest = max(signals, key=lambda one: (one.size, one.ndim))
    if any(one.size not in (1, largest.size) for one in signals):
        lengths = ", ".join(str(one.size) for one in signals)
        raise node.refusal(f"its inputs have {lengths} elements; they must be equally long, or scalars")
    return [widened(one, largest.size).reshape(largest.shape, order="F") for one in signals]


def widened(values: Signal, size: int) -> Signal:
    """Let a scalar stand for all elements; an input of unknown width grows to the width that is asked for."""
    if values.size != 1 or size == 1:
        return values
    (value,) = values.ravel()
    ((term, factor), *others) = terms_of(value).items() or [(ONE, 0.0)]
    node = term.of
    if not others and isinstance(node, Node) and _has_no_width(term.kind, node):
        return signal(Form({Term(term.kind, node, term.index + index): factor}) for index in range(size))
    return signal([value] * size)


def _has_no_width(kind: TermKind, node: Node) -> bool:
    return kind == "open" or (kind == "input" and node.text("PortDimensions", "-1") in ("-1", ""))
