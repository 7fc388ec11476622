"""Where the pieces of a station come from: the package, a folder of the user's own, or a mesh file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydrake.geometry import ReadObjToTriangleSurfaceMesh

from simrob_drake.errors import InvalidParameter
from simrob_drake.robots.pieces import PieceModel, PieceShape, described_piece, piece_file, with_changes
from simrob_drake.stations.config import PieceConfig
from simrob_drake.yaml_files import YAML_SUFFIXES

_FIGURES = {"density", "mass", "com", "inertia", "tcp", "frames", "colour"}
_SIZES = 1e-4, 50.0  # of a piece from a mesh [m]


def piece_of(entry: PieceConfig, name: str) -> PieceModel:
    """Return the piece that the section ``pieces.<name>`` of a station stands for, with all its figures.

    It is the piece of the package of that name, unless the section names another source.

    Raises:
        UnknownName: no such piece.
        InvalidConfig: a figure that cannot be.
        InvalidModel: a mesh that cannot be read, or has no volume though a density is given.
        InvalidParameter: a mesh that is far too large or small, as one in millimetres is.
        OutputError: the cache of converted meshes cannot be written.
    """
    changes = {key: value for key, value in entry.model_dump(exclude_none=True).items() if key in _FIGURES}
    return with_changes(_described(entry, name), changes, f"pieces.{name}")


def _described(entry: PieceConfig, name: str) -> PieceModel:
    if entry.mesh is not None:
        return _mesh_piece(entry.mesh, entry.scale or 1.0, name)
    model = entry.model or name
    return described_piece(Path(model) if model.endswith(YAML_SUFFIXES) else piece_file(model))


def _mesh_piece(file: Path, scale: float, name: str) -> PieceModel:
    from simrob_drake.stations.piece_meshes import drake_mesh  # few stations need a mesh library

    mesh = drake_mesh(file)
    size = scale * float(np.ptp(np.array(ReadObjToTriangleSurfaceMesh(str(mesh)).vertices()), axis=0).max())
    if not _SIZES[0] <= size <= _SIZES[1]:
        wanted = f"such that the mesh, now {size:.3g} m long, is of a piece's size; for millimetres 0.001"
        raise InvalidParameter(f"pieces.{name}.scale", scale, wanted)
    return PieceModel(folder=mesh.parent, shapes=(PieceShape(mesh=mesh.name, scale=scale),))
