"""What each linear block does to sums of terms; a saturation, an integral and a PID make terms of their own."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import (
    ONE,
    Form,
    Limits,
    Signal,
    Term,
    TermKind,
    added,
    as_constant,
    constant,
    same_size,
    scaled,
    spread,
)
from simrob_drake.simulink.signals.frame_sensing import PARTS
from simrob_drake.simulink.signals.primitives import Primitive, elementwise
from simrob_drake.simulink.values.evaluate import UndefinedVariable
from simrob_drake.simulink.values.functions import matrix
from simrob_drake.simulink.values.syntax import NotUnderstood

if TYPE_CHECKING:
    from simrob_drake.simulink.signals.tracing import Tracer

_MOST_ELEMENTS = 10_000
_FOLLOWING: dict[TermKind, TermKind] = {"q": "w", "w": "a"}
_PLACES = 3
_BETWEEN = re.compile(r",(?![^\[]*\])")
"""The commas between the indices of a matrix, and not those within brackets."""
_LAG = 1e-3  # s, of the derivative of what is not measured


def _inport(_: Tracer, node: Node, __: int) -> Signal:
    dimensions = node.numbers("PortDimensions", "-1")
    size = int(abs(np.prod(dimensions))) if dimensions.size else 1
    return [{Term("input", node, index): 1.0} for index in range(max(1, min(size, _MOST_ELEMENTS)))]


def _constant(_: Tracer, node: Node, __: int) -> Signal:
    return [constant(float(value)) for value in node.numbers("Value", "1")]


def _gain(tracer: Tracer, node: Node, _: int) -> Signal:
    gain = node.matrix("Gain", "1")
    signal = tracer.input(node)
    if gain.size == 1:
        return scaled(signal, float(gain[0, 0]))
    mode = node.text("Multiplication", "Element-wise(K.*u)")
    if mode.startswith("Element-wise"):
        signal = spread(signal, gain.size)
        if len(signal) != gain.size:
            raise node.refusal(f"Gain has {gain.size} numbers for a signal of {len(signal)}")
        return [added((float(k), form)) for k, form in zip(gain.reshape(-1), signal, strict=True)]
    if mode.startswith("Matrix(u*K)"):
        gain = gain.T
    signal = spread(signal, gain.shape[1])
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
    return [added(*zip(factors, forms, strict=True)) for forms in zip(*same_size(node, signals), strict=True)]


def _product(tracer: Tracer, node: Node, _: int) -> Signal | None:
    signs = _signs(node, "2", "*/")
    signals = same_size(node, [tracer.input(node, place + 1) for place in range(len(signs))])
    if len(signals) == 1:
        return None
    divides = [place for place, sign in enumerate(signs) if sign == "/"]
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
                return elementwise(node, tracer, "product", signals, {"divides": divides} if divides else {})
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
        signal = spread(signal, count)
        width, rest = divmod(len(signal), count)
        if not width:
            raise node.refusal(f"splits a signal of {len(signal)} elements in {count}")
        sizes = np.array([width + 1] * rest + [width] * (count - rest))
    if number > sizes.size:
        raise node.refusal(f"has no output {number}")
    signal = spread(signal, int(sizes.sum()))
    start = int(sizes[: number - 1].sum())
    return signal[start : start + int(sizes[number - 1])] or [{}]


def _selector(tracer: Tracer, node: Node, _: int) -> Signal | None:
    signal = tracer.input(node)
    first = 1 if node.text("IndexMode", "One-based") == "One-based" else 0
    if node.text("NumberOfDimensions", "1") == "1":
        places = node.numbers("Indices", node.text("IndexParamArray", "1") or "1").astype(int) - first
    else:  # of a square matrix, column by column
        size, parts = math.isqrt(len(signal)), _BETWEEN.split(node.text("Indices"))
        try:
            rows, columns = (matrix(node.workspace.value(part)).astype(int).reshape(-1) - first for part in parts)
        except (UndefinedVariable, NotUnderstood, ValueError, TypeError):
            return None
        known = size * size == len(signal) and "all" not in node.text("IndexOptions")
        if not known or max(*rows, *columns, 0) >= size or min(*rows, *columns, 0) < 0:
            return None
        places = (rows + size * columns[:, np.newaxis]).reshape(-1)
    if not places.size or np.any(places < 0):
        return None
    signal = spread(signal, int(places.max()) + 1)
    if places.max() >= len(signal):
        raise node.refusal(f"selects element {places.max() + 1} of a signal of {len(signal)}")
    return [signal[place] for place in places]


def _bus_selector(tracer: Tracer, node: Node, number: int) -> Signal | None:
    """Return the signals that a selector takes by name out of a bus, the ``number``-th or all of them."""
    wanted = [name.strip() for name in node.text("OutputSignals").split(",")]
    if node.text("OutputAsBus", "off") == "off":
        wanted = wanted[number - 1 : number]
    found: Signal = []
    for name in wanted:
        source = tracer.network.source(node)
        for part in name.split("."):
            if source is None or source[0].kind != "BusCreator":
                return None
            bus = source[0]
            place = _place_in_bus(tracer, bus, part)
            source = None if place is None else tracer.network.source(bus, place)
        if source is None:
            return None
        found += tracer.output(*source)
    return found


def _place_in_bus(tracer: Tracer, bus: Node, name: str) -> int | None:
    """Return the input of a Bus Creator that has a name: its own, its line's, or ``signal3`` for the third."""
    text = bus.text("Inputs", "2")
    named = [part.strip(" '") for part in text.split(",")] if "," in text else []
    count = len(named) or (int(text) if text.isdecimal() else 1)
    for place in range(1, min(count, 1000) + 1):
        own = named[place - 1] if named else tracer.network.signal_name(bus, place)
        if name in (own, f"signal{place}"):
            return place
    return None


