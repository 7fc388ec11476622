"""Forces at the tools of a station's robots over time."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Sine
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake.blocks.references import add_trajectory
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.force_config import Pushes, SineForce
from simrob_drake.stations.ports import StationPorts


def takes_force(config: StationConfig) -> bool:
    """Tell whether a station's robots have the input ``external_force``."""
    return "external_force" in config.inputs or config.external_force is not None


def add_force_sources(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Feed the inputs ``external_force`` what the configuration says; nothing where it says nothing."""
    wanted = ports.config.external_force
    if wanted is None:
        return
    for robot in ports.plant.robots.values():
        name = f"{robot.prefix}external_force"
        source = _sine(builder, wanted, name) if isinstance(wanted, SineForce) else _pushes(builder, wanted, name)
        builder.Connect(source, ports.inputs[name])
        ports.outputs[name] = source


def _sine(builder: DiagramBuilder, wanted: SineForce, name: str) -> OutputPort:
    amplitude = np.array(wanted.amplitude)
    pulsation, phase = np.full(3, 2 * np.pi * wanted.frequency), np.full(3, np.deg2rad(wanted.phase_deg))
    return builder.AddNamedSystem(f"{name}.source", Sine(amplitude, pulsation, phase)).get_output_port(0)


def _pushes(builder: DiagramBuilder, wanted: Pushes, name: str) -> OutputPort:
    """Add a source of pushes whose edges are events, which no solver steps over."""
    times, forces = [0.0], [np.zeros(3)]
    for push in wanted.pushes:
        for time, force in ((push.start, np.array(push.force)), (push.start + push.duration, np.zeros(3))):
            if time == times[-1]:
                forces[-1] = force
            else:
                times.append(time)
                forces.append(force)
    times.append(times[-1] + 1.0)  # a zero-order hold needs an end
    forces.append(np.zeros(3))
    trajectory = PiecewisePolynomial.ZeroOrderHold(times, np.array(forces).T)
    return add_trajectory(builder, trajectory, name=f"{name}.source").position
