"""Add the pose outputs of a station: bases and tools."""

from __future__ import annotations

from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake.blocks.frame_pose import FramePose
from simrob_drake.frames import transform_from_pose, xyz_quaternion_from_transform
from simrob_drake.stations.plant import StationRobot
from simrob_drake.stations.ports import StationPorts


def add_poses(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add ``base_pose``, ``tcp_pose`` and ``tcp_pose.<tool>`` for every robot."""
    for robot in ports.plant.robots.values():
        ports.outputs[f"{robot.prefix}base_pose"] = _base_pose(builder, ports, robot)
        for tool, frame in robot.tools.items():
            pose = _frame_pose(builder, ports, f"{robot.prefix}tcp_pose.{tool}", frame)
            ports.outputs[f"{robot.prefix}tcp_pose.{tool}"] = pose
        if robot.tcp:
            ports.outputs[f"{robot.prefix}tcp_pose"] = ports.outputs[f"{robot.prefix}tcp_pose.{robot.tcp}"]


def _base_pose(builder: DiagramBuilder, ports: StationPorts, robot: StationRobot) -> OutputPort:
    if robot.model.base == "floating" and ports.config.mode == "dynamic":
        return _frame_pose(builder, ports, f"{robot.prefix}base_pose", robot.root)
    pose = xyz_quaternion_from_transform(transform_from_pose(ports.config.robots[robot.name].base))
    return builder.AddNamedSystem(f"{robot.prefix}base_pose", ConstantVectorSource(pose)).get_output_port()


def _frame_pose(builder: DiagramBuilder, ports: StationPorts, name: str, frame: Frame) -> OutputPort:
    block = builder.AddNamedSystem(name, FramePose(plant=ports.plant.plant, frame=frame))
    builder.Connect(ports.state, block.get_input_port())
    return block.get_output_port()
