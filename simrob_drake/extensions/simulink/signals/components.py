"""Components of the Simscape language that compute physical signals, from their files, as blocks of a signal flow."""

from __future__ import annotations

import re
from functools import partial
from typing import Any, NamedTuple

from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.signals.code import columned, understood
from simrob_drake.extensions.simulink.signals.forms import Signal, Tracer, signal
from simrob_drake.extensions.simulink.signals.translation import Translation, as_signal
from simrob_drake.extensions.simulink.values.code import undefined
from simrob_drake.extensions.simulink.values.syntax import (
    ScriptFunction,
    Section,
    Statement,
    lines_of,
    statements,
)

_SECTION = re.compile(
    r"(?m)^[ \t]*(?:(component|inputs|outputs|parameters|equations|function)|nodes|variables|branches|components)\b(.*)"
)
_MEMBER = re.compile(
    r"^[ \t]*(\w+)[ \t]*=[ \t]*\{(.*)\}[^%\n]*(?:%[^\n]*?(?::[ \t]*(left|right))?[ \t]*)?$", re.M
)
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
            found.parameters.update(
                {name: f"{{{value}}}" for name, value, _ in _MEMBER.findall(lines)}
            )
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
        known: list[Any] = [columned(signal([0.0]) if one is None else one) for one in reached]
        for name, default in found.parameters.items():
            known.append(
                node.matrix(name, _in_si(node, default))
                * node.in_si(node.text(f"{name}_unit", "1"), name)
            )
        body = [
            _assigned(node, line)
            for line in found.body
            if not next(lines_of(line)).startswith("assert")
        ]
        law = ScriptFunction("law", [*found.inputs, *found.parameters], [*found.outputs], body)
        files, note = reader.network.expanded.libraries, partial(node.note, "approximated")
        run = Translation({}, undefined, files, {"law": law}, note=note)
        return [as_signal(value) for value in run.called("law", known)]

    return understood(node, lambda: reader.once(node, translated))[number - 1]


def _in_si(node: Node, text: str) -> str:
    """Return text with quantities such as ``{2, 'cm'}`` as numbers in SI."""
    return _QUANTITY.sub(lambda one: f"(({one[1]})*{node.in_si(one[2], 'unit'):.17g})", text)


def _assigned(node: Node, line: Statement) -> Statement:
    """Return a statement whose equations are assignments."""
    if isinstance(line, str):
        return re.sub(r"^(\w+)\s*==", r"\1 =", _in_si(node, line))
    return Section(line.keyword, [(_in_si(node, head), [_assigned(node, one) for one in body])
                                  for head, body in line.parts])  # fmt: skip
