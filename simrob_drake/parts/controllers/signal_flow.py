"""Signal flows: control laws as nets of small blocks, between measured signals and torques, forces and stops.

A *flow* is a section of ``controllers`` with blocks by name. Each input of a block is a sum of *terms*, which are names
with factors: of another block (``Plant``, or ``Plant.1`` for an element of an output of several), of a column of the
station's results (``q.joint_1``), or of the constant ``one`` and the ``time``. All blocks of a flow become one system
of the diagram, the *net*. Its input is the vector of the *measured* values, which it reads from outputs of the station.
A *stop* is a signal of a flow that ends the run once it is not 0.
"""

from collections.abc import Iterator, Mapping, Sequence
from graphlib import CycleError
from itertools import accumulate
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, TypeAdapter
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer, PassThrough

from simrob_drake.base.errors import InvalidParameter, UnknownName, Unsuitable, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message, message_of
from simrob_drake.base.sections import Strict, Triple
from simrob_drake.base.signals import Signal, applied_signal
from simrob_drake.blocks.block import add_and_connect, add_multiplexer
from simrob_drake.blocks.monitor import Condition, Trigger
from simrob_drake.blocks.passive_joints import add_external_force
from simrob_drake.blocks.signal_net import signal_net
from simrob_drake.blocks.written_net import FIRST_MEASURED, WiredBlock
from simrob_drake.parts.captions import InnerBlock, wrap_label
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
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import check_frame, frame_of

# Names of the constant 1 and of the time in sums.
_ONE = "one"
_TIME = "time"
# Name of the block that adds up the torques of a flow. No other block may have it.
_TORQUE = "torque"
# Roles of signals that a torque changes at once: a flow that reads one of them would be an algebraic loop.
_INSTANT_ROLES = ("effort", "estimate", "inertial")
# Largest count of blocks that the picture of a station shows one by one.
_MOST_DRAWN_BLOCKS = 12

FlowBlockConfig = Annotated[
    Sums | Product | Saturation | DeadZone | Integrator | StateSpace | TransferFunction | Pid | RateLimiter
    | ZeroOrderHold | Delay | Lookup | Compare | Logic | Switch | MathFunction | Step | Input,
    Field(discriminator="kind"),
]  # fmt: skip

BlockName = Annotated[str, Field(pattern=r"^[A-Za-z_]\w*$")]
"""Name of a block, force or stop, without dots: after a dot comes the index of an element."""


class FlowForce(Strict):
    """Force or torque by which a signal flow acts on a body, along the axes of the frame at which it acts."""

    at: str
    """Link or tool of a robot, or piece, at whose origin the force acts."""
    point: Triple = (0.0, 0.0, 0.0)
    """Point in that frame at which the force acts instead [m]."""
    force: tuple[Sum, Sum, Sum] | None = None
    """Force along x, y and z [N]."""
    torque: tuple[Sum, Sum, Sum] | None = None
    """Torque about x, y and z [N·m]."""

    def sums(self, name: str) -> dict[str, Sums]:
        """Create the blocks that add up the signals of the force and of the torque.

        Args:
            name: name of the force.

        Returns:
            The blocks by their names, which are also the names of the station's outputs. Without a force or a torque,
            its block is left out.
        """
        blocks = dict[str, Sums]()
        if self.force is not None:
            blocks[_force_output(name)] = Sums(kind="sum", of=self.force)
        if self.torque is not None:
            blocks[_torque_output(name)] = Sums(kind="sum", of=self.torque)
        return blocks

    def apply(
        self, builder: DiagramBuilder, site: Site, name: str, ports: Mapping[str, OutputPort]
    ) -> None:
        """Apply the force and the torque to the body, and declare them as outputs of the station.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the force.
            ports: ports of the blocks of `sums`, by name, size 3 each [N or N·m].
        """
        if self.force is not None:
            title = message(
                "parts.applied_force",
                "applied force '{name}' at {place}, in its axes",
                name=name,
                place=self.at,
            )
            output = _force_output(name)
            self._apply_vector(builder, site, output, ports[output], is_torque=False)
            label = message(
                "parts.block_applied_force", "Force '{name}'\nat {place}", name=name, place=self.at
            )
            site.picture.draw(output, "force", label)
            site.outputs.add(output, ports[output], applied_signal(output, "N", title, part=name))
        if self.torque is not None:
            title = message(
                "parts.applied_torque",
                "applied torque '{name}' at {place}, in its axes",
                name=name,
                place=self.at,
            )
            output = _torque_output(name)
            self._apply_vector(builder, site, output, ports[output], is_torque=True)
            label = message(
                "parts.block_applied_torque",
                "Torque '{name}'\nat {place}",
                name=name,
                place=self.at,
            )
            site.picture.draw(output, "force", label)
            site.outputs.add(output, ports[output], applied_signal(output, "N·m", title, part=name))

    def _apply_vector(
        self,
        builder: DiagramBuilder,
        site: Site,
        block_name: str,
        port: OutputPort,
        *,
        is_torque: bool,
    ) -> None:
        """Add the block that lets a force or a torque act on the plant; the station gathers its forces at the end.

        Args:
            builder: builder of the diagram.
            site: the station under construction, to whose forces the port of the block is appended.
            block_name: name of the block.
            port: port of the force or torque, size 3, in the axes of the frame at which it acts [N or N·m].
            is_torque: whether it is a torque.
        """
        frame = frame_of(site.plant, self.at)
        block = add_external_force(
            builder,
            site.plant.plant_block,
            frame,
            name=block_name,
            point=self.point,
            turns=is_torque,
        )
        builder.Connect(port, block.get_command_input_port())
        site.spatial_forces.append(block.get_spatial_forces_output_port())


