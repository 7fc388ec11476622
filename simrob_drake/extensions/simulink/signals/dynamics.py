"""Blocks that remember: integrators, transfer functions, delays, PID controllers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.signals.forms import (
    LAG,
    ONE,
    PARTS,
    Form,
    Primitive,
    Rule,
    Signal,
    Term,
    TermKind,
    Tracer,
    Value,
    added,
    computed,
    early,
    fitted,
    flat,
    late,
    mapped,
    of_time,
    signal,
    terms_of,
)

Parameters = dict[str, Any]
_FOLLOWING: dict[TermKind, TermKind] = {"q": "w", "w": "a"}
_PLACES = 3
_LONGEST_WAY = 50
_FINEST = 1e-3  # s, between the samples of a Transport Delay
_MOST_SAMPLES = 2000


def blocks(
    reader: Tracer, node: Node, kind: str, *parameters: Parameters, at_once: bool = False
) -> Signal:
    """Return a block, element by element; its inputs are followed later, unless its outputs depend on them at once."""
    shape = reader.input(node).shape if at_once else reader.shape(node)
    return late(kind, parameters, partial(reader.input, node), node, shape)


def filtered(value: Value, numerator: Iterable[float], denominator: Iterable[float]) -> Value:
    """Return a transfer function of a value that is known."""
    above, below = ([float(one) for one in factors] for factors in (numerator, denominator))
    return computed("transfer_function", value, numerator=above, denominator=below)


def rate_of(node: Node, value: Value) -> Value:
    """Return how fast a value changes: as it is measured, and of the rest by a filter of time constant ``LAG``."""
    rate: dict[Term, float] = {}
    rest: dict[Term, float] = {}
    for term, factor in terms_of(value).items():
        still = isinstance(term.of, Node) and term.of.text("MeasurementFrame").startswith(
            "NonRotating"
        )
        if term.kind == "time":
            rate[ONE] = factor
        elif term.kind in _FOLLOWING:
            rate[Term(_FOLLOWING[term.kind], term.of)] = factor
        elif term.kind == "sensed" and term.index < _PLACES and not still:
            rate[Term("sensed", term.of, term.index + PARTS.index("vx"))] = factor
        elif term.kind != "one":
            rest[term] = factor
    found = added((1.0, Form(rate)))
    if rest:
        node.note(
            "approximated",
            message(
                "simulink.derivative_filtered", "its derivative is filtered, by {lag:g} s", lag=LAG
            ),
        )
        parameters = {"numerator": [1.0, 0.0], "denominator": [LAG, 1.0]}
        found = (
            Primitive("transfer_function", parameters, _from_rest(Form(rest)), node).outputs[0]
            + found
        )
    return found


def _from_rest(value: Form) -> Callable[[], list[Value]]:
    """Return what gives, once all is traced, a value less what it begins with, where that is of time alone."""
    begun: list[float] = []

    def inputs() -> list[Value]:
        if not begun:
            begun.append(0.0)  # for a loop through it, which asks again
            begun[0] = (of_time(value) and early(value)) or 0.0
        return [value - begun[0]]

    return inputs


def period_of(reader: Tracer, node: Node) -> float | None:
    """Return the time between samples [s] of a block, or of what it inherits it from; None where nothing says it."""
    waiting, known = [node], [node]
    while waiting and len(known) < _LONGEST_WAY:
        here = waiting.pop(0)
        for name in ("SampleTime", "OutPortSampleTime", "st", "samptime", "SystemSampleTime"):
            if name in here.block.parameters:
                period = float(here.matrix(name, "-1").reshape(-1)[0])
                if 0 < period < math.inf:
                    return period
        new = [
            one
            for one in dict.fromkeys(one for one, _ in reader.network.sources(here))
            if one not in known
        ]
        known += new
        waiting += new
    return None


def _sampled(reader: Tracer, node: Node) -> Parameters:
    """Return the period of a sampled block (raises InvalidModel: nothing says it)."""
    if (period := period_of(reader, node)) is None:
        raise node.refusal(message("simulink.no_sample_time", "nothing says its sample time"))
    return {"period": period}


def _tell_of_left_out(node: Node) -> None:
    for what, name, default in (
        ("reset", "ExternalReset", "none"),
        (message("simulink.tracking_input", "tracking input"), "TrackingMode", "off"),
    ):
        if node.text(name, default) != default:
            node.note(
                "approximated", message("simulink.is_left_out", "its {what} is left out", what=what)
            )


def _integrator(reader: Tracer, node: Node, _: int) -> Signal:
    _tell_of_left_out(node)
    start = node.numbers("InitialCondition", "0")
    if node.text("InitialConditionSource", "internal") == "external":
        external = reader.input(node, 2 if node.text("ExternalReset", "none") == "none" else 3)
        known = [one for one in flat(external) if not isinstance(one, Form)]
        if len(known) < external.size:
            node.note(
                "approximated",
                message("simulink.begins_at_zero", "it begins at 0, not at its input"),
            )
        start = np.array(known if len(known) == external.size else [0.0], dtype=float)
    return blocks(
        reader, node, "integrator", *({"initial": float(one), **_limits(node)} for one in start)
    )


def _limits(node: Node) -> Parameters:
    sides = (("Lower", "-inf"), ("Upper", "inf")) if node.is_on("LimitOutput") else ()
    bounds = {
        end.lower(): float(node.matrix(f"{end}SaturationLimit", none).reshape(-1)[0])
        for end, none in sides
    }
    return {name: bound for name, bound in bounds.items() if math.isfinite(bound)}


def _discrete_integrator(reader: Tracer, node: Node, _: int) -> Signal:
    sampled = _sampled(reader, node)
    period = sampled["period"]
    _tell_of_left_out(node)
    method, gain = (
        node.text("IntegratorMethod", "Integration: Forward Euler"),
        node.number("gainval", "1"),
    )
    if method.startswith("Accumulation"):
        gain /= period
    starts, limits = (
        node.numbers("InitialCondition", "0"),
        {name: one / gain for name, one in _limits(node).items()},
    )
    if "Forward" in method or node.is_on("LimitOutput"):
        if "Forward" not in method:
            node.note(
                "approximated",
                message("simulink.as_forward_euler", "as forward Euler, with its limits"),
            )
        parameters = [{"initial": float(one) / gain, **limits, **sampled} for one in starts]
        return np.asarray(gain * blocks(reader, node, "integrator", *parameters))
    through = gain * period * (0.5 if "Trapezoidal" in method else 1.0)
    matrices: Parameters = {
        "A": [[1.0]],
        "B": [[gain * period]],
        "C": [[1.0]],
        "D": [[through]],
        **sampled,
    }
    return blocks(
        reader,
        node,
        "state_space",
        *(matrices | {"initial": [float(one)]} for one in starts),
        at_once=True,
    )


def _transfer_function(reader: Tracer, node: Node, _: int) -> Signal | None:
    if any(
        len(node.matrix(name, "1")) > 1 for name in ("Numerator", "Denominator")
    ):  # outputs of one input
        return None
    sampled = _sampled(reader, node) if "Discrete" in node.kind else {}
    if "ZeroPole" in node.kind:
        zeros, poles = (
            np.atleast_1d(np.poly(node.numbers(name, "[]"))) for name in ("Zeros", "Poles")
        )
        numerator, denominator = node.number("Gain", "1") * zeros, poles
    elif node.kind == "Discrete Derivative":
        gain = node.number("gainval", "1") / sampled["period"]
        numerator, denominator = np.array([gain, -gain]), np.array([1.0, 0.0])
    elif node.kind == "DiscreteFir":
        numerator, denominator = node.numbers("Coefficients", "[0.5 0.5]"), np.array([1.0])
    else:
        numerator, denominator = (
            node.numbers("Numerator", "[1]"),
            node.numbers("Denominator", "[1 1]"),
        )
    if node.kind in ("DiscreteFilter", "DiscreteFir"):  # powers of 1/z
        size = max(numerator.size, denominator.size)
        numerator, denominator = (
            np.append(one, np.zeros(size - one.size)) for one in (numerator, denominator)
        )
    return _rational(reader, node, numerator, denominator, sampled)


def _rational(
    reader: Tracer, node: Node, numerator: Vector, denominator: Vector, sampled: Parameters
) -> Signal:
    parameters = {"numerator": numerator.tolist(), "denominator": denominator.tolist(), **sampled}
    at_once = np.trim_zeros(numerator, "f").size >= denominator.size
    return blocks(reader, node, "transfer_function", parameters, at_once=at_once)


def _lti(reader: Tracer, node: Node, _: int) -> Signal | None:
    """Return what a system object makes of its input, where it is ``tf`` or ``ss`` of matrices, and begins at rest."""
    system = node.value("sys", "tf(1, [1 1])")
    if not isinstance(system, dict) or node.numbers("IC", "[]").any():
        return None
    if "numerator" in system:
        return _rational(
            reader, node, system["numerator"].reshape(-1), system["denominator"].reshape(-1), {}
        )
    return (
        _states(reader, node, {name: system[name].tolist() for name in "ABCD"})
        if "A" in system
        else None
    )


def _begun_transfer_function(reader: Tracer, node: Node, _: int) -> Signal | None:
    """Return y = Y0 + G (u - U0): it begins at an output, at rest where that is what the input comes to."""
    numerator, denominator = node.numbers("N", "[1]"), node.numbers("D", "[1 1]")
    if np.trim_zeros(numerator, "f").size >= denominator.size:
        return None
    output, begun = (node.numbers(name, "0") for name in ("Y0", "U0"))
    if not np.allclose(denominator[-1] * output, numerator[-1] * begun):
        node.note(
            "approximated",
            message(
                "simulink.begins_at_output",
                "begins at its output without what its states are beside it",
            ),
        )
    parameters = {"numerator": numerator.tolist(), "denominator": denominator.tolist()}
    values = blocks(reader, node, "transfer_function", parameters)
    rest = mapped(lambda u: filtered(u, numerator, denominator), begun.astype(object))
    return mapped(
        lambda one, y, other: one + y - other, *fitted(node, values, output.astype(object), rest)
    )


def _state_space(reader: Tracer, node: Node, _: int) -> Signal:
    parameters: Parameters = {name: node.matrix(name, "1").tolist() for name in "ABCD"}
    start = node.numbers(node.named("X0", "InitialCondition"), "0")
    if start.any():
        parameters["initial"] = (
            np.resize(start, len(parameters["A"])) if start.size == 1 else start
        ).tolist()
    return _states(
        reader, node, parameters | (_sampled(reader, node) if "Discrete" in node.kind else {})
    )


def _states(reader: Tracer, node: Node, parameters: Parameters) -> Signal:
    if any(map(any, parameters["D"])):
        reader.input(node)  # its outputs depend on it at once
    made = Primitive(
        "state_space", parameters, lambda: flat(reader.input(node)), node, len(parameters["C"]), 0
    )
    return signal(made.outputs)


def _delay(reader: Tracer, node: Node, _: int) -> Signal:
    known = node.kind == "Delay" and node.text("DelayLengthSource", "Dialog") == "Dialog"
    period, steps = period_of(reader, node), int(node.number("DelayLength", "2")) if known else 1
    if period is None or node.kind == "Memory" or steps < 1:
        if steps >= 1:
            node.note(
                "approximated",
                message(
                    "simulink.delay_left_out", "its delay of one step of the solver is left out"
                ),
            )
        return reader.input(node)
    starts = node.numbers(node.named("InitialCondition", "vinit", "X0"), "0")
    shared = {"period": period, **({"steps": steps} if steps > 1 else {})}
    return blocks(reader, node, "delay", *(shared | {"initial": float(one)} for one in starts))


def _hold(reader: Tracer, node: Node, _: int) -> Signal:
    period = period_of(reader, node)
    return (
        reader.input(node)
        if period is None
        else blocks(reader, node, "hold", {"period": period}, at_once=True)
    )


def _transport_delay(reader: Tracer, node: Node, _: int) -> Signal:
    late, start = node.number("DelayTime", "1"), node.number("InitialOutput", "0")
    if late <= 0:
        return reader.input(node)
    steps = int(np.clip(math.ceil(late / _FINEST), 1, _MOST_SAMPLES))
    node.note(
        "approximated",
        message(
            "simulink.delay_sampled", "its delay is sampled, each {period:g} s", period=late / steps
        ),
    )
    return blocks(reader, node, "delay", {"period": late / steps, "steps": steps, "initial": start})


def _rate_limiter(reader: Tracer, node: Node, _: int) -> Signal:
    rising = node.quantity("risingSlewLimit", "RisingSlewLimit", default="1")
    falling = -node.quantity("fallingSlewLimit", "FallingSlewLimit", default="-1")
    node.note(
        "approximated",
        message("simulink.late_where_it_follows", "is late by {lag:g} s where it follows", lag=LAG),
    )
    parameters = {
        "rising": rising,
        "falling": falling,
        "initial": node.number("InitialCondition", "0"),
    }
    return blocks(reader, node, "rate_limiter", parameters)


_METHODS = {"Forward Euler": 0.0, "Backward Euler": 1.0, "Trapezoidal": 0.5}


def _pid(reader: Tracer, node: Node, _: int) -> Signal:
    letters, both = (
        node.text("Controller", "PID"),
        "2" in node.kind or "2DOF" in node.text("SourceType"),
    )
    gains = _gains(reader, node, letters, both)
    errors = [reader.input(node)]
    if both:
        setpoint, measured = fitted(node, errors[0], reader.input(node, 2))
        weights = node.numbers("b", "1"), np.ones(1), node.numbers("c", "1")
        errors = [
            mapped(lambda r, y, b: b * r - y, setpoint, measured, one.astype(object))
            for one in weights
        ]
    errors = fitted(node, *errors, *(gains[name].astype(object) for name in gains.keys() - {"N"}))[
        : len(errors)
    ]
    _tell_of_left_out(node)
    parameters = _pid_parameters(reader, node, letters, gains.pop("N", None))
    found = []
    for index, parts in enumerate(zip(*(flat(one) for one in errors), strict=True)):
        own = {
            name.lower(): float(np.resize(gain, index + 1)[index]) for name, gain in gains.items()
        }
        if node.text("Form", "Parallel") != "Parallel":
            own |= {name: own[name] * own.get("p", 1.0) for name in ("i", "d") if name in own}
        extra: Value = 0.0
        if "d" in own and node.text("UseFilter", "on") == "off" and not parameters.get("period"):
            extra, rest = _unfiltered(node, parts[-1], own["d"], parameters)
            own |= rest
        place = index if errors[0].size > 1 else None
        made = Primitive(
            "pid", parameters | own, partial(tuple[Value, ...], parts), node, place=place
        ).outputs[0]
        found.append(made + extra)
    return signal(found).reshape(errors[0].shape, order="F")


def _gains(reader: Tracer, node: Node, letters: str, both: bool) -> dict[str, Vector]:
    """Return a controller's gains, and N where inputs have them.

    Raises InvalidModel: these change, or weight a setpoint.
    """
    names = [name for name in "PID" if name in letters]
    if node.text("ControllerParametersSource", "internal") == "internal":
        return {name: node.numbers(name, "1" if name in "PI" else "0") for name in names}
    names += ["N"] if "D" in letters and node.text("UseFilter", "on") == "on" else []
    values = {name: flat(reader.input(node, place)) for place, name in enumerate(names, start=2)}
    if both or any(isinstance(one, Form) for gain in values.values() for one in gain):
        raise node.refusal(
            message(
                "simulink.gains_from_inputs",
                "its gains come from inputs, and change or are those of two degrees of freedom",
            )
        )
    return {name: np.array(gain, dtype=float) for name, gain in values.items()}


def _unfiltered(
    node: Node, error: Value, gain: float, parameters: Parameters
) -> tuple[Value, Parameters]:
    """Return what a derivative without a filter adds to a controller, and its parameters: none, or a fast filter."""
    measured = all(term.kind in (*_FOLLOWING, "one", "time") for term in terms_of(error))
    if measured and not {"lower", "upper"} & parameters.keys():
        return gain * rate_of(node, error), {"d": 0.0}
    node.note(
        "approximated",
        message(
            "simulink.derivative_filtered", "its derivative is filtered, by {lag:g} s", lag=LAG
        ),
    )
    return 0.0, {"filter": 1 / LAG}


def _pid_parameters(reader: Tracer, node: Node, letters: str, rate: Vector | None) -> Parameters:
    """Return what a controller has beyond its gains (raises InvalidModel: nothing says its period)."""
    discrete = node.text("TimeDomain", "Continuous-time").startswith("Discrete")
    parameters = _sampled(reader, node) if discrete else {}
    if "D" in letters and (not discrete or node.text("UseFilter", "on") == "on"):
        parameters["filter"] = max(
            node.number("N", "100") if rate is None else float(rate[0]), 1e-3
        )
    for part, name, key in (("I", "Integrator", "integration"), ("D", "Filter", "filtering")):
        if part in letters:
            start = node.number(f"InitialConditionFor{name}", "0")
            parameters |= {f"{key}_initial": start} if start else {}
            method = _METHODS.get(node.text(f"{name}Method", "Forward Euler"), 0.0)
            parameters |= {f"{key}_weight": method} if discrete and method else {}
    parameters |= _limits(node)
    mode = node.text("AntiWindupMode", "none")
    if node.is_on("LimitOutput") and "I" in letters and mode != "none":
        parameters |= {"anti_windup": "clamping"} if mode == "clamping" else {
            "anti_windup": "back_calculation", "back_calculation": node.number("Kb", "1")}  # fmt: skip
    return parameters


DYNAMICS: dict[str, Rule] = {
    "Integrator": _integrator,
    "DiscreteIntegrator": _discrete_integrator,
    "Derivative": lambda reader, node, _: mapped(lambda value: rate_of(node, value), reader.input(node)),
    **dict.fromkeys(
        ("TransferFcn", "ZeroPole", "DiscreteTransferFcn", "DiscreteZeroPole", "DiscreteFilter", "DiscreteFir",
         "Discrete Derivative"), _transfer_function,
    ),
    "Transfer Fcn (with initial outputs)": _begun_transfer_function,
    **dict.fromkeys(("StateSpace", "DiscreteStateSpace"), _state_space),
    "LTI System": _lti,
    **dict.fromkeys(("UnitDelay", "Delay", "Memory"), _delay),
    "ZeroOrderHold": _hold,
    "TransportDelay": _transport_delay,
    "RateLimiter": _rate_limiter,
    **dict.fromkeys(("PID Controller", "PID Controller (2DOF)", "PID 1dof", "PID 2dof"), _pid),
}  # fmt: skip
