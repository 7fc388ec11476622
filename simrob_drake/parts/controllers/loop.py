"""Base class of loops, and the blocks by which several loops act together on the reference of a robot's servos.

A *loop* is a controller around the servos of a robot: a sampled block that reads signals of the station and changes the
reference that the servos follow. Loops of one robot are *layers* over its reference, sorted by their priorities: each
layer changes the reference that the layers below it leave. At the end, the sum is limited to the joint limits.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort
from pydrake.systems.primitives import Adder, AffineSystem, Multiplexer, Saturation

from simrob_drake.base.errors import InvalidParameter, UnknownName, Unsuitable, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.base.sections import Integer, Number, Positive
from simrob_drake.blocks.block import add_matrix_gain
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.parts.captions import wrap_label
from simrob_drake.parts.controllers.own import add_to, declare_output
from simrob_drake.parts.controllers.section import ControllerSection
from simrob_drake.parts.resolved import ResolvedRobot, StationContents
from simrob_drake.parts.sensors.sensor import Sensor
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot

if TYPE_CHECKING:
    from simrob_drake.parts.controllers.signal_flow import SignalFlow


@dataclass(frozen=True)
class LoopPorts:
    """Ports of a loop that has been added to a diagram.

    Attributes:
        inputs: input ports by name.
        outputs: output ports by name.
        units: unit of an output's values, by the output's name. An output that is missing here has the unit "1".
        components: names of an output's values in plots, by the output's name. An output that is missing here has none.
    """

    inputs: Mapping[str, InputPort]
    outputs: Mapping[str, OutputPort]
    units: Mapping[str, str]
    components: Mapping[str, Sequence[str]] = field(default_factory=dict)


ASKED = "asked"
"""Name of the input of a loop that is the reference below it, with the changes of loops of lower priority."""

# Samples may be shorter than the solver's steps by this part [1], since 1 / rate has rounding errors.
_ROUNDING = 1e-9
# Number of shared axes that an error lists.
_AXES_LISTED = 3

Weight = Annotated[Number, Field(gt=0, le=1)]


class LoopSection(ControllerSection):
    """A section of ``controllers`` that is a loop around the servos of a robot with n axes.

    The names of its block's outputs determine how it drives the axes. All other outputs are only signals.

    - ``offset`` (n) is added to the reference [rad or m].
    - ``target`` (n) replaces the reference while the output ``active`` (1) is not zero [rad or m].
    - ``offset_velocity`` (n) is added to the velocity of the reference, if the station has this input [rad/s or m/s].
    - ``feedforward`` (n) is added to the torques of the servos [N·m or N].

    An input ``asked`` (n) gets the reference below the loop [rad or m]. All other inputs get the output of the station
    that has the name of the input, unless ``reads`` names another one.
    """

    needs: ClassVar[tuple[Literal["feedforward"], ...]] = ()
    """Inputs of its robot that it drives in addition to the reference. The station gets these inputs."""
    label: ClassVar[str] = ""
    """Name of the kind as the block picture shows it. If it is empty, the word in the station's file is shown."""
    stages: ClassVar[tuple[str, ...]] = ()
    """What it does at each sample, one after the other, as the block picture shows it."""
    overrules_reference: ClassVar[bool] = False
    """Whether it sets the reference of all of its axes all the time, so that moves of these axes have no effect."""
    uppermost: ClassVar[bool] = False
    """Whether it is above all other loops of its robot, whatever their priorities."""

    robot: str | None = None
    """Robot that it drives; the only robot unless given."""
    rate: Positive = 100.0
    """Samples a second [Hz]."""
    reads: dict[str, str] = Field(default_factory=dict)
    """Sources that the loop reads in place of the true state, by input: a sensor (`position: encoders`), or any output
    of the station or of another controller."""
    priority: Integer | None = None
    """Order among the loops of a robot: a loop of higher priority is above the others, and its input `asked` contains
    their changes."""
    weight: Weight | None = None
    """Share of its changes that acts, more than 0 and at most 1; of a target, the rest is the reference below it. All
    unless given."""

    @property
    def read_names(self) -> list[str]:
        """Names that the user gives for what the loop reads: of sensors, of outputs, or of an output's column.

        Parts of a name are separated by dots, such as ``force.left``. An input without an entry in ``reads`` adds no
        name. So a kind with an input that itself has the name of a sensor's output must add this name.
        """
        return list(self.reads.values())

    @property
    def layer(self) -> tuple[bool, int]:
        """Sort key among the loops of a robot: a loop with a larger key is above."""
        return self.uppermost, self.priority or 0

    def check(self, key: str, station: StationContents) -> None:
        """Check the section before anything is built.

        Args:
            key: key of the section in the station file, such as ``controllers.balance``, for errors.
            station: contents of the station.

        Raises:
            SimrobError: the robot or an axis does not exist, the station is kinematic (nothing moves by forces), or the
                rate is higher than that of a discrete solver's steps.
        """
        robot = station.robot(self.robot, key)
        if not station.engine.moves_by_forces:
            raise Unsuitable(
                key,
                message(
                    "parts.no_loops_in_kinematic_station",
                    "a kinematic station has no servos, whose reference the loop would change",
                ),
                message("parts.leave_out_or_dynamic", "leave it out, or set mode: dynamic"),
            )
        # A discrete solver only sees the state at its own steps, so a loop cannot sample more often.
        time_step = station.engine.time_step
        if 1 / self.rate < time_step * (1 - _ROUNDING):
            expected = message(
                "parts.rate_of_solver",
                "at most {rate:g} Hz, one sample in each time_step of the discrete solver",
                rate=1 / time_step,
            )
            raise InvalidParameter(f"{key}.rate", compound("{rate:g} Hz", rate=self.rate), expected)
        self.axes(robot)  # it raises an error if an axis does not exist

    def on_feet(self, key: str, station: StationContents) -> ResolvedRobot:
        """Find the loop's robot, for a loop that only drives robots that stand on feet.

        Args:
            key: key of the section in the station file, for errors.
            station: contents of the station.

        Raises:
            SimrobError: there is no such robot, it has no feet, or its root link is fixed.

        Returns:
            The robot, whose ``feet`` are not None.
        """
        robot = station.robot(self.robot, key)
        if not robot.floats or robot.feet is None:
            raise Unsuitable(
                key,
                message(
                    "parts.not_on_own_feet",
                    "{robot} has no feet, or its base is fixed",
                    robot=robot.name,
                ),
                message("parts.robot_on_own_feet", "name a robot that stands on its own feet"),
            )
        return robot

    def warnings(self, key: str, robot: ResolvedRobot) -> list[str]:
        """Find settings of the section that have another effect than they seem to have.

        Args:
            key: key of the section in the station file, such as ``controllers.balance``.
            robot: robot of the loop.

        Returns:
            A sentence for each such setting. Kinds that have some override this method; here the list is empty.
        """
        return []

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Names of the axes that the loop drives. A kind that drives only some axes overrides this method.

        Raises:
            SimrobError: the section names an axis that the robot does not have.
        """
        return robot.axes

    def target_axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Names of those of its axes whose reference the loop's ``target`` replaces."""
        return self.axes(robot)

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the block of the loop. Each kind overrides this method, or `wire`, which calls it.

        Args:
            key: key of the section in the station file, for errors.
            robot: robot of the loop.
            site: the station under construction.
        """
        raise NotImplementedError

    def wire(
        self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site
    ) -> LoopPorts:
        """Add the block of the loop to the diagram, as ``controller.<name>``, and return its ports.

        Args:
            builder: builder of the diagram.
            name: name of the loop in the station file.
            robot: robot of the loop.
            site: the station under construction.
        """
        block = self._block(f"controllers.{name}", robot, site)
        builder.AddNamedSystem(f"controller.{name}", block)
        inputs = [block.get_input_port(index) for index in range(block.num_input_ports())]
        outputs = [block.get_output_port(index) for index in range(block.num_output_ports())]
        return LoopPorts(
            inputs={port.get_name(): port for port in inputs},
            outputs={port.get_name(): port for port in outputs},
            units=block.units,
            components=block.components,
        )

    def source(
        self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str
    ) -> OutputPort:
        """Find the output port of the station that an input of the loop reads.

        Args:
            builder: builder of the diagram. Blocks that compute the output may be added.
            name: name of the input.
            robot: robot of the loop.
            site: the station under construction.
            key: key of the section in the station file, for errors.

        Returns:
            The port: of the source that ``reads`` names for the input; without an entry, of the output that has the
            name of the input.

        Raises:
            UnknownName: there is no such output.
        """
        source = self.reads.get(name, "")
        # With several robots, the outputs of each begin with its prefix ("left."); with one robot, the prefix is empty.
        own_output = name if name.startswith(robot.prefix) else f"{robot.prefix}{name}"
        # An output with a rule from the plant's state gets a block of its own, which is faster than the station's.
        if not source and own_output in site.outputs.of_state:
            return add_output_of_state(builder, site, own_output)
        # ``reads: {position: encoders}`` means the output position.encoders, and ``reads: {force: force.left}`` the
        # output force.left itself. Without an entry, the robot's own output comes before one of the whole station.
        candidates = (f"{name}.{source}", source) if source else (f"{robot.prefix}{name}", name)
        for output in candidates:
            if output in site.outputs:
                return site.port(builder, output)
        what = message(
            "parts.readable_output",
            "sensor or output of the station for {key}.reads.{name}",
            key=key,
            name=name,
        )
        raise UnknownName(what, source or name, site.outputs)


keep_former_attributes(LoopSection, named="read_names", layered="target_axes")


def check_force_is_read(section: LoopSection, key: str) -> None:
    """Check that a loop that reads a force names its sensor.

    Args:
        section: section of the loop.
        key: key of the section, for errors.

    Raises:
        InvalidParameter: the section does not name one.
    """
    if "force" not in section.reads:
        raise InvalidParameter(
            f"{key}.reads",
            section.reads,
            message(
                "parts.with_force_sensor",
                "a mapping with a force sensor, {{force: <sensor>}}",
            ),
        )


def loops_of(controllers: Mapping[str, Any]) -> dict[str, LoopSection]:
    """Select the controllers that are loops, by name."""
    return {
        name: section for name, section in controllers.items() if isinstance(section, LoopSection)
    }


def flows_of(controllers: Mapping[str, Any]) -> "dict[str, SignalFlow]":
    """Select the controllers that are signal flows (nets of blocks below all loops), by name."""
    return {name: section for name, section in controllers.items() if section.is_flow}


def readers_of(controllers: Mapping[str, Any]) -> "dict[str, LoopSection | SignalFlow]":
    """Select the controllers that are loops or signal flows: their sections name what they read and drive."""
    return {**loops_of(controllers), **flows_of(controllers)}


def sensors_read(
    loops: "Mapping[str, LoopSection | SignalFlow]", sensors: Mapping[str, Sensor]
) -> set[str]:
    """Find the sensors that must take samples while a station is stepped.

    These are the sensors that the names of loops contain (`read_names`), those that sample in any case
    (`samples_while_stepping`), and those that these sensors read themselves.

    Args:
        loops: sections of the station's loops and signal flows, by name.
        sensors: sections of the station's sensors, by name.

    Returns:
        The names of the sensors.
    """
    # A loop reads ``force.left`` or ``left``: each part between the dots may be the name of a sensor. A part that only
    # has the same name as a sensor gives one sensor too many, which only costs time.
    read_parts = set[str]()
    for loop in loops.values():
        for name in loop.read_names:
            read_parts.update(name.split("."))

    found = set[str]()
    for name, sensor in sensors.items():
        if sensor.samples_while_stepping or name in read_parts:
            found.add(name)
            # The names of the sensors that this sensor reads, by its inputs.
            found.update(sensor.read(sensors).values())
    return found & set(sensors)


def add_output_of_state(builder: DiagramBuilder, site: Site, output: str) -> OutputPort:
    """Add a block that computes an output from the plant's state by a matrix, if it is not there yet.

    The station's own block of such an output, for example a base pose, is written in Python and is slower. The matrix
    is that of the output's rule (`FromState`), without the rule's function `finish`, which normalises quaternions:
    those of this block may have either sign, and their length is only 1 as precisely as the solver keeps it.

    Args:
        builder: builder of the diagram.
        site: the station under construction.
        output: name of the output, which must be one of ``site.outputs.of_state``.

    Returns:
        The port of the new block, or of the block that an earlier call has added.
    """
    name = f"{output}.of_state"
    if builder.HasSubsystemNamed(name):
        return builder.GetSubsystemByName(name).get_output_port()
    site.picture.draw_nothing(name)
    matrix = site.outputs.of_state[output].matrix(site.state.size())
    return add_matrix_gain(builder, name, matrix, site.state)


def check_loops(station: StationContents, loops: Mapping[str, LoopSection]) -> None:
    """Check each loop, and that the order or the shares of loops that drive the same axes are given.

    Args:
        station: contents of the station.
        loops: sections of the loops, by name.

    Raises:
        SimrobError: a section is wrong; or two loops drive the same axes with the same priority, and they do not both
            have a weight.
    """
    for name, loop in loops.items():
        loop.check(f"controllers.{name}", station)
    for first_name, second_name in combinations(loops, 2):
        first = loops[first_name]
        second = loops[second_name]
        robot = station.robot(first.robot, "controllers")
        drive_same_robot = robot is station.robot(second.robot, "controllers")
        # Weights of both, or different layers (priorities), determine how two loops act together on an axis.
        have_weights = first.weight is not None and second.weight is not None
        if not drive_same_robot or have_weights or first.layer != second.layer:
            continue
        axes_of_second = second.axes(robot)
        shared = [axis for axis in first.axes(robot) if axis in axes_of_second]
        if shared:
            raise _conflict(first_name, second_name, shared)


def _conflict(first: str, second: str, shared: Sequence[str]) -> InvalidParameter:
    """Make the error that two loops, given by their names, drive the same axes and nothing sets their order."""
    conflict = message(
        "parts.loops_share_axes",
        "controllers.{other} also drives {shared}{more}",
        shared=", ".join(shared[:_AXES_LISTED]),
        more=" ..." if len(shared) > _AXES_LISTED else "",
        other=first,
    )
    remedy = message(
        "parts.alone_on_axes", "give the two loops different priorities, or give both a weight"
    )
    return Unsuitable(f"controllers.{second}", conflict, remedy)


# Limit that an axis without limits is taken to have [rad or m].
_FAR = 1e3


def add_loops(builder: DiagramBuilder, site: Site, loops: Mapping[str, LoopSection]) -> None:
    """Add a station's loops to the diagram, declare their outputs, and let them drive the robots.

    Args:
        builder: builder of the diagram.
        site: the station under construction.
        loops: sections of the loops, by name.

    Raises:
        SimrobError: a section does not fit, or an input of a loop has no source of its size.
    """
    ports_of = dict[str, LoopPorts]()
    for name, section in loops.items():
        ports_of[name] = _add_loop(builder, site, name, section)
    # A loop can read outputs of all others, so inputs are connected when all loops have been added.
    for name, section in loops.items():
        _connect(builder, site, name, section, ports_of[name])
    for robot in site.plant.robots.values():
        # Names of the loops that drive this robot.
        own = [name for name, loop in loops.items() if site.robot(loop.robot) is robot]
        # The lowest layer first. Python's sort keeps the order of the file among equal ones.
        own.sort(key=lambda name: loops[name].layer)
        layers = {name: (loops[name], ports_of[name]) for name in own}
        if layers:
            _drive(builder, site, robot, layers)


def _add_loop(builder: DiagramBuilder, site: Site, name: str, section: LoopSection) -> LoopPorts:
    """Add one loop to the diagram, label it in the block picture and declare its outputs. Returns its ports."""
    robot = site.robot(section.robot)
    ports = section.wire(builder, name, robot, site)
    site.outputs.notes[name] = {"kind": section.kind}
    label = _block_label(name, section)
    site.picture.draw(f"controller.{name}", "loop", label, robot, inside=section.stages)
    for output, port in ports.outputs.items():
        # Offsets and targets of axes that the loop does not drive have no effect, and get no columns.
        match output:
            case "offset":
                axes = section.axes(robot)
            case "target":
                axes = section.target_axes(robot)
            case _:
                axes = robot.axes
        unit = ports.units.get(output, "1")
        components = ports.components.get(output, ())
        declare_output(site, name, port, unit, robot, axes, called=output, components=components)
    return ports


def _connect(
    builder: DiagramBuilder, site: Site, name: str, section: LoopSection, ports: LoopPorts
) -> None:
    """Connect the inputs of a loop to the outputs that it reads, except ``asked``, which `_drive` connects.

    Args:
        builder: builder of the diagram.
        site: the station under construction.
        name: name of the loop.
        section: section of the loop.
        ports: ports of the loop.

    Raises:
        SimrobError: ``reads`` names an input that the loop does not have, or an output that does not exist or has
            another size than the input.
    """
    key = f"controllers.{name}"
    robot = site.robot(section.robot)
    inputs = {input_name: port for input_name, port in ports.inputs.items() if input_name != ASKED}
    for input_name in section.reads:
        one_of(
            message("parts.input_for_reads", "input of {key} for {key}.reads", key=key),
            input_name,
            inputs,
        )
    for input_name, port in inputs.items():
        source = section.source(builder, input_name, robot, site, key)
        # Drake's own error would not name the key of the station.
        if source.size() != port.size():
            raise InvalidParameter(
                f"{key}.reads.{input_name}",
                message("parts.of_size", "of size {size}", size=source.size()),
                message("parts.of_size", "of size {size}", size=port.size()),
            )
        builder.Connect(source, port)


class _LayeredReference:
    """Reference of a robot with n axes, with the layers that were added so far. It is a sum of ports.

    Each block between reference and servos takes time at every step, so the terms are only added up when needed.
    """

    def __init__(self, builder: DiagramBuilder, site: Site, robot: StationRobot) -> None:
        """Begin with the reference alone, without layers.

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
        # Terms of the sum. None is the reference from outside of the station, which has no output port: the first block
        # that reads it becomes the station's input.
        self._terms: list[OutputPort | None] = [None]

    def add_term(self, port: OutputPort) -> None:
        """Add the values of a port (n) to the reference."""
        self._terms.append(port)

    def _replace_terms(self, name: str, block: LeafSystem, *further_inputs: OutputPort) -> None:
        """Add a block that reads all terms. Its output becomes the only term.

        If the reference from outside is one of the terms, the block's port for it becomes the station's input.

        Args:
            name: name of the block.
            block: the block, whose first inputs are the terms.
            *further_inputs: ports for the block's inputs after the terms.
        """
        self._builder.AddNamedSystem(name, block)
        for index, port in enumerate([*self._terms, *further_inputs]):
            if port is None:
                self._site.inputs[self._key] = block.get_input_port(index)
            else:
                self._builder.Connect(port, block.get_input_port(index))
        self._terms = [block.get_output_port()]

    def sum(self, name: str) -> OutputPort:
        """Port of the sum of all terms.

        A block of this name is added, and its output becomes the only term, if there are several terms, or if the only
        one is the reference from outside, which has no port.
        """
        if len(self._terms) > 1 or self._terms[0] is None:
            self._replace_terms(name, Adder(len(self._terms), self._size))
        (port,) = self._terms
        assert port is not None  # now, the only term is a block's output
        return port

    def limit(self) -> OutputPort:
        """Limit the sum to the joint limits by a block, whose output becomes the only term. Returns this output."""
        # The block of the limits has one input: several terms are added up first.
        if len(self._terms) > 1:
            self.sum(f"{self._key}.limits.sum")
        lower, upper = self._limits
        saturation = Saturation(lower, upper)
        self._replace_terms(f"{self._key}.limits", saturation)
        return saturation.get_output_port()

    def blend(self, name: str, target: OutputPort, active: OutputPort, share: Vector) -> None:
        """Blend the sum r with a target: (1 - share) r + share target while ``active`` is 1, and r while it is 0.

        It is made of Drake's linear blocks and saturations, so that no Python is called at each evaluation of the
        solver. They have no product with ``active``, so a switch is made of two saturated parts, of which at least one
        is 0. With the lower limit l of an axis, and a W larger than the range of its limits,

            switch = l + max(r - l - W active, 0) + max(target - l - W (1 - active), 0)

        is r if ``active`` is 0, and the target if it is 1, as long as both are within the limits: then W is above r - l
        and target - l. The blend is share switch + (1 - share) r. It becomes the only term of the sum.

        Args:
            name: prefix of the names of the blocks.
            target: port of the target, size n [rad or m].
            active: port of size 1, 0 or 1.
            share: share of the target for each axis, shape (n,), 0 to 1.
        """
        size = self._size
        # Indices of the k axes with a share. The other axes need no blend, and fewer rows make the block faster.
        axes = np.flatnonzero(share)
        term_count = len(self._terms)
        all_lower, all_upper = self._limits
        lower = np.clip(all_lower, -_FAR, _FAR)[axes]
        upper = np.clip(all_upper, -_FAR, _FAR)[axes]
        # W, as a column.
        wide = (upper - lower + 1.0)[:, None]
        identity = np.eye(size)
        # Matrix that picks the k axes with a share from all n axes, shape (k, n).
        pick = identity[axes]
        no_axes = np.zeros((len(axes), size))

        # Columns: the terms of r, the target, then active. Rows: r and the target of the axes, then all of r.
        bus = Multiplexer([size] * (term_count + 1) + [1])
        matrix = np.block(
            [
                [*[pick] * term_count, no_axes, -wide],
                [*[no_axes] * term_count, pick, wide],
                [*[identity] * term_count, np.zeros((size, size + 1))],
            ]
        )
        # The columns of all terms repeat, which adds the terms up to r.
        # Constants of the rows: -l of r, -l - W of the target, and nothing for r itself.
        constant = np.concatenate([-lower, -lower - wide[:, 0], np.zeros(size)])
        # The saturation: max(..., 0) for the two parts; r itself is not limited.
        least = np.concatenate([np.zeros(2 * len(axes)), np.full(size, -np.inf)])
        most = np.full(len(least), np.inf)
        # share (l + first part + second part) + (1 - share) r. The matrix `back` puts the k axes, times their shares,
        # to their places among all n axes.
        back = pick.T * share[axes]
        blend = np.hstack([back, back, identity - np.diag(share)])
        self._replace_terms(f"{name}.bus", bus, target, active)
        self._replace_terms(f"{name}.shown", AffineSystem(D=matrix, y0=constant))
        self._replace_terms(f"{name}.either", Saturation(least, most))
        self._replace_terms(f"{name}.layers", AffineSystem(D=blend, y0=back @ lower))


