"""Lay loops over the reference of the servos, the lowest first, with blocks of Drake's between them."""

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import Adder, AffineSystem, Multiplexer, Saturation

from simrob_drake.blocks.wiring import mapped
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.parts.captions import wrapped
from simrob_drake.parts.controllers.loop import ASKED, LoopSection, Wired
from simrob_drake.parts.controllers.outputs import add_to, declare_output
from simrob_drake.parts.site import Site, StationRobot

_FAR = 1e3
"""Where an axis without limits is taken to end [rad or m]."""


def add_loops(builder: DiagramBuilder, site: Site, loops: Mapping[str, LoopSection]) -> None:
    """Add the loops of a station and let them drive its robots.

    Raises:
        SimrobError: an input that reads nothing, or a section that does not fit its robot.
    """
    wired = {}
    for name, section in loops.items():
        robot = site.robot(section.robot)
        wired[name] = section.wire(builder, name, robot, site)
        site.notes[name] = {"kind": section.kind}
        kind = section.kind.replace("_", " ")
        label = f"{wrapped(name)}\n{kind}, {section.rate:g} Hz" if kind != name else f"{kind}, {section.rate:g} Hz"
        site.draw(f"controller.{name}", "loop", label, robot, inside=section.stages)
        for output, port in wired[name].outputs.items():
            driven = {"offset": section.axes, "target": section.layered}.get(output)
            axes = robot.axes if driven is None else driven(robot)
            unit, components = wired[name].units.get(output, "1"), wired[name].components.get(output, ())
            declare_output(site, name, port, unit, robot, axes, called=output, components=components)
    for name, section in loops.items():
        _connect(builder, site, name, section, wired[name])
    for robot in site.plant.robots.values():
        own = {name: loop for name, loop in loops.items() if site.robot(loop.robot) is robot}
        layers = sorted(own, key=lambda name: own[name].layer)
        if layers:
            _drive(builder, site, robot, {name: (own[name], wired[name]) for name in layers})


def _connect(builder: DiagramBuilder, site: Site, name: str, section: LoopSection, wired: Wired) -> None:
    """Connect the inputs of a loop to what they read."""
    key, robot = f"controllers.{name}", site.robot(section.robot)
    known = {read: port for read, port in wired.inputs.items() if read != ASKED}
    for read in section.reads:
        if read not in known:
            raise UnknownName(f"input of {key} for {key}.reads", read, known)
    for read, port in known.items():
        source = section.source(builder, read, robot, site, key)
        if source.size() != port.size():
            raise InvalidParameter(f"{key}.reads.{read}", f"of size {source.size()}", f"of size {port.size()}")
        builder.Connect(source, port)


