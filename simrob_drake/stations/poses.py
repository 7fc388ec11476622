"""Add the pose outputs of a station: bases, tools and free pieces, and how these move."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import MatrixGain

from simrob_drake.blocks.frame_poses import FramePoses
from simrob_drake.frames import Vector
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
                of_state = FromState(_free_pose(plant, robot.root.body()), unit_poses) if _is_free(robot) else None
            ports.add(f"{robot.prefix}{name}", block.GetOutputPort(name), *signals, of_state=of_state)
        if _is_free(robot):
            output, pick = f"{robot.prefix}base_velocity", _free_velocity(plant, robot.root.body())
            gain = MatrixGain(pick)
            ports.add_report(builder, output, gain, ports.state, output)
            ports.add(output, gain.get_output_port(), of_state=FromState(pick))
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
    for piece, body in free.items():
        pick = _free_velocity(plant, body)
        gain = MatrixGain(pick)
        ports.add_report(builder, f"piece_velocity.{piece}", gain, ports.state, f"piece_velocity.{piece}")
        pose, velocity = piece_pose_signal(piece), _piece_signal(piece, "velocity", VELOCITY)
        port, unit = poses.GetOutputPort(pose.output), FromState(_free_pose(plant, body), unit_poses)
        ports.add(pose.output, port, pose, of_state=unit)
        ports.add(velocity.output, gain.get_output_port(), velocity, of_state=FromState(pick))


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


def _free_pose(plant: MultibodyPlant, body: RigidBody) -> Vector:
    """Return the matrix (7, nq + nv) that picks the pose of a free body from the state."""
    places = body.floating_positions_start() + np.array([4, 5, 6, 0, 1, 2, 3])  # Drake has the quaternion first
    return np.asarray(np.eye(plant.num_multibody_states())[places])


def _free_velocity(plant: MultibodyPlant, body: RigidBody) -> Vector:
    """Return the matrix (6, nq + nv) that picks the linear and the angular velocity of a free body from the state."""
    start = plant.num_positions() + body.floating_velocities_start_in_v()
    pick = np.zeros((6, plant.num_multibody_states()))
    pick[[3, 4, 5, 0, 1, 2], range(start, start + 6)] = 1.0  # Drake has the angular part first
    return pick
