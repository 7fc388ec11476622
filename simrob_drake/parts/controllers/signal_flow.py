"""A control law as a net of blocks between what is measured and the torques."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError
from itertools import accumulate
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, TypeAdapter
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer, PassThrough

from simrob_drake.base.errors import InvalidParameter, UnknownName, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Strict, Triple
from simrob_drake.base.signals import applied_signal
from simrob_drake.blocks.block import add_and_connect, add_multiplexer
from simrob_drake.blocks.monitor import Condition, Trigger
from simrob_drake.blocks.passive_joints import add_external_force
from simrob_drake.blocks.signal_net import signal_net
from simrob_drake.blocks.written_net import WiredBlock
from simrob_drake.parts.captions import InnerBlock, wrapped
from simrob_drake.parts.controllers.flow_blocks import (
    Compare,
    DeadZone,
    FlowBlock,
    Input,
    Logic,
    Lookup,
    MathFunction,
    Product,
    Saturation,
    Step,
    Sum,
    Sums,
    Switch,
)
from simrob_drake.parts.controllers.flow_states import (
    Delay,
    Integrator,
    Pid,
    RateLimiter,
    StateSpace,
    TransferFunction,
    ZeroOrderHold,
)
from simrob_drake.parts.controllers.own import add_to, declare_output
from simrob_drake.parts.controllers.section import ControllerSection
from simrob_drake.parts.monitors.monitor import add_monitor
from simrob_drake.parts.resolved import StationContents
from simrob_drake.parts.site import Site
from simrob_drake.parts.targets import check_frame, frame_of

_ONE, _TIME = "one", "time"
_AT_ONCE = ("effort", "estimate", "inertial")
"""Roles of signals that a torque changes at once: a law that reads one is an algebraic loop."""
_TORQUE = "torque"
_DRAWN = 12  # so many blocks are drawn each for itself, at most

FlowBlockConfig = Annotated[
    Sums | Product | Saturation | DeadZone | Integrator | StateSpace | TransferFunction | Pid | RateLimiter
    | ZeroOrderHold | Delay | Lookup | Compare | Logic | Switch | MathFunction | Step | Input,
    Field(discriminator="kind"),
]  # fmt: skip

BlockName = Annotated[str, Field(pattern=r"^[A-Za-z_]\w*$")]


class FlowForce(Strict):
    """What a signal flow applies to a body, along the axes of the frame at which it acts."""

    at: str
    """The link or tool of a robot, or the piece, at whose origin it acts."""
    point: Triple = (0.0, 0.0, 0.0)
    """Where it acts in that frame [m]."""
    force: tuple[Sum, Sum, Sum] | None = None
    """Along x, y and z [N]."""
    torque: tuple[Sum, Sum, Sum] | None = None
    """About x, y and z [N·m]."""

    def sums(self, name: str) -> dict[str, Sums]:
        """Return the blocks that gather it, by the names of their outputs."""
        parts = {f"applied_force.{name}": self.force, f"applied_torque.{name}": self.torque}
        return {output: Sums(kind="sum", of=part) for output, part in parts.items() if part is not None}

    def apply(self, builder: DiagramBuilder, site: Site, name: str, ports: Mapping[str, OutputPort]) -> None:
        """Let the outputs of these blocks act."""
        frame = frame_of(site.plant, self.at)
        for output in self.sums(name):
            turns = output.startswith("applied_torque")
            block = add_external_force(
                builder, site.plant.plant_block, frame, name=output, point=self.point, turns=turns
            )
            builder.Connect(ports[output], block.get_command_input_port())
            site.spatial_forces.append(block.get_spatial_forces_output_port())
            what, unit = ("torque", "N·m") if turns else ("force", "N")
            site.picture.draw(output, "force", f"{what.capitalize()} '{name}'\nat {self.at}")
            title = message(
                "parts.applied_force", "applied force '{name}' at {place}, in its axes", name=name, place=self.at
            )
            if turns:
                title = message(
                    "parts.applied_torque", "applied torque '{name}' at {place}, in its axes", name=name, place=self.at
                )
            site.outputs.add(output, ports[output], applied_signal(output, unit, title, part=name))


class SignalFlow(ControllerSection):
    """A control law of blocks that compute, filter and compare, as they are drawn in Simulink.

    Blocks read other blocks by their names (`Plant.1` is an element of an output of several), and signals of the
    station by those of its results (`q.joint_1`, `q_ref.joint_1`, `tcp.z`, a sensor's). Each block's output is a
    signal, ``<controller>.<block>``. Outputs are exact in time: blocks with states are part of the station's.
    """

    is_flow: ClassVar[bool] = True

    kind: Literal["signal_flow"]
    robot: str | None = None
    """Whom it drives; the only robot unless given. A flow without ``torque`` needs none."""
    blocks: dict[BlockName, FlowBlockConfig] = Field(default_factory=dict)
    """By name, in any order."""
    torque: dict[str, Sum] = Field(default_factory=dict)
    """What is added to the torque of the servos, by axis [N·m or N]."""
    forces: dict[BlockName, FlowForce] = Field(default_factory=dict)
    """What it applies to bodies, by name."""
    stops: dict[BlockName, Sum] = Field(default_factory=dict)
    """What ends the run, by name: as soon as it is not 0."""
    signals: tuple[BlockName, ...] | None = None
    """The blocks whose outputs are signals of the station; all unless given."""

    @property
    def needs(self) -> tuple[Literal["feedforward"], ...]:
        """The inputs of its robot that it drives."""
        return ("feedforward",) if self.torque else ()

    @property
    def read_names(self) -> list[str]:
        """What it reads by names: signals of sensors and others."""
        sums = [*self.torque.values(), *(terms for block in self._all.values() for terms in block.inputs)]
        return sorted({name for terms in sums for name in _terms(terms)})

    @property
    def _all(self) -> dict[str, FlowBlock]:
        """Its blocks, and those that gather its outputs."""
        ends = {name: Sums(kind="sum", of=terms) for name, terms in self.stops.items()}
        for name, force in self.forces.items():
            ends |= force.sums(name)
        return {**{name: block for name, block in self.blocks.items() if not isinstance(block, Input)}, **ends}

    def check(self, key: str, station: StationContents) -> None:
        """Check what is known before building; raises SimrobError: no such robot, axis, frame, block, or no torques."""
        if not station.engine.moves_by_forces:
            raise InvalidParameter(
                key,
                message("parts.in_kinematic_station", "in a kinematic station"),
                message("parts.torque_in_dynamic_station", "in a dynamic one: its output is a torque"),
            )
        if self.torque or self.robot is not None:
            robot = station.robot(self.robot, key)
            for axis in self.torque:
                one_of(
                    message("parts.axis_for_torque", "axis of {robot} for {key}.torque", robot=robot.name, key=key),
                    axis,
                    robot.axes,
                )
        for name, force in self.forces.items():
            check_frame(station, f"{key}.forces.{name}.at", force.at)
        for name, block in self.blocks.items():
            block.check(f"{key}.blocks.{name}")
            if name in (_ONE, _TIME, _TORQUE, *self.stops):
                raise InvalidParameter(
                    f"{key}.blocks.{name}", name, message("parts.name_is_taken", "another name: this one is taken")
                )
        for name in self.signals or ():
            one_of(message("parts.block_for_signals", "block for {key}.signals", key=key), name, self.blocks)

    def add(
        self, builder: DiagramBuilder, site: Site, name: str, *, monitors: bool, integrated: bool = True
    ) -> OutputPort | None:
        """Add its blocks, return its robot's torques (n) [N·m or N], or None; raises SimrobError: no signal, a loop."""
        robot = site.robot(self.robot) if self.torque or self.robot is not None else None
        axes = robot.axes if robot is not None and self.torque else []
        torque = {_TORQUE: Sums(kind="sum", of=tuple(self.torque.get(axis, {}) for axis in axes))} if axes else {}
        if not self._all and not torque:  # a force of no signals: it is none
            return None
        opened = {block: f"{name}.{block}" for block, one in self.blocks.items() if isinstance(one, Input)}
        for block, called in opened.items():
            opening = builder.AddNamedSystem(called, PassThrough(1))
            site.inputs[called] = opening.get_input_port()
            declare_output(site, name, opening.get_output_port(), "1", called=block)
        net = _Net(site, f"controllers.{name}", robot.prefix if robot else "", {**self._all, **torque}, opened)
        ports = net.add(builder, f"controller.{name}", integrated=integrated)
        site.outputs.notes[name] = {"kind": self.kind}
        label = message(
            "parts.block_signal_flow", "{name}\nsignal flow, {count} blocks", name=wrapped(name), count=len(self.blocks)
        )
        inner_blocks = net.inner_blocks if len(ports) <= _DRAWN else None
        site.picture.draw(f"controller.{name}", "loop", label, robot, net=inner_blocks)
        shown = self.blocks if self.signals is None else self.signals
        for block, port in ports.items():
            if block in shown or block in self.stops:
                declare_output(site, name, port, "1", called=block)
            site.edges.extend(net.blocks[block].edges)
        for stop in self.stops:
            condition = Condition(
                {f"{name}.{stop}": 1},
                lambda value: 1.0 if value[0] else -1.0,
                lambda *_, stop=stop: message("parts.stop_is_on", "{stop} is on", stop=stop),
            )
            add_monitor(builder if monitors else None, site, f"{name}_{stop}", Trigger(condition))
        for place, force in self.forces.items():
            force.apply(builder, site, place, ports)
        return ports.get(_TORQUE)


def add_flows(
    builder: DiagramBuilder,
    site: Site,
    flows: Mapping[str, SignalFlow],
    *,
    monitors: bool = True,
    integrated: bool = True,
) -> None:
    """Add a station's signal flows, which drive its robots; raises SimrobError: no such signal, an algebraic loop.

    ``integrated``: whether other parts of the diagram may have continuous states.
    """
    integrated |= any(block.law.start for flow in flows.values() for block in flow.blocks.values())
    torques: dict[str, list[OutputPort]] = {}
    for name, flow in flows.items():
        torque = flow.add(builder, site, name, monitors=monitors, integrated=integrated)
        if torque is not None:
            torques.setdefault(site.robot(flow.robot).name, []).append(torque)
    for robot, ports in torques.items():
        add_to(builder, site, f"{site.plant.robots[robot].prefix}feedforward", ports, name="flows")


@dataclass
class _Net:
    """The blocks of one law, under construction; the places of values are those of a :class:`SignalNet`."""

    site: Site | None
    key: str
    prefix: str
    blocks: Mapping[str, FlowBlock]
    opened: Mapping[str, str]
    sources: dict[str, int] = field(default_factory=dict)
    inner_blocks: dict[str, InnerBlock] = field(default_factory=dict)

    def add(self, builder: DiagramBuilder, place: str, *, integrated: bool = True) -> dict[str, OutputPort]:
        """Add the blocks as one, and return the outputs of all of them by name."""
        sums = {name: [self._elements(name, terms) for terms in block.inputs] for name, block in self.blocks.items()}
        for name, inputs in sums.items():
            read = dict.fromkeys(owner for of in inputs for owner, _ in of)
            inside, outside = (tuple(owner for owner in read if owner in own) for own in (self.blocks, self.sources))
            label = f"{wrapped(name)}\n{self.blocks[name].kind.replace('_', ' ')}"
            self.inner_blocks[name] = InnerBlock(label, inside, outside)
        measured = sum(self.sources.values())
        owners = [*self.sources, *self.blocks]
        sizes = [*self.sources.values(), *(block.size for block in self.blocks.values())]
        starts = dict(zip(owners, accumulate(sizes, initial=2), strict=False)) | {_ONE: 0, _TIME: 1}
        wired = {
            name: WiredBlock(self.blocks[name].law, [[(starts[o] + i, k) for (o, i), k in of.items()] for of in inputs])
            for name, inputs in sums.items()
        }
        try:
            net = signal_net(wired, measured, integrated=integrated)
        except CycleError as problem:
            expected = message(
                "parts.no_algebraic_loop",
                "no algebraic loop: something that takes time must lie in it, as an integrator",
            )
            raise InvalidParameter(f"{self.key}.blocks", " → ".join(problem.args[1]), expected) from None
        except ValueError as problem:
            raise InvalidParameter(
                f"{self.key}.blocks", str(problem), message("parts.multiples_of_step", "multiples of a common step")
            ) from None
        ports = [self.site.port(builder, source) for source in self.sources] if self.site is not None else []
        values = add_and_connect(
            builder, place, net, *([add_multiplexer(builder, f"{place}.bus", *ports)] if ports else [])
        )
        split = Demultiplexer([block.size for block in self.blocks.values()])
        add_and_connect(builder, f"{place}.split", split, values)
        return {name: split.get_output_port(index) for index, name in enumerate(self.blocks)}

    def _elements(self, name: str, terms: Sum) -> dict[tuple[str, int], float]:
        return {self._element(f"{self.key}.blocks.{name}.of", term): k for term, k in _terms(terms).items()}

    def _element(self, key: str, term: str) -> tuple[str, int]:
        """Return the block or output of the station that a signal is an element of, and which one."""
        if term in (_ONE, _TIME):
            return term, 0
        if term in self.opened:
            self.sources[self.opened[term]] = 1
            return self.opened[term], 0
        block, _, number = term.partition(".")
        if block in self.blocks:
            size = self.blocks[block].size
            index = int(number) if number.isdecimal() else 0 if size == 1 and not number else -1
            if not 0 <= index < size:
                raise InvalidParameter(
                    key,
                    term,
                    message("parts.output_range", "{block}.0 to {block}.{last}", block=block, last=size - 1)
                    if size > 1
                    else block,
                )
            return block, index
        known = [*self.blocks, _ONE, _TIME]
        outputs = {} if self.site is None else self.site.outputs
        for signal in [] if self.site is None else self.site.outputs.signals:
            if signal.output not in outputs or signal.role in _AT_ONCE:
                continue
            for column in (f"{self.prefix}{term}", term):
                if column in signal.names:
                    self.sources[signal.output] = outputs[signal.output].size()
                    place = signal.names.index(column)
                    return signal.output, place if signal.entries is None else signal.entries[place]
            known += signal.names
        raise UnknownName(
            message("parts.block_or_signal", "block, or signal that is measured while stepping, for {key}", key=key),
            term,
            known,
        )


def flow_over_time(blocks: Mapping[str, Any], sums: Sequence[Sum], times: Vector) -> Vector:
    """Return sums of blocks of time alone at rising times (t,), shape (n, t); raises InvalidParameter: other blocks."""
    made = {name: _BLOCK.validate_python(block) for name, block in blocks.items() if block["kind"] != "input"}
    opened = Sums(kind="sum", of=({},))
    whole = {**dict.fromkeys(blocks, opened), **made, _TORQUE: Sums(kind="sum", of=tuple(sums))}
    builder = DiagramBuilder()
    port = _Net(None, "flow", "", whole, {}).add(builder, "flow")[_TORQUE]
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.get_mutable_integrator().set_target_accuracy(1e-6)
    context = simulator.get_mutable_context()
    rows = []
    for time in times:
        simulator.AdvanceTo(time)
        rows.append(port.Eval(diagram.GetSubsystemContext(port.get_system(), context)))
    return np.transpose(rows)


_BLOCK: TypeAdapter[FlowBlock] = TypeAdapter(FlowBlockConfig)


def _terms(terms: Sum) -> Mapping[str, float]:
    return {terms: 1.0} if isinstance(terms, str) else terms
