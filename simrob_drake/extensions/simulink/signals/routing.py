"""Blocks that hand signals on: ports, vectors, matrices, buses, choices, and subsystems that run under a condition."""

from __future__ import annotations

import math
import re
from functools import partial
from typing import Any

import numpy as np

from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.reading.graph import ELEMENT
from simrob_drake.extensions.simulink.signals.arithmetic import (
    MOST_INPUTS,
    chosen,
    compared,
    inputs_of,
    joined,
    switched,
)
from simrob_drake.extensions.simulink.signals.code import condition_on
from simrob_drake.extensions.simulink.signals.forms import (
    MOST_ELEMENTS,
    Form,
    Rule,
    Signal,
    Term,
    Tracer,
    Value,
    fitted,
    flat,
    mapped,
    signal,
    widened,
)
from simrob_drake.extensions.simulink.values.evaluate import matrix

_BETWEEN = re.compile(
    r",(?![^\[]*\])"
)  # the commas between the indices of a matrix, and not those within brackets


def _inport(reader: Tracer, node: Node, _: int) -> Signal:
    bus = reader.network.bus_of(node)
    if bus is not None:
        return _of_bus(reader, node, bus, [node.text(ELEMENT)])
    size = int(abs(np.prod(node.numbers("PortDimensions", "-1"))))  # 1 of none
    return signal(
        Form({Term("input", node, index): 1.0}) for index in range(max(1, min(size, MOST_ELEMENTS)))
    )


def _concatenated(reader: Tracer, node: Node, _: int) -> Signal:
    parts = inputs_of(reader, node)
    if node.text("Mode", "Vector") == "Vector" and all(part.ndim == 1 for part in parts):
        return np.concatenate(parts)
    axis = 1 if node.text("ConcatenateDimension", "1") == "2" else 0
    columns = [part.reshape(-1, 1) if part.ndim == 1 else part for part in parts]
    if len({part.shape[1 - axis] for part in columns}) > 1:
        raise node.refusal(
            message(
                "simulink.shapes_do_not_fit",
                "its inputs have shapes {shapes}: they do not fit",
                shapes=", ".join(str(part.shape) for part in columns),
            )
        )
    return np.concatenate(columns, axis=axis)


def _demux(reader: Tracer, node: Node, number: int) -> Signal:
    sizes, values = node.numbers("Outputs", "2"), reader.input(node).ravel(order="F")
    if sizes.size == 1:
        count = int(sizes[0])
        values = widened(values, count)
        width, rest = divmod(len(values), count)
        if not width:
            raise node.refusal(
                message(
                    "simulink.splits_signal",
                    "splits a signal of {size} elements in {count}",
                    size=len(values),
                    count=count,
                )
            )
        parts = _muxed(reader, reader.network.source(node)) if rest else []
        even = [width + 1] * rest + [width] * (count - rest)
        sizes = np.array(parts if len(parts) == count and sum(parts) == len(values) else even)
    if number > sizes.size:
        raise node.refusal(message("simulink.no_output", "has no output {number}", number=number))
    if np.any(sizes < 0):
        sizes = np.where(sizes < 0, max(len(values) - sizes[sizes > 0].sum(), 1), sizes)
    values = widened(values, int(sizes.sum()))
    start = int(sizes[: number - 1].sum())
    taken = values[start : start + int(sizes[number - 1])]
    return taken if len(taken) else signal([0.0])


def _muxed(reader: Tracer, source: tuple[Node, int] | None) -> list[int]:
    """Return the widths of what makes up a signal, also behind a choice; Simulink finds them from both its ends."""
    while source is not None:
        node = source[0]
        if node.kind == "Mux":
            return [part.size for part in inputs_of(reader, node)]
        if node.kind == "Merge":
            ways = (_muxed(reader, way) for way in reader.network.sources(node))
            return next(filter(None, ways), [])
        source = reader.network.inside(*source) if node.children else None
    return []


def _selector(reader: Tracer, node: Node, _: int) -> Signal | None:
    values = reader.input(node)
    first = 1 if node.text("IndexMode", "One-based") == "One-based" else 0
    if node.text("NumberOfDimensions", "1") == "1":
        places = (
            node.numbers("Indices", node.text("IndexParamArray", "1") or "1").astype(int) - first
        )
        values = widened(values.ravel(order="F"), int(places.max(initial=0)) + 1)
        if places.size and places.max() >= len(values):
            raise node.refusal(
                message(
                    "simulink.selects_element",
                    "selects element {element} of a signal of {size}",
                    element=places.max() + first,
                    size=len(values),
                )
            )
        return None if not places.size or np.any(places < 0) else values[places]
    options, parts = node.text("IndexOptions").split(","), _BETWEEN.split(node.text("Indices"))
    if values.ndim != 2 or len(parts) != 2:
        return None
    taken = []
    for size, option, part in zip(values.shape, [*options, "", ""], parts, strict=False):
        try:
            whole = "all" in option.lower()
            own: Any = (
                range(size)
                if whole
                else matrix(node.workspace.value(part)).astype(int).reshape(-1) - first
            )
        except (LookupError, ValueError, TypeError):
            return None
        if any(not 0 <= index < size for index in own):
            return None
        taken.append(own)
    return np.asarray(values[np.ix_(*taken)], dtype=object)


