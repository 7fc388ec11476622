"""Where the pieces of a station come from: the package, a folder of the user's own, or a mesh file."""

from pathlib import Path

import numpy as np
from pydrake.geometry import ReadObjToTriangleSurfaceMesh

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.site import WORLD
from simrob_drake.robots.pieces import PieceModel, PieceShape, described_piece, piece_file, with_changes
from simrob_drake.stations.config import PieceConfig
from simrob_drake.yaml_files import YAML_SUFFIXES

_OWN_KEYS = {"density", "mass", "com", "inertia", "tcp", "frames", "colour"}
_SIZES = 1e-4, 50.0  # of a piece from a mesh [m]
_WITHOUT_UNIT, _UNSCALED = (".stl", ".obj"), 1.0  # files that do not tell it, and the size [m] from which we ask


def piece_of(entry: PieceConfig, name: str) -> PieceModel:
    """Return the piece that the section ``pieces.<name>`` of a station stands for, with all its figures.

    It is the piece of the package of that name, unless the section names another source.

    Raises:
        UnknownName: no such piece.
        InvalidConfig: a figure that cannot be.
        InvalidModel: a mesh that cannot be read, or has no volume though a density is given.
        InvalidParameter: a mesh that is far too large or small, as one in millimetres is; or a robot carries it, and
            what it weighs is not said.
        OutputError: the cache of converted meshes cannot be written.
    """
    changes = {key: value for key, value in entry.model_dump(exclude_none=True).items() if key in _OWN_KEYS}
    return with_changes(_described(entry, name), changes, f"pieces.{name}")


def _described(entry: PieceConfig, name: str) -> PieceModel:
    if entry.mesh is not None:
        return _mesh_piece(entry, entry.mesh, f"pieces.{name}")
    model = entry.model or name
    return described_piece(Path(model) if model.endswith(YAML_SUFFIXES) else piece_file(model))


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
