"""What the kinds of loop share: whom they drive, what they read, and how several mix."""

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import AffineSystem, PassThrough, Saturation

from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.blocks.wiring import fed, joined, mapped, summed
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.parts.captions import wrapped
from simrob_drake.parts.site import ResolvedRobot, Site, StationRobot, Surroundings
from simrob_drake.quantities import Positive
from simrob_drake.signals import Panel, Signal
from simrob_drake.yaml_files import Number, Strict

_FAR = 1e3
"""Where an axis without limits is taken to end [rad or m]."""

Weight = Annotated[Number, Field(gt=0, le=1)]


class LoopSection(Strict):
    """A section of ``controllers`` that is a loop of the package's.

    A kind has its key ``kind`` and the methods ``axes(robot)``, the names of the axes that it drives, and
    ``block(key, robot, site)``, which makes its :class:`~simrob_drake.blocks.sampled.SampledBlock`. What that block
    gives tells how it drives them: ``offset`` (n) is added to the reference [rad or m], ``target`` (n) takes its place
    while ``active`` is not zero, ``feedforward`` (n) is added to the torques [N·m or N]; other outputs are signals.
    """

    needs: ClassVar[tuple[Literal["feedforward"], ...]] = ()
    """Inputs of robots that it drives beside the reference."""

    kind: str
    robot: str | None = None
    """Whom it drives; the only robot unless given."""
    rate: Positive = 100.0
    """Samples a second [Hz]."""
    reads: dict[str, str] = Field(default_factory=dict)
    """What it reads in place of the true state, by input: a sensor (`position: encoders`), or any output of the
    station or of another controller."""
    priority: int | None = None
    """Its place among the loops of a robot: one of higher priority lies above, and sees what is below driven first."""
    weight: Weight | None = None
    """How much of it shows above what is below it, 0 to 1; all unless given."""

    @property
    def named(self) -> list[str]:
        """What it reads by names of the user's: sensors, outputs, columns."""
        return list(self.reads.values())

    def check(self, key: str, station: Surroundings) -> None:
        """Check what is known before anything is built.

        Raises:
            SimrobError: no such robot or axis, or a station that no loop can drive.
        """
        robot = station.robot(self.robot, key)
        if station.mode != "dynamic":
            raise InvalidParameter(key, "in a kinematic station", "in a dynamic one: there is nothing to be measured")
        if 1 / self.rate < station.time_step * (1 - 1e-9):
            told = f"at most {1 / station.time_step:g} Hz, one sample in each time_step of the discrete solver"
            raise InvalidParameter(f"{key}.rate", f"{self.rate:g} Hz", told)
        self.axes(robot)

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the names of the axes that it drives."""
        raise NotImplementedError

    def layered(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return those of them whose reference it takes over."""
        return self.axes(robot)

    def block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Return the loop; ``key`` is where the section stands, for errors."""
        raise NotImplementedError

    def source(self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str) -> OutputPort:
        """Return the output that an input of the loop reads.

        Raises:
            UnknownName: nothing of that name is measured while stepping.
        """
        given = self.reads.get(name, "")
        direct = name if name.startswith(robot.prefix) else f"{robot.prefix}{name}"
        if not given and direct in site.of_state:
            return of_state(builder, site, direct)
        for output in (f"{name}.{given}", given) if given else (f"{robot.prefix}{name}", name):
            if output in site.outputs:
                return site.outputs[output]
        raise UnknownName(f"sensor or output of the station for {key}.reads.{name}", given or name, site.outputs)


def sensors_read(loops: Mapping[str, LoopSection], sensors: Collection[str]) -> set[str]:
    """Return the names of the sensors that loops read: those must sample while the station is stepped."""
    parts = {part for loop in loops.values() for text in loop.named for part in text.split(".")}
    return parts & set(sensors)


def of_state(builder: DiagramBuilder, site: Site, output: str) -> OutputPort:
    """Return what the plant's state tells at once, from blocks that need no Python: base poses above all.

    Quaternions are as the state has them: of either sign, and of length one as well as the solver keeps it.
    """
    name = f"{output}.of_state"
    if builder.HasSubsystemNamed(name):
        return builder.GetSubsystemByName(name).get_output_port()
    site.draw_nothing(name)
    return mapped(builder, name, site.of_state[output].matrix, site.state)


def check_loops(station: Surroundings, loops: Mapping[str, LoopSection]) -> None:
    """Check loops one by one, and that those which drive one axis say how they mix.

    Raises:
        InvalidParameter: two loops on one axis, of the same priority and not both with a weight.
    """
    for name, loop in loops.items():
        loop.check(f"controllers.{name}", station)
    for (one, first), (other, second) in combinations(loops.items(), 2):
        robots = [station.robot(loop.robot, "controllers") for loop in (first, second)]
        weighed = first.weight is not None and second.weight is not None
        if robots[0] is not robots[1] or weighed or first.priority != second.priority:
            continue
        shared = [axis for axis in first.axes(robots[0]) if axis in second.axes(robots[0])]
        if shared:
            told = f"drives {', '.join(shared[:3])}{' ...' if len(shared) > 3 else ''}, as controllers.{one} does"
            expected = "alone on its axes, or with a priority (or both with a weight), which says how they mix"
            raise InvalidParameter(f"controllers.{other}", told, expected)


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
        known = [blocks[name].get_input_port(index).get_name() for index in range(blocks[name].num_input_ports())]
        for read in section.reads:
            if read not in known:
                raise UnknownName(f"input of controllers.{name} for controllers.{name}.reads", read, known)
        for index in range(blocks[name].num_input_ports()):
            port = blocks[name].get_input_port(index)
            source = section.source(builder, port.get_name(), site.robot(section.robot), site, f"controllers.{name}")
            if source.size() != port.size():
                sizes = f"of size {source.size()}", f"of size {port.size()}"
                raise InvalidParameter(f"controllers.{name}.reads.{port.get_name()}", *sizes)
            builder.Connect(source, port)
    for robot in site.plant.robots.values():
        own = {name: loop for name, loop in loops.items() if site.robot(loop.robot) is robot}
        layers = sorted(own, key=lambda name: own[name].priority or 0)
        if layers:
            _drive(builder, site, robot, {name: (own[name], blocks[name]) for name in layers})


def declare_output(
    site: Site,
    name: str,
    port: OutputPort,
    unit: str,
    robot: StationRobot | None = None,
    axes: Collection[str] | None = None,
) -> None:
    """Declare an output of a controller as a signal, ``<controller>.<output>``; by axis where it has one value each.

    Of a robot's axes those are told that are named.
    """
    output, size = f"{name}.{port.get_name()}", port.size()
    robots = site.plant.robots.values() if robot is None else [robot]
    entries = next((each.axes for each in robots if len(each.axes) == size), [str(index) for index in range(size)])
    told = tuple(index for index, entry in enumerate(entries) if size == 1 or axes is None or entry in axes)
    names = (output,) if size == 1 else tuple(f"{output}.{entries[index]}" for index in told)
    panel = Panel(f"controller_{name}", f"the block '{name}'", port.get_name(), f"{port.get_name()} [{unit}]", names)
    picked = told if len(told) < size else None
    site.add(output, port, Signal(names, (unit,) * len(names), "own", output, picked, part=name, panel=panel))


def _drive(
    builder: DiagramBuilder, site: Site, robot: StationRobot, layers: Mapping[str, tuple[LoopSection, SampledBlock]]
) -> None:
    """Lay loops over the reference of a robot and its feedforward, the lowest first, within the joint limits."""
    size, key = len(robot.axes), f"{robot.prefix}reference"
    asked = builder.AddNamedSystem(f"{key}.asked", PassThrough(size))
    inner, site.inputs[key] = site.inputs[key], asked.get_input_port()
    port, torques = asked.get_output_port(), list[OutputPort]()
    for name, (section, block) in layers.items():
        outputs = {port.get_name(): port for port in _outputs(block)}
        weight, place = section.weight or 1.0, f"{key}.{name}"
        _draw(site, place, name, section, robot)
        if "offset" in outputs:
            added = mapped(builder, f"{place}.weight", weight * np.eye(size), outputs["offset"])
            port = summed(builder, f"{place}.sum", port, added)
        if "target" in outputs:
            share = np.where(np.isin(robot.axes, section.layered(robot)), weight, 0.0)
            limits = robot.model.axis_limits
            port = _laid_over(builder, place, port, outputs["target"], outputs["active"], share=share, limits=limits)
        if "feedforward" in outputs:
            torques.append(mapped(builder, f"{place}.torque", weight * np.eye(size), outputs["feedforward"]))
    limited = fed(builder, f"{key}.limits", Saturation(*robot.model.axis_limits), port)
    builder.Connect(limited, inner)
    _draw(site, f"{key}.limits", name, section, robot)
    if torques:
        _add_torques(builder, site, robot, torques)


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


def _add_torques(builder: DiagramBuilder, site: Site, robot: StationRobot, torques: Sequence[OutputPort]) -> None:
    key = f"{robot.prefix}feedforward"
    given = builder.AddNamedSystem(f"{key}.asked", PassThrough(len(robot.axes)))
    inner, site.inputs[key] = site.inputs[key], given.get_input_port()
    builder.Connect(summed(builder, f"{key}.loops", given.get_output_port(), *torques), inner)
    site.draw_nothing(key)


def _outputs(block: SampledBlock) -> list[OutputPort]:
    return [block.get_output_port(index) for index in range(block.num_output_ports())]
