"""Subsystems that run under a condition (If Action, Enabled), and what Merge takes of them."""

from __future__ import annotations

from functools import partial

from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.arithmetic import chosen, compared, inputs_of, joined
from simrob_drake.simulink.signals.forms import Form, Rule, Signal, SignalReader, Value, fitted, flat, mapped, signal
from simrob_drake.simulink.signals.matlab import condition_on

_MOST_WAYS = 100


def conditional(reader: SignalReader, node: Node, number: int) -> Signal | None:
    """Return an output of a subsystem: what is in it while its condition holds, else what its output begins with."""
    condition, inside = _condition(reader, node), reader.network.inside(node, number)
    if inside is None or condition is None:
        return None
    values, port = reader.output(*inside), reader.network.outport(node, number)
    start = port.numbers("InitialOutput", "0") if port is not None and port.text("InitialOutput") != "[]" else None
    if start is None or start.size not in (1, values.size):
        other = signal([0.0])
    else:
        other = signal(float(one) for one in start)
    if port is not None and port.text("OutputWhenDisabled", "held") == "held":
        message = "while its condition fails its outputs are what they begin with, and not held; its states go on"
        node.findings.report.add("approximated", node.path, message)
    return mapped(partial(chosen, condition), *fitted(node, values, other))


def _condition(reader: SignalReader, node: Node) -> Value | None:
    """Return whether a subsystem runs, as a value that is not 0; None where that is not understood."""
    enabled = reader.network.source(node, 1, "enable")
    if enabled is not None:
        return joined("or", *(compared(">", value, 0.0) for value in flat(reader.output(*enabled))))
    action = reader.network.source(node, 1, "ifaction")
    if action is None or action[0].kind != "If":
        return None
    block, way = action
    texts = [block.text("IfExpression", "u1 > 0")]
    texts += [text.strip() for text in block.text("ElseIfExpressions").split(",") if text.strip()]
    inputs = {f"u{place}": one for place, one in enumerate(inputs_of(reader, block, "1"), start=1)}
    tests = [condition_on(block, text, inputs) for text in texts[: min(way, _MOST_WAYS)]]
    earlier = [joined("not", test) if isinstance(test, Form) else float(not test) for test in tests[: way - 1]]
    parts = [*earlier, *tests[way - 1 :]]
    return parts[0] if len(parts) == 1 else joined("and", *parts)


def _merge(reader: SignalReader, node: Node, _: int) -> Signal | None:
    """Return what the subsystem gives that runs; the last one where none does."""
    merged: Signal | None = None
    for place in range(1, min(int(node.number("Inputs", "2")), _MOST_WAYS) + 1):
        source = reader.network.source(node, place)
        condition = None if source is None else _condition(reader, source[0])
        inside = None if source is None else reader.network.inside(*source)
        if condition is None or inside is None:
            return None
        values = reader.output(*inside)
        merged = values if merged is None else mapped(partial(chosen, condition), *fitted(node, values, merged))
    return merged


CONDITIONAL: dict[str, Rule] = {"Merge": _merge}
