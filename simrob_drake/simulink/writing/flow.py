"""Control laws that are no servos, as a signal flow of a station: the same blocks by the same names."""

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from simrob_drake.errors import InvalidParameter
from simrob_drake.importer.report import ImportReport
from simrob_drake.parts.controllers.flow_block import FlowBlock
from simrob_drake.parts.controllers.signal_flow import FlowBlockConfig
from simrob_drake.simulink.mechanics.joints import Freedom
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import Form, Term, added, constant
from simrob_drake.simulink.signals.laws import Law
from simrob_drake.simulink.signals.tracing import Tracer
from simrob_drake.simulink.simulink_model import SimulinkModel
from simrob_drake.simulink.writing.contact_sections import StationFiles
from simrob_drake.simulink.writing.names import Names, plain

Sum = dict[str, float]
_AS_WRITTEN: TypeAdapter[FlowBlock] = TypeAdapter(FlowBlockConfig)


class FlowWriter:
    """Writes one station's signal flow, for one robot."""

    def __init__(self, tracer: Tracer, measured: Mapping[Term, Sum], report: ImportReport) -> None:
        """Take what the blocks are made of.

        Args:
            tracer: that has followed them.
            measured: what no block computes, as sums of the station's signals.
            report: of the import.
        """
        self._tracer, self._measured, self._report = tracer, measured, report
        families = {name.partition(".")[0] for given in measured.values() for name in given}
        self._names = Names(("one", "time", "torque", *families))
        self._known: dict[Term, Sum] = {}
        self.blocks: dict[str, dict[str, Any]] = {}

    def sum(self, form: Form) -> Sum:
        """Return a form as a sum of signals, and add the blocks that it takes."""
        total: Sum = {}
        for term, factor in form.items():
            for name, value in self._signal(term).items():
                total[name] = total.get(name, 0.0) + factor * value
        return {name: float(f"{value:.15g}") for name, value in total.items()}

    def _signal(self, term: Term) -> Sum:
        if term not in self._known:
            self._known[term] = self._new(term)
        return self._known[term]

    def _new(self, term: Term) -> Sum:
        if term.kind in ("sat", "integral", "block"):
            return self._block(term)
        told = self._told(term)
        if told is None:
            where = term.of.path if isinstance(term.of, Node) else f"{term.kind} of {getattr(term.of, 'name', '')}"
            self._report.add("dropped", where, "in a control law: no signal of a station, so it counts as 0")
        return told or {}

    def _told(self, term: Term) -> Sum | None:
        """Return what no block computes; None where a station has no such signal."""
        if term.kind == "one":
            return {"one": 1.0}
        if term.kind == "source" and isinstance(term.of, Node) and term.of.kind in _SOURCES:
            return _SOURCES[term.of.kind](self, term.of)
        return self._measured.get(term)

    def _block(self, term: Term) -> Sum:
        tracer, node = self._tracer, term.of
        assert isinstance(node, Node)
        if term in tracer.limits:
            bounds = tracer.limits[term]
            name = self._given(node, term.index)
            self._put(name, term, {"kind": "saturation", **_bounds(bounds.lower, bounds.upper)})
            self.blocks[name]["of"] = self.sum(bounds.inner)
        elif term in tracer.integrands:
            name = self._given(node, term.index)
            self._put(name, term, {"kind": "integrator", **_integrator(node, term.index)})
            self.blocks[name]["of"] = self.sum(tracer.integrands[term]())
        else:
            primitive = tracer.primitives[term]
            several = primitive.elements > 1
            name = self._given(node, None if several or primitive.place is None else primitive.place)
            figures: dict[str, Any] = {"kind": primitive.kind, **primitive.figures}
            if several:
                for index in range(primitive.elements):
                    self._known[Term("block", node, index)] = {f"{name}.{index}": 1.0}
            self._put(name, term, figures, several=several)
            sums = [self.sum(form) for form in primitive.inputs()]
            self.blocks[name]["of"] = sums[0] if len(sums) == 1 else sums
        self._check(name, node)
        return self._known[term]

    def _check(self, name: str, node: Node) -> None:
        """Check a block as a station's file is checked.

        Raises:
            InvalidModel: its figures are none that such a block can have.
        """
        try:
            _AS_WRITTEN.validate_python(self.blocks[name]).check(name)
        except ValidationError as problem:
            found = problem.errors()[0]
            raise node.refusal(f"{'.'.join(map(str, found['loc'][1:]))} {found['msg']}".strip()) from problem
        except InvalidParameter as problem:
            raise node.refusal(str(problem)) from problem

    def _put(self, name: str, term: Term, figures: dict[str, Any], *, several: bool = False) -> None:
        """Note a block before its inputs are followed: they may lead back to it."""
        self.blocks[name] = figures
        if not several:
            self._known[term] = {name: 1.0}

    def _given(self, node: Node, index: int | None) -> str:
        return self._names.give(node.path if not index else f"{node.path}_{index + 1}")

    def source(self, node: Node, figures: dict[str, Any]) -> str:
        """Add a block without inputs, or one of the time, and return its name."""
        name = self._given(node, None)
        self.blocks[name] = figures
        return name


def _bounds(lower: float, upper: float) -> dict[str, float]:
    return {name: value for name, value in (("lower", lower), ("upper", upper)) if np.isfinite(value)}


def _integrator(node: Node, index: int) -> dict[str, float]:
    start = node.numbers("InitialCondition", node.text("InitialConditionForIntegrator", "0"))
    figures = {"initial": float(start[min(index, start.size - 1)])}
    if node.kind == "Integrator" and node.is_on("LimitOutput"):
        figures |= _bounds(
            *(float(np.resize(node.matrix(f"{side}SaturationLimit", "inf"), 1)[0]) for side in ("Lower", "Upper"))
        )
    return figures


