"""Follow signals from where they are used to where they come from."""

import math
from collections.abc import Callable
from functools import partial

from simrob_drake.errors import InvalidModel
from simrob_drake.simulink.mechanics.bodies import ContactPair
from simrob_drake.simulink.mechanics.joints import Joint
from simrob_drake.simulink.model.network import Connections, Place
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.arithmetic import ARITHMETIC
from simrob_drake.simulink.signals.dynamics import DYNAMICS, LAG
from simrob_drake.simulink.signals.forms import (
    MOST_ELEMENTS,
    Form,
    Primitive,
    Rule,
    Signal,
    Term,
    TermKind,
    Value,
    flat,
    name_after,
    signal,
)
from simrob_drake.simulink.signals.frame_sensing import SENSOR, sensed
from simrob_drake.simulink.signals.matlab import MATLAB
from simrob_drake.simulink.signals.networks import NETWORKS, outputs_of
from simrob_drake.simulink.signals.routing import ROUTING, bus_output, conditional
from simrob_drake.simulink.signals.sources import PHYSICAL, SOURCES, out_of_physics

RULES: dict[str, Rule] = {
    **ROUTING, **ARITHMETIC, **SOURCES, **DYNAMICS, **MATLAB, **PHYSICAL, **NETWORKS,
    "PS-Simulink Converter": out_of_physics,
}  # fmt: skip
"""What each type of block gives."""
_SENSED: dict[str, TermKind] = {kind: kind for kind in ("q", "w", "a", "t")}
_MOST_GUESSES = 5


class Tracer:
    """Knows what each output of a model is made of.

    Attributes:
        network: the connections.
        opened: blocks that are left open, in the order they were met, and what is wrong with their parameters.
    """

    def __init__(self, network: Connections, joints: list[Joint], contacts: list[ContactPair]) -> None:
        self.network = network
        self.opened: dict[Node, str] = {}
        self._known: dict[tuple[Node, int], Signal] = {}
        self._made: dict[Node, list[Signal]] = {}
        self._under_way: list[tuple[Node, int]] = []
        self._shapes: dict[tuple[Node, int], tuple[int, ...]] = {}
        self._guesses: dict[tuple[Node, int], tuple[int, ...]] | None = None
        self._physical: dict[Place, Callable[[], Signal]] = {}
        for joint in joints:
            self._offer_sensed(joint)
        for contact in contacts:
            if contact.senses_distance:
                self._offer(contact.node, contact.senses_distance, partial(_each, Term("distance", contact.node)))
        for node in network.expanded.nodes:
            if node.kind == SENSOR:
                for number, give in sensed(node).items():
                    self._offer(node, number, give)
            elif node.kind in PHYSICAL:
                self._offer(node, 1, partial(self.output, node))
            for number, (_, side, port) in enumerate(outputs_of(node) if node.kind in NETWORKS else (), start=1):
                self._offer(node, port, partial(self.output, node, number), side)

    def _offer_sensed(self, joint: Joint) -> None:
        for number, (freedom, what) in joint.outputs.items():
            term = (
                Term(_SENSED[what], freedom)
                if what in _SENSED
                else Term("open", joint.node, (number - 1) * MOST_ELEMENTS)
            )
            self._offer(joint.node, number, partial(_each, term))
        for number, parts in joint.senses.items():
            terms = [Term("sensed", joint.node, part) for part in parts]
            self._offer(joint.node, number, partial(_each, *(terms or [Term("open", joint.node, number)])))

    def _offer(self, node: Node, number: int, give: Callable[[], Signal], side: str = "rconn") -> None:
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
        if node.kind in PHYSICAL and node.kind != "Simulink-PS Converter":
            found = self.physical(node, "lconn", number)
        else:
            source = self.network.source(node, number)
            found = None if source is None else self.output(*source)
        if found is None:
            node.note("defaulted", f"input {number} is not connected: it is 0")
            return signal([0.0])
        return found

    def inputs(self, node: Node) -> list[Signal]:
        """Return the signals at the inputs of a block that is left open."""
        found: list[Signal] = []
        while (source := self.network.source(node, len(found) + 1)) is not None:
            found.append(self.output(*source))
        return found

    def once(self, node: Node, make: Callable[[], list[Signal]]) -> list[Signal]:
        """Return all outputs of a block, which are made at the first of them."""
        if self._guesses is not None:
            return make()
        if node not in self._made:
            self._made[node] = make()
        return self._made[node]

    def shape(self, node: Node, number: int = 1) -> tuple[int, ...]:
        """Return the shape of what an input takes, of a block through which loops go.

        The loop is followed with a guess of the shape until it comes round to the same; what is found on the way is
        forgotten.
        """
        key = node, number
        if key in self._shapes:
            return self._shapes[key]
        if self._guesses is not None:  # within another search
            if key not in self._guesses:
                self._guesses[key] = (1,)
                self._guesses[key] = self.input(node, number).shape
            return self._guesses[key]
        kept, self._under_way, way = dict(self._known), [], self._under_way
        opened, entries = dict(self.opened), list(node.findings.report.entries)
        guesses = {key: (1,)}
        for _ in range(_MOST_GUESSES):
            self._guesses = dict(guesses)
            found = {one: self.input(*one).shape for one in list(guesses)}
            found |= {one: shape for one, shape in self._guesses.items() if one not in found}
            self._known = dict(kept)
            if found == guesses:
                break
            guesses = found
        self._guesses, self._under_way, self.opened = None, way, opened
        node.findings.report.entries[:] = entries
        self._shapes |= guesses
        return self._shapes[key]

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
        rule = conditional if node.children and self.network.is_conditional(node) else RULES.get(node.kind)
        if self.network.elements(node, number):
            rule = bus_output
        why = ""
        try:
            found = rule(self, node, number) if rule is not None else None
        except InvalidModel as problem:
            found, why = None, problem.problem
        return self._open(node, number, why) if found is None else found

    def _open(self, node: Node, number: int, why: str = "") -> Signal:
        if node not in self.opened:
            self.opened[node] = why
        return _each(Term("open", node, (number - 1) * MOST_ELEMENTS))

    def _broken(self, node: Node, number: int) -> Signal:
        """Return an output that depends on itself at once: late by a filter, for no net of blocks solves for it."""
        if self._guesses is not None:
            return _each(Term("open", node))
        way = [one.path for one, _ in self._under_way]
        loop = " → ".join([*way[way.index(node.path) :], node.path])
        node.note("approximated", f"an algebraic loop, late by {LAG:g} s: {loop}")
        shape = self._shape_of(node, number)

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

    def _shape_of(self, node: Node, number: int) -> tuple[int, ...]:
        """Return the shape of an output that is being computed, by computing it with a guess."""
        kept, way, opened = dict(self._known), self._under_way, dict(self.opened)
        entries = list(node.findings.report.entries)
        self._under_way, self._guesses = [], {}
        shape: tuple[int, ...] = self.output(node, number).shape
        self._known, self._under_way, self._guesses, self.opened = kept, way, None, opened
        node.findings.report.entries[:] = entries
        return shape


def _each(*terms: Term) -> Signal:
    return signal(Form({term: 1.0}) for term in terms)
