"""Follow signals from where they are used to where they come from, as sums of terms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from simrob_drake.simulink.mechanics.contacts import Contact
from simrob_drake.simulink.mechanics.joints import Joint
from simrob_drake.simulink.model.network import Network, Place
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import ONE, Form, Limits, Term, TermKind, added, as_constant, constant
from simrob_drake.simulink.values.units import UnknownUnit, factor, parse_unit

Signal = list[Form]
"""A vector signal, a form for each element."""

SOURCES = {"Step", "Ramp", "Sin", "Sine Wave", "FromWorkspace", "Clock", "DigitalClock", "DiscretePulseGenerator"}
"""Blocks whose output is a function of time."""
SINKS = {"Scope", "Display", "ToWorkspace", "ToFile", "Terminator", "Outport", "Stop", "XYGraph"}
"""Blocks that only take."""
_PASSING = {
    "SignalConversion", "SignalSpecification", "DataTypeConversion", "RateTransition", "Reshape", "UnitConversion",
    "ZeroOrderHold", "Memory", "UnitDelay", "Delay", "BusToVector",
}  # fmt: skip
_DELAYING = {"ZeroOrderHold", "Memory", "UnitDelay", "Delay"}
_SENSED: dict[str, TermKind] = {"q": "q", "w": "w", "a": "a", "t": "t"}
_MOST_ELEMENTS = 10_000


class Tracer:
    """Knows what each output of a model is made of.

    Attributes:
        limits: of saturations, by their terms.
        integrands: what integrals add up, by their terms.
        opened: blocks that are left open, in the order they were met.
    """

    def __init__(self, network: Network, joints: list[Joint], contacts: list[Contact]) -> None:
        """Note which physical signals come from where."""
        self.network = network
        self.limits: dict[Term, Limits] = {}
        self.integrands: dict[Term, Callable[[], Form]] = {}
        self.opened: list[Node] = []
        self._known: dict[tuple[int, int], Signal] = {}
        self._under_way: list[Node] = []
        self._physical: dict[Place, Callable[[], Signal]] = {}
        for joint in joints:
            for number, (freedom, what) in joint.outputs.items():
                term = Term(_SENSED[what], freedom) if what in _SENSED else Term("open", joint.node, number)
                self._offer(joint.node, number, [{term: 1.0}])
        for contact in contacts:
            if contact.senses_distance:
                self._offer(contact.node, contact.senses_distance, [{Term("distance", contact.node): 1.0}])
        for node in network.expanded.nodes:
            if node.kind == "Simulink-PS Converter":
                self._physical[network.net(node, "rconn")] = partial(self._into_physics, node)
            elif node.kind == "PS Gain":
                self._physical[network.net(node, "rconn")] = partial(self._scaled, node)

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

    def output(self, node: Node, number: int = 1) -> Signal:
        """Return the signal at an output.

        Raises:
            InvalidModel: an algebraic loop.
        """
        key = (id(node), number)
        if key in self._known:
            return self._known[key]
        if node in self._under_way:
            loop = [other.path for other in self._under_way[self._under_way.index(node) :]]
            raise node.refusal(f"is in an algebraic loop: {' → '.join([*loop, node.path])}")
        self._under_way.append(node)
        signal = self._computed(node, number)
        self._under_way.pop()
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
        rule = _RULES.get(node.kind)
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

    def _scaled(self, node: Node) -> Signal:
        signal = self.physical(node, "lconn", 1)
        gain = node.number("gain", "1")
        return self._open(node, 1) if signal is None else scaled(signal, gain)


def scaled(signal: Signal, factor_: float) -> Signal:
    """Return a signal times a number."""
    return [added((factor_, form)) for form in signal]


def _same_size(node: Node, signals: list[Signal]) -> list[Signal]:
    """Spread scalars over vectors.

    Raises:
        InvalidModel: vectors of different lengths.
    """
    size = max(len(signal) for signal in signals)
    if any(len(signal) not in (1, size) for signal in signals):
        lengths = ", ".join(str(len(signal)) for signal in signals)
        raise node.refusal(f"its inputs have {lengths} elements; they must be equally long, or scalars")
    return [_spread(signal, size) for signal in signals]


def _spread(signal: Signal, size: int) -> Signal:
    """Let a scalar stand for all elements; one of the model's inputs of unknown width grows to the width asked for."""
    if len(signal) == size or len(signal) != 1:
        return signal
    terms = list(signal[0].items())
    if len(terms) == 1 and terms[0][0].kind == "input" and isinstance(terms[0][0].of, Node):
        inport = terms[0][0].of
        if inport.text("PortDimensions", "-1") in ("-1", ""):
            return [{Term("input", inport, index): terms[0][1]} for index in range(size)]
    return signal * size


