"""Add the pose outputs of a station: bases, tools and free pieces, and how these move."""

from collections.abc import Mapping

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Selector, SelectorParams

from simrob_drake.blocks.frame_poses import FramePoses
from simrob_drake.frames import Indices, Vector
from simrob_drake.parts.captions import wrapped
from simrob_drake.parts.site import FromState, StationRobot
from simrob_drake.signals import POSE, VELOCITY, Panel, Role, Signal
from simrob_drake.stations.ports import StationPorts


def add_poses(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add ``base_pose``, ``tcp_pose``, ``tcp_pose.<tool>`` of every robot, ``base_velocity`` (6) of those that float.

    A velocity is the linear one of the root link, then the angular one, in the world's axes [m/s, rad/s].
    """
    plant = ports.plant.plant
    for robot in ports.plant.robots.values():
        frames = {"base_pose": robot.root, **{f"tcp_pose.{tool}": frame for tool, frame in robot.tools.items()}}
        block = FramePoses(plant=plant, frames=frames)
        outputs = [f"{robot.prefix}{output}" for output in [*frames, *(["tcp_pose"] if robot.tcp else [])]]
        ports.add_report(builder, f"{robot.prefix}poses", block, ports.state, *outputs)
        ports.draw(f"{robot.prefix}poses", "sensor", "Poses\n" + wrapped(", ".join(["base", *robot.tools])), robot)
        for name in frames:
            signals, of_state = [], None
            if name == "base_pose":
                signals = [_pose_signal(robot, "base", name)]
                of_state = FromState(_free_pose(robot.root.body()), unit_poses) if _is_free(robot) else None
            ports.add(f"{robot.prefix}{name}", block.GetOutputPort(name), *signals, of_state=of_state)
        if _is_free(robot):
            output, pick = f"{robot.prefix}base_velocity", _free_velocity(plant, robot.root.body())
            velocity = _selector(plant, {output: pick})
            ports.add_report(builder, output, velocity, ports.state, output)
            ports.add(output, velocity.get_output_port(), of_state=FromState(pick))
        if robot.tcp:
            port = block.GetOutputPort(f"tcp_pose.{robot.tcp}")
            ports.add(f"{robot.prefix}tcp_pose", port, _pose_signal(robot, "tcp", "tcp_pose"))


def add_free_pieces(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add ``piece_pose.<piece>`` (7) and ``piece_velocity.<piece>`` (6: linear, then angular, in the world's axes)."""
    plant, free = ports.plant.plant, ports.plant.free_pieces
    if not free:
        return
    frames = {f"piece_pose.{piece}": body.body_frame() for piece, body in free.items()}
    poses = FramePoses(plant=plant, frames=frames)
    ports.add_report(builder, "piece_poses", poses, ports.state, *frames)
    ports.draw("piece_poses", "sensor", wrapped(f"Poses of {', '.join(free)}"))
    picks = {f"piece_velocity.{piece}": _free_velocity(plant, body) for piece, body in free.items()}
    velocities = _selector(plant, picks)
    ports.add_report(builder, "piece_velocity", velocities, ports.state, *picks)
    for piece, body in free.items():
        pose = piece_pose_signal(piece)
        from_state = FromState(_free_pose(body), unit_poses)
        ports.add(pose.output, poses.GetOutputPort(pose.output), pose, of_state=from_state)
        velocity = _piece_signal(piece, "velocity", VELOCITY)
        port = velocities.GetOutputPort(velocity.output)
        ports.add(velocity.output, port, velocity, of_state=FromState(picks[velocity.output]))


def piece_pose_signal(piece: str) -> Signal:
    """Return what the pose of a piece is that moves."""
    return _piece_signal(piece, "pose", POSE)


def _piece_signal(piece: str, output: str, content: tuple[tuple[str, ...], tuple[str, ...], str]) -> Signal:
    parts, units, quantity = content
    names, title = tuple(f"piece.{piece}.{part}" for part in parts), quantity.partition(" ")[0]
    panel = Panel(f"piece_{piece}", f"the piece '{piece}' in the world", title, quantity, names[:3])
    role: Role = "pose" if output == "pose" else "motion"
    return Signal(names, units, role, f"piece_{output}.{piece}", part=piece, panel=panel)


def unit_poses(poses: Vector) -> Vector:
    """Return poses (m, 7) with quaternions of length one whose qw is not negative."""
    size = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True) * np.where(poses[:, 3:4] < 0, -1.0, 1.0)
    return np.hstack([poses[:, :3], poses[:, 3:] / size])


def _pose_signal(robot: StationRobot, columns: str, output: str) -> Signal:
    names = tuple(f"{robot.prefix}{columns}.{part}" for part in POSE[0])
    return Signal(names, POSE[1], "pose", f"{robot.prefix}{output}")


def _is_free(robot: StationRobot) -> bool:
    """Tell whether the root link is a free body of the plant, and no part of one."""
    return robot.floats and robot.root.body().is_floating_base_body() and robot.root.is_body_frame()


def _free_pose(body: RigidBody) -> Indices:
    """Return the entries (7,) of the state that are the pose of a free body: x y z qw qx qy qz."""
    drake_order = np.array([4, 5, 6, 0, 1, 2, 3])  # Drake has the quaternion first
    return np.asarray(body.floating_positions_start() + drake_order)


def _free_velocity(plant: MultibodyPlant, body: RigidBody) -> Indices:
    """Return the entries (6,) of the state that are the linear and the angular velocity of a free body."""
    drake_order = np.array([3, 4, 5, 0, 1, 2])  # Drake has the angular part first
    return np.asarray(plant.num_positions() + body.floating_velocities_start_in_v() + drake_order)


def _selector(plant: MultibodyPlant, picks: Mapping[str, Indices]) -> Selector:
    """Return a block that reads the state of a plant, with an output port for each name of these entries."""
    selection = SelectorParams.OutputSelection
    outputs = [
        SelectorParams.OutputPortParams(
            name=name,
            selections=[selection(input_port_index=0, input_offset=int(entry)) for entry in entries],
        )
        for name, entries in picks.items()
    ]
    state = SelectorParams.InputPortParams(name="state", size=plant.num_multibody_states())
    return Selector(SelectorParams(inputs=[state], outputs=outputs))
