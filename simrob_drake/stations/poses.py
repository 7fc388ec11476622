"""Add the pose outputs of a station: bases, tools and free pieces, and how these move."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.geometry import ReadObjToTriangleSurfaceMesh
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import MatrixGain

from simrob_drake.blocks.frame_poses import FramePoses
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import XYZ_QUATERNION_NAMES, Vector
from simrob_drake.parts.captions import wrapped
from simrob_drake.parts.site import WORLD, FromState, StationRobot
from simrob_drake.robots.pieces import PieceModel, PieceShape, described_piece, piece_file, with_changes
from simrob_drake.signals import Panel, Role, Signal
from simrob_drake.stations.config import PieceConfig
from simrob_drake.stations.ports import StationPorts
from simrob_drake.yaml_files import YAML_SUFFIXES

VELOCITY_NAMES = ("vx", "vy", "vz", "wx", "wy", "wz")
_POSE_UNITS = ("m",) * 3 + ("1",) * 4
_VELOCITY_UNITS = ("m/s",) * 3 + ("rad/s",) * 3


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
        for output, port, parts, units, of_state, quantity in (
            ("pose", poses.GetOutputPort(f"piece_pose.{piece}"), XYZ_QUATERNION_NAMES, _POSE_UNITS,
             FromState(_free_pose(plant, body), unit_poses), "position [m]"),
            ("velocity", gain.get_output_port(), VELOCITY_NAMES, _VELOCITY_UNITS, FromState(pick), "velocity [m/s]"),
        ):  # fmt: skip
            name = f"piece_{output}.{piece}"
            ports.add(name, port, _piece_signal(piece, name, parts, units, quantity), of_state=of_state)


def piece_pose_signal(piece: str) -> Signal:
    """Return what the pose of a piece is that moves."""
    return _piece_signal(piece, f"piece_pose.{piece}", XYZ_QUATERNION_NAMES, _POSE_UNITS, "position [m]")


def _piece_signal(piece: str, output: str, parts: Sequence[str], units: tuple[str, ...], quantity: str) -> Signal:
    names, title = tuple(f"piece.{piece}.{part}" for part in parts), quantity.partition(" ")[0]
    panel = Panel(f"piece_{piece}", f"the piece '{piece}' in the world", title, quantity, names[:3])
    role: Role = "pose" if title == "position" else "motion"
    return Signal(names, units, role, output, part=piece, panel=panel)


def unit_poses(poses: Vector) -> Vector:
    """Return poses (m, 7) with quaternions of length one whose qw is not negative."""
    size = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True) * np.where(poses[:, 3:4] < 0, -1.0, 1.0)
    return np.hstack([poses[:, :3], poses[:, 3:] / size])


def _pose_signal(robot: StationRobot, columns: str, output: str) -> Signal:
    names = tuple(f"{robot.prefix}{columns}.{part}" for part in XYZ_QUATERNION_NAMES)
    return Signal(names, _POSE_UNITS, "pose", f"{robot.prefix}{output}")


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


_OWN_KEYS = {"density", "mass", "com", "inertia", "tcp", "frames", "colour"}
_SIZES = 1e-4, 50.0  # of a piece from a mesh [m]
_WITHOUT_UNIT, _UNSCALED = (".stl", ".obj"), 1.0  # files that do not tell it, and the size [m] from which we ask


def piece_of(entry: PieceConfig, name: str) -> PieceModel:
    """Return the piece that the section ``pieces.<name>`` of a station stands for, with all its figures.

    It is the piece of the package of that name, unless the section names another source. Raises UnknownName: no such
    piece; InvalidConfig: a figure that cannot be; InvalidModel: a mesh that cannot be read, or has no volume though a
    density is given; InvalidParameter: a mesh that is far too large or small, as one in millimetres is; or a robot
    carries it, and what it weighs is not said; OutputError: the cache of converted meshes cannot be written.
    """
    changes = {key: value for key, value in entry.model_dump(exclude_none=True).items() if key in _OWN_KEYS}
    model = entry.model or name
    if entry.mesh is not None:
        piece = _mesh_piece(entry, entry.mesh, f"pieces.{name}")
    else:
        piece = described_piece(Path(model) if model.endswith(YAML_SUFFIXES) else piece_file(model))
    return with_changes(piece, changes, f"pieces.{name}")


def _mesh_piece(entry: PieceConfig, file: Path, where: str) -> PieceModel:
    from simrob_drake.importer.meshes.library import drake_mesh  # few stations need what reads meshes

    mesh, scale = drake_mesh(file), entry.scale or 1.0
    size = scale * float(np.ptp(np.array(ReadObjToTriangleSurfaceMesh(str(mesh)).vertices()), axis=0).max())
    if not _SIZES[0] <= size <= _SIZES[1]:
        expected = f"such that the mesh, now {size:.3g} m long, is of a piece's size; for millimetres 0.001"
        raise InvalidParameter(f"{where}.scale", scale, expected)
    if entry.scale is None and size > _UNSCALED and file.suffix.lower() in _WITHOUT_UNIT:
        raise InvalidParameter(f"{where}.scale", None, f"0.001 for millimetres, or 1 if it is {size:.3g} m long")
    if entry.mass is None and entry.density is None and (entry.free or entry.parent != WORLD):
        raise InvalidParameter(f"{where}.mass", None, "a mass [kg], 0 if it is only seen; or give a density [kg/m³]")
    return PieceModel(folder=mesh.parent, shapes=(PieceShape(mesh=mesh.name, scale=scale),))
