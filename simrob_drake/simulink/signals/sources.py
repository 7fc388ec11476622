"""Blocks by their formula or MATLAB code, signals of time, physical signals, and what sensors measure."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.parts.controllers.flow_blocks import FUNCTIONS
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.reading.model_file import SCRIPT
from simrob_drake.simulink.signals.arithmetic import applied, chosen, compared, limited, looked_up
from simrob_drake.simulink.signals.dynamics import blocks, filtered, period_of
from simrob_drake.simulink.signals.forms import (
    MOST_ELEMENTS,
    PARTS,
    TIME,
    Form,
    Rule,
    Signal,
    Term,
    Tracer,
    Value,
    computed,
    early,
    fitted,
    flat,
    mapped,
    of_time,
    signal,
    terms_of,
)
from simrob_drake.simulink.signals.translation import Translation, as_signal
from simrob_drake.simulink.tables import table
from simrob_drake.simulink.values.code import undefined
from simrob_drake.simulink.values.evaluate import UndefinedVariable, matrix
from simrob_drake.simulink.values.syntax import (
    NotUnderstood,
    ScriptFunction,
    Section,
    Statement,
    functions_of,
    lines_of,
    statements,
)

_LATE = 0.02  # how long a filter takes to forget its start where that is told [s]


def _constant(_: Tracer, node: Node, __: int) -> Signal:
    value = node.matrix(node.named("Value", "constant"), "1").astype(object)
    return value.reshape(-1) if 1 in value.shape and node.text("VectorParams1D", "on") == "on" else value


def _repeated(times: Any, values: Any, *, stairs: bool) -> Value:
    """Return a table over time that begins anew at its end."""
    begin, period = float(times[0]), float(times[-1] - times[0])
    turns = (TIME - begin) / period
    phase = begin + period * (turns - applied("floor", turns))
    return _stairs(times, values, phase) if stairs else looked_up(phase, times, values, clip=True)


def _stairs(times: Any, values: Any, time: Value) -> Value:
    """Return a table that holds each value until the next."""
    instants, steps = np.asarray(times, dtype=float), np.diff(np.asarray(times, dtype=float))
    points = np.concatenate([instants[:1], np.column_stack([instants[1:] - 1e-9 * steps, instants[1:]]).reshape(-1)])
    held = np.repeat(np.asarray(values, dtype=float), 2)[:-1]
    return looked_up(time, points, held, clip=True)


def _repeating(_: Tracer, node: Node, __: int) -> Signal:
    if node.kind == "Repeating Sequence":
        times, values = node.numbers("rep_seq_t", "[0 2]"), node.numbers("rep_seq_y", "[0 2]")
    else:
        times, values = node.numbers("TimeValues", "[0 0.1 0.5 0.6 1]"), node.numbers("OutValues", "[3 1 4 2 1]")
    if node.kind == "Repeating Sequence Stair":
        values = np.append(values, values[0])
        times = np.asarray(node.number("tsamp", "1") * np.arange(values.size), dtype=float)
    if times.size != values.size or times.size < 2 or np.any(np.diff(times) < 0) or times[-1] <= times[0]:
        raise node.refusal(f"has {times.size} times for {values.size} values; the times must rise, with as many values")
    return signal([_repeated(_parted(times), values, stairs=node.kind == "Repeating Sequence Stair")])


def _parted(times: Vector) -> Vector:
    """Return times that rise: two values at one time are a jump."""
    return np.asarray(times - 1e-9 * max(times[-1] - times[0], 1e-9) * np.append(np.diff(times) == 0, False))


def _rows_of(structure: dict[str, Any]) -> Vector:
    """Return times and values (t, 1 + n) of a structure with time, or of a time series."""
    times = matrix(structure["time" if "time" in structure else "Time"]).reshape(-1)
    values = matrix(structure["signals"]["values"] if "time" in structure else structure["Data"])
    return np.column_stack([times, values.reshape(times.size, -1)])


def _workspace(_: Tracer, node: Node, __: int) -> Signal:
    value = node.value("VariableName", "[0 0]")
    try:
        rows = _rows_of(value) if isinstance(value, dict) else node.matrix("VariableName", "[0 0]")
    except (NotUnderstood, LookupError, TypeError, ValueError) as problem:
        raise node.refusal(f"needs times and values in its structure: {problem}") from problem
    if rows.shape[1] < 2 or not np.all(np.isfinite(rows)) or np.any(np.diff(rows[:, 0]) < 0):
        raise node.refusal("needs a matrix of times that rise, and values")
    if len(rows) < 2:
        return rows[0, 1:].astype(object)
    times, after = _parted(rows[:, 0]), node.text("OutputAfterFinalValue", "Extrapolation")
    stairs = node.text("Interpolate", "on") == "off"
    found = []
    for column in rows[:, 1:].T:
        if after == "Cyclic repetition":
            value = _repeated(times, column, stairs=stairs)
        elif stairs:
            value = _stairs(times, column, TIME)
        else:
            value = looked_up(TIME, times, column, clip=after != "Extrapolation")
        zero_after = after == "Setting to zero"
        found.append(chosen(compared("<=", TIME, float(times[-1])), value, 0.0) if zero_after else value)
    return signal(found)


def _converter_unit(node: Node, values: Signal) -> float:
    """Return what the converter's unit is in SI, after checking that it fits a joint's signal."""
    text = node.text("Unit", "1")
    if text in ("1", "inherit", ""):
        return 1.0
    terms = [term for value in flat(values) for term in terms_of(value)]
    sensed = {term.kind for term in terms} == {"q"} and node.kind == "PS-Simulink Converter"
    return node.in_si(text, "Unit", ("rad" if getattr(terms[0].of, "turns", True) else "m") if sensed else "")


def out_of_physics(reader: Tracer, node: Node, _: int) -> Signal | None:
    """Return what a PS-Simulink Converter gives."""
    values = reader.physical(node, "lconn", 1)
    return None if values is None else 1.0 / _converter_unit(node, values) * values


def _into_physics(reader: Tracer, node: Node, _: int) -> Signal:
    values = reader.input(node)
    values = np.asarray(_converter_unit(node, values) * values)
    if node.text("FilteringAndDerivatives", "provide") != "filter":
        return values
    lag = node.number("InputFilterTimeConstant", "0.001")
    denominator = [lag, 1.0] if node.text("SimscapeFilterOrder", "1") == "1" else [lag * lag, 2 * lag, 1.0]
    return mapped(lambda value: _settled(node, value, denominator), values)


def _settled(node: Node, value: Value, denominator: list[float]) -> Value:
    """Return what a filter makes of a value: it begins at rest at what this begins with, as Simulink's does."""
    if not isinstance(value, Form):
        return value
    begun = 0.0
    if of_time(value):
        begun = early(value) or 0.0
    elif denominator[-2] > _LATE:
        node.note("approximated", "its filter begins at 0, not at its input")
    return filtered(value - begun, [1.0], denominator) + begun