def _saturate(tracer: Tracer, node: Node, _: int) -> Signal:
    signal = tracer.input(node)
    lower, upper = node.numbers("LowerLimit", "-0.5"), node.numbers("UpperLimit", "0.5")
    size = max(len(signal), lower.size, upper.size)
    found: Signal = []
    for index, form in enumerate(spread(signal, size)):
        term = Term("sat", node, index)
        low, high = (float(bound[min(index, bound.size - 1)]) for bound in (lower, upper))
        tracer.limits[term] = Limits(low, high, form)
        found.append({term: 1.0})
    return found


def _integrator(tracer: Tracer, node: Node, _: int) -> Signal:
    size = node.numbers("InitialCondition", "0").size
    found = []
    for index in range(max(size, tracer.width(node))):
        term = Term("integral", node, index)
        tracer.integrands[term] = partial(_element, tracer, node, index)
        found.append({term: 1.0})
    return found


def _element(tracer: Tracer, node: Node, index: int) -> Form:
    signal = tracer.input(node)
    return signal[min(index, len(signal) - 1)]


def _derivative(tracer: Tracer, node: Node, _: int) -> Signal:
    return [_rate(tracer, node, index, form, _LAG) for index, form in enumerate(tracer.input(node))]


def _rate(tracer: Tracer, node: Node, index: int, form: Form, lag: float, held: tuple[TermKind, ...] = ()) -> Form:
    """Return how fast a sum changes: as it is measured, or else a filter of time constant ``lag`` [s].

    What is ``held`` counts as constant.
    """
    rate: Form = {}
    for term, value in form.items():
        still = isinstance(term.of, Node) and term.of.text("MeasurementFrame").startswith("NonRotating")
        if term.kind in _FOLLOWING:
            rate[Term(_FOLLOWING[term.kind], term.of)] = value
        elif term.kind == "sensed" and term.index < _PLACES and not still:
            rate[Term("sensed", term.of, term.index + PARTS.index("vx"))] = value
        elif term.kind not in ("one", *held):
            figures = {"numerator": [1.0, 0.0], "denominator": [lag, 1.0]}
            rated = Term("block", node, index)
            tracer.primitives[rated] = Primitive(node, "transfer_function", figures, partial(list, [form]), place=index)
            node.findings.report.add("repaired", node.path, f"its derivative is filtered, by {lag:g} s")
            return {rated: 1.0}
    return rate


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
            lag = 1 / max(node.number("N", "100"), 1e-3)
            rate = _rate(tracer, node, index, form, lag, ("input", "source"))
            parts.append((float(d), rate))
            if all(term.kind != "block" for term in rate):
                told = "its derivative acts on measured speed alone, unfiltered"
                node.findings.report.add("repaired", node.path, told)
        total = added(*parts)
        if node.text("LimitOutput", "off") == "on":
            term = Term("sat", node, index)
            low, high = node.number("LowerSaturationLimit", "-inf"), node.number("UpperSaturationLimit", "inf")
            tracer.limits[term] = Limits(low, high, total)
            total = {term: 1.0}
        found.append(total)
    return found


RULES: dict[str, Callable[[Tracer, Node, int], Signal | None]] = {
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
    "BusSelector": _bus_selector,
    "Saturate": _saturate,
    "Integrator": _integrator,
    "Derivative": _derivative,
    "PID Controller": _pid,
}
