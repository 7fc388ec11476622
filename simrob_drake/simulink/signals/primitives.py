"""Blocks of Simulink that no sum can tell, as blocks of a signal flow: kind, figures and inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.simulink.mechanics.joints import Freedom
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import Form, Signal, Term, added, same_size

if TYPE_CHECKING:
    from simrob_drake.simulink.signals.tracing import Tracer

Figures = dict[str, Any]


@dataclass(frozen=True)
class Primitive:
    """One block of a signal flow.

    Attributes:
        node: the block that it is, or is an element of.
        kind, figures: as in a station's file.
        inputs: gives its inputs, once all is traced: loops go through blocks with states.
        elements: of its output, of which each is a term; others have one for each block.
        place: which element of the block's signal it is; None where there is one only.
    """

    node: Node
    kind: str
    figures: Figures = field(default_factory=dict)
    inputs: Callable[[], list[Form]] = list
    elements: int = 1
    place: int | None = None


def elementwise(node: Node, tracer: Tracer, kind: str, signals: list[Signal], *figures: Figures) -> Signal:
    """Return a block's signal whose elements are each a primitive of the same elements of its inputs.

    Figures are those of each element, or one set for all.
    """
    same = same_size(node, signals)
    size = max(len(same[0]), len(figures))
    found: Signal = []
    for index in range(size):
        forms = [signal[min(index, len(signal) - 1)] for signal in same]
        own = figures[min(index, len(figures) - 1)] if figures else {}
        term = Term("block", node, index)
        place = index if size > 1 else None
        tracer.primitives[term] = Primitive(node, kind, own, partial(list, forms), place=place)
        found.append({term: 1.0})
    return found


def closure(tracer: Tracer, *forms: Form) -> Iterator[Form]:
    """Return sums with all those that the blocks in them take."""
    waiting, known = list(forms), set[Term]()
    while waiting:
        form = waiting.pop()
        yield form
        for term in form.keys() - known:
            known.add(term)
            waiting += inner_forms(tracer, term)


def inner_forms(tracer: Tracer, term: Term) -> list[Form]:
    """Return what the block of a term takes."""
    if term in tracer.limits:
        return [tracer.limits[term].inner]
    if term in tracer.integrands:
        return [tracer.integrands[term]()]
    return tracer.primitives[term].inputs() if term in tracer.primitives else []


def commanded(tracer: Tracer, forms: list[Form]) -> dict[Term, tuple[Freedom, float]]:
    """Return which joint's position is wanted by which input of the model, and the factor: `k (factor input - q)`."""
    found: dict[Term, tuple[Freedom, float]] = {}
    taken: set[Freedom] = set()
    for form in closure(tracer, *forms):
        for term, value in form.items():
            for other, gain in form.items() if term.kind == "input" and term not in found else ():
                if other.kind == "q" and isinstance(other.of, Freedom) and other.of not in taken and gain * value < 0:
                    found[term] = other.of, -value / gain
                    taken.add(other.of)
                    break
    return found


def _transfer_function(tracer: Tracer, node: Node, _: int) -> Signal | None:
    sampled = _period(node, "Discrete" in node.kind)
    several = any(len(node.matrix(name, "1")) > 1 for name in ("Numerator", "Denominator"))
    if sampled is None or several:  # outputs of one input
        return None
    if "ZeroPole" in node.kind:
        zeros, poles = (node.numbers(name, default) for name, default in (("Zeros", "[]"), ("Poles", "[]")))
        numerator, denominator = node.number("Gain", "1") * np.atleast_1d(np.poly(zeros)), np.poly(poles)
    else:
        numerator, denominator = node.numbers("Numerator", "[1]"), node.numbers("Denominator", "[1 1]")
    figures = {"numerator": _listed(numerator), "denominator": _listed(np.atleast_1d(denominator)), **sampled}
    return _with_states(tracer, node, "transfer_function", figures)


