"""Where the pieces of a station come from: the package, a folder of the user's own, or a mesh file.

A mesh is kept in the form that Drake reads: OBJ, in a cache that is keyed by content.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydrake.geometry import ReadObjToTriangleSurfaceMesh

from simrob_drake.errors import InvalidModel, InvalidParameter
from simrob_drake.folders import cache_entry, written_at_once
from simrob_drake.importer.meshes.checks import MESH_FORMATS, UnreadableMesh
from simrob_drake.importer.meshes.mending import mend
from simrob_drake.importer.meshes.parts import MeshPart, joined
from simrob_drake.importer.meshes.places import MeshOutside, MeshPlaces
from simrob_drake.importer.meshes.reading import mesh_content, read_mesh
from simrob_drake.importer.meshes.writing import obj_text
from simrob_drake.interrupts import heard_afterwards
from simrob_drake.parts.site import WORLD
from simrob_drake.robots.pieces import PieceModel, PieceShape, described_piece, piece_file, with_changes
from simrob_drake.stations.config import PieceConfig
from simrob_drake.yaml_files import YAML_SUFFIXES

_CODE = [Path(__file__), Path(__file__).parents[1] / "importer" / "meshes"]
_FIGURES = {"density", "mass", "com", "inertia", "tcp", "frames", "colour"}
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
    changes = {key: value for key, value in entry.model_dump(exclude_none=True).items() if key in _FIGURES}
    return with_changes(_described(entry, name), changes, f"pieces.{name}")


def _described(entry: PieceConfig, name: str) -> PieceModel:
    if entry.mesh is not None:
        return _mesh_piece(entry, entry.mesh, f"pieces.{name}")
    model = entry.model or name
    return described_piece(Path(model) if model.endswith(YAML_SUFFIXES) else piece_file(model))


def _mesh_piece(entry: PieceConfig, file: Path, where: str) -> PieceModel:
    mesh, scale = drake_mesh(file), entry.scale or 1.0
    size = scale * float(np.ptp(np.array(ReadObjToTriangleSurfaceMesh(str(mesh)).vertices()), axis=0).max())
    if not _SIZES[0] <= size <= _SIZES[1]:
        wanted = f"such that the mesh, now {size:.3g} m long, is of a piece's size; for millimetres 0.001"
        raise InvalidParameter(f"{where}.scale", scale, wanted)
    if entry.scale is None and size > _UNSCALED and file.suffix.lower() in _WITHOUT_UNIT:
        raise InvalidParameter(f"{where}.scale", None, f"0.001 for millimetres, or 1 if it is {size:.3g} m long")
    if entry.mass is None and entry.density is None and (entry.free or entry.parent != WORLD):
        raise InvalidParameter(f"{where}.mass", None, "a mass [kg], 0 if it is only seen; or give a density [kg/m³]")
    return PieceModel(folder=mesh.parent, shapes=(PieceShape(mesh=mesh.name, scale=scale),))


def drake_mesh(file: Path) -> Path:
    """Return an OBJ file with the triangles of a mesh file, faces outwards; colours and textures are left out.

    It lies in the cache, in a folder whose name follows from the file's content. Other files that the mesh names, as
    the buffers of a glTF, are read from its own folder only.

    Raises:
        InvalidModel: the file is missing, too large, of another format, garbage, or holds no triangles.
        OutputError: the cache cannot be written.
    """
    kind = file.suffix.lower()
    if kind not in MESH_FORMATS:
        raise InvalidModel(file, "", f"is no mesh that a piece can have; {', '.join(MESH_FORMATS)} are")
    try:
        others, _ = MeshPlaces(file.resolve(), ()).needed_by(file.resolve())
        content = [mesh_content(path) for path in (file, *others.values())]
        converted = cache_entry("pieces", made_of=[kind.encode(), *content], made_by=_CODE) / "mesh.obj"
        if not converted.is_file():
            written_at_once(converted, obj_text(_outside_out(_one_part(file, others))).decode())
    except OSError as problem:
        raise InvalidModel(file, "", f"cannot be read ({problem.strerror or problem})") from problem
    except (UnreadableMesh, MeshOutside) as problem:
        raise InvalidModel(file, "", str(problem)) from problem
    return converted


def _one_part(file: Path, others: Mapping[str, Path]) -> MeshPart:
    """Return all triangles of a file as one part."""
    part = mend(joined([replace(part, uv=None, image=None) for part in read_mesh(file, others).parts]))
    if not len(part.faces):
        raise UnreadableMesh("holds no triangle with an area")
    return part


@heard_afterwards()
def _outside_out(part: MeshPart) -> MeshPart:
    """Return a closed mesh with its faces outwards, which its volume depends on; an open one stays as it is."""
    from trimesh import Trimesh

    mesh = Trimesh(part.vertices, part.faces, process=False)
    if not mesh.is_watertight:
        return part
    mesh.fix_normals()
    return replace(part, faces=mesh.faces, normals=None)
