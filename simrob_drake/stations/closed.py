"""Close a station: give its inputs sources, so that it can run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.trajectories import Trajectory

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.forces import add_force_sources
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.references import Samples, add_reference
from simrob_drake.stations.station import add_station

_LOOKS = 500
"""At how many times a reference is checked against the joint limits."""


def add_closed_station(
    builder: DiagramBuilder,
    config: StationConfig,
    references: Mapping[str, Trajectory | Samples] | None = None,
    starts: Mapping[str, Vector] | None = None,
) -> StationPorts:
    """Add a station with the sources of its references; its other inputs are zero.

    Args:
        builder: the diagram under construction.
        config: the station.
        references: by robot, in place of the configuration's.
        starts: by robot, where the configuration's references begin instead of at its initial posture, (n,) [rad].
    """
    ports = add_station(builder, config)
    given, begun = references or {}, starts or {}
    for robot in ports.plant.robots.values():
        start = begun.get(robot.name, robot.initial)
        if len(start) != len(robot.axes):
            size = f"a state in which '{robot.name}' is of size {len(start)}"
            raise InvalidParameter("start", size, f"of a station where it is of size {len(robot.axes)}")
        velocity, acceleration = f"{robot.prefix}reference_velocity", f"{robot.prefix}reference_acceleration"
        derivatives = velocity in ports.inputs or acceleration in ports.inputs
        wanted = given.get(robot.name, config.reference_of(robot.name))
        source = add_reference(builder, wanted, robot, start=start, derivatives=derivatives)
        builder.Connect(source.position, ports.inputs[f"{robot.prefix}reference"])
        for name, port in ((velocity, source.velocity), (acceleration, source.acceleration)):
            if name in ports.inputs and port is not None:
                builder.Connect(port, ports.inputs[name])
    add_force_sources(builder, ports)
    for name, port in ports.inputs.items():
        if not builder.IsConnectedOrExported(port):
            zero = builder.AddNamedSystem(f"{name}.zero", ConstantVectorSource(np.zeros(port.size())))
            builder.Connect(zero.get_output_port(), port)
    return ports


def reference_samples(diagram: Diagram, ports: StationPorts, robot: str) -> tuple[Vector, Vector]:
    """Return a robot's reference over the run: times (m,) [s] and positions (m, n) [rad]."""
    context = diagram.CreateDefaultContext()
    port = ports.outputs[f"{ports.config.prefix(robot)}reference"]
    own = port.get_system().GetMyContextFromRoot(context)
    times = np.linspace(0.0, ports.config.duration, _LOOKS + 1)
    positions = np.empty((len(times), port.size()))
    for row, time in enumerate(times):
        context.SetTime(time)
        positions[row] = port.Eval(own)
    return times, positions


def check_references(diagram: Diagram, ports: StationPorts) -> None:
    """Check that every reference stays within the joint limits.

    Raises:
        InvalidParameter: names the joint, the time, the value and the limits.
    """
    for robot in ports.plant.robots.values():
        times, positions = reference_samples(diagram, ports, robot.name)
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