def _with_states(tracer: Tracer, node: Node, kind: str, *figures: Figures) -> Signal:
    """Return a block with states, element by element; its inputs are followed later."""
    size = max(len(figures), tracer.width(node))
    found: Signal = []
    for index in range(size):
        term, own = Term("block", node, index), figures[min(index, len(figures) - 1)]
        place = index if size > 1 else None

        def inputs(index: int = index) -> list[Form]:
            signal = tracer.input(node)
            return [signal[min(index, len(signal) - 1)]]

        tracer.primitives[term] = Primitive(node, kind, own, inputs, place=place)
        found.append({term: 1.0})
    return found


def _state_space(tracer: Tracer, node: Node, _: int) -> Signal | None:
    sampled = _period(node, "Discrete" in node.kind)
    if sampled is None:
        return None
    figures: Figures = {name: node.matrix(name, "1").tolist() for name in "ABCD"}
    start = node.numbers("X0" if "X0" in node.block.parameters else "InitialCondition", "0")
    states, outputs = len(figures["A"]), len(figures["C"])
    if start.any():
        figures["initial"] = _listed(np.resize(start, states) if start.size == 1 else start)
    found: Signal = []
    for index in range(outputs):
        term = Term("block", node, index)
        primitive = Primitive(node, "state_space", figures | sampled, lambda: tracer.input(node), outputs, index)
        tracer.primitives[term] = primitive
        found.append({term: 1.0})
    return found


def _discrete_integrator(tracer: Tracer, node: Node, _: int) -> Signal | None:
    sampled = _period(node, True)
    if sampled is None or node.text("IntegratorMethod", "Integration: Forward Euler") != "Integration: Forward Euler":
        return None
    figures = [{"initial": float(value), **sampled} for value in node.numbers("InitialCondition", "0")]
    gain = node.number("gainval", "1")
    return [dict.fromkeys(form, gain) for form in _with_states(tracer, node, "integrator", *figures)]


def _rate_limiter(tracer: Tracer, node: Node, _: int) -> Signal:
    figures = {
        "rising": node.number("RisingSlewLimit", "1"),
        "falling": -node.number("FallingSlewLimit", "-1"),
        "initial": node.number("InitialCondition", "0"),
    }
    return _with_states(tracer, node, "rate_limiter", figures)


def _dead_zone(tracer: Tracer, node: Node, _: int) -> Signal:
    lower, upper = node.numbers("LowerValue", "-0.5"), node.numbers("UpperValue", "0.5")
    size = max(lower.size, upper.size)
    bounds = zip(np.resize(lower, size), np.resize(upper, size), strict=True)
    figures = [{"lower": float(low), "upper": float(high)} for low, high in bounds]
    return elementwise(node, tracer, "dead_zone", [tracer.input(node)], *figures)


def _lookup(tracer: Tracer, node: Node, _: int) -> Signal | None:
    if node.text("NumberOfTableDimensions", "1") != "1":
        return None
    points = "BreakpointsForDimension1" if "BreakpointsForDimension1" in node.block.parameters else "InputValues"
    values = "Table" if "Table" in node.block.parameters else "OutputValues"
    figures: Figures = {
        "points": _listed(node.numbers(points, "[-5:5]")),
        "values": _listed(node.numbers(values, "tanh([-5:5])")),
    }
    if "Clip" in node.text("ExtrapMethod") or "Use End Values" in node.text("LookUpMeth"):
        figures["clip"] = True
    return elementwise(node, tracer, "lookup", [tracer.input(node)], figures)


def _compare(tracer: Tracer, node: Node, _: int) -> Signal:
    """Compare two inputs, or one with a constant: by the difference."""
    first = tracer.input(node)
    figures: Figures = {"operator": _OPERATORS.get(node.text("relop", node.text("Operator", "<=")), "<=")}
    if node.kind == "RelationalOperator":
        pairs = zip(*same_size(node, [first, tracer.input(node, 2)]), strict=True)
        first = [added((1.0, one), (-1.0, other)) for one, other in pairs]
    elif node.kind == "Compare To Constant":
        figures["threshold"] = node.number("const", "3")
    return elementwise(node, tracer, "compare", [first], figures)