class _Stack:
    """What a robot is asked, as far as loops have been laid over it: a sum of ports.

    Each block between reference and servos takes time at every step: so there are as few of them as can be.

    Attributes:
        ports: that are added up; None is the input of the station.
    """

    def __init__(self, builder: DiagramBuilder, site: Site, robot: StationRobot) -> None:
        self._builder, self._site, self._key = builder, site, f"{robot.prefix}reference"
        self._size, self._limits = len(robot.axes), robot.model.axis_limits
        self.ports: list[OutputPort | None] = [None]

    def feed(self, name: str, block: LeafSystem, *above: OutputPort) -> None:
        """Feed a block with the ports, and others above them; its output takes their place."""
        self._builder.AddNamedSystem(name, block)
        for index, port in enumerate([*self.ports, *above]):
            if port is None:
                self._site.inputs[self._key] = block.get_input_port(index)
            else:
                self._builder.Connect(port, block.get_input_port(index))
        self.ports = [block.get_output_port()]

    def sum(self, name: str) -> OutputPort:
        """Return the sum as a port."""
        if len(self.ports) > 1 or self.ports[0] is None:
            self.feed(name, Adder(len(self.ports), self._size))
        assert self.ports[0] is not None
        return self.ports[0]

    def limit(self) -> OutputPort:
        """Return the sum within the joint limits."""
        if len(self.ports) > 1:
            self.sum(f"{self._key}.limits.sum")
        self.feed(f"{self._key}.limits", Saturation(*self._limits))
        return self.sum("")

    def lay_over(self, name: str, target: OutputPort, active: OutputPort, share: Vector) -> None:
        """Let it be (1 - share) of what it was and share of a target where ``active`` is 1; as it was where that is 0.

        Of Drake's primitives, so that no Python is asked at each look of the solver: with the lower limits l, and W
        wider than the limits, it is l + max(below - l - W active, 0) + max(target - l - W (1 - active), 0) on the axes
        that share.
        """
        size, axes, count = self._size, np.flatnonzero(share), len(self.ports)
        lower, upper = (np.clip(bound, -_FAR, _FAR)[axes] for bound in self._limits)
        eye, wide, part, far = np.eye(size), (upper - lower + 1.0)[:, None], share[axes], np.full(size, np.inf)
        pick, none = eye[axes], np.zeros((len(axes), size))
        bus = Multiplexer([size] * (count + 1) + [1])
        shown = np.block(
            [
                [*[pick] * count, none, -wide],
                [*[none] * count, pick, wide],
                [*[eye] * count, np.zeros((size, size + 1))],
            ]
        )
        hidden = np.concatenate([-lower, -lower - wide[:, 0], np.zeros(size)])
        least = np.concatenate([np.zeros(2 * len(axes)), -far])
        back = pick.T * part
        self.feed(f"{name}.bus", bus, target, active)
        self.feed(f"{name}.shown", AffineSystem(D=shown, y0=hidden))
        self.feed(f"{name}.either", Saturation(least, np.full(len(least), np.inf)))
        self.feed(f"{name}.layers", AffineSystem(D=np.hstack([back, back, eye - np.diag(share)]), y0=back @ lower))


def _drive(
    builder: DiagramBuilder, site: Site, robot: StationRobot, layers: Mapping[str, tuple[LoopSection, Wired]]
) -> None:
    """Lay loops over the reference of a robot and its feedforward, the lowest first, within the joint limits."""
    size, key = len(robot.axes), f"{robot.prefix}reference"
    inner, stack, torques, speeds = (
        site.inputs[key],
        _Stack(builder, site, robot),
        list[OutputPort](),
        list[OutputPort](),
    )
    for name, (section, wired) in layers.items():
        outputs = wired.outputs
        weight, place = section.weight or 1.0, f"{key}.{name}"
        _draw_layers(site, place, robot)
        if ASKED in wired.inputs:
            builder.Connect(stack.sum(f"{place}.asked"), wired.inputs[ASKED])
        if "offset" in outputs:
            stack.ports.append(mapped(builder, f"{place}.weight", weight * np.eye(size), outputs["offset"]))
        if "offset_velocity" in outputs and f"{robot.prefix}reference_velocity" in site.inputs:
            speeds.append(mapped(builder, f"{place}.speed", weight * np.eye(size), outputs["offset_velocity"]))
        if "target" in outputs:
            share = np.where(np.isin(robot.axes, section.layered(robot)), weight, 0.0)
            stack.lay_over(place, outputs["target"], outputs["active"], share)
        if "feedforward" in outputs:
            torques.append(mapped(builder, f"{place}.torque", weight * np.eye(size), outputs["feedforward"]))
    builder.Connect(stack.limit(), inner)
    _draw_layers(site, f"{key}.limits", robot)
    for key, added in (("feedforward", torques), ("reference_velocity", speeds)):
        if added:
            add_to(builder, site, f"{robot.prefix}{key}", added, name="loops")
            _draw_layers(site, f"{robot.prefix}{key}.loops", robot)


def _draw_layers(site: Site, system: str, robot: StationRobot) -> None:
    """Say that a system is part of the block that lays loops over the reference."""
    label = "Reference\nand loops,\njoint limits"
    site.draw(system, "loop", label, robot, key=f"{robot.prefix}layers")