def _force_output(name: str) -> str:
    """Name of the station's output for the force of a name."""
    return f"applied_force.{name}"


def _torque_output(name: str) -> str:
    """Name of the station's output for the torque of a force's name."""
    return f"applied_torque.{name}"


class SignalFlow(ControllerSection):
    """A control law of blocks that compute, filter and compare, like a block diagram of Simulink.

    Blocks read other blocks by their names (`Plant.1` is an element of an output of several), and signals of the
    station by those of its results (`q.joint_1`, `q_ref.joint_1`, `tcp.z`, a sensor's). Each block's output is a
    signal, ``<controller>.<block>``. Continuous blocks are exact in time: the station's solver integrates their states.
    """

    is_flow: ClassVar[bool] = True

    kind: Literal["signal_flow"]
    robot: str | None = None
    """Robot that the flow drives; if it is left out, the only robot. A flow without ``torque`` needs none."""
    blocks: dict[BlockName, FlowBlockConfig] = Field(default_factory=dict)
    """Blocks by name, in any order."""
    torque: dict[str, Sum] = Field(default_factory=dict)
    """Torques that are added to those of the servos, by axis [N·m or N]."""
    forces: dict[BlockName, FlowForce] = Field(default_factory=dict)
    """Forces and torques on bodies, by name."""
    stops: dict[BlockName, Sum] = Field(default_factory=dict)
    """Signals that end the run as soon as they are not 0, by the name of the stop."""
    signals: tuple[BlockName, ...] | None = None
    """Blocks whose outputs are signals of the station; all if it is left out."""

    @property
    def needs(self) -> tuple[Literal["feedforward"], ...]:
        """Inputs of its robot that the flow drives."""
        return ("feedforward",) if self.torque else ()

    @property
    def read_names(self) -> list[str]:
        """Names of all terms that the flow reads, sorted: blocks, columns of the results, ``one``, ``time``."""
        # The sums of stops and forces are among the computed blocks, the sum of torques is not.
        sums = list(self.torque.values())
        for block in self._computed_blocks.values():
            sums += block.inputs
        names = set[str]()
        for terms in sums:
            names.update(_factors(terms))
        return sorted(names)

    @property
    def _computed_blocks(self) -> dict[str, FlowBlock]:
        """Blocks that the net computes, by name: all but the inputs, and the sums of stops and forces.

        A sum has the name of its stop, or of the station's output that shows the force.
        """
        blocks: dict[str, FlowBlock] = {
            name: block for name, block in self.blocks.items() if not isinstance(block, Input)
        }
        for name, terms in self.stops.items():
            blocks[name] = Sums(kind="sum", of=terms)
        for name, force in self.forces.items():
            blocks.update(force.sums(name))
        return blocks

    def check(self, key: str, station: StationContents) -> None:
        """Check what can be checked before the station is built.

        Args:
            key: key of the section, for errors.
            station: contents of the station.

        Raises:
            SimrobError: a robot, axis, frame or block does not exist, a block is wrong or its name is taken, or the
                station is kinematic (nothing moves by forces).
        """
        if not station.engine.moves_by_forces:
            raise Unsuitable(
                key,
                message(
                    "parts.no_flows_in_kinematic_station",
                    "a kinematic station has no torques and forces, which the flow would drive",
                ),
                message("parts.leave_out_or_dynamic", "leave it out, or set mode: dynamic"),
            )
        if self.torque or self.robot is not None:
            robot = station.robot(self.robot, key)
            for axis in self.torque:
                kind = message(
                    "parts.axis_for_torque",
                    "axis of {robot} for {key}.torque",
                    robot=robot.name,
                    key=key,
                )
                one_of(kind, axis, robot.axes)
        for name, force in self.forces.items():
            check_frame(station, f"{key}.forces.{name}.at", force.at)
        # Names of terms are checked when the net is built, since only then all signals of the station are known.
        for name, block in self.blocks.items():
            block.check(f"{key}.blocks.{name}")
            if name in (_ONE, _TIME, _TORQUE, *self.stops):
                raise InvalidParameter(
                    f"{key}.blocks.{name}",
                    name,
                    message(
                        "parts.name_is_taken",
                        "another name: one, time, torque and the names of stops are taken",
                    ),
                )
        for name in self.signals or ():
            one_of(
                message("parts.block_for_signals", "block for {key}.signals", key=key),
                name,
                self.blocks,
            )

    def add(
        self,
        builder: DiagramBuilder,
        site: Site,
        name: str,
        *,
        monitors: bool,
        integrated: bool = True,
    ) -> OutputPort | None:
        """Add the blocks of the flow to the diagram, with its inputs, outputs, forces and stops.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the flow.
            monitors: whether stops get blocks that end the run. Otherwise they are only registered in the station's
                outputs, for the code that steps the station to evaluate.
            integrated: whether the diagram may have continuous states. Drake then asks all systems for derivatives,
                also a net without states.

        Returns:
            The port of the torques of the flow's robot, size n [N·m or N]. None if the flow gives no torques.

        Raises:
            SimrobError: a term names no signal, there is an algebraic loop, or the periods of blocks do not fit.
        """
        robot = site.robot(self.robot) if self.torque or self.robot is not None else None
        blocks = self._computed_blocks
        if robot is not None and self.torque:
            # One input for each axis of the robot; an empty sum, which is 0, for axes without a torque.
            torques = tuple(self.torque.get(axis, {}) for axis in robot.axes)
            blocks[_TORQUE] = Sums(kind="sum", of=torques)
        site.outputs.notes[name] = {"kind": self.kind}
        station_inputs = self._add_station_inputs(builder, site, name)
        # A flow that computes nothing has no net. It is empty, has forces that add up no signals, or only has blocks of
        # the kind `input`, which other controllers read.
        if not blocks:
            return None

        prefix = robot.prefix if robot else ""
        net = _FlowNet(site, f"controllers.{name}", prefix, blocks, station_inputs)
        ports = net.add(builder, f"controller.{name}", integrated=integrated)
        self._draw(site, name, robot, net)

        signals = self.blocks if self.signals is None else self.signals
        for block, port in ports.items():
            # Monitors of stops read the outputs of the station, so stops are always among them.
            # The units of a law are the user's own, so outputs of blocks are declared without one.
            if block in signals or block in self.stops:
                declare_output(site, name, port, "1", called=block)
            site.edges.extend(blocks[block].edges)
        for stop in self.stops:
            trigger = Trigger(_stop_condition(name, stop))
            add_monitor(builder if monitors else None, site, f"{name}_{stop}", trigger)
        # Blocks of the net have given the forces their signals; here they act on bodies.
        for force_name, force in self.forces.items():
            force.apply(builder, site, force_name, ports)
        return ports.get(_TORQUE)

    def _add_station_inputs(self, builder: DiagramBuilder, site: Site, name: str) -> dict[str, str]:
        """Add an input of the station for each block of the kind ``input``. Its value is an output of the flow, too.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the flow.

        Returns:
            The name of the input, ``<flow>.<block>``, by the name of the block.
        """
        station_inputs = dict[str, str]()
        for block_name, block in self.blocks.items():
            if not isinstance(block, Input):
                continue
            # The net has a single input port for all measured values. A PassThrough gives the input a port of its own.
            input_name = f"{name}.{block_name}"
            system = builder.AddNamedSystem(input_name, PassThrough(1))
            site.inputs[input_name] = system.get_input_port()
            declare_output(site, name, system.get_output_port(), "1", called=block_name)
            station_inputs[block_name] = input_name
        return station_inputs

    def _draw(self, site: Site, name: str, robot: StationRobot | None, net: "_FlowNet") -> None:
        """Draw the flow in the picture of the station, with the blocks of its net unless they are too many.

        Args:
            site: the station under construction.
            name: name of the flow.
            robot: robot that the flow drives, or None.
            net: the net of the flow.
        """
        label = message(
            "parts.block_signal_flow",
            "{name}\nsignal flow, {count} {count:block|blocks}",
            name=wrap_label(name),
            count=len(self.blocks),
        )
        # The net has the sums of torques, forces and stops as blocks, too, but no inputs of the station.
        inner_blocks = net.inner_blocks() if len(net.blocks) <= _MOST_DRAWN_BLOCKS else None
        site.picture.draw(f"controller.{name}", "loop", label, robot, net=inner_blocks)