def _lookup(reader: Tracer, node: Node, _: int) -> Signal:
    points, clip = [node.numbers(name, "[1 2 3]") for name in ("x_t", "y_t")], node.text("extrap_method")
    return mapped(lambda u: looked_up(u, *points, clip=clip not in ("1", "linear")), reader.input(node))


SENSOR = "Transform Sensor"
_FIRST_PORT = 2  # after the follower's frame


def sensed(node: Node) -> dict[int, Callable[[], Signal]]:
    """Return what gives the signals of a Transform Sensor, by the number of their right port."""
    asked = [name for name in table("sensing") if node.is_on(f"Sense{name}")]
    return {port: partial(_measured, node, name, port) for port, name in enumerate(asked, start=_FIRST_PORT)}


def _measured(node: Node, name: str, port: int = 0) -> Signal:
    if (formula := table("sensing")[name]) is None:
        return signal([Form({Term("open", node, (port - 1) * MOST_ELEMENTS): 1.0})])
    parts = {part: matrix(signal([part_of(node, index)])) for index, part in enumerate(PARTS)}
    return as_signal(Translation(parts).value(formula))


def part_of(node: Node, index: int) -> Form:
    """Return a part of what a sensor of the block measures, as ``PARTS`` has them."""
    return Form({Term("sensed", node, index): 1.0})


def orientation(node: Node) -> Signal:
    """Return the rotation matrix (3, 3) of a frame in the model's world, which a sensor of the block measures."""
    return _measured(node, "R")


def _columns(values: Signal) -> Any:
    return values.reshape(-1, 1) if values.ndim == 1 else values


def _matlab_function(reader: Tracer, node: Node, number: int) -> Signal | None:
    """Return an output of a MATLAB Function: of the S-Function in it, whose first output is for order alone."""
    block = node.parent
    code = block.text(SCRIPT) if block is not None else ""
    if block is None or not code:
        return None

    def translated() -> list[Signal]:
        functions = functions_of(code)
        (main, *_) = functions.values()
        inports = (child for child in block.children.values() if child.kind == "Inport")
        ports = {child.block.name: int(child.text("Port", "1") or "1") for child in inports}
        inputs = {name: _columns(reader.input(node, ports[name])) for name in main.inputs if name in ports}
        arguments = [inputs[name] if name in ports else block.workspace.lookup(name) for name in main.inputs]
        files = reader.network.expanded.libraries
        run = Translation({}, undefined, files, functions, period=period_of(reader, block))
        run.note = partial(block.note, "approximated")
        return [as_signal(value) for value in run.called(main.name, arguments)]

    outputs = _understood(block, lambda: reader.once(node, translated))
    return outputs[number - 2] if 0 <= number - 2 < len(outputs) else None