def _step(writer: FlowWriter, node: Node) -> Sum:
    before, after = node.number("Before", "0"), node.number("After", "1")
    figures = {"kind": "step", "time": node.number("Time", "1"), "before": before, "after": after}
    return {writer.source(node, figures): 1.0}


def _sine(writer: FlowWriter, node: Node) -> Sum:
    angle = {"time": node.number("Frequency", "1"), "one": node.number("Phase", "0")}
    name = writer.source(node, {"kind": "function", "function": "sin", "of": angle})
    return {name: node.number("Amplitude", "1"), "one": node.number("Bias", "0")}


def _ramp(writer: FlowWriter, node: Node) -> Sum:
    late = {"time": 1.0, "one": -node.number("start", "0")}
    start = node.number("InitialOutput" if "InitialOutput" in node.block.parameters else "X0", "0")
    name = writer.source(node, {"kind": "saturation", "lower": 0.0, "of": late})
    return {name: node.number("slope", "1"), "one": start}


def _table(writer: FlowWriter, node: Node) -> Sum:
    table = node.matrix("VariableName", "[0 0]")
    if table.shape[1] < 2 or len(table) < 2:
        raise node.refusal("needs a matrix of times and values")
    points, values = table[:, 0].tolist(), table[:, 1].tolist()
    figures = {"kind": "lookup", "points": points, "values": values, "clip": True, "of": "time"}
    return {writer.source(node, figures): 1.0}


def _pulses(writer: FlowWriter, node: Node) -> Sum:
    period, delay = node.number("Period", "10"), node.number("PhaseDelay", "0")
    if period <= 0:
        raise node.refusal(f"Period is {period:g}; it must be positive")
    phase, width = {"time": 1 / period, "one": -delay / period}, node.number("PulseWidth", "5") / 100
    begun = writer.source(node, {"kind": "function", "function": "floor", "of": phase})
    high = {"kind": "compare", "operator": "<", "threshold": width, "of": {**phase, begun: -1.0}}
    late = {"kind": "compare", "operator": ">=", "threshold": delay, "of": "time"}
    both = [{writer.source(node, figures): 1.0} for figures in (high, late)]
    return {writer.source(node, {"kind": "product", "of": both}): node.number("Amplitude", "1")}


_SOURCES: dict[str, Callable[[FlowWriter, Node], Sum]] = {
    "DiscretePulseGenerator": _pulses,
    "Step": _step,
    "Sin": _sine,
    "Sine Wave": _sine,
    "Ramp": _ramp,
    "FromWorkspace": _table,
    "Clock": lambda *_: {"time": 1.0},
    "DigitalClock": lambda *_: {"time": 1.0},
}


def _measured(model: SimulinkModel, files: StationFiles, sensors: Collection[str]) -> dict[Term, Sum]:
    """Return joints, inputs and distances as signals of the station."""
    several = len(files.robots) > 1
    found: dict[Term, Sum] = {}
    for name, robot in files.robots.items():
        prefix = f"{name}." if several else ""
        for freedom, axis in robot.axes.items():
            found[Term("q", freedom)] = {f"{prefix}q.{axis}": 1.0}
            found[Term("w", freedom)] = {f"{prefix}v.{axis}": 1.0}
            wanted = model.laws[freedom].wanted if freedom in model.laws else {}
            for term, factor in wanted.items() if len(wanted) == 1 else ():
                if term.kind == "input":
                    found[term] = {f"{prefix}q_ref.{axis}": 1.0 / factor}
    for contact in model.contacts:
        name = plain(contact.node.block.name)
        if name in sensors:
            found[Term("distance", contact.node)] = {f"distance.{name}": 1.0}
    return found


def _net(model: SimulinkModel, freedom: Freedom) -> Form:
    """Return what of a joint's torque no servo is: its law, and its spring where that is not all that drives it."""
    law = model.laws.get(freedom, Law())
    if not freedom.stiffness or law.is_idle or freedom.driven == "motion":
        return law.net
    spring = {Term("q", freedom): -freedom.stiffness, **constant(freedom.stiffness * freedom.rest)}
    return added((1.0, law.net), (1.0, spring))


def flows_of(
    model: SimulinkModel, files: StationFiles, sensors: Collection[str], sensed: Mapping[Term, Sum]
) -> dict[str, Any]:
    """Return the controllers of a station: a signal flow for each robot with a law that is no servo.

    Stops that no contact tells are part of the first. Frame sensors are measured as ``sensed`` says.
    """
    several = len(files.robots) > 1
    measured = {**_measured(model, files, sensors), **sensed}
    flows: dict[str, Any] = {}
    stops = dict(model.stops)
    for name, robot in files.robots.items():
        nets = {axis: _net(model, freedom) for freedom, axis in robot.axes.items()}
        writer = FlowWriter(model.tracer, measured, model.report)
        torque = {axis: writer.sum(net) for axis, net in nets.items() if net}
        ends = {f"{plain(node.block.name)}_end": writer.sum(form) for node, form in stops.items()}
        if not (torque or ends):
            continue
        stops.clear()
        section: dict[str, Any] = {"kind": "signal_flow", **({"robot": name} if several else {})}
        section |= {"blocks": writer.blocks} if writer.blocks else {}
        section |= {"torque": torque, **({"stops": ends} if ends else {})}
        flows[f"law_{name}" if several else "law"] = section
    return flows
