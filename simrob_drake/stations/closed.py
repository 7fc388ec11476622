"""Close a station: give its inputs sources, and build a diagram that can run.

A *reference* is the desired motion of a robot: positions of its n axes over time, in rad or m. A *source* is a block
without inputs that puts a reference out. A *prescribed* axis follows its own reference exactly, without a servo. In a
*dynamic* station forces move the robots, in a *kinematic* one the references do (``engine.moves_by_forces`` is False).
*Ports* hold the input and output ports of a station by name. The names of a robot's ports begin with its *prefix*,
which is empty for the only robot.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import Trajectory

from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import build_diagram
from simrob_drake.base.messages import message
from simrob_drake.blocks.block import add_and_connect, add_multiplexer
from simrob_drake.blocks.references import (
    Reference,
    ReferenceSource,
    Samples,
    add_reference,
    as_reference,
    corner_times,
    interpolate_samples,
    reference_values,
)
from simrob_drake.parts.captions import wrap_label
from simrob_drake.parts.forces import ForceConfig
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.coupled_references import obey_couplings
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import ResolvedStation
from simrob_drake.stations.station import compose

_MOTION = "reference", "reference_velocity", "reference_acceleration"
"""Inputs of a robot for its desired motion, by order of the derivative. A robot need not have the later ones."""

_REFERENCE_INTERVALS = 500
"""Count of intervals into which a run is divided to check a reference against the joint limits."""


@dataclass(frozen=True)
class ClosedStation:
    """A diagram that can run: a station with a source at each of its inputs.

    Attributes:
        diagram: the diagram.
        ports: ports of the station in it.
        references: reference of each robot by its name, except for robots whose reference is computed by a block.
        players: sources of those references that are trajectories of Drake, by the name of the robot.
    """

    diagram: Diagram
    ports: StationPorts
    references: dict[str, Reference] = field(default_factory=dict)
    players: Mapping[str, TrajectorySource] = field(default_factory=dict)

    def play(
        self,
        references: Mapping[str, Reference],
        forces: Mapping[str, ForceConfig],
    ) -> None:
        """Replace the trajectories of the robots and the forces over time, without building the diagram again.

        The attribute `references` is changed as well. Robots that are not in `players` keep their references.

        Args:
            references: the new reference of each robot in `players`, a trajectory of Drake, by the robot's name.
            forces: new pushes and drags by name, as in :meth:`play_forces`.
        """
        for robot, player in self.players.items():
            # Compared by identity: comparing trajectories would take as long as copying them.
            is_new = self.references[robot] is not references[robot]
            if is_new:  # the source copies its trajectory, which takes time and memory
                self.references[robot] = references[robot]
                player.UpdateTrajectory(references[robot])
        self.play_forces(forces)

    def play_forces(self, forces: Mapping[str, ForceConfig]) -> None:
        """Replace how pushes and drags change over time. The points on which they act stay.

        Args:
            forces: the new forces, by the names of the station's forces. Forces that are no pushes or drags, and forces
                that the diagram does not have, are ignored.
        """
        for name, force in forces.items():
            # The name under which the station added the source of the force.
            source = f"force.{name}.source"
            trajectory = force.trajectory()
            # Forces of other kinds have no trajectory, and a diagram may have been built without forces.
            if trajectory is not None and self.diagram.HasSubsystemNamed(source):
                self.diagram.GetSubsystemByName(source).UpdateTrajectory(trajectory)


@dataclass(frozen=True)
class _DrivenInputs:
    """A source of a robot's desired motion, and the inputs that it drives.

    Attributes:
        source: the source.
        outputs: ports of the source by the names of the inputs that they drive.
    """

    source: ReferenceSource
    outputs: dict[str, OutputPort]


def closed_station(
    station: ResolvedStation,
    references: Mapping[str, Reference] | None = None,
    *,
    sensors: Collection[str] | None = None,
    forces: bool = True,
    monitors: bool = True,
    blocks: Mapping[str, LeafSystem] | None = None,
    lean: bool = False,
) -> ClosedStation:
    """Build a station with the sources of its references. All inputs that remain are zero.

    Args:
        station: the station.
        references: reference of each robot by its name. By default they are those of the configuration.
        sensors: names of the sensors that are added; all sensors by default.
        forces: whether the forces of the configuration act.
        monitors: whether monitors are blocks of the diagram. Otherwise the recorder of the run evaluates them.
        blocks: blocks that the user has written, by name; by default those of the configuration (controllers of the
            kind ``own``). Its controllers of other kinds are added in any case.
        lean: whether blocks that only report, such as poses, are left out unless another block reads them. In a dynamic
            station without blocks and controllers, the blocks that only pass a reference on are left out, too.

    Raises:
        SimrobError: a part of the station does not fit the others, or the user's blocks cannot be connected to it.
        RuntimeError: Drake cannot build the diagram, and there are no blocks of the user's that could be the cause.
    """
    builder = DiagramBuilder()
    # A caller that resumes a run has computed the references already, from the positions at which the run goes on.
    played = station_references(station) if references is None else references
    # An input of a station is usually a block that passes its signal on, and the source is connected to this block. A
    # lean dynamic station has no such block and reads the source itself, which must therefore exist before the station.
    # With blocks or controllers that is not possible: whether they drive the input in place of the source is known only
    # after the station has been composed.
    early: dict[str, _DrivenInputs] = {}
    if lean and not blocks and not station.config.controllers:
        early = _early_sources(builder, station, played)
    early_ports = dict[str, OutputPort]()
    for driven in early.values():
        early_ports.update(driven.outputs)
    ports = compose(
        builder,
        station,
        sensors=sensors,
        forces=forces,
        monitors=monitors,
        blocks=blocks,
        sources=early_ports,
        lean=lean,
        closed=True,
    )
    kept = dict[str, Reference]()
    players = dict[str, TrajectorySource]()
    for robot in ports.plant.robots.values():
        reference = played[robot.name]
        if robot.name in early:
            source: ReferenceSource | None = early[robot.name].source
        else:
            source = _add_source(builder, ports, robot, reference)
        if source is not None:
            # Steps have to end where the reference has a corner: integration assumes smooth
            # signals.
            ports.edges.extend(corner_times(reference))
            caption = ports.config.reference_of(robot.name).caption(robot.model)
            ports.picture.draw(
                f"{robot.prefix}reference_source", "reference", wrap_label(caption), robot
            )
            kept[robot.name] = reference
            if source.player is not None:
                players[robot.name] = source.player
        for axis, motion in robot.prescribed.items():
            _add_prescribed(builder, ports, robot.axes[axis], robot, motion)
    # Last, since an input that is open now has no other source.
    _add_zeros(builder, ports)
    try:
        return ClosedStation(build_diagram(builder), ports, kept, players)
    except RuntimeError as problem:
        # Without blocks of the user, an error in the wiring is ours, and is not blamed on the user.
        if not ports.blocks:
            raise
        raise _wiring_error(ports, problem) from problem


def _add_zeros(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Connect every input that nothing drives to a constant source of zeros, and draw this source in the picture."""
    # Drake refuses to evaluate a block with an open input. Zero is no feedforward, no force and no speed.
    for name, port in ports.inputs.items():
        if builder.IsConnectedOrExported(port):
            continue
        zero = add_and_connect(builder, f"{name}.zero", ConstantVectorSource(np.zeros(port.size())))
        builder.Connect(zero, port)
        # The robot whose input it is, for the picture. The prefix of an only robot is empty, and fits every name.
        owner = next(
            (robot for robot in ports.plant.robots.values() if name.startswith(robot.prefix)), None
        )
        ports.picture.draw(f"{name}.zero", "reference", "0", owner)