def _understood(node: Node, translate: Callable[[], list[Signal]]) -> list[Signal]:
    try:
        return translate()
    except UndefinedVariable as problem:
        raise node.refusal(f"its code uses {problem.name}, which is not known") from problem
    except (NotUnderstood, ValueError, TypeError, IndexError, KeyError) as problem:
        raise node.refusal(f"its code is not plain arithmetic: {' '.join(str(problem).split())[:120]}") from problem


def condition_on(node: Node, text: str, variables: Mapping[str, Signal]) -> Value:
    """Return whether all of a condition on signals holds, as a value that is not 0.

    Raises InvalidModel: what is not understood.
    """
    run = Translation({name: _columns(values) for name, values in variables.items()}, node.workspace.lookup)
    run.note = partial(node.note, "approximated")
    return flat(_understood(node, lambda: [signal([run._condition(text)])])[0])[0]


_SECTION = re.compile(
    r"(?m)^[ \t]*(?:(component|inputs|outputs|parameters|equations|function)|nodes|variables|branches|components)\b(.*)"
)
_MEMBER = re.compile(r"^[ \t]*(\w+)[ \t]*=[ \t]*\{(.*)\}[^%\n]*(?:%[^\n]*?(?::[ \t]*(left|right))?[ \t]*)?$", re.M)
_QUANTITY = re.compile(r"\{([^{},']*?)[\s,]*'([^']*)'\s*\}")


class Component(NamedTuple):
    """What a file of the language says."""

    inputs: dict[str, tuple[str, int]]  # side and number of each port
    outputs: dict[str, tuple[str, int]]
    parameters: dict[str, str]  # what each is by default
    body: list[Statement]  # private parameters and equations


def component(text: str) -> Component | None:
    """Return what a component computes of physical signals; None of one that has nodes, states or parts."""
    _, *parts = _SECTION.split(text)
    if not parts or None in parts[::3]:
        return None
    found, counts = Component({}, {}, {}, []), {"left": 0, "right": 0}
    for kind, head, lines in zip(parts[::3], parts[1::3], parts[2::3], strict=True):
        if kind == "equations" or "private" in head.lower():
            found.body.extend(statements(lines))
        elif kind == "parameters":
            found.parameters.update({name: f"{{{value}}}" for name, value, _ in _MEMBER.findall(lines)})
        elif kind in ("inputs", "outputs"):
            for name, _, written in _MEMBER.findall(lines):
                side = written or ("left" if kind == "inputs" else "right")
                counts[side] += 1
                getattr(found, kind)[name] = f"{side[0]}conn", counts[side]
    return found


def offer_component(tracer: Tracer, node: Node) -> None:
    """Let a block of a component in the folders give its physical signals."""
    found = component(tracer.network.expanded.libraries.script(node.text("ClassName"), ".ssc"))
    if found is not None:
        tracer.own[node] = partial(_output, found)
        for number, (side, port) in enumerate(found.outputs.values(), start=1):
            tracer.offer(node, port, partial(tracer.output, node, number), side)


def _output(found: Component, reader: Tracer, node: Node, number: int) -> Signal:
    def translated() -> list[Signal]:
        reached = [reader.physical(node, *port) for port in found.inputs.values()]
        known: list[Any] = [_columns(signal([0.0]) if one is None else one) for one in reached]
        for name, default in found.parameters.items():
            known.append(node.matrix(name, _in_si(node, default)) * node.in_si(node.text(f"{name}_unit", "1"), name))
        body = [_assigned(node, line) for line in found.body if not next(lines_of(line)).startswith("assert")]
        law = ScriptFunction("law", [*found.inputs, *found.parameters], [*found.outputs], body)
        run = Translation({}, undefined, reader.network.expanded.libraries, {"law": law})
        run.note = partial(node.note, "approximated")
        return [as_signal(value) for value in run.called("law", known)]

    return _understood(node, lambda: reader.once(node, translated))[number - 1]


def _in_si(node: Node, text: str) -> str:
    """Return text with quantities such as ``{2, 'cm'}`` as numbers in SI."""
    return _QUANTITY.sub(lambda one: f"(({one[1]})*{node.in_si(one[2], 'unit'):.17g})", text)


