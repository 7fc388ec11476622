"""Mesh files of a user's own pieces, in the form that Drake reads: OBJ, in a cache that is keyed by content."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from simrob_drake.errors import InvalidModel
from simrob_drake.folders import cache_entry, written_at_once
from simrob_drake.importer.meshes.checks import MESH_FORMATS, UnreadableMesh
from simrob_drake.importer.meshes.mending import mend
from simrob_drake.importer.meshes.parts import MeshPart, joined
from simrob_drake.importer.meshes.places import MeshOutside, MeshPlaces
from simrob_drake.importer.meshes.reading import content_of, read_mesh
from simrob_drake.importer.meshes.writing import obj_text

_CODE = [Path(__file__), Path(__file__).parents[1] / "importer" / "meshes"]


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
        content = [content_of(path) for path in (file, *others.values())]
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


def _outside_out(part: MeshPart) -> MeshPart:
    """Return a closed mesh with its faces outwards, which its volume depends on; an open one stays as it is."""
    from trimesh import Trimesh

    mesh = Trimesh(part.vertices, part.faces, process=False)
    if not mesh.is_watertight:
        return part
    mesh.fix_normals()
    return replace(part, faces=mesh.faces, normals=None)