def _stop_condition(flow: str, stop: str) -> Condition:
    """Make the condition that holds while the signal of a stop is not 0.

    Args:
        flow: name of the flow.
        stop: name of the stop.
    """

    def excess(value: Vector) -> float:
        """Excess of the condition for the signal's value (1,): 1 if the signal is on, else -1. It holds from 0 on."""
        # A signal is on or off: it is on with any value but 0, also with a negative one or not a number.
        return 1.0 if value[0] else -1.0

    def why(value: Vector) -> str:
        """Reason why the run ends. It does not depend on the value of the signal."""
        return message("parts.stop_is_on", "the stop {stop} is active", stop=stop)

    # It reads one output of the station, of size 1.
    return Condition({f"{flow}.{stop}": 1}, excess, why)


def add_flows(
    builder: DiagramBuilder,
    site: Site,
    flows: Mapping[str, SignalFlow],
    *,
    monitors: bool = True,
    integrated: bool = True,
) -> None:
    """Add the signal flows of a station, and add their torques to those of the servos of its robots.

    Args:
        builder: builder of the diagram.
        site: the station under construction.
        flows: the flows, by name.
        monitors: whether stops get blocks that end the run. Otherwise they are only registered in the station's
            outputs, for the code that steps the station to evaluate.
        integrated: whether other parts of the diagram may have continuous states.

    Raises:
        SimrobError: a term names no signal, there is an algebraic loop, or the periods of blocks do not fit.
    """
    # If a block of one flow has continuous states, Drake integrates, and asks all flows for derivatives. Sampled states
    # count here, too, which does no harm. The law of a block, which is the block itself or an equivalent one, has its
    # states; `start` is empty if there are none.
    for flow in flows.values():
        integrated |= any(block.law.start for block in flow.blocks.values())
    # Torques of the flows, by the name of the robot that they drive.
    torques = dict[str, list[OutputPort]]()
    for name, flow in flows.items():
        torque = flow.add(builder, site, name, monitors=monitors, integrated=integrated)
        if torque is not None:
            robot = site.robot(flow.robot)
            torques.setdefault(robot.name, []).append(torque)
    for robot_name, ports in torques.items():
        # Several flows may drive one robot: their torques are added up.
        prefix = site.plant.robots[robot_name].prefix
        add_to(builder, site, f"{prefix}feedforward", ports, name="flows")


