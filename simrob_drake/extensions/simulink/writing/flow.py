"""Control laws as a signal flow of a station, with the same blocks by the same names, and the sensors it reads."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.value_problems import value_problem
from simrob_drake.extensions.simulink.mechanics.bodies import PUSH, frame_place
from simrob_drake.extensions.simulink.mechanics.joints import Freedom
from simrob_drake.extensions.simulink.model.network import Connections, Place
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.signals.forms import (
    AS_WRITTEN,
    LAG,
    PARTS,
    Form,
    Primitive,
    Term,
    Tracer,
    Value,
    flat,
    signal,
    terms_of,
)
from simrob_drake.extensions.simulink.signals.laws import ExternalForce, Law
from simrob_drake.extensions.simulink.signals.sources import SENSOR
from simrob_drake.extensions.simulink.writing.touching import StationFiles
from simrob_drake.extensions.simulink.writing.urdf import UniqueNames, plain, pose_list
from simrob_drake.parts.resolved import WORLD
from simrob_drake.robots.imports import ImportReport

Sum = dict[str, float]
_MOST_SIGNALS = 60  # blocks of a law that are signals of its station


class FlowWriter:
    """Writes one signal flow.

    Attributes:
        name: of the flow in its station.
        blocks: as they stand in a station's file, by name.
        shown: names of those that are blocks of the model as they are.
        opened: what is left open in it, by the block of the model.
    """

    def __init__(
        self,
        name: str,
        measured: Mapping[Term, Sum],
        laws: Mapping[Freedom, Law],
        report: ImportReport,
    ) -> None:
        """Take what no block computes, as sums of the station's signals, and joints' laws, for who reads a torque."""
        self.name, self._measured, self._laws, self._report = name, dict(measured), laws, report
        families = {one.partition(".")[0] for names in measured.values() for one in names}
        self._names = UniqueNames(("one", "time", "torque", *families))
        self._known: dict[Primitive, list[str]] = {}
        self.blocks: dict[str, dict[str, Any]] = {}
        self.shown: list[str] = []
        self.opened: dict[Node, dict[int, str]] = {}

    def sum(self, value: Value) -> Sum:
        """Return a value as a sum of signals, and add the blocks that it takes."""
        total: Sum = {}
        for term, factor in terms_of(value).items():
            for name, own in self._signal(term).items():
                total[name] = total.get(name, 0.0) + factor * own
        if not np.isfinite(
            total.get("one", 0.0)
        ):  # which no file holds: something divided by 0 is it
            sign = float(np.nan_to_num(np.sign(total.pop("one"))))
            total |= self.sum(
                Primitive("product", {"divides": [1]}, lambda: [sign, 0.0]).outputs[0]
            )
        return {name: float(f"{own:.15g}") for name, own in total.items()}

    def _signal(self, term: Term) -> Sum:
        if isinstance(term.of, Primitive):
            return {self._block(term.of)[term.index]: 1.0}
        if term.kind in ("one", "time"):
            return {term.kind: 1.0}
        if term not in self._measured:
            self._measured[term] = self._derived(term)
        return self._measured[term]

    def _derived(self, term: Term) -> Sum:
        """Return what a station does not measure: by what it does measure, or as an open input."""
        if term.kind == "a":
            joint = getattr(term.of, "name", "")
            self._report.add(
                "approximated",
                joint,
                message(
                    "simulink.acceleration_filtered",
                    "its acceleration is filtered, by {lag:g} s",
                    lag=LAG,
                ),
            )
            name = self._names.give(f"{joint or 'joint'}_a")
            self.blocks[name] = {
                "kind": "transfer_function",
                "numerator": [1.0, 0.0],
                "denominator": [LAG, 1.0],
            }
            self.blocks[name]["of"] = [self.sum(Form({Term("w", term.of): 1.0}))]
            return {name: 1.0}
        if term.kind == "t" and isinstance(term.of, Freedom) and term.of in self._laws:
            self._measured[term] = {}  # a torque that reads itself reads 0
            return self.sum(self._laws[term.of].net)
        return self._open(term)

    def _open(self, term: Term) -> Sum:
        node = term.of
        path = (
            node.path
            if isinstance(node, Node)
            else f"{getattr(node, 'name', term.kind)}_{term.kind}"
        )
        name = self._names.give(path if not term.index else f"{path}_{term.index + 1}")
        self.blocks[name] = {"kind": "input"}
        if isinstance(node, Node) and term.kind == "open":
            self.opened.setdefault(node, {})[term.index] = f"{self.name}.{name}"
        text = message(
            "simulink.input_of_station",
            "it is the input {block}.{port} of the station, at 0 until something drives it",
            block=self.name,
            port=name,
        )
        self._report.add("open", path, text)
        return {name: 1.0}

    def name_of(self, node: Node) -> str:
        """Return a name that nothing else in the flow has, after a block of the model."""
        return self._names.give(node.path)

    def take_inputs(self, tracer: Tracer) -> None:
        """Add blocks that hold what open blocks take, and those that are open in these."""
        done = set[Node]()
        while waiting := [node for node in self.opened if node not in done]:
            done.update(waiting)
            for node in waiting:
                for number, values in enumerate(tracer.inputs(node), start=1):
                    name = self._names.give(f"{node.path}_in_{number}")
                    self.blocks[name] = {"kind": "sum"}
                    self.blocks[name]["of"] = [self.sum(value) for value in flat(values)]
                    self.shown.append(name)

    def _block(self, block: Primitive) -> list[str]:
        if block not in self._known:
            name = self._give(block)
            outputs = (
                [f"{name}.{index}" for index in range(block.size)] if block.size > 1 else [name]
            )
            self._known[block] = outputs  # before its inputs, which may lead back to it
            self.blocks[name] = {"kind": block.kind, **block.parameters}
            sums = [self.sum(value) for value in block.inputs()]
            if sums or block.kind != "step":
                self.blocks[name]["of"] = sums[0] if len(sums) == 1 else sums
            if (
                problem := _problem(name, self.blocks[name])
            ) is not None and block.node is not None:
                block.node.note(
                    "open",
                    message(
                        "simulink.left_open_at_zero",
                        "{problem}: it is left open, at 0",
                        problem=problem,
                    ),
                )
                self.blocks[name] = {"kind": "input"}
                outputs[:] = [name] * block.size
        return self._known[block]

    def _give(self, block: Primitive) -> str:
        node = block.node
        if node is None:
            return self._names.give(block.kind)
        path = f"{node.path}_{block.place + 1}" if block.place else node.path
        name = self._names.give(path)
        if name == plain(path.rpartition("/")[2]):
            self.shown.append(name)
        return name

    @property
    def section(self) -> dict[str, Any]:
        """What a station's file says of the blocks."""
        if not self.blocks:
            return {}
        several = len(self.blocks) > _MOST_SIGNALS
        return {
            "blocks": self.blocks,
            **({"signals": self.shown[:_MOST_SIGNALS]} if several else {}),
        }