def _assigned(node: Node, line: Statement) -> Statement:
    """Return a statement whose equations are assignments."""
    if isinstance(line, str):
        return re.sub(r"^(\w+)\s*==", r"\1 =", _in_si(node, line))
    return Section(line.keyword, [(_in_si(node, head), [_assigned(node, one) for one in body])
                                  for head, body in line.parts])  # fmt: skip


_OF_C = {"sgn": "sign", "ln": "log", "fabs": "abs", "pow": "power"}  # functions that a Fcn has in place of MATLAB's
_BARE = re.compile(r"\bu\b(?!\s*\()")  # the input of a Fcn without an index: its first element


def _expression(reader: Tracer, node: Node, _: int) -> Signal | None:
    """Return an expression of the input ``u``, of a Fcn or Interpreted MATLAB Function."""
    text = node.text("Expr", node.text("Expression", node.text("MATLABFcn", "")))
    values = reader.input(node)
    if node.kind == "Fcn":
        text = _BARE.sub("u(1)", text.replace("[", "(").replace("]", ")"))
        text = re.sub(r"\b(sgn|ln|fabs|pow)\b", lambda found: _OF_C[found[1]], text)
    run = Translation({"u": _columns(values)}, node.workspace.lookup, reader.network.expanded.libraries)
    run.note = partial(node.note, "approximated")
    if text in FUNCTIONS or (text.isidentifier() and run.find(text)):
        text = f"{text}(u)"
    return _understood(node, lambda: [as_signal(run.value(text))])[0] if text else None


_BLOCKS: dict[str, Callable[..., Value]] = {
    **{kind: partial(limited, kind=kind) for kind in ("saturation", "dead_zone")},
    "choose": chosen,
    "step": lambda time, before, after: computed("step", time=float(time), before=float(before), after=float(after)),
}
"""Functions of formulas that are blocks of a flow."""


_CHOICE = re.compile(r"\{(\w+)(?: or (\w+))?:(.+?)\}")


def _formula(reader: Tracer, node: Node, _: int) -> Signal | None:
    """Return what a block computes by its formula; None where that has no such choice."""
    row = dict(table("formulas")[node.kind])
    text, choices = row.pop("is"), row.pop("choices", None)
    while choice := _CHOICE.search(text):
        taken = node.text(choice[1], node.text(choice[2] or "")) or choice[3]
        if (taken := taken if choices is None else choices.get(taken.lower().rpartition(".")[2], "")) == "":
            return None
        text = text[: choice.start()] + taken + text[choice.end() :]
    if note := row.pop("note", ""):
        node.note("approximated", note)
    words = set(re.findall(r"[A-Za-z]\w*", text))
    values = {name: reader.input(node, place) for place, name in enumerate("uvw", start=1) if name in words}
    if "t" in words:
        values["t"] = reader.input(node) if node.text("TimeSource").startswith("Use external") else signal([TIME])
    values |= {name: _parameter(node, default, others or [name]) for name, (default, *others) in row.items()}
    columns = map(_columns, fitted(node, *values.values()))
    run = Translation(dict(zip(values, columns, strict=True)), own=_BLOCKS)
    return _understood(node, lambda: [as_signal(run.value(text))])[0]


def _parameter(node: Node, default: str, names: list[str]) -> Signal:
    name = node.named(*names)
    unit = node.text(f"{name}_unit", "1")
    factor = node.in_si(unit, name) * (2 * np.pi if "Hz" in unit else 1.0)  # in sines
    return (node.matrix(name, default) * factor).reshape(-1, order="F").astype(object)


_FORMULAS: dict[str, Rule] = dict.fromkeys(table("formulas"), _formula)
SOURCES: dict[str, Rule] = {
    **_FORMULAS,
    "S-Function": _matlab_function,
    **dict.fromkeys(("Fcn", "MATLABFcn"), _expression),
    "Constant": _constant,
    "Ground": lambda *_: signal([0.0]),
    **dict.fromkeys(("Repeating Sequence", "Repeating Sequence Interpolated", "Repeating Sequence Stair"), _repeating),
    "FromWorkspace": _workspace,
}
PHYSICAL: dict[str, Rule] = {
    "Simulink-PS Converter": _into_physics,
    **{kind: rule for kind, rule in _FORMULAS.items() if kind.startswith("PS ")},
    "PS Lookup Table (1D)": _lookup,
    "PS Integrator": lambda reader, node, _: blocks(reader, node, "integrator", {"initial": node.quantity("x0", "x")}),
}
"""What blocks give at their right port 1, by type."""
