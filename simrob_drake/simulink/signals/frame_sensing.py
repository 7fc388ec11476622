"""What Transform Sensors measure: parts of a station's frame sensor, or blocks that compute it from these."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.arithmetic import applied
from simrob_drake.simulink.signals.forms import MOST_ELEMENTS, PARTS, Form, Signal, Term, Value, signal

SENSOR = "Transform Sensor"
_TURNS = ("X", "Y", "Z", "1", "2", "3")
_PORTS = [
    *("Angle", "Axis", "Angle1", "Angle2", "Angle3", "Q", "R"),
    *(f"Omega{axis}" for axis in _TURNS), "QDot", "RDot",
    *(f"Alpha{axis}" for axis in _TURNS), "QDDot", "RDDot",
    *(f"{name}{dots}" for dots in ("", "Dot", "DDot") for name in ("X", "Y", "Z", "Rad", "Azim", "Dist", "Inc")),
]  # fmt: skip
"""Its signals in the order of its ports, of which only those are there that are switched on."""
_FIRST_PORT = 2  # after the follower's frame


def sensed(node: Node) -> dict[int, Callable[[], Signal]]:
    """Return what gives the signals of a Transform Sensor, by the number of their right port."""
    asked = [name for name in _PORTS if node.is_on(f"Sense{name}")]
    return {port: partial(_signal, node, name, port) for port, name in enumerate(asked, start=_FIRST_PORT)}


def _signal(node: Node, name: str, port: int) -> Signal:
    parts = [part_of(node, index) for index in range(len(PARTS))]
    place, (qw, *turn), (vx, vy, vz) = parts[:3], parts[3:7], parts[7:10]
    x, y, z = place
    named = [*"XYZ", *[""] * 4, "XDot", "YDot", "ZDot", "OmegaX", "OmegaY", "OmegaZ"]
    if name in named:
        return signal([parts[named.index(name)]])
    made: dict[str, Callable[[], list[Value]]] = {
        "Q": lambda: [qw, *turn],
        "Angle": lambda: [2.0 * applied("atan2", _length(turn), qw)],
        "Axis": lambda: [part / _length(turn) for part in turn],
        "Rad": lambda: [_length([x, y])],
        "Azim": lambda: [applied("atan2", y, x)],
        "Dist": lambda: [_length(place)],
        "Inc": lambda: [applied("atan2", z, _length([x, y]))],
        "RadDot": lambda: [(x * vx + y * vy) / _length([x, y])],
        "AzimDot": lambda: [(x * vy - y * vx) / (x * x + y * y)],
        "DistDot": lambda: [(x * vx + y * vy + z * vz) / _length(place)],
    }
    if name == "R":
        return _rotation(qw, turn)
    return (
        signal(made[name]()) if name in made else signal([Form({Term("open", node, (port - 1) * MOST_ELEMENTS): 1.0})])
    )


def part_of(node: Node, index: int) -> Form:
    """Return a part of what a sensor of the block measures, as ``PARTS`` has them."""
    return Form({Term("sensed", node, index): 1.0})


def orientation(node: Node) -> Signal:
    """Return the rotation matrix (3, 3) of a frame in the model's world, which a sensor of the block measures."""
    qw, *turn = (part_of(node, index) for index in range(3, 7))
    return _rotation(qw, turn)


def _rotation(qw: Value, turn: Sequence[Form]) -> Signal:
    qx, qy, qz = turn
    rows: list[list[Value]] = [
        [1.0 - 2.0 * (qy * qy + qz * qz), 2.0 * (qx * qy - qw * qz), 2.0 * (qx * qz + qw * qy)],
        [2.0 * (qx * qy + qw * qz), 1.0 - 2.0 * (qx * qx + qz * qz), 2.0 * (qy * qz - qw * qx)],
        [2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)],
    ]
    return np.array(rows, dtype=object)


def _length(vector: list[Form]) -> Value:
    return applied("sqrt", sum((part * part for part in vector), start=0.0))
