"""Pose and velocity outputs of a station: for bases and tools of robots, and for free pieces.

A *free* body is held by nothing but contact and gravity: a piece on a table, or the root link of a robot that floats.
Its pose and velocity are entries of the plant's state. A *pose* is x y z [m] and a unit quaternion qw qx qy qz.
"""

from collections.abc import Mapping

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Selector, SelectorParams

from simrob_drake.base.frames import Indices, Vector
from simrob_drake.base.messages import message, translate
from simrob_drake.base.signals import POSE, VELOCITY, Panel, Role, Signal
from simrob_drake.blocks.frame_poses import FramePoses
from simrob_drake.parts.captions import wrap_label
from simrob_drake.parts.outputs import FromState
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.ports import StationPorts


def add_poses(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add the outputs for the bases and tools of all robots to the ports of a station.

    These are ``base_pose`` (7), ``tcp_pose.<tool>`` (7) for every tool, ``tcp_pose`` (7) for the tool in use if there
    is one, and for a robot whose root link is a free body ``base_velocity`` (6): the linear velocity of the root link
    [m/s], then the angular velocity [rad/s], in the world's axes. All poses are in the world. Names begin with the
    robot's prefix if there are several robots.
    """
    plant = ports.plant.plant
    for robot in ports.plant.robots.values():
        frames = {"base_pose": robot.root}  # by the name of the output
        for tool, frame in robot.tools.items():
            frames[f"tcp_pose.{tool}"] = frame
        poses = FramePoses(plant=plant, frames=frames)
        outputs = [f"{robot.prefix}{output}" for output in frames]
        if robot.tcp:
            outputs.append(f"{robot.prefix}tcp_pose")
        # The block joins the diagram that is stepped only if another block reads one of these outputs.
        ports.outputs.add_report(builder, f"{robot.prefix}poses", poses, ports.state, *outputs)
        names = wrap_label(", ".join(["base", *robot.tools]))
        label = message("stations.block_poses", "Poses\n{names}", names=names)
        ports.picture.draw(f"{robot.prefix}poses", "sensor", label, robot)

        # Only the base and the tool in use have columns in a result. The pose of a free base is part of the state, so
        # that it can also be computed from recorded states.
        is_free = _is_free(robot)
        from_state = FromState(_free_pose(robot.root.body()), unit_poses) if is_free else None
        base_signal = _pose_signal(robot, "base", "base_pose")
        base_port = poses.GetOutputPort("base_pose")
        ports.outputs.add(f"{robot.prefix}base_pose", base_port, base_signal, of_state=from_state)
        for tool in robot.tools:
            ports.outputs.add(
                f"{robot.prefix}tcp_pose.{tool}", poses.GetOutputPort(f"tcp_pose.{tool}")
            )
        if is_free:
            output = f"{robot.prefix}base_velocity"
            entries = _free_velocity(plant, robot.root.body())
            velocity = _selector(plant, {output: entries})
            ports.outputs.add_report(builder, output, velocity, ports.state, output)
            ports.outputs.add(output, velocity.get_output_port(), of_state=FromState(entries))
        if robot.tcp:
            port = poses.GetOutputPort(f"tcp_pose.{robot.tcp}")
            ports.outputs.add(
                f"{robot.prefix}tcp_pose", port, _pose_signal(robot, "tcp", "tcp_pose")
            )


def add_free_pieces(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add the outputs for all free pieces to the ports of a station.

    These are ``piece_pose.<piece>`` (7) in the world, and ``piece_velocity.<piece>`` (6): the linear velocity [m/s],
    then the angular velocity [rad/s], in the world's axes. A station without free pieces gets nothing.
    """
    plant = ports.plant.plant
    free = ports.plant.free_pieces
    if not free:
        return
    # One block for the poses of all pieces, and one for their velocities: a station may have thousands of pieces.
    frames = {f"piece_pose.{piece}": body.body_frame() for piece, body in free.items()}
    poses = FramePoses(plant=plant, frames=frames)
    ports.outputs.add_report(builder, "piece_poses", poses, ports.state, *frames)
    label = message("stations.block_poses_of", "Poses of {names}", names=", ".join(free))
    ports.picture.draw("piece_poses", "sensor", wrap_label(translate(label)))
    # Indices in the plant's state, by the name of the output.
    entries = {
        f"piece_velocity.{piece}": _free_velocity(plant, body) for piece, body in free.items()
    }
    velocities = _selector(plant, entries)
    ports.outputs.add_report(builder, "piece_velocity", velocities, ports.state, *entries)
    for piece, body in free.items():
        pose = piece_pose_signal(piece)
        from_state = FromState(_free_pose(body), unit_poses)
        ports.outputs.add(pose.output, poses.GetOutputPort(pose.output), pose, of_state=from_state)
        velocity = _piece_signal(piece, "velocity", VELOCITY)
        port = velocities.GetOutputPort(velocity.output)
        ports.outputs.add(
            velocity.output, port, velocity, of_state=FromState(entries[velocity.output])
        )


def piece_pose_signal(piece: str) -> Signal:
    """Declare the columns of a free piece's pose in a result."""
    return _piece_signal(piece, "pose", POSE)


def _piece_signal(
    piece: str,
    output: str,
    content: tuple[tuple[str, ...], tuple[str, ...], str],
) -> Signal:
    """Declare the columns of a free piece's pose or velocity in a result, with a plot of the first three.

    Args:
        piece: name of the piece.
        output: ``pose`` or ``velocity``.
        content: names of the components, their units, and the quantity for the plot.
    """
    parts, units, quantity = content
    names = tuple(f"piece.{piece}.{part}" for part in parts)
    heading = message("stations.piece_in_world", "the piece '{piece}' in the world", piece=piece)
    panel = Panel(f"piece_{piece}", heading, quantity, quantity, names[:3])
    role: Role = "pose" if output == "pose" else "motion"
    return Signal(names, units, role, f"piece_{output}.{piece}", part=piece, panel=panel)


def unit_poses(poses: Vector) -> Vector:
    """Normalize the quaternions of poses (m, 7): to length one, and with qw not negative.

    A quaternion and its negative describe the same orientation; this choice makes them unique.
    """
    quaternions = poses[:, 3:]
    signs = np.where(poses[:, 3:4] < 0, -1.0, 1.0)
    # q / (|q| s) with the sign s of qw: one division does both.
    size = np.linalg.norm(quaternions, axis=1, keepdims=True) * signs
    return np.hstack([poses[:, :3], quaternions / size])


def _pose_signal(robot: StationRobot, columns: str, output: str) -> Signal:
    """Declare the columns ``<columns>.x`` to ``<columns>.qz`` of a result for a pose output of a robot."""
    names = tuple(f"{robot.prefix}{columns}.{part}" for part in POSE[0])
    return Signal(names, POSE[1], "pose", f"{robot.prefix}{output}")


def _is_free(robot: StationRobot) -> bool:
    """Whether the root link of a robot is a free body of the plant, and its frame the frame of that body."""
    return robot.floats and robot.root.body().is_floating_base_body() and robot.root.is_body_frame()


def _free_pose(body: RigidBody) -> Indices:
    """Indices (7,) of the pose of a free body in the plant's state, in the order x y z qw qx qy qz."""
    order = np.array([4, 5, 6, 0, 1, 2, 3])  # Drake has the quaternion first
    return np.asarray(body.floating_positions_start() + order)


def _free_velocity(plant: MultibodyPlant, body: RigidBody) -> Indices:
    """Indices (6,) of the velocity of a free body in the plant's state, first linear, then angular."""
    order = np.array([3, 4, 5, 0, 1, 2])  # Drake has the angular velocity first
    start = plant.num_positions() + body.floating_velocities_start_in_v()
    return np.asarray(start + order)


def _selector(plant: MultibodyPlant, entries: Mapping[str, Indices]) -> Selector:
    """Make a block that selects entries of a plant's state.

    Args:
        plant: the plant; its state is the block's only input.
        entries: indices of the entries that each output port has, by the name of the port.
    """
    outputs = []
    for name, indices in entries.items():
        selections = []
        for index in indices.tolist():
            selection = SelectorParams.OutputSelection(input_port_index=0, input_offset=index)
            selections.append(selection)
        outputs.append(SelectorParams.OutputPortParams(name=name, selections=selections))
    state = SelectorParams.InputPortParams(name="state", size=plant.num_multibody_states())
    return Selector(SelectorParams(inputs=[state], outputs=outputs))
