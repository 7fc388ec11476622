"""Close a station: give its inputs sources, so that it can run."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource
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
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.captions import wrapped
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import ResolvedStation
from simrob_drake.stations.station import compose

_LOOKS = 500
"""At how many times a reference is checked against the joint limits."""


@dataclass(frozen=True)
class ClosedStation:
    """A station whose inputs all have sources.

    Attributes:
        ports: of the station.
        courses: what each robot is asked, by name; those that a block asks are left out.
        sources: of these, by robot.
    """

    ports: StationPorts
    courses: dict[str, Course]
    sources: dict[str, ReferenceSource]


def add_closed_station(
    builder: DiagramBuilder,
    station: ResolvedStation,
    courses: Mapping[str, Course] | None = None,
    *,
    sensors: Collection[str] | None = None,
    forces: bool = True,
    monitors: bool = True,
    blocks: Mapping[str, LeafSystem] | None = None,
) -> ClosedStation:
    """Add a station with the sources of its references; its other inputs are zero.

    Args:
        builder: the diagram under construction.
        station: resolved.
        courses: what each robot is asked; as the configuration says unless given.
        sensors: the names of those that are added; all unless given.
        forces: whether those of the configuration act.
        monitors: whether they stand in the diagram.
        blocks: the station's controllers, made, and others of the user's own, by name.
    """
    ports = compose(builder, station, sensors=sensors, forces=forces, monitors=monitors, blocks=blocks)
    given = station_courses(station) if courses is None else courses
    asked, sources = dict[str, Course](), dict[str, ReferenceSource]()
    for robot in ports.plant.robots.values():
        names = [f"{robot.prefix}reference{order}" for order in ("", "_velocity", "_acceleration")]
        open_ = [name in ports.inputs and not builder.IsConnectedOrExported(ports.inputs[name]) for name in names]
        if not any(open_):
            continue
        course = given[robot.name]
        source = add_course(builder, course, name=f"{robot.prefix}reference_source", derivatives=any(open_[1:]))
        for name, is_open, port in zip(
            names, open_, (source.position, source.velocity, source.acceleration), strict=True
        ):
            if is_open and port is not None:
                builder.Connect(port, ports.inputs[name])
        ports.edges.extend(corner_times(course))
        sources[robot.name] = source
        told = station.config.reference_of(robot.name).caption(robot.model)
        ports.draw(f"{robot.prefix}reference_source", "reference", wrapped(told), robot)
        if open_[0]:
            asked[robot.name] = course
    for name, port in ports.inputs.items():
        if not builder.IsConnectedOrExported(port):
            zero = builder.AddNamedSystem(f"{name}.zero", ConstantVectorSource(np.zeros(port.size())))
            owner = next((robot for robot in ports.plant.robots.values() if name.startswith(robot.prefix)), None)
            ports.draw(f"{name}.zero", "reference", "0", owner)
            builder.Connect(zero.get_output_port(), port)
    return ClosedStation(ports, asked, sources)


def station_courses(
    station: ResolvedStation,
    given: Mapping[str, Trajectory | Samples] | None = None,
    starts: Mapping[str, Vector] | None = None,
) -> dict[str, Course]:
    """Return what each robot is asked: what is given, else what the configuration says.

    Args:
        station: resolved.
        given: by robot. Samples are joined by straight lines, as Simulink joins them, but by a smooth curve where
            their derivatives are needed.
        starts: by robot, where the configuration's references begin instead of at its initial posture, (n,) [rad].

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
            linear = station.mode == "dynamic" and "reference_velocity" not in station.config.inputs
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
    lower, upper = robot.model.axis_limits
    outside = (positions < lower - 1e-9) | (positions > upper + 1e-9)
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
