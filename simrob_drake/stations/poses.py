"""Add the pose outputs of a station: bases and tools."""

from __future__ import annotations

from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.frame_poses import FramePoses
from simrob_drake.stations.ports import StationPorts


def add_poses(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add ``base_pose``, ``tcp_pose`` and ``tcp_pose.<tool>`` for every robot."""
    for robot in ports.plant.robots.values():
        frames = {"base_pose": robot.root, **{f"tcp_pose.{tool}": frame for tool, frame in robot.tools.items()}}
        block = builder.AddNamedSystem(f"{robot.prefix}poses", FramePoses(plant=ports.plant.plant, frames=frames))
        builder.Connect(ports.state, block.get_input_port())
        for name in frames:
            ports.outputs[f"{robot.prefix}{name}"] = block.GetOutputPort(name)
        if robot.tcp:
            ports.outputs[f"{robot.prefix}tcp_pose"] = block.GetOutputPort(f"tcp_pose.{robot.tcp}")
