"""Follow signals from where they are used to where they come from."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TypeAlias

from simrob_drake.errors import InvalidModel
from simrob_drake.simulink.model.network import Connections, Place
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import (
    MOST_ELEMENTS,
    Form,
    Primitive,
    Signal,
    Term,
    Value,
    flat,
    name_after,
    signal,
)

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

    def offer(self, node: Node, number: int, give: Callable[[], Signal], side: str = "rconn") -> None:
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
            node.note("defaulted", f"input {number} is not connected: it is 0")
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
            raise node.refusal(f"has a signal of more than {MOST_ELEMENTS} elements")
        name_after(node, flat(found))
        self._known[key] = found
        return found

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
        node.note("approximated", f"an algebraic loop, late by {LAG:g} s: {loop}")
        with self._guessing({}):
            shape = self.output(node, number).shape

        def late(index: int) -> Primitive:
            parameters = {"numerator": [1.0], "denominator": [LAG, 1.0]}
            return Primitive(
                "transfer_function", parameters, lambda: [self._element(node, number, index)], node, place=index
            )

        found = signal(late(index).outputs[0] for index in range(math.prod(shape)))
        return found.reshape(shape, order="F")

    def _element(self, node: Node, number: int, index: int) -> Value:
        values = flat(self.output(node, number))
        return values[min(index, len(values) - 1)]


Rule: TypeAlias = Callable[[Tracer, Node, int], Signal | None]
"""What a block gives at an output; None where it is not understood."""
