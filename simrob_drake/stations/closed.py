"""Close a station: give its inputs sources, and build a diagram that can run."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import Trajectory

from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import built
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
from simrob_drake.parts.captions import wrapped
from simrob_drake.parts.forces import ForceConfig
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.coupled_references import obey_couplings
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import ResolvedStation
from simrob_drake.stations.station import compose

_MOTION = "reference", "reference_velocity", "reference_acceleration"
_LOOKS = 500  # at how many times a reference is checked against the joint limits


@dataclass(frozen=True)
class ClosedStation:
    """A diagram that holds a station whose inputs all have sources."""

    diagram: Diagram  # that can be run
    ports: StationPorts  # of the station
    # what each robot is asked, by name; those that a block asks are left out
    references: dict[str, Reference] = field(default_factory=dict)
    # the sources of those that are trajectories, by robot
    players: Mapping[str, TrajectorySource] = field(default_factory=dict)

    def play(self, references: Mapping[str, Reference], forces: Mapping[str, ForceConfig]) -> None:
        """Let the sources give other trajectories and pushes."""
        for robot, player in self.players.items():
            if self.references[robot] is not references[robot]:  # a copy of it takes time and memory
                self.references[robot] = references[robot]
                player.UpdateTrajectory(references[robot])
        self.play_forces(forces)

    def play_forces(self, forces: Mapping[str, ForceConfig]) -> None:
        """Let the sources give other pushes and drags at the same places."""
        for name, force in forces.items():
            place = f"force.{name}.source"
            trajectory = force.trajectory()
            if trajectory is not None and self.diagram.HasSubsystemNamed(place):
                self.diagram.GetSubsystemByName(place).UpdateTrajectory(trajectory)


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
    """Build a station with the sources of its references; its other inputs are zero.

    What each robot is asked is as the configuration says unless given; the other arguments are those of
    :func:`~simrob_drake.stations.station.compose`. Raises SimrobError: blocks that cannot be wired so.
    """
    builder = DiagramBuilder()
    played = station_references(station) if references is None else references
    early = _early_sources(builder, station, played) if lean and not (blocks or station.config.controllers) else {}
    ports = compose(
        builder,
        station,
        sensors=sensors,
        forces=forces,
        monitors=monitors,
        blocks=blocks,
        sources={name: port for _, driven in early.values() for name, port in driven.items()},
        lean=lean,
        closed=True,
    )
    kept, players = dict[str, Reference](), dict[str, TrajectorySource]()
    for robot in ports.plant.robots.values():
        reference = played[robot.name]
        source = early[robot.name][0] if robot.name in early else _add_source(builder, ports, robot, reference)
        if source is not None:
            ports.edges.extend(corner_times(reference))
            caption = ports.config.reference_of(robot.name).caption(robot.model)
            ports.picture.draw(f"{robot.prefix}reference_source", "reference", wrapped(caption), robot)
            kept[robot.name] = reference
            if source.player is not None:
                players[robot.name] = source.player
        for place, reference in robot.prescribed.items():
            _add_prescribed(builder, ports, robot.axes[place], robot, reference)
    for name, port in ports.inputs.items():
        if not builder.IsConnectedOrExported(port):
            builder.Connect(add_and_connect(builder, f"{name}.zero", ConstantVectorSource(np.zeros(port.size()))), port)
            owner = next((robot for robot in ports.plant.robots.values() if name.startswith(robot.prefix)), None)
            ports.picture.draw(f"{name}.zero", "reference", "0", owner)
    try:
        return ClosedStation(built(builder), ports, kept, players)
    except RuntimeError as problem:
        if not ports.blocks:
            raise
        used = "been built into a different Diagram" in str(problem)
        cause = (
            message("stations.block_serves_one_diagram", "a block serves one diagram; make it anew")
            if used
            else message("stations.signals_in_circle", "signals must not go around in a circle")
        )
        raise SimrobError(
            message(
                "stations.blocks_cannot_be_wired",
                "the blocks {blocks} cannot be wired so; {cause} ({problem})",
                blocks=", ".join(ports.blocks),
                cause=cause,
                problem=problem,
            )
        ) from problem


def _add_source(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, reference: Reference
) -> ReferenceSource | None:
    """Add the source of a robot's reference, with what derivatives the station takes; None if a block drives it."""
    inputs = {name: ports.inputs.get(f"{robot.prefix}{name}") for name in _MOTION}
    free = {name: port for name, port in inputs.items() if port and not builder.IsConnectedOrExported(port)}
    if "reference" not in free:
        return None
    source, driven = _source(builder, robot.prefix, reference, list(free))
    for name, port in driven.items():
        builder.Connect(port, ports.inputs[name])
    return source


def _early_sources(
    builder: DiagramBuilder, station: ResolvedStation, played: Mapping[str, Reference]
) -> dict[str, tuple[ReferenceSource, dict[str, OutputPort]]]:
    """Add the sources of a dynamic station's references before the station, which then needs no blocks as inputs."""
    found, config = {}, station.config
    for name, robot in station.robots.items() if station.engine.moves_by_forces else ():
        listed = {"reference", *config.inputs, *(_MOTION if config.servo_of(name).follows_motion else ())}
        found[name] = _source(builder, robot.prefix, played[name], [each for each in _MOTION if each in listed])
    return found