def _wiring_error(ports: StationPorts, problem: RuntimeError) -> SimrobError:
    """Create the error for blocks that Drake cannot build into a diagram, with the likely cause.

    Args:
        ports: ports of the station, with the user's own blocks by name.
        problem: error of Drake when the diagram was built.
    """
    # Drake has no class for this error: its text is the only sign.
    was_built_before = "been built into a different Diagram" in str(problem)
    cause = message("stations.signals_in_circle", "signals must not form an algebraic loop")
    if was_built_before:
        cause = message(
            "stations.block_serves_one_diagram",
            "a block belongs to one diagram only, so create a new one",
        )
    text = message(
        "stations.blocks_cannot_be_wired",
        "the blocks {blocks} cannot be connected: {cause} ({problem})",
        blocks=", ".join(ports.blocks),
        cause=cause,
        problem=problem,
    )
    return SimrobError(text)


def _add_source(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, reference: Reference
) -> ReferenceSource | None:
    """Add the source of a robot's reference, and connect it to the robot's free inputs.

    These are the inputs for positions, velocities and accelerations that the robot has and that no block drives.

    Returns:
        the source, or None if a block drives the input of the positions. Then nothing is added, also for velocities
        and accelerations.
    """
    free = []
    for name in _MOTION:
        port = ports.inputs.get(f"{robot.prefix}{name}")
        # A block or a controller may drive the input already, and Drake allows one source only.
        if port and not builder.IsConnectedOrExported(port):
            free.append(name)
    # Derivatives without the position that they belong to would contradict the block's reference.
    if "reference" not in free:
        return None
    driven = _source(builder, robot.prefix, reference, free)
    for input_name, output in driven.outputs.items():
        builder.Connect(output, ports.inputs[input_name])
    return driven.source


