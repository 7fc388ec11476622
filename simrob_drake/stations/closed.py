"""Close a station: give its inputs sources, and build a diagram that can run."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import (
    Course,
    ReferenceSource,
    Samples,
    add_course,
    corner_times,
    course_values,
    table,
)
from simrob_drake.blocks.wiring import fed
from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.frames import Vector
from simrob_drake.lifetime import built
from simrob_drake.parts.captions import wrapped
from simrob_drake.parts.forces import Drag, ForceConfig, Push
from simrob_drake.parts.site import ResolvedRobot, StationRobot
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import ResolvedStation
from simrob_drake.stations.station import compose

_LOOKS = 500
"""At how many times a reference is checked against the joint limits."""


@dataclass(frozen=True)
class ClosedStation:
    """A diagram that holds a station whose inputs all have sources.

    Attributes:
        diagram: that can be run.
        ports: of the station.
        courses: what each robot is asked, by name; those that a block asks are left out.
        players: the sources of these courses that are trajectories, by robot.
    """

    diagram: Diagram
    ports: StationPorts
    courses: dict[str, Course] = field(default_factory=dict)
    players: Mapping[str, TrajectorySource] = field(default_factory=dict)

    def play(self, courses: Mapping[str, Course], forces: Mapping[str, ForceConfig]) -> None:
        """Let the sources give other trajectories and pushes."""
        for robot, player in self.players.items():
            if self.courses[robot] is not courses[robot]:  # a copy of it takes time and memory
                self.courses[robot] = courses[robot]
                player.UpdateTrajectory(courses[robot])
        self.play_forces(forces)

    def play_forces(self, forces: Mapping[str, ForceConfig]) -> None:
        """Let the sources give other pushes and drags at the same places."""
        for name, force in forces.items():
            place = f"force.{name}.source"
            if isinstance(force, Push | Drag) and self.diagram.HasSubsystemNamed(place):
                self.diagram.GetSubsystemByName(place).UpdateTrajectory(force.course())


def closed_station(
    station: ResolvedStation,
    courses: Mapping[str, Course] | None = None,
    *,
    sensors: Collection[str] | None = None,
    forces: bool = True,
    monitors: bool = True,
    blocks: Mapping[str, LeafSystem] | None = None,
) -> ClosedStation:
    """Build a station with the sources of its references; its other inputs are zero.

    What each robot is asked is as the configuration says unless given; the other arguments are those of
    :func:`~simrob_drake.stations.station.compose`.

    Raises:
        SimrobError: blocks that cannot be wired so.
    """
    builder = DiagramBuilder()
    ports = compose(builder, station, sensors=sensors, forces=forces, monitors=monitors, blocks=blocks)
    given = station_courses(station) if courses is None else courses
    asked, players = dict[str, Course](), dict[str, TrajectorySource]()
    for robot in ports.plant.robots.values():
        course = given[robot.name]
        if (source := _add_source(builder, ports, robot, course)) is not None:
            asked[robot.name] = course
            if source.player is not None:
                players[robot.name] = source.player
    for name, port in ports.inputs.items():
        if not builder.IsConnectedOrExported(port):
            builder.Connect(fed(builder, f"{name}.zero", ConstantVectorSource(np.zeros(port.size()))), port)
            owner = next((robot for robot in ports.plant.robots.values() if name.startswith(robot.prefix)), None)
            ports.draw(f"{name}.zero", "reference", "0", owner)
    try:
        return ClosedStation(built(builder), ports, asked, players)
    except RuntimeError as problem:
        if not ports.blocks:
            raise
        used = "been built into a different Diagram" in str(problem)
        told = "a block serves one diagram; make it anew" if used else "signals must not go around in a circle"
        raise SimrobError(f"the blocks {', '.join(ports.blocks)} cannot be wired so; {told} ({problem})") from problem


def _add_source(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, course: Course
) -> ReferenceSource | None:
    """Add the source of a robot's reference, with what derivatives the station takes; None if a block drives it."""
    names = [f"{robot.prefix}reference{order}" for order in ("", "_velocity", "_acceleration")]
    wanted = [name for name in names if name in ports.inputs and not builder.IsConnectedOrExported(ports.inputs[name])]
    if names[0] not in wanted:
        return None
    source = add_course(builder, course, name=f"{names[0]}_source", derivatives=names.index(wanted[-1]))
    for name, port in zip(names, (source.position, source.velocity, source.acceleration), strict=True):
        if name in wanted and port is not None:
            builder.Connect(port, ports.inputs[name])
    ports.edges.extend(corner_times(course))
    told = ports.config.reference_of(robot.name).caption(robot.model)
    ports.draw(f"{names[0]}_source", "reference", wrapped(told), robot)
    return source