def _problem(name: str, block: dict[str, Any]) -> str | None:
    """Find what is wrong with a block of a signal flow: the key and the reason. Returns None if nothing is."""
    try:
        AS_WRITTEN.validate_python(block).check(name)
    except ValidationError as problem:
        found = problem.errors()[0]
        key = ".".join(map(str, found["loc"][1:]))
        return (
            compound("{key} {problem}", key=key, problem=value_problem(found))
            if key
            else value_problem(found)
        )
    except InvalidParameter as problem:
        return str(problem)
    return None


def _measured(files: StationFiles, sensors: Collection[str]) -> dict[Term, Sum]:
    found: dict[Term, Sum] = {}
    for name, robot in files.robots.items():
        prefix = files.prefix(name)
        for freedom, axis in robot.axes.items():
            found[Term("q", freedom)] = {f"{prefix}q.{axis}": 1.0}
            found[Term("w", freedom)] = {f"{prefix}v.{axis}": 1.0}
            form = terms_of(files.model.law_of(freedom).reference or 0.0)
            for term, factor in form.items() if len(form) == 1 else ():
                if term.kind == "input":
                    found[term] = {f"{prefix}q_ref.{axis}": 1.0 / factor}
    for contact in files.model.contacts:
        name = plain(contact.node.block.name)
        if name in sensors:
            found[Term("distance", contact.node)] = {f"distance.{name}": 1.0}
    return found


def _net(law: Law, freedom: Freedom) -> Value:
    """Return what of a joint's torque no servo is: its law, and its spring where that is not all that drives it."""
    if not freedom.stiffness or law.is_idle or freedom.driven == "motion":
        return law.net
    return law.net + freedom.stiffness * (freedom.rest - Form({Term("q", freedom): 1.0}))


def flows_of(
    files: StationFiles, sensors: Collection[str], sensed: Mapping[Term, Sum]
) -> dict[str, Any]:
    """Return the controllers of a station, a signal flow for each robot with a law.

    Stops that no contact gives, and forces on bodies, are part of the first. Frame sensors are measured as ``sensed``
    says.
    """
    model, several = files.model, len(files.robots) > 1
    measured = {**_measured(files, sensors), **sensed}
    flows: dict[str, Any] = {}
    stops, pushes = dict(model.stops), list(model.pushes)
    for name, robot in files.robots.items() or [("", None)]:
        called = f"law_{name}" if several else "law"
        writer = FlowWriter(called, measured, model.laws, model.report)
        axes = robot.axes.items() if robot is not None else ()
        torque = {
            axis: made for one, axis in axes if (made := writer.sum(_net(model.law_of(one), one)))
        }
        ends = {f"{plain(node.block.name)}_end": writer.sum(value) for node, value in stops.items()}
        forces = {
            writer.name_of(push.node): made
            for push in pushes
            if (made := _force(writer, push, files))
        }
        if not (torque or ends or forces):
            continue
        stops.clear()
        pushes.clear()
        writer.take_inputs(model.tracer)
        section: dict[str, Any] = {"kind": "signal_flow", **({"robot": name} if several else {})}
        parts = {"torque": torque, "forces": forces, "stops": ends}
        flows[called] = (
            section | writer.section | {key: part for key, part in parts.items() if part}
        )
        for node, outputs in writer.opened.items():
            measured |= {Term("open", node, index): {one: 1.0} for index, one in outputs.items()}
    return flows


