"""What a station shows to the diagram around it: its named ports."""

from __future__ import annotations

from dataclasses import dataclass, field

from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import PassThrough

from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.blocks.monitor import Monitor
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import StationPlant
from simrob_drake.stations.robots import StationRobot


@dataclass(frozen=True)
class StationPorts:
    """The ports of a station; names carry the prefix ``<robot>.`` where there are several robots.

    Attributes:
        config: the station's configuration.
        plant: its multibody plant, scene graph and robots.
        state: positions and velocities of the whole plant, size nq + nv.
        inputs: input ports by name: ``reference`` (n) and what the station lists under ``inputs``.
        outputs: output ports by name: ``position``, ``velocity``, ``torque`` (n), ``base_pose``, ``tcp_pose`` (7),
            ``piece_pose.<piece>`` (7), ``piece_velocity.<piece>`` (6), ``force.<sensor>`` (3) ...
        monitors: the monitor blocks by name.
        observers: the momentum observers by the names of their sensors; those out of the loop are in no diagram.
    """

    config: StationConfig
    plant: StationPlant
    state: OutputPort
    inputs: dict[str, InputPort] = field(default_factory=dict)
    outputs: dict[str, OutputPort] = field(default_factory=dict)
    monitors: dict[str, Monitor] = field(default_factory=dict)
    observers: dict[str, MomentumObserver] = field(default_factory=dict)


def add_input(builder: DiagramBuilder, inputs: dict[str, InputPort], robot: StationRobot, name: str) -> OutputPort:
    """Add an input of one value an axis to a station, as a block that any number of others can read."""
    block = builder.AddNamedSystem(f"{robot.prefix}{name}", PassThrough(len(robot.joints)))
    inputs[f"{robot.prefix}{name}"] = block.get_input_port()
    return block.get_output_port()