def _early_sources(
    builder: DiagramBuilder, station: ResolvedStation, played: Mapping[str, Reference]
) -> dict[str, _DrivenInputs]:
    """Add the sources of a dynamic station's references before the station is composed.

    The station then reads the sources directly, and has no inputs for the quantities that the sources give.

    Args:
        builder: builder of the diagram.
        station: the station.
        played: reference of each robot, by the robot's name.

    Returns:
        the source of each robot by the robot's name; empty for a kinematic station.
    """
    found: dict[str, _DrivenInputs] = {}
    if not station.engine.moves_by_forces:
        return found
    for name, robot in station.robots.items():
        # The inputs that the station will have: it does not exist yet.
        inputs = {"reference", *station.config.inputs}
        if station.config.servo_of(name).follows_motion:
            inputs.update(_MOTION)
        input_names = [each for each in _MOTION if each in inputs]
        found[name] = _source(builder, robot.prefix, played[name], input_names)
    return found


def _source(
    builder: DiagramBuilder,
    prefix: str,
    reference: Reference,
    input_names: Sequence[str],
) -> _DrivenInputs:
    """Add a source for a robot's desired motion.

    Args:
        builder: builder of the diagram.
        prefix: prefix of the robot's names.
        reference: the desired motion.
        input_names: names of the inputs that the source drives, without the prefix: a part of ``_MOTION`` in its order.
    """
    # The names are in the order of the derivatives, so that the index of a name is the order of its derivative.
    highest_derivative = _MOTION.index(input_names[-1])
    source = add_reference(
        builder, reference, name=f"{prefix}reference_source", derivatives=highest_derivative
    )
    outputs = zip(_MOTION, (source.position, source.velocity, source.acceleration), strict=True)
    driven = {
        f"{prefix}{name}": port
        for name, port in outputs
        if name in input_names and port is not None
    }
    return _DrivenInputs(source, driven)


def _add_prescribed(
    builder: DiagramBuilder,
    ports: StationPorts,
    axis: str,
    robot: StationRobot,
    reference: Reference,
) -> None:
    """Add the source of a prescribed axis, unless a block drives it.

    A prescribed axis is moved along its reference by whatever force that takes. Its input has the position, velocity
    and acceleration in one vector, shape (3,).

    Args:
        builder: builder of the diagram.
        ports: ports of the station, which has the input already.
        axis: name of the axis.
        robot: robot of the axis.
        reference: motion of this axis alone, one value at each time [rad or m].
    """
    name = f"{robot.prefix}prescribed.{axis}"
    if builder.IsConnectedOrExported(ports.inputs[name]):
        return
    # Two derivatives, since the force that the axis needs depends on its acceleration.
    source = add_reference(builder, reference, name=f"{name}.source", derivatives=2)
    assert source.velocity is not None
    assert source.acceleration is not None
    motion = add_multiplexer(
        builder, f"{name}.motion", source.position, source.velocity, source.acceleration
    )
    builder.Connect(motion, ports.inputs[name])
    ports.edges.extend(corner_times(reference))
    caption = ports.config.prescribed[f"{robot.prefix}{axis}"].caption(robot.model)
    ports.picture.draw(f"{name}.source", "reference", wrap_label(caption), robot)
    ports.picture.draw_nothing(f"{name}.motion")


def station_references(
    station: ResolvedStation,
    requested: Mapping[str, Reference | Samples] | None = None,
    starts: Mapping[str, Vector] | None = None,
) -> dict[str, Reference]:
    """Determine the reference of each robot, by the robot's name.

    Coupled axes to which neither the requested references nor those of the configuration give a value of their own
    follow the axes to which they are coupled, see `obey_couplings`.

    Args:
        station: the station.
        requested: references that replace those of the configuration, by the robot's name. Samples (times and
            positions) are joined by straight lines as in Simulink, or by a smooth curve if the servos need derivatives.
        starts: positions (n,) [rad or m] of the robots at the start, by name, from which the references of the
            configuration are computed: a move begins there, a sine swings about them. By default they are the robots'
            initial positions.

    Returns:
        the references by robot, also of robots whose references a controller will replace.

    Raises:
        SimrobError: a reference does not fit its robot, or contradicts a coupling. Joint limits are checked separately,
            by :func:`check_reference`.
    """
    requested = requested or {}
    starts = starts or {}
    references = {}
    for robot in station.robots.values():
        start = starts.get(robot.name, robot.initial)
        _check_start(robot, start)
        requested_one: Any = requested.get(robot.name)  # a reference, samples, or None
        if requested_one is None:
            reference: Reference = station.config.reference_of(robot.name).trajectory(robot, start)
        elif isinstance(requested_one, tuple):
            # Straight lines have jumps of the speed, which servos that follow the speed would pass
            # on.
            linear = not station.config.follows_speed(robot.name)
            reference = _interpolate(requested_one, robot, linear=linear)
        else:
            reference = requested_one
        _check_size(robot, reference)
        references[robot.name] = reference
    # Last, since an axis that follows others needs their references.
    return obey_couplings(station, references, requested, starts)


