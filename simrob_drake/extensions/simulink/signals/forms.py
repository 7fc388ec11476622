"""What signals are made of: sums of measured and computed terms, which add and multiply as numbers do.

Linear blocks keep such sums exact through any number of levels, so a law is what it computes, and not how it is drawn.
What no sum can tell (a saturation, an integral, a product of two signals) is a block of a signal flow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from pydantic import TypeAdapter

from simrob_drake.base.errors import InvalidModel, SimrobError
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics.joints import Freedom
from simrob_drake.extensions.simulink.model.network import Connections, Place
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.parts.controllers.flow_blocks import FlowBlock
from simrob_drake.parts.controllers.signal_flow import FlowBlockConfig

TermKind = Literal[
    "one", "time", "q", "w", "a", "t", "distance", "sensed", "input", "open", "block"
]


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
    place: int | None = (
        None  # which element of the block's signal it is; None where there is one only
    )

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
        return (
            computed("product", self, other)
            if isinstance(other, Form)
            else added((float(other), self))
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Value) -> Value:
        if isinstance(other, Form) or not other:
            return computed("product", self, other, divides=[1])
        return added((1.0 / float(other), self))

    def __rtruediv__(self, other: Value) -> Value:
        return computed("product", other, self, divides=[1])


Value: TypeAlias = Form | float  # an element of a signal
Signal: TypeAlias = np.ndarray[
    Any, np.dtype[np.object_]
]  # values in an array of shape (n,), or (r, c) of a matrix

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


def evaluated(
    value: Value, leaf: Callable[[Term], float | None], known: dict[Term, float], time: float = 0.0
) -> float:
    """Return what a value is at a time [s], of blocks in the states at their start.

    ``leaf`` gives a term, or None of a block that is to be computed; ``known`` are terms, to which others are added.
    Raises RecursionError: a loop; ArithmeticError, ValueError: what cannot be computed.
    """
    total = 0.0
    for term, factor in terms_of(value).items():
        if term not in known:
            own = leaf(term)
            if own is None and isinstance(term.of, Primitive):
                inputs = [evaluated(one, leaf, known, time) for one in term.of.inputs()]
                written = {
                    "kind": term.of.kind,
                    **term.of.parameters,
                    **({"of": [{}] * len(inputs)} if inputs else {}),
                }
                block = AS_WRITTEN.validate_python(written).law
                own = float(block.output(time, block.start, inputs)[term.index])
            known[term] = own or 0.0
        total += factor * known[term]
    return total


def of_time(value: Value) -> bool:
    """Tell whether a value depends on time alone."""
    return all(
        term.kind in ("one", "time", "block") for terms in closure([value]) for term in terms
    )


def early(value: Value, time: float = 0.0) -> float | None:
    """Return a value of time alone, at a time [s] so early that its states are as at the start; None of none."""

    def leaf(term: Term) -> float | None:
        return None if isinstance(term.of, Primitive) else time if term.kind == "time" else 1.0

    with suppress(
        SimrobError, ValueError, ArithmeticError, RecursionError
    ):  # it is told where it is written
        return evaluated(value, leaf, {}, time)
    return None


def computed(kind: str, *inputs: Value, **parameters: Any) -> Value:
    """Return what a block of one output makes of its inputs (raises ValueError: complex ones)."""
    if any(isinstance(one, Form) and type(one) is not Form for one in inputs):
        raise ValueError(
            message("simulink.complex_numbers", "complex numbers in a {kind}", kind=kind)
        )
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


def late(
    kind: str,
    parameters: Sequence[dict[str, Any]],
    give: Callable[[], Signal],
    node: Node,
    shape: tuple[int, ...],
) -> Signal:
    """Return a block for each element of a signal that is followed later, with parameters of its own or the last."""
    size = max(len(parameters), math.prod(shape))

    def made(index: int) -> Value:
        def inputs() -> list[Value]:
            values = flat(give())
            return [values[min(index, len(values) - 1)]]

        own = parameters[min(index, len(parameters) - 1)]
        return Primitive(kind, own, inputs, node, place=index if size > 1 else None).outputs[0]

    found = signal(map(made, range(size)))
    return found.reshape(shape, order="F") if size == math.prod(shape) else found


def blocks_in(values: Iterable[Value]) -> Iterator[Primitive]:
    """Return the blocks that values depend on at once."""
    for value in values:
        yield from (term.of for term in terms_of(value) if isinstance(term.of, Primitive))


def name_after(node: Node, values: Iterable[Value]) -> None:
    """Let blocks without a node, and those that they take, be parts of a block of the model."""
    waiting = list(blocks_in(values))
    while waiting:
        if (block := waiting.pop()).node is None:
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
        raise node.refusal(
            message(
                "simulink.unequal_inputs",
                "its inputs have {lengths} elements; they must be equally long, or scalars",
                lengths=lengths,
            )
        )
    return [widened(one, largest.size).reshape(largest.shape, order="F") for one in signals]


def widened(values: Signal, size: int) -> Signal:
    """Let a scalar stand for all elements; an input of unknown width grows to the width that is asked for."""
    if values.size != 1 or size == 1:
        return values
    (value,) = values.ravel()
    ((term, factor), *others) = terms_of(value).items() or [(ONE, 0.0)]
    node, grows = term.of, term.kind == "open"
    if term.kind == "input" and isinstance(node, Node):
        grows = node.text("PortDimensions", "-1") in ("-1", "")
    if not others and isinstance(node, Node) and grows:
        return signal(
            Form({Term(term.kind, node, term.index + index): factor}) for index in range(size)
        )
    return signal([value] * size)


LAG = 1e-3
"""Time constant [s] of what stands for a derivative of something that is not measured, or breaks an algebraic loop."""
_MOST_GUESSES = 5
_Shapes: TypeAlias = dict[Node, tuple[int, ...]]


class Tracer:
    """Knows what each output of a model is made of, by the rules of its blocks.

    Attributes:
        network: the connections.
        opened: blocks that are left open, in the order they were met, and what is wrong with their parameters.
        own: rules of blocks that have one of their own.
    """

    def __init__(self, network: Connections, rules: Mapping[str, Rule]) -> None:
        self.network, self._rules = network, rules
        self.opened: dict[Node, str] = {}
        self.own: dict[Node, Rule] = {}
        self._known: dict[tuple[Node, int], Signal] = {}
        self._made: dict[Node, list[Signal]] = {}
        self._under_way: list[tuple[Node, int]] = []
        self._shapes: _Shapes = {}
        self._guesses: _Shapes | None = None
        self._physical: dict[Place, Callable[[], Signal]] = {}

    def offer(
        self, node: Node, number: int, give: Callable[[], Signal], side: str = "rconn"
    ) -> None:
        """Take note of what gives the physical signal at a port."""
        self._physical[self.network.net(node, side, number)] = give

    def physical(self, node: Node, side: str, number: int) -> Signal | None:
        """Return the physical signal at a port, in SI; None where nothing drives it."""
        source = self._physical.get(self.network.net(node, side, number))
        return None if source is None else source()

    def followed(self, node: Node) -> bool:
        """Tell whether anything that moves, or ends a run, depends on a block's output."""
        return any(known is node for known, _ in self._known)

    def input(self, node: Node, number: int = 1) -> Signal:
        """Return the signal at an input; an unconnected one is 0, as in Simulink, and is noted."""
        source = self.network.source(node, number)
        found = self.physical(node, "lconn", number) if source is None else self.output(*source)
        if found is None:
            node.note(
                "defaulted",
                message(
                    "simulink.input_not_connected",
                    "input {number} is not connected: it is 0",
                    number=number,
                ),
            )
            return signal([0.0])
        return found

    def inputs(self, node: Node) -> list[Signal]:
        """Return the signals at the inputs of a block that is left open."""
        return [self.output(*source) for source in self.network.sources(node)]

    def once(self, node: Node, make: Callable[[], list[Signal]]) -> list[Signal]:
        """Return all outputs of a block, which are made at the first of them."""
        if self._guesses is not None:
            return make()
        if node not in self._made:
            self._made[node] = make()
        return self._made[node]

    def shape(self, node: Node) -> tuple[int, ...]:
        """Return the shape of what the first input takes, of a block through which loops go.

        The loop is followed with a guess of the shape until it comes round to the same; what is found on the way is
        forgotten.
        """
        if node in self._shapes:
            return self._shapes[node]
        if self._guesses is not None:  # within another search
            if node not in self._guesses:
                self._guesses[node] = (1,)
                self._guesses[node] = self.input(node).shape
            return self._guesses[node]
        guesses: _Shapes = {node: (1,)}
        for _ in range(_MOST_GUESSES):
            with self._guessing(guesses) as guessed:
                found = {one: self.input(one).shape for one in guesses}
            found = guessed | found
            if found == guesses:
                break
            guesses = found
        self._shapes |= guesses
        return self._shapes[node]

    @contextmanager
    def _guessing(self, guesses: _Shapes) -> Iterator[_Shapes]:
        """Follow signals with guesses of shapes, to which others are added; else all that is found is forgotten."""
        entries = self.network.expanded.findings.report.entries
        kept = self._known, self._under_way, self.opened, entries.copy()
        self._known, self._under_way, self.opened = dict(self._known), [], dict(self.opened)
        self._guesses = dict(guesses)
        try:
            yield self._guesses
        finally:
            self._known, self._under_way, self.opened, entries[:] = kept
            self._guesses = None

    def output(self, node: Node, number: int = 1) -> Signal:
        """Return the signal at an output."""
        key = node, number
        if key in self._known:
            return self._known[key]
        if key in self._under_way:
            return self._broken(node, number)
        self._under_way.append(key)
        found = self._computed(node, number)
        self._under_way.remove(key)
        if found.size > MOST_ELEMENTS:
            raise node.refusal(
                message(
                    "simulink.signal_too_large",
                    "has a signal of more than {most} elements",
                    most=MOST_ELEMENTS,
                )
            )
        name_after(node, flat(found))
        self._known[key] = found
        return found

    @np.errstate(all="ignore")  # as above
    def _computed(self, node: Node, number: int) -> Signal:
        rule, why = self.own.get(node) or self._rules.get(node.kind), ""
        try:
            found = rule(self, node, number) if rule is not None else None
        except InvalidModel as problem:
            found, why = None, problem.problem
        return self._open(node, number, why) if found is None else found

    def _open(self, node: Node, number: int, why: str = "") -> Signal:
        self.opened.setdefault(node, why)
        return signal([Form({Term("open", node, (number - 1) * MOST_ELEMENTS): 1.0})])

    def _broken(self, node: Node, number: int) -> Signal:
        """Return an output that depends on itself at once: late by a filter, for no net of blocks solves for it."""
        if self._guesses is not None:
            return signal([Form({Term("open", node): 1.0})])
        way = [one.path for one, _ in self._under_way]
        loop = " → ".join([*way[way.index(node.path) :], node.path])
        node.note(
            "approximated",
            message(
                "simulink.algebraic_loop",
                "an algebraic loop, late by {lag:g} s: {loop}",
                lag=LAG,
                loop=loop,
            ),
        )
        with self._guessing({}):
            shape = self.output(node, number).shape

        parameters = [
            {"numerator": [1.0], "denominator": [LAG, 1.0]} for _ in range(math.prod(shape))
        ]
        return late("transfer_function", parameters, lambda: self.output(node, number), node, shape)


Rule: TypeAlias = Callable[[Tracer, Node, int], Signal | None]
"""What a block gives at an output; None where it is not understood."""