class _Element(NamedTuple):
    """One number that a block reads.

    Attributes:
        owner: name of the block, or of the output of the station, whose vector contains the number; or `_ONE` or
            `_TIME`.
        entry: index of the number in that vector.
        is_measured: whether the owner is an output of the station.
    """

    owner: str
    entry: int = 0
    is_measured: bool = False


class _Term(NamedTuple):
    """Term of a sum that a block reads: a number with a factor."""

    element: _Element
    factor: float


class _FlowNet:
    """The blocks of one signal flow, which become one system of the diagram.

    Attributes:
        blocks: blocks that the net computes, by name.
    """

    def __init__(
        self,
        site: Site | None,
        key: str,
        prefix: str,
        blocks: Mapping[str, FlowBlock],
        station_inputs: Mapping[str, str],
    ) -> None:
        """Prepare the net: find the numbers that the blocks read.

        Args:
            site: the station under construction, or None if the blocks read no signals of a station.
            key: key of the flow's section, for errors.
            prefix: prefix of the columns of the flow's robot, which terms may leave out.
            blocks: blocks that the net computes, by name.
            station_inputs: name of the station's input by the name of each block of the kind ``input``, which is not
                among ``blocks``.

        Raises:
            SimrobError: a term names no signal.
        """
        self._site = site
        self._key = key
        self._prefix = prefix
        self.blocks = blocks
        self._station_inputs = station_inputs
        self._readable_signals = [] if site is None else list(_readable_signals(site))

        # Inputs of each block: each input is a list of terms.
        self._inputs = dict[str, list[list[_Term]]]()
        # Sizes of the outputs of the station that blocks read, in the order in which blocks first read them.
        self._measured_sizes = dict[str, int]()
        for name, block in blocks.items():
            self._inputs[name] = [self._find_terms(name, terms) for terms in block.inputs]
            for element in self._elements_read(name):
                # Only a net in a station reads measured values.
                if element.is_measured and site is not None:
                    self._measured_sizes[element.owner] = site.outputs[element.owner].size()

    def _elements_read(self, block: str) -> list[_Element]:
        """Numbers that a block reads, input after input. A number that several terms name is listed several times."""
        return [term.element for terms in self._inputs[block] for term in terms]

    def add(
        self, builder: DiagramBuilder, system_name: str, *, integrated: bool = True
    ) -> dict[str, OutputPort]:
        """Add the net to the diagram.

        Args:
            builder: builder of the diagram.
            system_name: name of the net's system, and prefix of the names of the systems around it.
            integrated: whether the diagram may have continuous states. Drake then asks all systems for derivatives,
                also a net without states.

        Returns:
            The port of each block's output, by the name of the block.

        Raises:
            InvalidParameter: there is an algebraic loop, or the periods of blocks have no common step.
        """
        measured_count = sum(self._measured_sizes.values())
        try:
            net = signal_net(self._wired_blocks(), measured_count, integrated=integrated)
        except CycleError as problem:
            # The second argument lists the names of the blocks in the loop.
            names_of_loop = problem.args[1]
            raise Unsuitable(
                f"{self._key}.blocks",
                message(
                    "parts.algebraic_loop",
                    "{blocks} is an algebraic loop",
                    blocks=" → ".join(names_of_loop),
                ),
                message(
                    "parts.insert_a_state",
                    "insert a block with a state, such as an integrator or a delay",
                ),
            ) from None
        # A CycleError is a ValueError, too: this clause must come second.
        except ValueError as problem:
            raise Unsuitable(
                f"{self._key}.blocks",
                message_of(problem),
                message("parts.multiples_of_step", "choose multiples of a common step"),
            ) from None

        # Without measured values the net has no input port.
        if self._site is not None and self._measured_sizes:
            sources = [self._site.port(builder, output) for output in self._measured_sizes]
            bus = add_multiplexer(builder, f"{system_name}.bus", *sources)
            outputs = add_and_connect(builder, system_name, net, bus)
        else:
            outputs = add_and_connect(builder, system_name, net)
        # The output of the net holds all blocks' outputs, one after the other.
        split = Demultiplexer([block.size for block in self.blocks.values()])
        add_and_connect(builder, f"{system_name}.split", split, outputs)
        return {name: split.get_output_port(index) for index, name in enumerate(self.blocks)}

    def _wired_blocks(self) -> dict[str, WiredBlock]:
        """Describe the blocks and their inputs for the net, by name.

        An input is a list of pairs: the index of a value of the net, and its factor.
        """
        # Values of a net: the constant 1, the time, the measured values, then the outputs of the blocks.
        first_of_block = FIRST_MEASURED + sum(self._measured_sizes.values())
        block_sizes = {name: block.size for name, block in self.blocks.items()}
        # Index of the first value of each owner. There are two tables, as an output of the station may have the name of
        # a block.
        measured_starts = _starts(self._measured_sizes, FIRST_MEASURED)
        other_starts = _starts(block_sizes, first_of_block) | {_ONE: 0, _TIME: 1}

        def value_index(element: _Element) -> int:
            """Index of a number among the values of the net."""
            starts = measured_starts if element.is_measured else other_starts
            return starts[element.owner] + element.entry

        wired = dict[str, WiredBlock]()
        for name, block in self.blocks.items():
            inputs = list[list[tuple[int, float]]]()
            for terms in self._inputs[name]:
                inputs.append([(value_index(term.element), term.factor) for term in terms])
            wired[name] = WiredBlock(block.law, inputs)
        return wired

    def inner_blocks(self) -> dict[str, InnerBlock]:
        """Describe the blocks for the picture of the station, by name: their labels, and what each of them reads."""
        found = dict[str, InnerBlock]()
        for name, block in self.blocks.items():
            # Dictionaries, since they name each owner once, in the order of the inputs.
            blocks_read = dict[str, None]()
            outputs_read = dict[str, None]()
            for element in self._elements_read(name):
                if element.is_measured:
                    outputs_read[element.owner] = None
                # The constant and the time are drawn as no arrow.
                elif element.owner in self.blocks:
                    blocks_read[element.owner] = None
            kind = block.kind.replace("_", " ")
            found[name] = InnerBlock(
                f"{wrap_label(name)}\n{kind}", tuple(blocks_read), tuple(outputs_read)
            )
        return found

    def _find_terms(self, block: str, terms: Sum) -> list[_Term]:
        """Find the numbers that a sum adds up, with their factors.

        Args:
            block: name of the block that reads the sum, for errors.
            terms: the sum: a name, or factors by name.

        Raises:
            InvalidParameter: a term names an element that a block does not have.
            UnknownName: a term names nothing that can be read.
        """
        key = f"{self._key}.blocks.{block}.of"
        return [
            _Term(self._find_element(key, term), factor) for term, factor in _factors(terms).items()
        ]

    def _find_element(self, key: str, term: str) -> _Element:
        """Find the number that a term names.

        Args:
            key: key of the sum, for errors.
            term: name of the constant, the time, an input of the station, a block or a column of the results.

        Raises:
            InvalidParameter: the term names an element that the block does not have.
            UnknownName: the term names nothing that can be read.
        """
        if term in (_ONE, _TIME):
            return _Element(term)
        if term in self._station_inputs:
            return _Element(self._station_inputs[term], is_measured=True)
        # Names of blocks have no dots, those of columns may have. Of both, the block is meant.
        if term.partition(".")[0] in self.blocks:
            return self._find_block_element(key, term)
        for signal in self._readable_signals:
            # With several robots, a term may leave out the prefix of the flow's own robot, which comes first.
            for column in (f"{self._prefix}{term}", term):
                if column in signal.names:
                    # A signal may show only some entries of its output, such as those of driven axes.
                    index = signal.names.index(column)
                    entry = index if signal.entries is None else signal.entries[index]
                    return _Element(signal.output, entry, is_measured=True)

        # Nothing was found: the error proposes a name of a block, an input or a column.
        known = [*self.blocks, *self._station_inputs, _ONE, _TIME]
        for signal in self._readable_signals:
            known += signal.names
        raise UnknownName(
            message(
                "parts.block_or_signal",
                "block, or signal that is measured during the run, for {key}",
                key=key,
            ),
            term,
            known,
        )

    def _find_block_element(self, key: str, term: str) -> _Element:
        """Find the element of a block's output that a term names, as ``<block>`` or ``<block>.<index>``.

        Args:
            key: key of the sum, for errors.
            term: the term; its block exists.

        Raises:
            InvalidParameter: the index is missing although the output has several elements, is too large, or is no
                index.
        """
        block, _, index_text = term.partition(".")
        size = self.blocks[block].size
        if size == 1 and "." not in term:
            return _Element(block)
        if index_text.isdecimal() and int(index_text) < size:
            return _Element(block, int(index_text))
        expected = block
        if size > 1:
            expected = message(
                "parts.output_range", "{block}.0 to {block}.{last}", block=block, last=size - 1
            )
        raise InvalidParameter(key, term, expected)