def station_courses(
    station: ResolvedStation,
    given: Mapping[str, Course | Samples] | None = None,
    starts: Mapping[str, Vector] | None = None,
) -> dict[str, Course]:
    """Return what each robot is asked, by name: what is given, else what the configuration says.

    Samples that are given are joined by straight lines, as Simulink joins them, but by a smooth curve where their
    derivatives are needed. The configuration's references begin at ``starts`` (n,) [rad], else at the initial posture.

    Raises:
        SimrobError: a reference that does not fit the robot, or leaves its joint limits.
    """
    courses = {}
    for robot in station.robots.values():
        start = (starts or {}).get(robot.name, robot.initial)
        if len(start) != len(robot.axes):
            size = f"a state in which '{robot.name}' is of size {len(start)}"
            raise InvalidParameter("start", size, f"of a station where it is of size {len(robot.axes)}")
        wanted: Any = (given or {}).get(robot.name)
        if wanted is None:
            course: Course = station.config.reference_of(robot.name).course(robot, start)
        else:
            linear = not station.config.follows_speed(robot.name)
            course = _through(wanted, robot, linear=linear) if isinstance(wanted, tuple) else wanted
        if isinstance(course, Trajectory) and course.rows() != len(robot.axes):
            expected = f"{len(robot.axes)} joints: {', '.join(robot.axes)}"
            raise InvalidParameter("reference", f"a trajectory of {course.rows()} joints", expected)
        courses[robot.name] = course
    return courses


def course_samples(course: Course, duration: float) -> tuple[Vector, Vector]:
    """Return a reference over a run: times (m,) [s] and positions (m, n) [rad]."""
    times = np.linspace(0.0, duration, _LOOKS + 1)
    return times, course_values(course, times)


def check_course(robot: ResolvedRobot, course: Course, duration: float) -> None:
    """Check that a reference stays within the joint limits.

    Raises:
        InvalidParameter: names the joint, the time, the value and the limits.
    """
    times, positions = course_samples(course, duration)
    if not np.isfinite(positions).all():
        row, axis = np.argwhere(~np.isfinite(positions))[0]
        told = f"{positions[row, axis]} at {times[row]:.2f} s"
        raise InvalidParameter(f"reference of {robot.prefix}{robot.axes[axis]}", told, "a finite number at any time")
    lower, upper = robot.model.axis_limits
    outside = ~((positions >= lower - 1e-9) & (positions <= upper + 1e-9))  # nor is what is no number inside
    if outside.any():
        row, axis = np.argwhere(outside)[0]
        unit, name = robot.model.user_units[axis], robot.model.unit_names[axis]
        low, high, value = np.array([lower[axis], upper[axis], positions[row, axis]]) / unit
        raise InvalidParameter(
            f"reference of {robot.prefix}{robot.axes[axis]}",
            f"{value:.5g} {name} at {times[row]:.2f} s",
            f"within the joint's limits of {low:.5g} to {high:.5g} {name}",
        )


def _through(samples: Samples, robot: ResolvedRobot, *, linear: bool) -> Trajectory:
    """Return the trajectory through samples."""
    positions = np.asarray(samples[1], dtype=float)
    if positions.ndim != 2 or positions.shape[1] != len(robot.axes):
        shape = " x ".join(str(size) for size in positions.shape)
        raise InvalidParameter("reference", f"an array of {shape}", f"of {len(robot.axes)} columns, one a joint [rad]")
    return table(samples[0], positions, linear=linear)