def _source(
    builder: DiagramBuilder, prefix: str, reference: Reference, taken: Sequence[str]
) -> tuple[ReferenceSource, dict[str, OutputPort]]:
    """Add a source that gives what is taken of ``_MOTION``, and return its ports by the names of inputs."""
    source = add_reference(builder, reference, name=f"{prefix}reference_source", derivatives=_MOTION.index(taken[-1]))
    outputs = zip(_MOTION, (source.position, source.velocity, source.acceleration), strict=True)
    return source, {f"{prefix}{name}": port for name, port in outputs if name in taken and port is not None}


def _add_prescribed(
    builder: DiagramBuilder, ports: StationPorts, axis: str, robot: StationRobot, reference: Reference
) -> None:
    """Add the source of a prescribed axis, unless somebody drives it."""
    name = f"{robot.prefix}prescribed.{axis}"
    if builder.IsConnectedOrExported(ports.inputs[name]):
        return
    source = add_reference(builder, reference, name=f"{name}.source", derivatives=2)
    assert source.velocity is not None
    assert source.acceleration is not None
    motion = add_multiplexer(builder, f"{name}.motion", source.position, source.velocity, source.acceleration)
    builder.Connect(motion, ports.inputs[name])
    ports.edges.extend(corner_times(reference))
    caption = ports.config.prescribed[f"{robot.prefix}{axis}"].caption(robot.model)
    ports.picture.draw(f"{name}.source", "reference", wrapped(caption), robot)
    ports.picture.draw_nothing(f"{name}.motion")


def station_references(
    station: ResolvedStation,
    requested: Mapping[str, Reference | Samples] | None = None,
    starts: Mapping[str, Vector] | None = None,
) -> dict[str, Reference]:
    """Return what each robot is asked, by name: what is given, else what the configuration says.

    Samples that are given are joined by straight lines, as Simulink joins them, but by a smooth curve where their
    derivatives are needed. The configuration's references begin at ``starts`` (n,) [rad], else at the initial posture.
    Coupled axes that nobody asks for follow those that are asked.
    Raises SimrobError: a reference that does not fit the robot, leaves its joint limits, or contradicts a coupling.
    """
    references = {}
    for robot in station.robots.values():
        start = (starts or {}).get(robot.name, robot.initial)
        if len(start) != len(robot.axes):
            size = message(
                "stations.state_of_size",
                "a state in which '{robot}' is of size {size}",
                robot=robot.name,
                size=len(start),
            )
            raise InvalidParameter(
                "start",
                size,
                message("stations.station_of_size", "of a station where it is of size {size}", size=len(robot.axes)),
            )
        own: Any = (requested or {}).get(robot.name)
        if own is None:
            reference: Reference = station.config.reference_of(robot.name).trajectory(robot, start)
        else:
            linear = not station.config.follows_speed(robot.name)
            reference = _through(own, robot, linear=linear) if isinstance(own, tuple) else own
        count = as_reference(reference).size
        if count != len(robot.axes):
            expected = message(
                "stations.count_of_joints", "{count} joints: {axes}", count=len(robot.axes), axes=", ".join(robot.axes)
            )
            raise InvalidParameter(
                "reference",
                message("stations.trajectory_of_joints", "a trajectory of {count} joints", count=count),
                expected,
            )
        references[robot.name] = reference
    return obey_couplings(station, references, requested or {}, starts or {})


def reference_samples(reference: Reference, duration: float) -> tuple[Vector, Vector]:
    """Return a reference over a run: times (m,) [s] and positions (m, n) [rad]."""
    times = np.linspace(0.0, duration, _LOOKS + 1)
    return times, reference_values(reference, times)


def check_reference(robot: ResolvedRobot, reference: Reference, duration: float) -> None:
    """Check a reference against joint limits; raises InvalidParameter: the joint, the time, the value, the limits."""
    times, positions = reference_samples(reference, duration)
    if not np.isfinite(positions).all():
        row, axis = np.argwhere(~np.isfinite(positions))[0]
        text = message("stations.value_at_time", "{value} at {time:.2f} s", value=positions[row, axis], time=times[row])
        raise InvalidParameter(
            message(
                "stations.reference_of_axis", "reference of {prefix}{axis}", prefix=robot.prefix, axis=robot.axes[axis]
            ),
            text,
            message("stations.finite_at_any_time", "a finite number at any time"),
        )
    violation = robot.model.limits.find_violation(positions)
    if violation is not None:
        raise InvalidParameter(
            message(
                "stations.reference_of_axis",
                "reference of {prefix}{axis}",
                prefix=robot.prefix,
                axis=robot.axes[violation.axis],
            ),
            message(
                "stations.position_at_time",
                "{position} {unit} at {time:.2f} s",
                position=violation.value,
                unit=violation.unit,
                time=times[violation.row],
            ),
            message("stations.within_limits", "within the joint's limits of {limits}", limits=violation.limits),
        )


def _through(samples: Samples, robot: ResolvedRobot, *, linear: bool) -> Trajectory:
    positions = np.asarray(samples[1], dtype=float)
    if positions.ndim != 2 or positions.shape[1] != len(robot.axes):
        shape = " x ".join(str(size) for size in positions.shape)
        raise InvalidParameter(
            "reference",
            message("stations.array_of", "an array of {shape}", shape=shape),
            message("stations.columns_a_joint", "of {count} columns, one a joint [rad]", count=len(robot.axes)),
        )
    return interpolate_samples(samples[0], positions, linear=linear)
