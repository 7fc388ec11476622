"""Mesh files of a user's own pieces, in the form that Drake reads: OBJ, in a cache that is keyed by content."""

from __future__ import annotations

import hashlib
import os
import struct
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidModel, OutputError

PIECE_MESHES = (".stl", ".obj", ".dae", ".glb", ".ply", ".off")
"""What a piece's ``mesh:`` may be."""
CACHE_VARIABLE = "XDG_CACHE_HOME"

_LARGEST = 100_000_000  # bytes
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
"""From y upwards, as glTF has it, to z upwards."""
_FORM = "1"  # of what is written; another number makes all meshes be converted anew
_GARBAGE = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    ImportError,
    LookupError,
    MemoryError,
    NotImplementedError,
    OSError,
    RecursionError,
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
)
"""What mesh libraries raise on files that hold no mesh."""


def drake_mesh(file: Path) -> Path:
    """Return an OBJ file with the triangles of a mesh file, faces outwards; colours and textures are left out.

    The file lies in ``$XDG_CACHE_HOME/simrob_drake/pieces``, in a folder whose name follows from the file's content.
    glTF, whose y points upwards, is turned to z upwards, as Drake does.

    Raises:
        InvalidModel: the file is missing, too large, of another format, garbage, or holds no triangles.
        OutputError: the cache cannot be written.
    """
    kind = file.suffix.lower()
    if kind not in PIECE_MESHES:
        raise InvalidModel(file, "", f"is no mesh that a piece can have; {', '.join(PIECE_MESHES)} are")
    try:
        if file.stat().st_size > _LARGEST:
            raise InvalidModel(file, "", f"has more than {_LARGEST / 1e6:.0f} MB; decimate the mesh")
        data = file.read_bytes()
    except OSError as problem:
        raise InvalidModel(file, "", f"cannot be read ({problem.strerror or problem})") from problem
    key = hashlib.sha256(f"{_FORM} {kind} ".encode() + data).hexdigest()[:32]
    converted = _cache_root() / key / "mesh.obj"
    if not converted.is_file():
        _write(converted, _obj_text(file))
    return converted


def _obj_text(file: Path) -> str:
    """Convert a mesh: the one place where a mesh library is asked."""
    mesh = _loaded(file)
    points, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)
    if not len(faces) or not np.isfinite(points).all():
        raise InvalidModel(file, "", "holds no triangles" if not len(faces) else "holds points that are no numbers")
    lines = ["# made by simrob_drake"]
    lines += ["v " + " ".join(f"{value:.9g}" for value in point) for point in points.tolist()]
    lines += ["f " + " ".join(map(str, face)) for face in (faces + 1).tolist()]
    return "\n".join(lines) + "\n"


def _loaded(file: Path) -> Any:
    import trimesh

    garbage: tuple[type[Exception], ...] = (*_GARBAGE, *_collada_errors(file))
    try:
        mesh = trimesh.load_mesh(file)
        if file.suffix.lower() == ".glb":
            mesh.apply_transform(_UPRIGHT)
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        mesh.update_faces(mesh.nondegenerate_faces())
        mesh.remove_unreferenced_vertices()
        if mesh.is_watertight:
            mesh.fix_normals()
    except garbage as problem:
        unknown = "its text is in no known encoding" if isinstance(problem, ImportError) else ""  # it lacks a guesser
        reason = unknown or " ".join(str(problem).split())[:120] or type(problem).__name__
        raise InvalidModel(file, "", f"is not readable as a mesh ({reason})") from problem
    return mesh


def _collada_errors(file: Path) -> tuple[type[Exception], ...]:
    if file.suffix.lower() != ".dae":
        return ()
    from collada.common import DaeError

    return (DaeError,)


def _cache_root() -> Path:
    caches = Path(os.environ.get(CACHE_VARIABLE) or Path.home() / ".cache")
    return caches / "simrob_drake" / "pieces"


def _write(file: Path, text: str) -> None:
    """Write a file at once: two runs may convert the same mesh."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=file.parent, delete=False, encoding="utf-8") as part:
            part.write(text)
        os.replace(part.name, file)
    except OSError as problem:
        raise OutputError(f"{file.parent}: cannot be written: {problem.strerror or problem}") from problem
