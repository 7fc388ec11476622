"""Physical signals: converters, arithmetic, sources."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from simrob_drake.parts.controllers.flow_block import FUNCTIONS
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.arithmetic import applied, limited, switched, table_of
from simrob_drake.simulink.signals.dynamics import filtered, with_states
from simrob_drake.simulink.signals.forms import (
    TIME,
    Rule,
    Signal,
    SignalReader,
    Value,
    computed,
    fitted,
    flat,
    mapped,
    scaled,
    signal,
    terms_of,
)
from simrob_drake.simulink.values.units import UnknownUnit, factor, parse_unit


def _converter_unit(node: Node, values: Signal) -> float:
    """Return what the converter's unit is in SI, after checking that it fits a joint's signal."""
    text = node.text("Unit", "1")
    if text in ("1", "inherit", ""):
        return 1.0
    terms = [term for value in flat(values) for term in terms_of(value)]
    try:
        if {term.kind for term in terms} == {"q"} and node.kind == "PS-Simulink Converter":
            return factor(text, "rad" if getattr(terms[0].of, "turns", True) else "m")
        return parse_unit(text).factor
    except UnknownUnit as problem:
        raise node.refusal(f"Unit: {problem}") from problem


def out_of_physics(reader: SignalReader, node: Node, _: int) -> Signal | None:
    """Return what a PS-Simulink Converter gives."""
    values = reader.physical(node, "lconn", 1)
    return None if values is None else scaled(values, 1.0 / _converter_unit(node, values))


def _into_physics(reader: SignalReader, node: Node, _: int) -> Signal:
    values = reader.input(node)
    values = scaled(values, _converter_unit(node, values))
    if node.text("FilteringAndDerivatives", "provide") != "filter":
        return values
    lag = node.number("InputFilterTimeConstant", "0.001")
    denominator = [lag, 1.0] if node.text("SimscapeFilterOrder", "1") == "1" else [lag * lag, 2 * lag, 1.0]
    return mapped(lambda value: filtered(node, value, [1.0], denominator), values)


def _figure(node: Node, *names: str, default: str = "1") -> float:
    """Return a parameter in SI that goes by one of these names; its unit stands under ``<name>_unit``."""
    name = next((one for one in names if one in node.block.parameters), names[0])
    return node.number(name, default) * _unit(node, name)


def _unit(node: Node, name: str) -> float:
    try:
        return parse_unit(node.text(f"{name}_unit", "1")).factor
    except UnknownUnit as problem:
        raise node.refusal(f"{name}: {problem}") from problem


def _elementwise(function: Callable[..., Value], inputs: int = 1) -> Rule:
    """Return the rule of a block that computes each element of its inputs."""
    return lambda reader, node, _: mapped(function, *fitted(node, *(reader.input(node, k + 1) for k in range(inputs))))


def _with(make: Callable[[Node], Callable[[Value], Value]]) -> Rule:
    """Return the rule of a block of one input, whose function is made of its parameters."""
    return lambda reader, node, number: _elementwise(make(node))(reader, node, number)


def _ps_constant(_: SignalReader, node: Node, __: int) -> Signal:
    return signal(float(value) * _unit(node, "constant") for value in node.numbers("constant", "1"))


def _switch(reader: SignalReader, node: Node, _: int) -> Signal:
    """Return the first input where the second reaches the threshold, else the third."""
    yes, by, no = (reader.input(node, number) for number in (1, 2, 3))
    return switched(node, yes, by, no, ">=", _figure(node, "Threshold", "threshold", default="0.5"))


def _limited(node: Node, kind: str) -> Callable[[Value], Value]:
    lower, upper = (_figure(node, f"{side}_limit", default=one) for side, one in (("lower", "-0.5"), ("upper", "0.5")))
    return partial(limited, lower=lower, upper=upper, kind=kind)


def _lookup(node: Node) -> Callable[[Value], Value]:
    parameters = table_of(node.numbers("x_t", "[1 2 3]"), node.numbers("y_t", "[1 2 3]"),
                       clip=node.text("extrap_method", "") not in ("1", "linear"))  # fmt: skip
    return lambda u: computed("lookup", u, **parameters)


def _math(node: Node) -> Callable[..., Value]:
    name = node.text("function", "sin").rpartition(".")[2]
    return lambda u: applied(name if name in FUNCTIONS else "sin", u)


def _integrator(reader: SignalReader, node: Node, _: int) -> Signal:
    return with_states(reader, node, "integrator", {"initial": _figure(node, "x0", "x", default="0")})


def _ps_ramp(_: SignalReader, node: Node, __: int) -> Signal:
    begin = _figure(node, "start_time", default="0")
    rising = _figure(node, "slope") * limited(TIME - begin, 0.0, math.inf)
    return signal([rising + _figure(node, "initial_output", default="0")])


def _ps_step(_: SignalReader, node: Node, __: int) -> Signal:
    before, after = _figure(node, "initial_output", default="0"), _figure(node, "final_output")
    return signal([computed("step", time=_figure(node, "step_time", default="1"), before=before, after=after)])


def _ps_sine(_: SignalReader, node: Node, __: int) -> Signal:
    rate = _figure(node, "frequency") * (2 * math.pi if "Hz" in node.text("frequency_unit", "Hz") else 1.0)
    angle = rate * TIME + _figure(node, "phase", "phase_shift", default="0")
    return signal([_figure(node, "amplitude") * applied("sin", angle) + _figure(node, "bias", "center", default="0")])


PHYSICAL: dict[str, Rule] = {
    "Simulink-PS Converter": _into_physics,
    "PS Constant": _ps_constant,
    "PS Gain": lambda reader, node, _: scaled(reader.input(node), _figure(node, "gain")),
    "PS Add": _elementwise(lambda u, v: u + v, 2),
    "PS Subtract": _elementwise(lambda u, v: u - v, 2),
    "PS Product": _elementwise(lambda u, v: u * v, 2),
    "PS Divide": _elementwise(lambda u, v: u / v, 2),
    "PS Min": _elementwise(lambda u, v: applied("min", u, v), 2),
    "PS Max": _elementwise(lambda u, v: applied("max", u, v), 2),
    "PS Abs": _elementwise(lambda u: applied("abs", u)),
    "PS Signum": _elementwise(lambda u: applied("sign", u)),
    "PS Math Function": _with(_math),
    "PS Saturation": _with(partial(_limited, kind="saturation")),
    "PS Dead Zone": _with(partial(_limited, kind="dead_zone")),
    "PS Lookup Table (1D)": _with(_lookup),
    "PS Switch": _switch,
    "PS Ramp": _ps_ramp,
    "PS Step": _ps_step,
    "PS Sine Wave": _ps_sine,
    "PS Integrator": _integrator,
}
"""What blocks give at their right port 1, by type."""