def _inport(_: Tracer, node: Node, __: int) -> Signal:
    dimensions = node.numbers("PortDimensions", "-1")
    size = int(abs(np.prod(dimensions))) if dimensions.size else 1
    return [{Term("input", node, index): 1.0} for index in range(max(1, min(size, _MOST_ELEMENTS)))]


def _constant(_: Tracer, node: Node, __: int) -> Signal:
    return [constant(float(value)) for value in node.numbers("Value", "1")]


def _gain(tracer: Tracer, node: Node, _: int) -> Signal:
    gain = np.atleast_2d(np.asarray(node.value("Gain", "1"), dtype=float))
    signal = tracer.input(node)
    if gain.size == 1:
        return scaled(signal, float(gain[0, 0]))
    mode = node.text("Multiplication", "Element-wise(K.*u)")
    if mode.startswith("Element-wise"):
        signal = _spread(signal, gain.size)
        if len(signal) != gain.size:
            raise node.refusal(f"Gain has {gain.size} numbers for a signal of {len(signal)}")
        return [added((float(k), form)) for k, form in zip(gain.reshape(-1), signal, strict=True)]
    if mode.startswith("Matrix(u*K)"):
        gain = gain.T
    signal = _spread(signal, gain.shape[1])
    if gain.shape[1] != len(signal):
        raise node.refusal(f"Gain is {gain.shape[0]} × {gain.shape[1]} for a signal of {len(signal)}")
    return [added(*zip(map(float, row), signal, strict=True)) for row in gain]


def _signs(node: Node, default: str, letters: str) -> str:
    text = node.text("Inputs", default).replace("|", "").replace(" ", "")
    if text.isdecimal():
        return letters[0] * min(int(text), 1000)
    if not text or any(letter not in letters for letter in text):
        raise node.refusal(f"Inputs is '{text}'; it must be a number or signs such as {letters}")
    return text


def _sum(tracer: Tracer, node: Node, _: int) -> Signal:
    signs = _signs(node, "++", "+-")
    signals = [tracer.input(node, place + 1) for place in range(len(signs))]
    factors = [1.0 if sign == "+" else -1.0 for sign in signs]
    if len(signals) == 1:
        return [added(*((factors[0], form) for form in signals[0]))]
    return [added(*zip(factors, forms, strict=True)) for forms in zip(*_same_size(node, signals), strict=True)]


def _product(tracer: Tracer, node: Node, _: int) -> Signal | None:
    signs = _signs(node, "2", "*/")
    signals = _same_size(node, [tracer.input(node, place + 1) for place in range(len(signs))])
    if len(signals) == 1:
        return None
    result: Signal = []
    for forms in zip(*signals, strict=True):
        product: Form = {ONE: 1.0}
        for sign, form in zip(signs, forms, strict=True):
            value, so_far = as_constant(form), as_constant(product)
            if value is not None and (sign == "*" or value != 0):
                product = added((value if sign == "*" else 1 / value, product))
            elif so_far is not None and sign == "*":
                product = added((so_far, form))
            else:
                return None
        result.append(product)
    return result


def _mux(tracer: Tracer, node: Node, _: int) -> Signal:
    text = node.text("Inputs", node.text("NumInputs", "2"))
    sizes = node.numbers("Inputs", "2") if "Inputs" in node.block.parameters else np.array([2.0])
    named = "," in text and "[" not in text  # names of signals instead of widths
    count = text.count(",") + 1 if named else int(sizes[0]) if sizes.size == 1 else sizes.size
    parts = [tracer.input(node, place + 1) for place in range(min(count, 1000))]
    return [form for part in parts for form in part]


def _demux(tracer: Tracer, node: Node, number: int) -> Signal:
    sizes = node.numbers("Outputs", "2")
    signal = tracer.input(node)
    if sizes.size == 1:
        count = int(sizes[0])
        signal = _spread(signal, count)
        width, rest = divmod(len(signal), count)
        if not width:
            raise node.refusal(f"splits a signal of {len(signal)} elements in {count}")
        sizes = np.array([width + 1] * rest + [width] * (count - rest))
    if number > sizes.size:
        raise node.refusal(f"has no output {number}")
    signal = _spread(signal, int(sizes.sum()))
    start = int(sizes[: number - 1].sum())
    return signal[start : start + int(sizes[number - 1])] or [{}]


