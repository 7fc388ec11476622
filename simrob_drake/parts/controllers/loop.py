"""What the kinds of loop share: whom they drive, what they read, and how several lie over the servos' reference."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort
from pydrake.systems.primitives import Adder, AffineSystem, Multiplexer, Saturation

from simrob_drake.base.errors import InvalidParameter, UnknownName, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.sections import Integer, Number, Positive
from simrob_drake.blocks.block import add_matrix_gain
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.parts.captions import wrap_label
from simrob_drake.parts.controllers.own import add_to, declare_output
from simrob_drake.parts.controllers.section import ControllerSection
from simrob_drake.parts.resolved import ResolvedRobot, Surroundings
from simrob_drake.parts.sensors.sensor import Sensor
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot

if TYPE_CHECKING:
    from simrob_drake.parts.controllers.signal_flow import SignalFlow


@dataclass(frozen=True)
class Wired:
    """A loop in a diagram: its ports by name, units of its outputs, ``1`` unless named, and names of their numbers."""

    inputs: Mapping[str, InputPort]
    outputs: Mapping[str, OutputPort]
    units: Mapping[str, str]
    components: Mapping[str, Sequence[str]] = field(default_factory=dict)


ASKED = "asked"
"""Name of the input of a loop that is the reference below it, with the changes of loops of lower priority."""

Weight = Annotated[Number, Field(gt=0, le=1)]


class LoopSection(ControllerSection):
    """A section of ``controllers`` that is a loop of the package's.

    What its block gives tells how it drives axes: ``offset`` (n) is added to the reference [rad or m], ``target`` (n)
    takes its place while ``active`` is not zero, ``offset_velocity`` (n) is added to the reference's velocity where the
    station has one [rad/s or m/s], ``feedforward`` (n) to the torques [N·m or N]; other outputs are signals. An input
    ``asked`` (n) is the reference as it is below the loop [rad or m].
    """

    needs: ClassVar[tuple[Literal["feedforward"], ...]] = ()  # inputs of robots that it drives beside the reference
    label: ClassVar[str] = ""
    """Name of the kind as the block picture shows it. If it is empty, the word in the station's file is shown."""
    stages: ClassVar[tuple[str, ...]] = ()
    """What it does at each sample, one after the other, as the block picture shows it."""
    overrules_reference: ClassVar[bool] = False
    """Whether it sets the reference of all of its axes all the time, so that moves of these axes have no effect."""
    uppermost: ClassVar[bool] = False  # whether it lies above all others, whatever their priorities

    robot: str | None = None
    """Whom it drives; the only robot unless given."""
    rate: Positive = 100.0
    """Samples a second [Hz]."""
    reads: dict[str, str] = Field(default_factory=dict)
    """What it reads in place of the true state, by input: a sensor (`position: encoders`), or any output of the
    station or of another controller."""
    priority: Integer | None = None
    """Its place among the loops of a robot: one of higher priority lies above, and sees what is below driven first."""
    weight: Weight | None = None
    """How much of it shows above what is below it, 0 to 1; all unless given."""

    @property
    def read_names(self) -> list[str]:
        """Names of the sensors, outputs and result columns that the loop reads, as the section writes them."""
        return list(self.reads.values())

    @property
    def layer(self) -> tuple[bool, int]:
        """Its place among the loops of a robot: the higher one lies above."""
        return self.uppermost, self.priority or 0

    def check(self, key: str, station: Surroundings) -> None:
        """Check what is known before building; raises SimrobError: no such robot or axis, or nothing to drive."""
        robot = station.robot(self.robot, key)
        if not station.engine.moves_by_forces:
            raise InvalidParameter(
                key,
                message("parts.in_kinematic_station", "in a kinematic station"),
                message("parts.in_dynamic_station", "in a dynamic one: there is nothing to be measured"),
            )
        time_step = station.engine.time_step
        if 1 / self.rate < time_step * (1 - 1e-9):
            expected = message(
                "parts.rate_of_solver",
                "at most {rate:g} Hz, one sample in each time_step of the discrete solver",
                rate=1 / time_step,
            )
            raise InvalidParameter(f"{key}.rate", compound("{rate:g} Hz", rate=self.rate), expected)
        self.axes(robot)

    def on_feet(self, key: str, station: Surroundings) -> ResolvedRobot:
        """Return whom it drives; raises SimrobError: no such robot, or one that does not stand on feet of its own."""
        robot = station.robot(self.robot, key)
        if not robot.floats or robot.feet is None:
            raise InvalidParameter(
                key,
                message("parts.loop_of_robot", "{kind} of {robot}", kind=self.kind, robot=robot.name),
                message("parts.robot_on_own_feet", "of a robot that stands on feet of its own"),
            )
        return robot

    def warnings(self, key: str, robot: ResolvedRobot) -> list[str]:
        """Return what will not go as the section says, in words; ``key`` is where that stands."""
        return []

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the names of the axes that it drives: all unless a kind says otherwise."""
        return robot.axes

    def layered(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return those of them whose reference it takes over."""
        return self.axes(robot)

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Return the loop; ``key`` is where the section stands, for errors."""
        raise NotImplementedError

    def wire(self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site) -> Wired:
        """Add the loop, as a block ``controller.<name>``."""
        block = builder.AddNamedSystem(f"controller.{name}", self._block(f"controllers.{name}", robot, site))
        inputs = [block.get_input_port(index) for index in range(block.num_input_ports())]
        outputs = [block.get_output_port(index) for index in range(block.num_output_ports())]
        return Wired(
            {port.get_name(): port for port in inputs},
            {port.get_name(): port for port in outputs},
            block.units,
            block.components,
        )

    def source(self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str) -> OutputPort:
        """Return the output that an input of the loop reads; raises UnknownName: nothing of that name is measured."""
        source = self.reads.get(name, "")
        direct = name if name.startswith(robot.prefix) else f"{robot.prefix}{name}"
        if not source and direct in site.outputs.of_state:
            return of_state(builder, site, direct)
        for output in (f"{name}.{source}", source) if source else (f"{robot.prefix}{name}", name):
            if output in site.outputs:
                return site.port(builder, output)
        raise UnknownName(
            message(
                "parts.readable_output", "sensor or output of the station for {key}.reads.{name}", key=key, name=name
            ),
            source or name,
            site.outputs,
        )


def check_force_is_read(section: LoopSection, key: str) -> None:
    """Check that a loop on a force names its sensor.

    Raises:
        InvalidParameter: it does not.
    """
    if "force" not in section.reads:
        raise InvalidParameter(
            f"{key}.reads",
            section.reads,
            message("parts.with_force_sensor", "with a force sensor: reads: {{force: <sensor>}}"),
        )


def loops_of(controllers: Mapping[str, Any]) -> dict[str, LoopSection]:
    """Select the controllers that are loops of this package, by name."""
    return {name: section for name, section in controllers.items() if isinstance(section, LoopSection)}


def flows_of(controllers: Mapping[str, Any]) -> "dict[str, SignalFlow]":
    """The controllers that are signal flows, by name."""
    return {name: section for name, section in controllers.items() if section.is_flow}


def readers_of(controllers: Mapping[str, Any]) -> "dict[str, LoopSection | SignalFlow]":
    """Select the controllers that are loops or signal flows: their sections name what they read and drive."""
    return {**loops_of(controllers), **flows_of(controllers)}


def sensors_read(loops: "Mapping[str, LoopSection | SignalFlow]", sensors: Mapping[str, Sensor]) -> set[str]:
    """Return the names of the sensors that must sample while a station is stepped: loops read them, or such sensors."""
    parts = {part for loop in loops.values() for text in loop.read_names for part in text.split(".")}
    stepped = {name: sensor for name, sensor in sensors.items() if sensor.stepped or name in parts}
    read = {other for sensor in stepped.values() for other in sensor.read(sensors).values()}
    return {*stepped, *read} & set(sensors)


def of_state(builder: DiagramBuilder, site: Site, output: str) -> OutputPort:
    """Return what the plant's state tells at once, from blocks that need no Python: base poses above all.

    Quaternions are as the state has them: of either sign, and of length one as well as the solver keeps it.
    """
    name = f"{output}.of_state"
    if builder.HasSubsystemNamed(name):
        return builder.GetSubsystemByName(name).get_output_port()
    site.picture.draw_nothing(name)
    return add_matrix_gain(builder, name, site.outputs.of_state[output].matrix(site.state.size()), site.state)


def check_loops(station: Surroundings, loops: Mapping[str, LoopSection]) -> None:
    """Check loops, and how those of one axis mix; raises InvalidParameter: of one priority, not all with a weight."""
    for name, loop in loops.items():
        loop.check(f"controllers.{name}", station)
    for (one, first), (other, second) in combinations(loops.items(), 2):
        robots = [station.robot(loop.robot, "controllers") for loop in (first, second)]
        weighed = first.weight is not None and second.weight is not None
        if robots[0] is not robots[1] or weighed or first.layer != second.layer:
            continue
        shared = [axis for axis in first.axes(robots[0]) if axis in second.axes(robots[0])]
        if shared:
            conflict = message(
                "parts.loops_share_axes",
                "driving {shared}{more}, as controllers.{other} is",
                shared=", ".join(shared[:3]),
                more=" ..." if len(shared) > 3 else "",
                other=one,
            )
            expected = message(
                "parts.alone_on_axes",
                "alone on its axes, or with a priority (or both with a weight), which says how they mix",
            )
            raise InvalidParameter(f"controllers.{other}", conflict, expected)


# Limit that an axis without limits is taken to have [rad or m].
_FAR = 1e3


def add_loops(builder: DiagramBuilder, site: Site, loops: Mapping[str, LoopSection]) -> None:
    """Add a station's loops and let them drive its robots; raises SimrobError: an input or a section does not fit."""
    wired = {}
    for name, section in loops.items():
        robot = site.robot(section.robot)
        wired[name] = section.wire(builder, name, robot, site)
        site.outputs.notes[name] = {"kind": section.kind}
        site.picture.draw(f"controller.{name}", "loop", _block_label(name, section), robot, inside=section.stages)
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
    key, robot = f"controllers.{name}", site.robot(section.robot)
    known = {read: port for read, port in wired.inputs.items() if read != ASKED}
    for read in section.reads:
        one_of(message("parts.input_for_reads", "input of {key} for {key}.reads", key=key), read, known)
    for read, port in known.items():
        source = section.source(builder, read, robot, site, key)
        if source.size() != port.size():
            raise InvalidParameter(
                f"{key}.reads.{read}",
                message("parts.of_size", "of size {size}", size=source.size()),
                message("parts.of_size", "of size {size}", size=port.size()),
            )
        builder.Connect(source, port)


