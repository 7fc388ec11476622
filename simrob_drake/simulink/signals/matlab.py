"""MATLAB code of blocks, and equations of components, as blocks of a signal flow, where these are plain arithmetic."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.parts.controllers.flow_blocks import FUNCTIONS
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.reading.model_file import SCRIPT
from simrob_drake.simulink.signals.arithmetic import chosen, limited
from simrob_drake.simulink.signals.dynamics import period_of
from simrob_drake.simulink.signals.forms import TIME, Signal, Value, computed, fitted, flat, signal
from simrob_drake.simulink.signals.tracing import Rule, Tracer
from simrob_drake.simulink.signals.translation import Translation, as_signal
from simrob_drake.simulink.tables import table
from simrob_drake.simulink.values.code import undefined
from simrob_drake.simulink.values.evaluate import UndefinedVariable
from simrob_drake.simulink.values.mat import Files
from simrob_drake.simulink.values.syntax import (
    NotUnderstood,
    ScriptFunction,
    Section,
    Statement,
    functions_of,
    lines_of,
    statements,
)


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
        inports = [child for child in block.children.values() if child.kind == "Inport"]
        ports = {child.block.name: int(child.text("Port", "1") or "1") for child in inports}
        arguments = [
            _columns(reader.input(node, ports[name])) if name in ports else block.workspace.lookup(name)
            for name in main.inputs
        ]
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

    Raises:
        InvalidModel: what is not _understood.
    """
    run = _over(node, variables)
    return flat(_understood(node, lambda: [signal([run._condition(text)])])[0])[0]


def _over(node: Node, variables: Mapping[str, Signal], files: Files | None = None) -> Translation:
    known = {name: _columns(values) for name, values in variables.items()}
    run = Translation(known, node.workspace.lookup, files)
    run.note = partial(node.note, "approximated")
    return run


_BARE = re.compile(r"\bu\b(?!\s*\()")  # the input of a Fcn without an index: its first element
_OF_C = {"sgn": "sign", "ln": "log", "fabs": "abs", "pow": "power"}  # functions that a Fcn has in place of MATLAB's


def _expression(reader: Tracer, node: Node, _: int) -> Signal | None:
    """Return an expression of the input ``u``, of a Fcn or Interpreted MATLAB Function."""
    text = node.text("Expr", node.text("Expression", node.text("MATLABFcn", "")))
    values = reader.input(node)
    if node.kind == "Fcn":
        text = _BARE.sub("u(1)", text.replace("[", "(").replace("]", ")"))
        text = re.sub(r"\b(sgn|ln|fabs|pow)\b", lambda found: _OF_C[found[1]], text)
    run = _over(node, {"u": values}, reader.network.expanded.libraries)
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
    name = next((one for one in names if one in node.block.parameters), names[0])
    unit = node.text(f"{name}_unit", "1")
    factor = node.in_si(unit, name) * (2 * np.pi if "Hz" in unit else 1.0)  # in sines
    return (node.matrix(name, default) * factor).reshape(-1, order="F").astype(object)


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


FORMULAS: dict[str, Rule] = dict.fromkeys(table("formulas"), _formula)
MATLAB: dict[str, Rule] = {
    **FORMULAS,
    "S-Function": _matlab_function,
    **dict.fromkeys(("Fcn", "MATLABFcn"), _expression),
}
