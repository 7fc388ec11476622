"""The sources of a model as functions of time."""

from collections.abc import Callable

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import Form


def value_over_time(form: Form, times: Vector) -> Vector:
    """Return a sum of sources and constants at times, shape (t,); the model's inputs count as 0.

    Raises:
        InvalidModel: a source whose figures cannot be.
    """
    total = np.zeros_like(times)
    for term, factor in form.items():
        if term.kind == "one":
            total += factor
        elif term.kind == "source" and isinstance(term.of, Node):
            total += factor * _SOURCES[term.of.kind](term.of, times)
    return total


def step_times(form: Form) -> list[float]:
    """Return when the Step blocks of a form step [s]."""
    return [term.of.number("Time", "1") for term in form if isinstance(term.of, Node) and term.of.kind == "Step"]


def _step(node: Node, times: Vector) -> Vector:
    before, after = node.number("Before", "0"), node.number("After", "1")
    return np.where(times < node.number("Time", "1"), before, after)


def _ramp(node: Node, times: Vector) -> Vector:
    late = np.maximum(times - node.number("start", "0"), 0.0)
    return (
        node.number("InitialOutput" if "InitialOutput" in node.block.parameters else "X0", "0")
        + node.number("slope", "1") * late
    )


def _sine(node: Node, times: Vector) -> Vector:
    angle = node.number("Frequency", "1") * times + node.number("Phase", "0")
    return node.number("Amplitude", "1") * np.sin(angle) + node.number("Bias", "0")


def _pulses(node: Node, times: Vector) -> Vector:
    period, width = node.number("Period", "10"), node.number("PulseWidth", "5") / 100
    phase = ((times - node.number("PhaseDelay", "0")) / period) % 1.0
    return np.where((phase < width) & (times >= node.number("PhaseDelay", "0")), node.number("Amplitude", "1"), 0.0)


def _workspace(node: Node, times: Vector) -> Vector:
    table = node.matrix("VariableName", "[0 0]")
    if table.shape[1] < 2:
        raise node.refusal("needs a matrix of times and values")
    return np.interp(times, table[:, 0], table[:, 1])


def _clock(_: Node, times: Vector) -> Vector:
    return times


_SOURCES: dict[str, Callable[[Node, Vector], Vector]] = {
    "Step": _step,
    "Ramp": _ramp,
    "Sin": _sine,
    "Sine Wave": _sine,
    "DiscretePulseGenerator": _pulses,
    "FromWorkspace": _workspace,
    "Clock": _clock,
    "DigitalClock": _clock,
}