class _Stack:
    """Reference of a robot, with the loops that were laid over it so far. It is a sum of ports.

    Each block between reference and servos takes time at every step, so the terms are only added up when needed.
    """

    def __init__(self, builder: DiagramBuilder, site: Site, robot: StationRobot) -> None:
        """Begin with the reference alone.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            robot: the robot.
        """
        self._builder = builder
        self._site = site
        self._key = f"{robot.prefix}reference"
        self._size = len(robot.axes)
        self._limits = robot.model.axis_limits
        self.ports: list[OutputPort | None] = [None]
        """Terms of the sum. None stands for the station's input, which has no port yet."""

    def feed(self, name: str, block: LeafSystem, *above: OutputPort) -> None:
        """Add a block, and connect its inputs to the terms and to further ports. Its output becomes the only term.

        Args:
            name: name of the block.
            block: the block.
            *above: ports for the inputs after the terms.
        """
        self._builder.AddNamedSystem(name, block)
        for index, port in enumerate([*self.ports, *above]):
            if port is None:
                self._site.inputs[self._key] = block.get_input_port(index)
            else:
                self._builder.Connect(port, block.get_input_port(index))
        self.ports = [block.get_output_port()]

    def sum(self, name: str) -> OutputPort:
        """Add up the terms, by a block of a name if one is needed, and return the port."""
        if len(self.ports) > 1 or self.ports[0] is None:
            self.feed(name, Adder(len(self.ports), self._size))
        assert self.ports[0] is not None
        return self.ports[0]

    def limit(self) -> OutputPort:
        """Limit the sum to the joint limits, and return the port."""
        if len(self.ports) > 1:
            self.sum(f"{self._key}.limits.sum")
        lower, upper = self._limits
        self.feed(f"{self._key}.limits", Saturation(lower, upper))
        return self.sum("")

    def lay_over(self, name: str, target: OutputPort, active: OutputPort, share: Vector) -> None:
        """Blend the sum r with a target: (1 - share) r + share target while ``active`` is 1, and r while it is 0.

        It is made of Drake's primitives, so that no Python is called at each evaluation of the solver. With the lower
        limit l of an axis, and a W larger than the range of its limits, the sum of two parts is formed that cannot be
        negative, of which one is always zero:

            l + max(r - l - W active, 0) + max(target - l - W (1 - active), 0)

        Args:
            name: prefix of the names of the blocks.
            target: port of the target, size n [rad or m].
            active: port of size 1, 0 or 1.
            share: share of the target for each axis, shape (n,), 0 to 1.
        """
        size = self._size
        axes = np.flatnonzero(share)
        term_count = len(self.ports)
        all_lower, all_upper = self._limits
        lower = np.clip(all_lower, -_FAR, _FAR)[axes]
        upper = np.clip(all_upper, -_FAR, _FAR)[axes]
        wide = (upper - lower + 1.0)[:, None]  # W
        identity = np.eye(size)
        pick = identity[axes]  # picks the axes with a share
        none = np.zeros((len(axes), size))

        # Columns: the terms of r, the target, then active. Rows: r and the target of the axes, then all of r.
        bus = Multiplexer([size] * (term_count + 1) + [1])
        matrix = np.block(
            [
                [*[pick] * term_count, none, -wide],
                [*[none] * term_count, pick, wide],
                [*[identity] * term_count, np.zeros((size, size + 1))],
            ]
        )
        constant = np.concatenate([-lower, -lower - wide[:, 0], np.zeros(size)])
        # The two parts are not below zero; r itself is not limited.
        least = np.concatenate([np.zeros(2 * len(axes)), np.full(size, -np.inf)])
        most = np.full(len(least), np.inf)
        # share (l + first part + second part) + (1 - share) r
        back = pick.T * share[axes]
        blend = np.hstack([back, back, identity - np.diag(share)])
        self.feed(f"{name}.bus", bus, target, active)
        self.feed(f"{name}.shown", AffineSystem(D=matrix, y0=constant))
        self.feed(f"{name}.either", Saturation(least, most))
        self.feed(f"{name}.layers", AffineSystem(D=blend, y0=back @ lower))


