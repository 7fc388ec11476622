"""Follow signals from where they are used to where they come from, as sums of terms."""

from collections.abc import Callable
from functools import partial

from simrob_drake.errors import InvalidModel
from simrob_drake.simulink.mechanics.contacts import Contact
from simrob_drake.simulink.mechanics.joints import Joint
from simrob_drake.simulink.model.network import Network, Place
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import Form, Limits, Signal, Term, TermKind, added, constant, same_size, scaled
from simrob_drake.simulink.signals.frame_sensing import SENSOR, sensed
from simrob_drake.simulink.signals.primitives import PRIMITIVES, Primitive
from simrob_drake.simulink.signals.rules import RULES
from simrob_drake.simulink.values.units import UnknownUnit, factor, parse_unit

SOURCES = {"Step", "Ramp", "Sin", "Sine Wave", "FromWorkspace", "Clock", "DigitalClock", "DiscretePulseGenerator"}
"""Blocks whose output is a function of time."""
_PASSING = {
    "SignalConversion", "SignalSpecification", "DataTypeConversion", "RateTransition", "Reshape", "UnitConversion",
    "ZeroOrderHold", "Memory", "UnitDelay", "Delay", "BusToVector",
}  # fmt: skip
_PHYSICAL = {"PS Gain", "PS Constant", "PS Add", "PS Subtract"}
_DELAYING = {"ZeroOrderHold", "Memory", "UnitDelay", "Delay"}
_SENSED: dict[str, TermKind] = {"q": "q", "w": "w", "a": "a", "t": "t"}
_MOST_ELEMENTS = 10_000


class Tracer:
    """Knows what each output of a model is made of.

    Attributes:
        limits: of saturations, by their terms.
        integrands: what integrals add up, by their terms.
        primitives: what other blocks compute, by their terms.
        opened: blocks that are left open, in the order they were met.
        under_way: blocks whose outputs are being computed; one of them again is an algebraic loop.
    """

    def __init__(self, network: Network, joints: list[Joint], contacts: list[Contact]) -> None:
        """Note which physical signals come from where."""
        self.network = network
        self.limits: dict[Term, Limits] = {}
        self.integrands: dict[Term, Callable[[], Form]] = {}
        self.primitives: dict[Term, Primitive] = {}
        self.opened: list[Node] = []
        self._known: dict[tuple[int, int], Signal] = {}
        self.under_way: list[Node] = []
        self._physical: dict[Place, Callable[[], Signal]] = {}
        for joint in joints:
            for number, (freedom, what) in joint.outputs.items():
                term = Term(_SENSED[what], freedom) if what in _SENSED else Term("open", joint.node, number)
                self._offer(joint.node, number, [{term: 1.0}])
        for contact in contacts:
            if contact.senses_distance:
                self._offer(contact.node, contact.senses_distance, [{Term("distance", contact.node): 1.0}])
        for node in network.expanded.nodes:
            if node.kind == SENSOR:
                for number, signal in sensed(self, node).items():
                    self._offer(node, number, signal)
            elif node.kind == "Simulink-PS Converter":
                self._physical[network.net(node, "rconn")] = partial(self._into_physics, node)
            elif node.kind in _PHYSICAL:
                self._physical[network.net(node, "rconn")] = partial(self._physical_block, node)

    def _offer(self, node: Node, number: int, signal: Signal) -> None:
        self._physical[self.network.net(node, "rconn", number)] = lambda: signal

    def physical(self, node: Node, side: str, number: int) -> Signal | None:
        """Return the physical signal at a port, in SI; None where nothing drives it."""
        source = self._physical.get(self.network.net(node, side, number))
        return None if source is None else source()

    def input(self, node: Node, number: int = 1) -> Signal:
        """Return the signal at an input; an unconnected one is 0, as in Simulink, and is noted.

        Raises:
            InvalidModel: an algebraic loop.
        """
        found = self.network.source(node, number)
        if found is None:
            node.findings.report.add("defaulted", node.path, f"input {number} is not connected: it is 0")
            return [{}]
        return self.output(*found)

    def width(self, node: Node) -> int:
        """Return how many elements feed a block that breaks loops; one where the loop goes through it."""
        under_way = list(self.under_way)
        try:
            return len(self.input(node))
        except InvalidModel:
            self.under_way[:] = under_way
            return 1

    def output(self, node: Node, number: int = 1) -> Signal:
        """Return the signal at an output.

        Raises:
            InvalidModel: an algebraic loop.
        """
        key = (id(node), number)
        if key in self._known:
            return self._known[key]
        if node in self.under_way:
            loop = [other.path for other in self.under_way[self.under_way.index(node) :]]
            raise node.refusal(f"is in an algebraic loop: {' → '.join([*loop, node.path])}")
        self.under_way.append(node)
        signal = self._computed(node, number)
        self.under_way.pop()
        if len(signal) > _MOST_ELEMENTS:
            raise node.refusal(f"has a signal of more than {_MOST_ELEMENTS} elements")
        self._known[key] = signal
        return signal

    def _computed(self, node: Node, number: int) -> Signal:
        if node.kind == "PS-Simulink Converter":
            return self._out_of_physics(node)
        if node.kind in _PASSING:
            if node.kind in _DELAYING:
                node.findings.report.add("repaired", node.path, "its delay is left out")
            return self.input(node)
        rule = RULES.get(node.kind) or PRIMITIVES.get(node.kind)
        if rule is not None:
            signal = rule(self, node, number)
            if signal is not None:
                return signal
        if node.kind in SOURCES:
            return [{Term("source", node): 1.0}]
        return self._open(node, number)

    def _open(self, node: Node, number: int) -> Signal:
        if node not in self.opened:
            self.opened.append(node)
        return [{Term("open", node, number): 1.0}]

    def _out_of_physics(self, node: Node) -> Signal:
        signal = self.physical(node, "lconn", 1)
        if signal is None:
            return self._open(node, 1)
        return scaled(signal, 1.0 / self._converter_unit(node, signal))

    def _into_physics(self, node: Node) -> Signal:
        if node.text("FilteringAndDerivatives", "provide") == "filter":
            node.findings.report.add("repaired", node.path, "its input filter is left out")
        signal = self.input(node)
        return scaled(signal, self._converter_unit(node, signal))

    def _converter_unit(self, node: Node, signal: Signal) -> float:
        """Return what the converter's unit is in SI, after checking that it fits a joint's signal."""
        text = node.text("Unit", "1")
        if text in ("1", "inherit", ""):
            return 1.0
        kinds = {term.kind for form in signal for term in form}
        try:
            if kinds == {"q"} and node.kind == "PS-Simulink Converter":
                freedom = next(term.of for form in signal for term in form)
                return factor(text, "rad" if getattr(freedom, "turns", True) else "m")
            return parse_unit(text).factor
        except UnknownUnit as problem:
            raise node.refusal(f"Unit: {problem}") from problem

    def _physical_block(self, node: Node) -> Signal:
        """Return what a block of physical signals hands out: a constant, a multiple, a sum or a difference."""
        if node.kind == "PS Constant":
            return [constant(float(value)) for value in node.numbers("constant", "1")]
        parts = [self.physical(node, "lconn", number) for number in (1, 2)[: 1 if node.kind == "PS Gain" else 2]]
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return self._open(node, 1)
        if node.kind == "PS Gain":
            return scaled(known[0], node.number("gain", "1"))
        factors = (1.0, -1.0 if node.kind == "PS Subtract" else 1.0)
        return [added(*zip(factors, forms, strict=True)) for forms in zip(*same_size(node, known), strict=True)]