def _reshape(reader: Tracer, node: Node, _: int) -> Signal:
    values, mode = reader.input(node), node.text("OutputDimensionality", "1-D array")
    column, row = mode.startswith("Column"), mode.startswith("Row")
    shape: tuple[int, ...] = (
        (values.size, 1) if column else (1, values.size) if row else (values.size,)
    )
    if mode.startswith("Customize"):
        shape = tuple(map(int, node.numbers("OutputDimensions", "[1,1]")))
    values = widened(values.ravel(order="F"), math.prod(shape))
    if math.prod(shape) != values.size:
        raise node.refusal(
            message(
                "simulink.reshapes_signal",
                "makes {shape} of a signal of {size} elements",
                shape=shape,
                size=values.size,
            )
        )
    return values.reshape(shape, order="F")


def _bus_selector(reader: Tracer, node: Node, number: int) -> Signal | None:
    names = [name.strip() for name in node.text("OutputSignals").split(",")]
    asked = names if node.is_on("OutputAsBus") else names[number - 1 : number]
    return _of_bus(reader, node, reader.network.source(node), asked)


def _of_bus(reader: Tracer, node: Node, bus: tuple[Node, int] | None, names: list[str]) -> Signal:
    """Return the signals of a bus that a block asks for by their names; raises InvalidModel: one that is not there."""
    sources = {name: _selected(reader, bus, name) for name in names}
    for name, source in sources.items():
        if source is None:
            raise node.refusal(
                message(
                    "simulink.signal_of_bus", "the signal {name} of its bus is not found", name=name
                )
            )
    return signal(
        value
        for source in sources.values()
        if source is not None
        for value in flat(reader.output(*source))
    )


def _selected(reader: Tracer, bus: tuple[Node, int] | None, names: str) -> tuple[Node, int] | None:
    """Return what feeds a bus under a name, ``outer.inner`` of a bus in a bus."""
    name, _, rest = names.partition(".")
    while bus is not None and name:
        if (whole := _elements(reader, *bus).get(f"{name}.{rest}")) is not None:
            return reader.network.source(whole)
        bus = _in_bus(reader, *bus, name)
        name, _, rest = rest.partition(".")
    return bus


def _elements(reader: Tracer, node: Node, output: int) -> dict[str, Node]:
    """Return the port blocks that are the signals of a subsystem's bus; raises InvalidModel: it runs on a condition."""
    found = reader.network.elements(node, output)
    if found and reader.network.is_conditional(node):
        raise node.refusal(
            message("simulink.conditional_bus", "a bus that is made under a condition is not read")
        )
    return found


def _in_bus(reader: Tracer, bus: Node, output: int, name: str) -> tuple[Node, int] | None:
    """Return what feeds a bus under a name: its input's own, its line's, or ``signal3`` for the third."""
    network = reader.network
    if bus.kind in ("BusSelector", "Inport"):
        names = (
            bus.text("OutputSignals").split(",")
            if bus.kind == "BusSelector"
            else [bus.text(ELEMENT)] * output
        )
        outer = network.source(bus) if bus.kind == "BusSelector" else network.bus_of(bus)
        return (
            _selected(reader, outer, f"{names[output - 1].strip()}.{name}")
            if len(names) >= output
            else None
        )
    if (element := _elements(reader, bus, output).get(name)) is not None:
        return network.source(element)
    assigned = (
        [part.strip() for part in bus.text("AssignedSignals").split(",")]
        if bus.kind == "BusAssignment"
        else []
    )
    if name in assigned:
        return network.source(bus, 2 + assigned.index(name))
    if bus.kind in PASSING or bus.kind == "BusAssignment":
        source = network.source(bus)
        return None if source is None else _in_bus(reader, *source, name)
    text = bus.text("Inputs", "2")
    named = [part.strip(" '") for part in text.split(",")] if "," in text else []
    count = len(named) or (int(text) if text.isdecimal() else 1)
    for place in range(1, min(count, MOST_INPUTS) + 1) if bus.kind == "BusCreator" else ():
        own = named[place - 1] if named else network.signal_name(bus, place)
        if name in (own.strip("<>"), f"signal{place}"):
            return network.source(bus, place)
    return None