def _drive(
    builder: DiagramBuilder, site: Site, robot: StationRobot, layers: Mapping[str, tuple[LoopSection, Wired]]
) -> None:
    """Lay loops over the reference of a robot and its feedforward, within the joint limits.

    Args:
        builder: builder of the diagram.
        site: the station under construction.
        robot: the robot.
        layers: section and ports of each loop, by name, the one of lowest priority first.
    """
    key = f"{robot.prefix}reference"
    scale = np.eye(len(robot.axes))
    robot_input = site.inputs[key]
    stack = _Stack(builder, site, robot)
    torques = list[OutputPort]()
    speeds = list[OutputPort]()
    for name, (section, wired) in layers.items():
        outputs = wired.outputs
        weight = section.weight or 1.0
        place = f"{key}.{name}"
        _draw_layers(site, place, robot)
        if ASKED in wired.inputs:
            builder.Connect(stack.sum(f"{place}.asked"), wired.inputs[ASKED])
        if "offset" in outputs:
            stack.ports.append(add_matrix_gain(builder, f"{place}.weight", weight * scale, outputs["offset"]))
        if "offset_velocity" in outputs and f"{robot.prefix}reference_velocity" in site.inputs:
            speeds.append(add_matrix_gain(builder, f"{place}.speed", weight * scale, outputs["offset_velocity"]))
        if "target" in outputs:
            share = np.where(np.isin(robot.axes, section.layered(robot)), weight, 0.0)
            stack.lay_over(place, outputs["target"], outputs["active"], share)
        if "feedforward" in outputs:
            torques.append(add_matrix_gain(builder, f"{place}.torque", weight * scale, outputs["feedforward"]))
    builder.Connect(stack.limit(), robot_input)
    _draw_layers(site, f"{key}.limits", robot)
    for added_key, added in (("feedforward", torques), ("reference_velocity", speeds)):
        if added:
            add_to(builder, site, f"{robot.prefix}{added_key}", added, name="loops")
            _draw_layers(site, f"{robot.prefix}{added_key}.loops", robot)


def _block_label(name: str, section: LoopSection) -> str:
    """Label of a loop in the block picture: its name, what it is, and its rate."""
    word = section.kind.replace("_", " ")
    kind_and_rate = compound("{kind}, {rate:g} Hz", kind=section.label or word, rate=section.rate)
    # A loop that is named as its kind is not named twice.
    return kind_and_rate if word == name else join_texts([wrap_label(name), kind_and_rate], "\n")


def _draw_layers(site: Site, system: str, robot: StationRobot) -> None:
    """Draw a system as a part of the block that lays loops over the reference."""
    label = message("parts.block_layers", "Reference\nand loops,\njoint limits")
    site.picture.draw(system, "loop", label, robot, key=f"{robot.prefix}layers")