def _selector(tracer: Tracer, node: Node, _: int) -> Signal | None:
    signal = tracer.input(node)
    indices = node.numbers("Indices", node.text("IndexParamArray", "1") or "1")
    places = indices.astype(int) - (1 if node.text("IndexMode", "One-based") == "One-based" else 0)
    if np.any(places < 0):
        return None
    signal = _spread(signal, int(places.max()) + 1)
    if places.max() >= len(signal):
        raise node.refusal(f"selects element {places.max() + 1} of a signal of {len(signal)}")
    return [signal[place] for place in places]


def _saturate(tracer: Tracer, node: Node, _: int) -> Signal:
    signal = tracer.input(node)
    lower, upper = node.numbers("LowerLimit", "-0.5"), node.numbers("UpperLimit", "0.5")
    size = max(len(signal), lower.size, upper.size)
    found: Signal = []
    for index, form in enumerate(_spread(signal, size)):
        term = Term("sat", node, index)
        low, high = (float(bound[min(index, bound.size - 1)]) for bound in (lower, upper))
        tracer.limits[term] = Limits(low, high, form)
        found.append({term: 1.0})
    return found


def _integrator(tracer: Tracer, node: Node, _: int) -> Signal:
    size = node.numbers("InitialCondition", "0").size
    found = []
    for index in range(max(size, _width(tracer, node))):
        term = Term("integral", node, index)
        tracer.integrands[term] = partial(_element, tracer, node, index)
        found.append({term: 1.0})
    return found


def _element(tracer: Tracer, node: Node, index: int) -> Form:
    signal = tracer.input(node)
    return signal[min(index, len(signal) - 1)]


def _width(tracer: Tracer, node: Node) -> int:
    """Return how many elements feed a block that breaks loops; one where the loop goes through it."""
    from simrob_drake.errors import InvalidModel

    under_way = list(tracer._under_way)
    try:
        return len(tracer.input(node))
    except InvalidModel:
        tracer._under_way[:] = under_way
        return 1


def _derivative(tracer: Tracer, node: Node, _: int) -> Signal | None:
    following: dict[TermKind, TermKind] = {"q": "w", "w": "a"}
    found: Signal = []
    for form in tracer.input(node):
        rate: Form = {}
        for term, value in form.items():
            if term.kind in following:
                rate[Term(following[term.kind], term.of)] = value
            elif term.kind != "one":
                return None
        found.append(rate)
    return found


def _pid(tracer: Tracer, node: Node, _: int) -> Signal | None:
    signal = tracer.input(node)
    kind = node.text("Controller", "PID")
    parallel = node.text("Form", "Parallel") == "Parallel"
    p = node.numbers("P", "1")[0] if "P" in kind else 0.0
    i = node.numbers("I", "1")[0] if "I" in kind else 0.0
    d = node.numbers("D", "0")[0] if "D" in kind else 0.0
    if not parallel:
        i, d = i * p, d * p
    found: Signal = []
    for index, form in enumerate(signal):
        parts: list[tuple[float, Form]] = [(float(p), form)]
        if i:
            term = Term("integral", node, index)
            tracer.integrands[term] = partial(dict, form)
            parts.append((float(i), {term: 1.0}))
        if d:
            parts.append((float(d), {Term("w", t.of): v for t, v in form.items() if t.kind == "q"}))
            node.findings.report.add("repaired", node.path, "its derivative acts on measured speed alone, unfiltered")
        total = added(*parts)
        if node.text("LimitOutput", "off") == "on":
            term = Term("sat", node, index)
            low, high = node.number("LowerSaturationLimit", "-inf"), node.number("UpperSaturationLimit", "inf")
            tracer.limits[term] = Limits(low, high, total)
            total = {term: 1.0}
        found.append(total)
    return found


_RULES: dict[str, Callable[[Tracer, Node, int], Signal | None]] = {
    "Inport": _inport,
    "InportShadow": _inport,
    "Constant": _constant,
    "Ground": lambda *_: [{}],
    "Gain": _gain,
    "Slider Gain": _gain,
    "Sum": _sum,
    "Product": _product,
    "UnaryMinus": lambda tracer, node, _: scaled(tracer.input(node), -1.0),
    "Bias": lambda tracer, node, _: [
        added((1.0, form), (1.0, constant(node.number("Bias")))) for form in tracer.input(node)
    ],
    "Mux": _mux,
    "BusCreator": _mux,
    "Concatenate": _mux,
    "Demux": _demux,
    "Selector": _selector,
    "Saturate": _saturate,
    "Integrator": _integrator,
    "Derivative": _derivative,
    "PID Controller": _pid,
}