def _drive(
    builder: DiagramBuilder,
    site: Site,
    robot: StationRobot,
    layers: Mapping[str, tuple[LoopSection, LoopPorts]],
) -> None:
    """Connect the outputs of loops to the inputs of their robot: reference, its velocity, and feedforward.

    The reference is limited to the joint limits after all layers. Apart from the limits, blocks are only added for
    outputs that a loop has, and for its input ``asked``. An output ``offset_velocity`` has no effect if the station has
    no input for the velocity of the reference.

    Args:
        builder: builder of the diagram.
        site: the station under construction.
        robot: the robot.
        layers: section and ports of each loop, by name, the lowest layer first.
    """
    key = f"{robot.prefix}reference"
    identity = np.eye(len(robot.axes))
    # The port of the servos. It is looked up before the layers are added: a block that reads the reference from outside
    # takes its place in the inputs.
    robot_input = site.inputs[key]
    reference = _LayeredReference(builder, site, robot)
    torques = list[OutputPort]()
    speeds = list[OutputPort]()
    for name, (section, ports) in layers.items():
        outputs = ports.outputs
        # Without a weight, all of the loop's changes act.
        weight = section.weight or 1.0
        prefix = f"{key}.{name}"
        _draw_layers(site, prefix, robot)
        # The order matters: ``asked`` is the reference before the loop's own changes.
        if ASKED in ports.inputs:
            builder.Connect(reference.sum(f"{prefix}.asked"), ports.inputs[ASKED])
        if "offset" in outputs:
            offset = add_matrix_gain(
                builder, f"{prefix}.weight", weight * identity, outputs["offset"]
            )
            reference.add_term(offset)
        if "offset_velocity" in outputs and f"{robot.prefix}reference_velocity" in site.inputs:
            speed = add_matrix_gain(
                builder, f"{prefix}.speed", weight * identity, outputs["offset_velocity"]
            )
            speeds.append(speed)
        if "target" in outputs:
            # The target replaces the reference of its own axes only, to the share of the weight.
            has_target = np.isin(robot.axes, section.target_axes(robot))
            share = np.where(has_target, weight, 0.0)
            reference.blend(prefix, outputs["target"], outputs["active"], share)
        if "feedforward" in outputs:
            torque = add_matrix_gain(
                builder, f"{prefix}.torque", weight * identity, outputs["feedforward"]
            )
            torques.append(torque)
    builder.Connect(reference.limit(), robot_input)
    _draw_layers(site, f"{key}.limits", robot)
    for added_key, added in (("feedforward", torques), ("reference_velocity", speeds)):
        if added:
            full_key = f"{robot.prefix}{added_key}"
            add_to(builder, site, full_key, added, name="loops")
            _draw_layers(site, f"{full_key}.loops", robot)


def _block_label(name: str, section: LoopSection) -> str:
    """Label of a loop in the block picture: its name if it is not that of its kind, its kind, and its rate."""
    word = section.kind.replace("_", " ")
    kind_and_rate = compound("{kind}, {rate:g} Hz", kind=section.label or word, rate=section.rate)
    return kind_and_rate if word == name else join_texts([wrap_label(name), kind_and_rate], "\n")


def _draw_layers(site: Site, system: str, robot: StationRobot) -> None:
    """Draw systems as parts of the picture's one block that contains all layers over a robot's reference.

    Args:
        site: the station under construction.
        system: name of a system. Systems whose names begin with this name and a dot are drawn with it.
        robot: the robot.
    """
    label = message("parts.block_layers", "Reference\nand loops,\njoint limits")
    site.picture.draw(system, "loop", label, robot, key=f"{robot.prefix}layers")


if not TYPE_CHECKING:
    __getattr__ = former_names_of(
        __name__, {"Wired": "LoopPorts", "of_state": "add_output_of_state"}
    )