def _check_start(robot: ResolvedRobot, start: Vector) -> None:
    """Check that the positions at the start have one value for each axis of a robot.

    Raises:
        InvalidParameter: they have another count, such as those of another station.
    """
    if len(start) == len(robot.axes):
        return
    found = message(
        "stations.state_of_size",
        "a state in which '{robot}' has {size} axes",
        robot=robot.name,
        size=len(start),
    )
    expected = message(
        "stations.station_of_size", "a state in which it has {size} axes", size=len(robot.axes)
    )
    raise InvalidParameter("start", found, expected)


def _check_size(robot: ResolvedRobot, reference: Reference) -> None:
    """Check that a reference has one position for each axis of a robot; raises InvalidParameter otherwise."""
    count = as_reference(reference).size
    if count == len(robot.axes):
        return
    found = message("stations.trajectory_of_joints", "a trajectory of {count} joints", count=count)
    expected = message(
        "stations.count_of_joints",
        "a trajectory of {count} joints: {axes}",
        count=len(robot.axes),
        axes=", ".join(robot.axes),
    )
    raise InvalidParameter("reference", found, expected)


def reference_samples(reference: Reference, duration: float) -> tuple[Vector, Vector]:
    """Sample a reference evenly over a run.

    Returns:
        the times, shape (m,) [s], and the positions, shape (m, n) [rad or m].
    """
    # Both ends are samples, hence one more than there are intervals.
    times = np.linspace(0.0, duration, _REFERENCE_INTERVALS + 1)
    return times, reference_values(reference, times)


def check_reference(robot: ResolvedRobot, reference: Reference, duration: float) -> None:
    """Check a reference against the joint limits of a robot, over a run of a duration [s].

    Raises:
        InvalidParameter: a sampled position is beyond its limits by more than rounding, or not finite. The error names
            the joint, the time and the value, and the limits unless the value is not finite.
    """
    # A reference is any function of time, so that it is sampled: between samples it may exceed a limit slightly.
    times, positions = reference_samples(reference, duration)
    if not np.isfinite(positions).all():
        # The first value that is not finite: comparisons with limits would be false for it.
        row, axis = np.argwhere(~np.isfinite(positions))[0]
        subject = message(
            "stations.reference_of_axis",
            "reference of {prefix}{axis}",
            prefix=robot.prefix,
            axis=robot.axes[axis],
        )
        found = message(
            "stations.value_at_time",
            "{value} at {time:.2f} s",
            value=positions[row, axis],
            time=times[row],
        )
        expected = message("stations.finite_at_any_time", "a finite number at any time")
        raise InvalidParameter(subject, found, expected)
    violation = robot.model.limits.find_violation(positions)
    if violation is not None:
        subject = message(
            "stations.reference_of_axis",
            "reference of {prefix}{axis}",
            prefix=robot.prefix,
            axis=robot.axes[violation.axis],
        )
        found = message(
            "stations.position_at_time",
            "{position} {unit} at {time:.2f} s",
            position=violation.value,
            unit=violation.unit,
            time=times[violation.row],
        )
        expected = message(
            "stations.within_limits",
            "within the joint's limits of {limits}",
            limits=violation.limits,
        )
        raise InvalidParameter(subject, found, expected)


def _interpolate(samples: Samples, robot: ResolvedRobot, *, linear: bool) -> Trajectory:
    """Create a trajectory through samples of a robot's positions.

    Args:
        samples: times (m,) [s] and positions (m, n) [rad or m].
        robot: the robot.
        linear: whether straight lines join the samples; otherwise a smooth curve does.

    Raises:
        InvalidParameter: the positions do not have one column for each axis, or times and positions make no trajectory.
    """
    # Users pass lists as well as arrays.
    positions = np.asarray(samples[1], dtype=float)
    if positions.ndim != 2 or positions.shape[1] != len(robot.axes):
        shape = " x ".join(str(size) for size in positions.shape)
        raise InvalidParameter(
            "reference",
            message("stations.array_of", "an array of {shape}", shape=shape),
            message(
                "stations.columns_a_joint",
                "an array of {count} columns, one for each joint [rad or m]",
                count=len(robot.axes),
            ),
        )
    return interpolate_samples(samples[0], positions, linear=linear)
