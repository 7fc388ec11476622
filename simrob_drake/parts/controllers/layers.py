"""Lay loops over the reference of the servos, the lowest first, with blocks of Drake's between them."""

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import AffineSystem, PassThrough, Saturation

from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.blocks.wiring import fed, joined, mapped, summed
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.parts.captions import wrapped
from simrob_drake.parts.controllers.loop import ASKED, LoopSection
from simrob_drake.parts.controllers.outputs import add_to, declare_output
from simrob_drake.parts.site import Site, StationRobot

_FAR = 1e3
"""Where an axis without limits is taken to end [rad or m]."""


def add_loops(builder: DiagramBuilder, site: Site, loops: Mapping[str, LoopSection]) -> None:
    """Add the loops of a station and let them drive its robots.

    Raises:
        SimrobError: an input that reads nothing, or a section that does not fit its robot.
    """
    blocks = {}
    for name, section in loops.items():
        robot = site.robot(section.robot)
        block = blocks[name] = section.block(f"controllers.{name}", robot, site)
        builder.AddNamedSystem(f"controller.{name}", block)
        site.notes[name] = {"kind": section.kind}
        _draw(site, f"controller.{name}", name, section, robot)
        for port in _outputs(block):
            driven = {"offset": section.axes, "target": section.layered}.get(port.get_name())
            axes = robot.axes if driven is None else driven(robot)
            declare_output(site, name, port, block.units.get(port.get_name(), "1"), robot, axes)
    for name, section in loops.items():
        _connect(builder, site, name, section, blocks[name])
    for robot in site.plant.robots.values():
        own = {name: loop for name, loop in loops.items() if site.robot(loop.robot) is robot}
        layers = sorted(own, key=lambda name: own[name].priority or 0)
        if layers:
            _drive(builder, site, robot, {name: (own[name], blocks[name]) for name in layers})


def _connect(builder: DiagramBuilder, site: Site, name: str, section: LoopSection, block: SampledBlock) -> None:
    """Connect the inputs of a loop to what they read."""
    key, robot = f"controllers.{name}", site.robot(section.robot)
    ports = [block.get_input_port(index) for index in range(block.num_input_ports())]
    known = {port.get_name(): port for port in ports if port.get_name() != ASKED}
    for read in section.reads:
        if read not in known:
            raise UnknownName(f"input of {key} for {key}.reads", read, known)
    for read, port in known.items():
        source = section.source(builder, read, robot, site, key)
        if source.size() != port.size():
            raise InvalidParameter(f"{key}.reads.{read}", f"of size {source.size()}", f"of size {port.size()}")
        builder.Connect(source, port)


def _drive(
    builder: DiagramBuilder, site: Site, robot: StationRobot, layers: Mapping[str, tuple[LoopSection, SampledBlock]]
) -> None:
    """Lay loops over the reference of a robot and its feedforward, the lowest first, within the joint limits."""
    size, key = len(robot.axes), f"{robot.prefix}reference"
    asked = builder.AddNamedSystem(f"{key}.asked", PassThrough(size))
    inner, site.inputs[key] = site.inputs[key], asked.get_input_port()
    port, torques, speeds = asked.get_output_port(), list[OutputPort](), list[OutputPort]()
    for name, (section, block) in layers.items():
        outputs = {port.get_name(): port for port in _outputs(block)}
        weight, place = section.weight or 1.0, f"{key}.{name}"
        _draw(site, place, name, section, robot)
        if block.HasInputPort(ASKED):
            builder.Connect(port, block.GetInputPort(ASKED))
        if "offset" in outputs:
            added = mapped(builder, f"{place}.weight", weight * np.eye(size), outputs["offset"])
            port = summed(builder, f"{place}.sum", port, added)
        if "offset_velocity" in outputs and f"{robot.prefix}reference_velocity" in site.inputs:
            speeds.append(mapped(builder, f"{place}.speed", weight * np.eye(size), outputs["offset_velocity"]))
        if "target" in outputs:
            share = np.where(np.isin(robot.axes, section.layered(robot)), weight, 0.0)
            limits = robot.model.axis_limits
            port = _laid_over(builder, place, port, outputs["target"], outputs["active"], share=share, limits=limits)
        if "feedforward" in outputs:
            torques.append(mapped(builder, f"{place}.torque", weight * np.eye(size), outputs["feedforward"]))
    limited = fed(builder, f"{key}.limits", Saturation(*robot.model.axis_limits), port)
    builder.Connect(limited, inner)
    _draw(site, f"{key}.limits", name, section, robot)
    for key, added in (("feedforward", torques), ("reference_velocity", speeds)):
        if added:
            add_to(builder, site, f"{robot.prefix}{key}", added, name="loops")
            _draw(site, f"{robot.prefix}{key}.loops", name, section, robot)


def _draw(site: Site, system: str, name: str, section: LoopSection, robot: StationRobot) -> None:
    """Say that a system is part of a loop's block in the picture."""
    label = f"{wrapped(name)}\n{section.kind.replace('_', ' ')}, {section.rate:g} Hz"
    site.draw(system, "loop", label, robot, key=f"controller.{name}")


def _laid_over(
    builder: DiagramBuilder,
    place: str,
    below: OutputPort,
    above: OutputPort,
    active: OutputPort,
    *,
    share: Vector,
    limits: tuple[Vector, Vector],
) -> OutputPort:
    """Return (1 - share) below + share above where ``active`` is 1, and what is below where it is 0.

    Of Drake's primitives, so that no Python is asked at each look of the solver: with the lower limits l, and W wider
    than the limits, it is l + max(below - l - W active, 0) + max(above - l - W (1 - active), 0) on the axes that share.
    """
    size, axes = len(share), np.flatnonzero(share)
    lower, upper = (np.clip(bound, -_FAR, _FAR)[axes] for bound in limits)
    eye, wide, part = np.eye(size), (upper - lower + 1.0)[:, None], share[axes]
    pick, none = eye[axes], np.zeros((len(axes), size))
    shown = np.block([[pick, none, -wide], [none, pick, wide]])
    hidden = np.concatenate([-lower, -lower - wide[:, 0]])
    bus = joined(builder, f"{place}.bus", below, above, active)
    both = fed(builder, f"{place}.shown", AffineSystem(D=shown, y0=hidden), bus)
    either = fed(builder, f"{place}.either", Saturation(np.zeros(2 * len(axes)), np.full(2 * len(axes), np.inf)), both)
    back = pick.T * part
    mixed = AffineSystem(D=np.hstack([back, back, eye - np.diag(share)]), y0=back @ lower)
    return fed(builder, f"{place}.layers", mixed, joined(builder, f"{place}.mixed_bus", either, below))


def _outputs(block: SampledBlock) -> list[OutputPort]:
    return [block.get_output_port(index) for index in range(block.num_output_ports())]