def _logic(tracer: Tracer, node: Node, _: int) -> Signal | None:
    operator = node.text("Operator", "AND").lower()
    if operator not in ("and", "or", "nand", "nor", "xor", "not"):
        return None  # such as NXOR
    return elementwise(node, tracer, "logic", _inputs(tracer, node, operator == "not"), {"operator": operator})


def _inputs(tracer: Tracer, node: Node, single: bool = False) -> list[Signal]:
    """Return as many inputs as a block says that it has; the elements of one alone are inputs of their own."""
    text = node.text("Inputs", "2")
    count = int(text) if text.isdecimal() and not single else 1
    signals = [tracer.input(node, place + 1) for place in range(max(1, min(count, 100)))]
    return [[form] for form in signals[0]] if len(signals) == 1 and not single else signals


def _switch(tracer: Tracer, node: Node, _: int) -> Signal:
    criteria = node.text("Criteria", "u2 >= Threshold")
    figures: Figures = {"operator": next((sign for sign in (">=", ">", "~=") if sign in criteria), ">=")}
    if figures["operator"] == "~=":
        figures["operator"] = "!="
    else:
        figures["threshold"] = node.number("Threshold", "0")
    return elementwise(node, tracer, "switch", [tracer.input(node, place) for place in (1, 2, 3)], figures)


def _function(tracer: Tracer, node: Node, _: int) -> Signal | None:
    asked = node.text("Operator", node.text("Function", "")).lower()
    default = {
        "Abs": "abs",
        "Signum": "sign",
        "Sqrt": "sqrt",
        "Trigonometry": "sin",
        "Math": "exp",
        "MinMax": "min",
        "Rounding": "floor",
    }
    name = default[node.kind] if node.kind in ("Abs", "Signum") else asked or default[node.kind]
    if name in ("square", "magnitude^2"):
        return elementwise(node, tracer, "product", [tracer.input(node)] * 2)
    if name == "reciprocal":
        return elementwise(node, tracer, "product", [tracer.input(node)], {"divides": [0]})
    if name not in _FUNCTIONS:
        return None
    signals = _inputs(tracer, node) if node.kind == "MinMax" else [tracer.input(node)]
    if name in ("atan2", "pow"):
        signals.append(tracer.input(node, 2))
    if len(signals) != (2 if name in ("atan2", "pow", "min", "max") else 1):
        return None
    return elementwise(node, tracer, "function", signals, {"function": name})


def _period(node: Node, sampled: bool) -> Figures | None:
    """Return the period of a sampled block, and nothing of a continuous one; None where it is inherited."""
    if not sampled:
        return {}
    period = float(np.resize(node.numbers("SampleTime", "-1"), 1)[0])
    return {"period": period} if period > 0 else None


def _listed(values: Vector) -> list[float]:
    return [float(value) for value in values]


_OPERATORS = {"<": "<", "<=": "<=", ">": ">", ">=": ">=", "==": "==", "~=": "!="}
_FUNCTIONS = {
    "abs", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "sign", "atan2",
    "min", "max", "pow", "floor", "ceil",
}  # fmt: skip

PRIMITIVES: dict[str, Callable[[Tracer, Node, int], Signal | None]] = {
    **dict.fromkeys(("TransferFcn", "ZeroPole", "DiscreteTransferFcn", "DiscreteZeroPole"), _transfer_function),
    **dict.fromkeys(("StateSpace", "DiscreteStateSpace"), _state_space),
    "DiscreteIntegrator": _discrete_integrator,
    "RateLimiter": _rate_limiter,
    "DeadZone": _dead_zone,
    **dict.fromkeys(("Lookup_n-D", "Lookup"), _lookup),
    **dict.fromkeys(("RelationalOperator", "Compare To Constant", "Compare To Zero"), _compare),
    "Logic": _logic,
    "Switch": _switch,
    **dict.fromkeys(("Abs", "Signum", "Sqrt", "Trigonometry", "Math", "MinMax", "Rounding"), _function),
}
