"""Add the outputs of a station's free pieces: where they are and how they move."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.frame_poses import FramePoses
from simrob_drake.blocks.wiring import mapped
from simrob_drake.stations.ports import StationPorts

VELOCITY_NAMES = ("vx", "vy", "vz", "wx", "wy", "wz")


def add_free_pieces(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add ``piece_pose.<piece>`` (7) and ``piece_velocity.<piece>`` (6: linear, then angular, in the world's axes)."""
    plant, free = ports.plant.plant, ports.plant.free_pieces
    if not free:
        return
    frames = {f"piece_pose.{piece}": body.body_frame() for piece, body in free.items()}
    poses = builder.AddNamedSystem("piece_poses", FramePoses(plant=plant, frames=frames))
    builder.Connect(ports.state, poses.get_input_port())
    for piece, body in free.items():
        ports.outputs[f"piece_pose.{piece}"] = poses.GetOutputPort(f"piece_pose.{piece}")
        start = plant.num_positions() + body.floating_velocities_start_in_v()
        pick = np.zeros((6, plant.num_multibody_states()))
        pick[[3, 4, 5, 0, 1, 2], range(start, start + 6)] = 1.0  # Drake has the angular part first
        ports.outputs[f"piece_velocity.{piece}"] = mapped(builder, f"piece_velocity.{piece}", pick, ports.state)
