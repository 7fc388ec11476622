"""Forces on a station's robots over time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Sine

from simrob_drake.blocks.push import Push, force_over_time
from simrob_drake.blocks.references import add_trajectory
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.force_config import ExternalForce, PushConfig, Pushes
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
        source = _source(builder, wanted, f"{name}.source")
        builder.Connect(source, ports.inputs[name])
        ports.outputs[name] = source


def pushes_of(wanted: Iterable[PushConfig]) -> list[Push]:
    """Return the pushes that a configuration asks for."""
    return [Push(push.start, push.duration, np.array(push.force)) for push in wanted]


def _source(builder: DiagramBuilder, wanted: ExternalForce, name: str) -> OutputPort:
    if isinstance(wanted, Pushes):
        return add_trajectory(builder, force_over_time(pushes_of(wanted.pushes)), name=name).position
    amplitude = np.array(wanted.amplitude)
    pulsation, phase = np.full(3, 2 * np.pi * wanted.frequency), np.full(3, np.deg2rad(wanted.phase_deg))
    return builder.AddNamedSystem(name, Sine(amplitude, pulsation, phase)).get_output_port(0)
