"""What Transform Sensors measure: parts of a station's frame sensor, or blocks that compute it from these."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import MOST_ELEMENTS, PARTS, Form, Signal, Term, signal
from simrob_drake.simulink.signals.translation import Translation, as_signal
from simrob_drake.simulink.tables import table
from simrob_drake.simulink.values.evaluate import matrix

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


def _signal(node: Node, name: str, port: int = 0) -> Signal:
    if (formula := table("sensing").get(name)) is None:
        return signal([Form({Term("open", node, (port - 1) * MOST_ELEMENTS): 1.0})])
    parts = {part: matrix(signal([part_of(node, index)])) for index, part in enumerate(PARTS)}
    return as_signal(Translation(parts).value(formula))


def part_of(node: Node, index: int) -> Form:
    """Return a part of what a sensor of the block measures, as ``PARTS`` has them."""
    return Form({Term("sensed", node, index): 1.0})


def orientation(node: Node) -> Signal:
    """Return the rotation matrix (3, 3) of a frame in the model's world, which a sensor of the block measures."""
    return _signal(node, "R")