def _stored(reader: Tracer, node: Node, number: int) -> Signal | None:
    """Return what is written to a data store or an element of it, or what it begins with where nothing writes."""
    name = node.text("DataStoreName", "A")
    same = [one for one in reader.network.expanded.nodes if one.text("DataStoreName", "A") == name]
    asked = _elements_of(node)[number - 1]
    written = [(one, element, place) for one in same if one.kind == "DataStoreWrite" for place, element in
               enumerate(_elements_of(one), start=1) if f"{asked}.".startswith(f"{element}.")
               or element.startswith(f"{asked}.")]  # fmt: skip
    if [element for _, element, _ in written] == [asked]:
        node.note(
            "approximated",
            message(
                "simulink.data_store",
                "the data store {asked} holds what is written at that time",
                asked=asked,
            ),
        )
        return reader.input(written[0][0], written[0][2])
    memory = next((one for one in same if one.kind == "DataStoreMemory"), None)
    if written or memory is None:
        return None
    value = memory.value("InitialValue", "0")
    for field in asked.split(".")[1:]:
        value = value.get(field) if isinstance(value, dict) else None
    return (
        None
        if value is None or isinstance(value, dict)
        else signal(map(float, matrix(value).ravel(order="F")))
    )


def _elements_of(node: Node) -> list[str]:
    """Return what a block reads or writes of a data store, by port."""
    return (node.text("DataStoreElements") or node.text("DataStoreName", "A")).split("#")


def _multiport_switch(reader: Tracer, node: Node, _: int) -> Signal | None:
    if node.text("DataPortOrder", "One-based contiguous") not in (
        "One-based contiguous",
        "Zero-based contiguous",
    ):
        return None
    first = 0 if node.text("DataPortOrder", "One").startswith("Zero") else 1
    choices = [
        reader.input(node, 2 + place)
        for place in range(min(int(node.number("Inputs", "3")), MOST_INPUTS))
    ]
    found, index = choices[-1], reader.input(node)
    for place in reversed(range(len(choices) - 1)):
        found = switched(node, choices[place], index, found, "<=", place + first)
    return found


PASSING = {
    "SignalConversion", "SignalSpecification", "DataTypeConversion", "RateTransition", "UnitConversion", "BusToVector",
    "Width Conversion", "IC", "Signal Copy",
}  # fmt: skip
"""Blocks whose output is their input."""

ROUTING: dict[str, Rule] = {
    **dict.fromkeys((*PASSING, "BusAssignment"), lambda reader, node, _: reader.input(node)),
    **dict.fromkeys(("Inport", "InportShadow"), _inport),
    **dict.fromkeys(
        ("Mux", "BusCreator"),
        lambda reader, node, _: signal(
            value for part in inputs_of(reader, node) for value in flat(part)
        ),
    ),
    "Concatenate": _concatenated,
    "Demux": _demux,
    "Selector": _selector,
    "Reshape": _reshape,
    "BusSelector": _bus_selector,
    "ManualSwitch": lambda reader, node, _: reader.input(
        node, 1 if node.text("sw", "1") == "1" else 2
    ),
    "MultiPortSwitch": _multiport_switch,
    "DataStoreRead": _stored,
}


_MOST_WAYS = 100


def _conditional(reader: Tracer, node: Node, number: int) -> Signal | None:
    """Return an output of a subsystem: what is in it while its condition holds, else what its output begins with."""
    condition, inside = _condition(reader, node), reader.network.inside(node, number)
    if inside is None or condition is None:
        return None
    values, port = reader.output(*inside), reader.network.outport(node, number)
    start = (
        port.numbers("InitialOutput", "0")
        if port is not None and port.text("InitialOutput") != "[]"
        else None
    )
    other = signal(
        [0.0] if start is None or start.size not in (1, values.size) else map(float, start)
    )
    if port is not None and port.text("OutputWhenDisabled", "held") == "held":
        text = message(
            "simulink.condition_fails",
            "while its condition fails its outputs are what they begin with, and not held; its states go on",
        )
        node.note("approximated", text)
    return mapped(partial(chosen, condition), *fitted(node, values, other))


def _condition(reader: Tracer, node: Node) -> Value | None:
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
    earlier = [
        joined("not", test) if isinstance(test, Form) else float(not test)
        for test in tests[: way - 1]
    ]
    parts = [*earlier, *tests[way - 1 :]]
    return parts[0] if len(parts) == 1 else joined("and", *parts)


def _merge(reader: Tracer, node: Node, _: int) -> Signal | None:
    """Return what the subsystem gives that runs; the last one where none does."""
    merged: Signal | None = None
    for place in range(1, min(int(node.number("Inputs", "2")), _MOST_WAYS) + 1):
        if (source := reader.network.source(node, place)) is None:
            return None
        condition, inside = _condition(reader, source[0]), reader.network.inside(*source)
        if condition is None or inside is None:
            return None
        values = reader.output(*inside)
        merged = (
            values
            if merged is None
            else mapped(partial(chosen, condition), *fitted(node, values, merged))
        )
    return merged


def subsystem(reader: Tracer, node: Node, number: int) -> Signal | None:
    """Return an output of a subsystem that runs under a condition, or that is a bus of its own making."""
    if ports := _elements(reader, node, number).values():
        return signal(value for port in ports for value in flat(reader.input(port)))
    return _conditional(reader, node, number) if reader.network.is_conditional(node) else None


ROUTING["Merge"] = _merge
