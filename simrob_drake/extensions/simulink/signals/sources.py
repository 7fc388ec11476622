"""Signals of time, physical signals, and what sensors measure."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.signals.arithmetic import applied, chosen, compared, looked_up
from simrob_drake.extensions.simulink.signals.code import FORMULAS
from simrob_drake.extensions.simulink.signals.dynamics import blocks, filtered
from simrob_drake.extensions.simulink.signals.forms import (
    MOST_ELEMENTS,
    PARTS,
    TIME,
    Form,
    Rule,
    Signal,
    Term,
    Tracer,
    Value,
    early,
    flat,
    mapped,
    of_time,
    signal,
    terms_of,
)
from simrob_drake.extensions.simulink.signals.translation import Translation, as_signal
from simrob_drake.extensions.simulink.tables import table
from simrob_drake.extensions.simulink.values.evaluate import matrix
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood

_LATE = 0.02  # how long a filter takes to forget its start where that is told [s]


def _constant(_: Tracer, node: Node, __: int) -> Signal:
    value = node.matrix(node.named("Value", "constant"), "1").astype(object)
    return (
        value.reshape(-1)
        if 1 in value.shape and node.text("VectorParams1D", "on") == "on"
        else value
    )


def _repeated(times: Any, values: Any, *, stairs: bool) -> Value:
    """Return a table over time that begins anew at its end."""
    begin, period = float(times[0]), float(times[-1] - times[0])
    turns = (TIME - begin) / period
    phase = begin + period * (turns - applied("floor", turns))
    return _stairs(times, values, phase) if stairs else looked_up(phase, times, values, clip=True)


def _stairs(times: Any, values: Any, time: Value) -> Value:
    """Return a table that holds each value until the next."""
    instants, steps = np.asarray(times, dtype=float), np.diff(np.asarray(times, dtype=float))
    points = np.concatenate(
        [instants[:1], np.column_stack([instants[1:] - 1e-9 * steps, instants[1:]]).reshape(-1)]
    )
    held = np.repeat(np.asarray(values, dtype=float), 2)[:-1]
    return looked_up(time, points, held, clip=True)


def _repeating(_: Tracer, node: Node, __: int) -> Signal:
    if node.kind == "Repeating Sequence":
        times, values = node.numbers("rep_seq_t", "[0 2]"), node.numbers("rep_seq_y", "[0 2]")
    else:
        times, values = (
            node.numbers("TimeValues", "[0 0.1 0.5 0.6 1]"),
            node.numbers("OutValues", "[3 1 4 2 1]"),
        )
    if node.kind == "Repeating Sequence Stair":
        values = np.append(values, values[0])
        times = np.asarray(node.number("tsamp", "1") * np.arange(values.size), dtype=float)
    if (
        times.size != values.size
        or times.size < 2
        or np.any(np.diff(times) < 0)
        or times[-1] <= times[0]
    ):
        raise node.refusal(
            message(
                "simulink.times_and_values",
                "has {times} times for {count} values; the times must rise, with as many values",
                times=times.size,
                count=values.size,
            )
        )
    return signal(
        [_repeated(_parted(times), values, stairs=node.kind == "Repeating Sequence Stair")]
    )


def _parted(times: Vector) -> Vector:
    """Return times that rise: two values at one time are a jump."""
    return np.asarray(
        times - 1e-9 * max(times[-1] - times[0], 1e-9) * np.append(np.diff(times) == 0, False)
    )


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
        raise node.refusal(
            message(
                "simulink.times_in_structure",
                "needs times and values in its structure: {problem}",
                problem=problem,
            )
        ) from problem
    if rows.shape[1] < 2 or not np.all(np.isfinite(rows)) or np.any(np.diff(rows[:, 0]) < 0):
        raise node.refusal(
            message("simulink.matrix_of_times", "needs a matrix of times that rise, and values")
        )
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
        found.append(
            chosen(compared("<=", TIME, float(times[-1])), value, 0.0) if zero_after else value
        )
    return signal(found)


def _converter_unit(node: Node, values: Signal) -> float:
    """Return what the converter's unit is in SI, after checking that it fits a joint's signal."""
    text = node.text("Unit", "1")
    if text in ("1", "inherit", ""):
        return 1.0
    terms = [term for value in flat(values) for term in terms_of(value)]
    sensed = {term.kind for term in terms} == {"q"} and node.kind == "PS-Simulink Converter"
    return node.in_si(
        text, "Unit", ("rad" if getattr(terms[0].of, "turns", True) else "m") if sensed else ""
    )


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
    denominator = (
        [lag, 1.0] if node.text("SimscapeFilterOrder", "1") == "1" else [lag * lag, 2 * lag, 1.0]
    )
    return mapped(lambda value: _settled(node, value, denominator), values)


def _settled(node: Node, value: Value, denominator: list[float]) -> Value:
    """Return what a filter makes of a value: it begins at rest at what this begins with, as Simulink's does."""
    if not isinstance(value, Form):
        return value
    begun = 0.0
    if of_time(value):
        begun = early(value) or 0.0
    elif denominator[-2] > _LATE:
        node.note(
            "approximated",
            message("simulink.filter_begins_at_zero", "its filter begins at 0, not at its input"),
        )
    return filtered(value - begun, [1.0], denominator) + begun


def _lookup(reader: Tracer, node: Node, _: int) -> Signal:
    points, clip = (
        [node.numbers(name, "[1 2 3]") for name in ("x_t", "y_t")],
        node.text("extrap_method"),
    )
    return mapped(
        lambda u: looked_up(u, *points, clip=clip not in ("1", "linear")), reader.input(node)
    )


SENSOR = "Transform Sensor"
_FIRST_PORT = 2  # after the follower's frame


def sensed(node: Node) -> dict[int, Callable[[], Signal]]:
    """Return what gives the signals of a Transform Sensor, by the number of their right port."""
    asked = [name for name in table("sensing") if node.is_on(f"Sense{name}")]
    return {
        port: partial(_measured, node, name, port)
        for port, name in enumerate(asked, start=_FIRST_PORT)
    }


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


SOURCES: dict[str, Rule] = {
    "Constant": _constant,
    "Ground": lambda *_: signal([0.0]),
    **dict.fromkeys(
        ("Repeating Sequence", "Repeating Sequence Interpolated", "Repeating Sequence Stair"),
        _repeating,
    ),
    "FromWorkspace": _workspace,
}
PHYSICAL: dict[str, Rule] = {
    "Simulink-PS Converter": _into_physics,
    **{kind: rule for kind, rule in FORMULAS.items() if kind.startswith("PS ")},
    "PS Lookup Table (1D)": _lookup,
    "PS Integrator": lambda reader, node, _: blocks(
        reader, node, "integrator", {"initial": node.quantity("x0", "x")}
    ),
}
"""What blocks give at their right port 1, by type."""
