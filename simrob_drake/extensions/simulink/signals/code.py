"""Blocks by their formula or MATLAB code, where it is plain arithmetic, as blocks of a signal flow: nothing is run."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.reading.model_file import SCRIPT
from simrob_drake.extensions.simulink.signals.arithmetic import chosen, limited
from simrob_drake.extensions.simulink.signals.dynamics import period_of
from simrob_drake.extensions.simulink.signals.forms import (
    TIME,
    Rule,
    Signal,
    Tracer,
    Value,
    computed,
    fitted,
    flat,
    signal,
)
from simrob_drake.extensions.simulink.signals.translation import Translation, as_signal
from simrob_drake.extensions.simulink.tables import table
from simrob_drake.extensions.simulink.values.code import undefined
from simrob_drake.extensions.simulink.values.evaluate import UndefinedVariable
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood, functions_of
from simrob_drake.parts.controllers.flow_blocks import FUNCTIONS


def columned(values: Signal) -> Any:
    """Return a signal as code has it: a vector is a column."""
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
        inputs = {
            name: columned(reader.input(node, ports[name])) for name in main.inputs if name in ports
        }
        arguments = [
            inputs[name] if name in ports else block.workspace.lookup(name) for name in main.inputs
        ]
        files = reader.network.expanded.libraries
        note = partial(block.note, "approximated")
        run = Translation(
            {}, undefined, files, functions, period=period_of(reader, block), note=note
        )
        return [as_signal(value) for value in run.called(main.name, arguments)]

    outputs = understood(block, lambda: reader.once(node, translated))
    return outputs[number - 2] if 0 <= number - 2 < len(outputs) else None


def understood(node: Node, translate: Callable[[], list[Signal]]) -> list[Signal]:
    """Return what code is translated to; raises InvalidModel: it is not plain arithmetic, or not known."""
    try:
        return translate()
    except UndefinedVariable as problem:
        raise node.refusal(
            message(
                "simulink.code_uses_unknown",
                "its code uses {name}, which is not known",
                name=problem.name,
            )
        ) from problem
    except (NotUnderstood, ValueError, TypeError, IndexError, KeyError) as problem:
        raise node.refusal(
            message(
                "simulink.code_not_plain",
                "its code is not plain arithmetic: {problem}",
                problem=" ".join(str(problem).split())[:120],
            )
        ) from problem


def condition_on(node: Node, text: str, variables: Mapping[str, Signal]) -> Value:
    """Return whether all of a condition on signals holds, as a value that is not 0.

    Raises InvalidModel: what is not understood.
    """
    known, note = (
        {name: columned(values) for name, values in variables.items()},
        partial(node.note, "approximated"),
    )
    run = Translation(known, node.workspace.lookup, note=note)
    return flat(understood(node, lambda: [signal([run._condition(text)])])[0])[0]


_OF_C = {
    "sgn": "sign",
    "ln": "log",
    "fabs": "abs",
    "pow": "power",
}  # functions that a Fcn has in place of MATLAB's
_BARE = re.compile(r"\bu\b(?!\s*\()")  # the input of a Fcn without an index: its first element


def _expression(reader: Tracer, node: Node, _: int) -> Signal | None:
    """Return an expression of the input ``u``, of a Fcn or Interpreted MATLAB Function."""
    text = node.text("Expr", node.text("Expression", node.text("MATLABFcn", "")))
    values = reader.input(node)
    if node.kind == "Fcn":
        text = _BARE.sub("u(1)", text.replace("[", "(").replace("]", ")"))
        text = re.sub(r"\b(sgn|ln|fabs|pow)\b", lambda found: _OF_C[found[1]], text)
    known, files = {"u": columned(values)}, reader.network.expanded.libraries
    run = Translation(known, node.workspace.lookup, files, note=partial(node.note, "approximated"))
    if text in FUNCTIONS or (text.isidentifier() and run.find(text)):
        text = f"{text}(u)"
    return understood(node, lambda: [as_signal(run.value(text))])[0] if text else None


_BLOCKS: dict[str, Callable[..., Value]] = {
    **{kind: partial(limited, kind=kind) for kind in ("saturation", "dead_zone")},
    "choose": chosen,
    "step": lambda time, before, after: computed(
        "step", time=float(time), before=float(before), after=float(after)
    ),
}
"""Functions of formulas that are blocks of a flow."""


_NOTES = {
    "zero": message("simulink.noise_is_zero", "its noise is left out: it is 0, its mean"),
    "mean": message("simulink.noise_is_mean", "its noise is left out: it is its mean"),
}
"""Notes of the table of formulas: in what the formula differs from the block."""

_CHOICE = re.compile(r"\{(\w+)(?: or (\w+))?:(.+?)\}")


def _formula(reader: Tracer, node: Node, _: int) -> Signal | None:
    """Return what a block computes by its formula; None where that has no such choice."""
    row = dict(table("formulas")[node.kind])
    text, choices = row.pop("is"), row.pop("choices", None)
    while choice := _CHOICE.search(text):
        taken = node.text(choice[1], node.text(choice[2] or "")) or choice[3]
        if (
            taken := taken if choices is None else choices.get(taken.lower().rpartition(".")[2], "")
        ) == "":
            return None
        text = text[: choice.start()] + taken + text[choice.end() :]
    if note := row.pop("note", ""):
        node.note("approximated", _NOTES[note])
    words = set(re.findall(r"[A-Za-z]\w*", text))
    values = {
        name: reader.input(node, place)
        for place, name in enumerate("uvw", start=1)
        if name in words
    }
    if "t" in words:
        values["t"] = (
            reader.input(node)
            if node.text("TimeSource").startswith("Use external")
            else signal([TIME])
        )
    values |= {
        name: _parameter(node, default, others or [name])
        for name, (default, *others) in row.items()
    }
    columns = map(columned, fitted(node, *values.values()))
    run = Translation(dict(zip(values, columns, strict=True)), own=_BLOCKS)
    return understood(node, lambda: [as_signal(run.value(text))])[0]


def _parameter(node: Node, default: str, names: list[str]) -> Signal:
    name = node.named(*names)
    unit = node.text(f"{name}_unit", "1")
    factor = node.in_si(unit, name) * (2 * np.pi if "Hz" in unit else 1.0)  # in sines
    return (node.matrix(name, default) * factor).reshape(-1, order="F").astype(object)


FORMULAS: dict[str, Rule] = dict.fromkeys(table("formulas"), _formula)
CODE: dict[str, Rule] = {
    **FORMULAS,
    "S-Function": _matlab_function,
    **dict.fromkeys(("Fcn", "MATLABFcn"), _expression),
}