def _readable_signals(site: Site) -> Iterator[Signal]:
    """Yield the signals of a station that a flow can read while the station is stepped.

    They are those with an output, except the signals that a torque changes at once (`_INSTANT_ROLES`).
    """
    for signal in site.outputs.signals:
        # Signals that are only computed after a run have no output.
        if signal.output in site.outputs and signal.role not in _INSTANT_ROLES:
            yield signal


def _starts(sizes: Mapping[str, int], first: int) -> dict[str, int]:
    """Compute the index of the first value of each vector, by name, if vectors of these sizes follow one another.

    Args:
        sizes: size of each vector, by name, in the order of the vectors.
        first: index of the first value of all.
    """
    ends = accumulate(sizes.values(), initial=first)
    # There is one more end than vectors: the last end is the start of no vector.
    return dict(zip(sizes, ends, strict=False))


def _factors(terms: Sum) -> Mapping[str, float]:
    """Write a sum as factors by term: a sum may also be the name of a single signal, with the factor 1."""
    return {terms: 1.0} if isinstance(terms, str) else terms


# Makes a block of the class of its kind from a section.
_BLOCK: TypeAdapter[FlowBlock] = TypeAdapter(FlowBlockConfig)


def flow_over_time(blocks: Mapping[str, Any], sums: Sequence[Sum], times: Vector) -> Vector:
    """Compute sums of blocks that depend on time alone, by a simulation of the blocks without a station.

    Args:
        blocks: sections of the blocks, by name. Blocks of the kind ``input`` give 0.
        sums: n sums of the blocks' outputs.
        times: rising times, shape (t,) [s], none negative. The blocks start at the time 0.

    Returns:
        The value of each of the n sums at each time, shape (n, t).

    Raises:
        SimrobError: a term names no block, there is an algebraic loop, or the periods of blocks do not fit.
        pydantic.ValidationError: a section is wrong.
    """
    zero = Sums(kind="sum", of=({},))
    net_blocks = dict[str, FlowBlock]()
    for name, section in blocks.items():
        net_blocks[name] = (
            zero if section.get("kind") == "input" else _BLOCK.validate_python(section)
        )
    # The block of this name has all sums as its output; no other block may have the name.
    net_blocks[_TORQUE] = Sums(kind="sum", of=tuple(sums))

    builder = DiagramBuilder()
    port = _FlowNet(None, "flow", "", net_blocks, {}).add(builder, "flow")[_TORQUE]
    diagram = builder.Build()
    simulator = Simulator(diagram)
    # Relative error of the states in a step [1].
    simulator.get_mutable_integrator().set_target_accuracy(1e-6)
    context = simulator.get_mutable_context()
    # The solver goes from time to time, so each value is exact to its accuracy, and not interpolated.
    values_over_time = []
    for time in times:
        simulator.AdvanceTo(time)
        port_context = diagram.GetSubsystemContext(port.get_system(), context)
        values_over_time.append(port.Eval(port_context))
    return np.transpose(values_over_time)
