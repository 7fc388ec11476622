"""A control law as a net of blocks between what is measured and the torques."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from graphlib import CycleError
from itertools import accumulate
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer

from simrob_drake.blocks.monitor import Condition
from simrob_drake.blocks.signal_net import SignalNet, Wired
from simrob_drake.blocks.wiring import fed, joined
from simrob_drake.errors import InvalidParameter, UnknownName, one_of
from simrob_drake.parts.captions import wrapped
from simrob_drake.parts.controllers.flow_block import FlowBlock, Sum
from simrob_drake.parts.controllers.flow_blocks import (
    Compare,
    DeadZone,
    Function,
    Logic,
    Lookup,
    Product,
    Saturation,
    Step,
    Sums,
    Switch,
)
from simrob_drake.parts.controllers.flow_states import Delay, Integrator, RateLimiter, StateSpace, TransferFunction
from simrob_drake.parts.controllers.outputs import add_to, declare_output
from simrob_drake.parts.monitors.monitor import MonitorSection, add_monitor
from simrob_drake.parts.site import Site, Surroundings
from simrob_drake.yaml_files import Strict

_ONE, _TIME = "one", "time"
_AT_ONCE = ("effort", "estimate", "inertial")
"""Roles of signals that a torque changes at once: a law that reads one is an algebraic loop."""
_TORQUE = "torque"

FlowBlockConfig = Annotated[
    Sums | Product | Saturation | DeadZone | Integrator | StateSpace | TransferFunction | RateLimiter | Delay | Lookup
    | Compare | Logic | Switch | Function | Step,
    Field(discriminator="kind"),
]  # fmt: skip

BlockName = Annotated[str, Field(pattern=r"^[A-Za-z_]\w*$")]


class SignalFlow(Strict):
    """A control law of blocks that compute, filter and compare, as they are drawn in Simulink.

    Blocks read other blocks by their names (`Plant.1` is an element of an output of several), and signals of the
    station by those of its results (`q.joint_1`, `q_ref.joint_1`, `tcp.z`, a sensor's). Each block's output is a
    signal, ``<controller>.<block>``. Outputs are exact in time: blocks with states are part of the station's.
    """

    needs: ClassVar[tuple[Literal["feedforward"], ...]] = ("feedforward",)

    kind: Literal["signal_flow"]
    robot: str | None = None
    """Whom it drives; the only robot unless given."""
    blocks: dict[BlockName, FlowBlockConfig] = Field(default_factory=dict)
    """By name, in any order."""
    torque: dict[str, Sum]
    """What is added to the torque of the servos, by axis [N·m or N]."""
    stops: dict[BlockName, Sum] = Field(default_factory=dict)
    """What ends the run, by name: as soon as it is not 0."""

    @property
    def named(self) -> list[str]:
        """What it reads by names: signals of sensors and others."""
        sums = [*self.torque.values(), *(given for block in self._all.values() for given in block.inputs)]
        return sorted({name for given in sums for name in _terms(given)})

    @property
    def _all(self) -> dict[str, FlowBlock]:
        """Its blocks, and those that gather its outputs."""
        ends = {name: Sums(kind="sum", of=given) for name, given in self.stops.items()}
        return {**self.blocks, **ends}

    def check(self, key: str, station: Surroundings) -> None:
        """Check what is known before anything is built.

        Raises:
            SimrobError: no such robot, axis or block, or a station without torques.
        """
        robot = station.robot(self.robot, key)
        if station.mode != "dynamic":
            raise InvalidParameter(key, "in a kinematic station", "in a dynamic one: its output is a torque")
        for axis in self.torque:
            one_of(f"axis of {robot.name} for {key}.torque", axis, robot.axes)
        for name, block in self.blocks.items():
            block.check(f"{key}.blocks.{name}")
            if name in (_ONE, _TIME, _TORQUE, *self.stops):
                raise InvalidParameter(f"{key}.blocks.{name}", name, "another name: this one is taken")

    def add(self, builder: DiagramBuilder, site: Site, name: str, *, monitors: bool) -> OutputPort:
        """Add its blocks, and return the torques of its robot's axes, size n [N·m or N].

        Raises:
            SimrobError: a signal that is not there, or an algebraic loop.
        """
        robot = site.robot(self.robot)
        torque = Sums(kind="sum", of=tuple(self.torque.get(axis, {}) for axis in robot.axes))
        net = _Net(site, f"controllers.{name}", robot.prefix, {**self._all, _TORQUE: torque})
        ports = net.add(builder, f"controller.{name}")
        site.notes[name] = {"kind": self.kind}
        label = f"{wrapped(name)}\nsignal flow, {len(self.blocks)} blocks"
        site.draw(f"controller.{name}", "loop", label, robot)
        for block in (*self.blocks, *self.stops):
            declare_output(site, name, ports[block], "1", called=block)
            site.edges.extend(net.blocks[block].edges)
        for stop in self.stops:
            told = Condition(
                {f"{name}.{stop}": 1}, lambda value: 1.0 if value[0] else -1.0, lambda *_, stop=stop: f"{stop} is on"
            )
            add_monitor(builder if monitors else None, site, f"{name}_{stop}", MonitorSection(), told)
        return ports[_TORQUE]


def add_flows(builder: DiagramBuilder, site: Site, flows: Mapping[str, SignalFlow], *, monitors: bool = True) -> None:
    """Add the signal flows of a station, and let them drive its robots.

    Raises:
        SimrobError: a signal that is not there, or an algebraic loop.
    """
    torques: dict[str, list[OutputPort]] = {}
    for name, flow in flows.items():
        torques.setdefault(site.robot(flow.robot).name, []).append(flow.add(builder, site, name, monitors=monitors))
    for robot, ports in torques.items():
        add_to(builder, site, f"{site.plant.robots[robot].prefix}feedforward", ports, name="flows")


@dataclass
class _Net:
    """The blocks of one law, under construction; the places of values are those of a :class:`SignalNet`."""

    site: Site
    key: str
    prefix: str
    blocks: Mapping[str, FlowBlock]
    sources: dict[str, int] = field(default_factory=dict)

    def add(self, builder: DiagramBuilder, place: str) -> dict[str, OutputPort]:
        """Add the blocks as one, and return the outputs of all of them by name."""
        given = {name: [self._elements(name, terms) for terms in block.inputs] for name, block in self.blocks.items()}
        measured = sum(self.sources.values())
        owners = [*self.sources, *self.blocks]
        sizes = [*self.sources.values(), *(block.size for block in self.blocks.values())]
        starts = dict(zip(owners, accumulate(sizes, initial=2), strict=False)) | {_ONE: 0, _TIME: 1}
        wired = {
            name: Wired(self.blocks[name], [[(starts[o] + i, k) for (o, i), k in terms.items()] for terms in inputs])
            for name, inputs in given.items()
        }
        try:
            net = SignalNet(wired, measured)
        except CycleError as problem:
            expected = "no algebraic loop: something that takes time must lie in it, as an integrator"
            raise InvalidParameter(f"{self.key}.blocks", " → ".join(problem.args[1]), expected) from None
        except ValueError as problem:
            raise InvalidParameter(f"{self.key}.blocks", str(problem), "multiples of the shortest of them") from None
        read = [self.site.outputs[source] for source in self.sources]
        values = fed(builder, place, net, *([joined(builder, f"{place}.bus", *read)] if read else []))
        split = Demultiplexer([block.size for block in self.blocks.values()])
        fed(builder, f"{place}.split", split, values)
        return {name: split.get_output_port(index) for index, name in enumerate(self.blocks)}

    def _elements(self, name: str, given: Sum) -> dict[tuple[str, int], float]:
        """Return a sum by whose elements it takes, and which."""
        return {self._element(f"{self.key}.blocks.{name}.of", term): k for term, k in _terms(given).items()}

    def _element(self, key: str, term: str) -> tuple[str, int]:
        """Return the block or output of the station that a signal is an element of, and which one."""
        if term in (_ONE, _TIME):
            return term, 0
        block, _, number = term.partition(".")
        if block in self.blocks:
            size = self.blocks[block].size
            index = int(number) if number.isdecimal() else 0 if size == 1 and not number else -1
            if not 0 <= index < size:
                raise InvalidParameter(key, term, f"{block}.0 to {block}.{size - 1}" if size > 1 else block)
            return block, index
        known = [*self.blocks, _ONE, _TIME]
        for signal in self.site.signals:
            if signal.output not in self.site.outputs or signal.role in _AT_ONCE:
                continue
            for wanted in (f"{self.prefix}{term}", term):
                if wanted in signal.names:
                    self.sources[signal.output] = self.site.outputs[signal.output].size()
                    place = signal.names.index(wanted)
                    return signal.output, place if signal.entries is None else signal.entries[place]
            known += signal.names
        raise UnknownName(f"block, or signal that is measured while stepping, for {key}", term, known)


def _terms(given: Sum) -> Mapping[str, float]:
    return {given: 1.0} if isinstance(given, str) else given