def _force(writer: FlowWriter, push: ExternalForce, files: StationFiles) -> dict[str, Any]:
    """Return what a block applies, along the axes of the link or piece that it acts on; nothing of what cannot move."""
    named = files.named(push.body)
    if named is None or push.body.grounded:
        push.node.note(
            "dropped", message("simulink.force_on_fixed", "a force on what stands fixed")
        )
        return {}
    place, own = named
    pose = own @ push.pose
    section: dict[str, Any] = {
        "at": place,
        "point": [float(f"{value:.12g}") for value in pose.translation()],
    }
    axes = np.round(pose.rotation().matrix(), 15).astype(object)
    for what, vector in (("force", push.force), ("torque", push.torque)):
        if any(vector):
            section[what] = [writer.sum(part) for part in axes.dot(signal(vector))]
    push.node.note(
        "read",
        message(
            "simulink.acts_on", "it acts on {place}, by {writer}", place=place, writer=writer.name
        ),
    )
    return section


_AXES = {"World": "world", "Base": "base", "Follower": "frame"}
_VECTORS = (0, 7, 10)  # where position, velocity and turning rate begin among the parts


def frame_sensors(files: StationFiles) -> tuple[dict[str, dict[str, Any]], dict[Term, Sum]]:
    """Return a model's Transform Sensors by name, and what their terms are in the station as sums of signals."""
    sections, measured, model = dict[str, dict[str, Any]](), dict[Term, Sum](), files.model
    sensing = {push.node: push.ends for push in model.pushes if push.senses}
    sensing |= {
        link.joint.node: None
        for link in model.bodies.links
        if link.joint.senses or link.joint.pulls
    }
    for node in model.expanded.nodes:
        if (node.kind == SENSOR or node in sensing) and node.block.commented == "off":
            places = _ends(node, sensing.get(node), model.network)
            if (section := _sensor(node, places, files)) is None:
                continue
            name = files.names.give(node.path)
            rotation = files.turn.rotation().matrix() if section["axes"] == "world" else np.eye(3)
            sections[name] = section
            measured |= {
                Term("sensed", node, index): _part(name, index, rotation)
                for index in range(len(PARTS))
            }
            node.note(
                "read",
                message(
                    "simulink.sensor_with_signals",
                    "{kind}: the sensor {name}, with the signals frame.{name}.*",
                    kind=node.kind,
                    name=name,
                ),
            )
    return sections, measured


def _ends(node: Node, ends: tuple[Node, Node] | None, network: Connections) -> list[Place]:
    """Return where what a block senses is, and where it is seen from; of a force that is the world, and not told."""
    if ends is not None:
        return [frame_place(network, end) for end in ends]
    return [
        network.net(node, side)
        for side in ("rconn", "lconn")
        if node.kind != PUSH or side == "rconn"
    ]


def _sensor(node: Node, places: list[Place], files: StationFiles) -> dict[str, Any] | None:
    poses = []
    for place, end in zip(places, ("follower", "base"), strict=False):
        body = files.model.bodies.by_place[place]
        named = files.named(body)
        if named is None:
            node.note(
                "dropped",
                message(
                    "simulink.end_on_nothing",
                    "{kind}: its {end} is on no robot or piece",
                    kind=node.kind,
                    end=end,
                ),
            )
            return None
        poses.append((named[0], pose_list(named[1] @ body.frames[place])))
    (frame, offset), (base, base_offset), *_ = *poses, (WORLD, pose_list(files.turn))
    observer = node.text("MeasurementFrame", "World" if node.kind in (SENSOR, PUSH) else "Base")
    axes = _AXES.get(observer.removeprefix("NonRotating"), "world")
    ends = {"frame": frame, "offset": offset, "base": base, "base_offset": base_offset}
    section = {
        "kind": "frame",
        **{key: value for key, value in ends.items() if value != [0.0] * 6},
        "axes": axes,
    }
    return section | ({"turning": False} if observer.startswith("NonRotating") else {})


def _part(name: str, index: int, rotation: Vector) -> dict[str, float]:
    first = next((first for first in _VECTORS if first <= index < first + 3), None)
    if first is None:
        return {f"frame.{name}.{PARTS[index]}": 1.0}
    column = rotation[:, index - first]
    return {
        f"frame.{name}.{PARTS[first + k]}": float(column[k])
        for k in range(3)
        if abs(column[k]) > 1e-12
    }
