"""The meshes of one robot: found, read, scaled and mended, each file once; and written as OBJ, each content once."""

import hashlib
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.folders import cache_entry, written_at_once
from simrob_drake.base.frames import Vector
from simrob_drake.base.interrupts import heard_afterwards
from simrob_drake.base.messages import message
from simrob_drake.base.packages import OutsideBorder
from simrob_drake.importer.meshes.checks import MESH_FORMATS, UnreadableMesh
from simrob_drake.importer.meshes.parts import (
    MeshPart,
    as_png,
    clean,
    combine_without_look,
    decimate,
    distinct_rows,
    face_count,
    size_of,
    with_normals,
)
from simrob_drake.importer.meshes.places import MeshMissing, MeshPlaces
from simrob_drake.importer.meshes.reading import mesh_content, read_mesh

Scale = tuple[float, float, float]
_KEPT = 4  # how many meshes are kept in memory: the same file is mostly used again at once, for the collision
_LARGE = 50.0  # a robot's part that is larger was drawn in millimetres [m]


@dataclass(frozen=True)
class Mesh:
    """A mesh that can be used."""

    path: Path  # its file
    parts: list[MeshPart]  # one for each colour or texture, mended, in metres
    faces: int  # how many the file has
    original: bytes | None  # the bytes of the file if it can stay as it is, else None
    changes: list[str]  # what was mended, in words
    remarks: list[str]  # what is worth knowing, in words

    def remembered(self) -> "Mesh":
        """Return what is worth keeping when the mesh is written: not its content, and its remarks are told."""
        return replace(self, parts=[], original=None if self.original is None else b"", remarks=[])


@dataclass
class MeshLibrary:
    """Reads the meshes of one robot."""

    places: MeshPlaces  # where they may lie
    _meshes: dict[tuple[Path, Scale], Mesh] = field(default_factory=dict, init=False)
    _failures: dict[Path, str] = field(default_factory=dict, init=False)

    def path_of(self, uri: str) -> Path:
        """Return the file of a mesh; raises UnreadableMesh: nowhere, or can't be read; OutsideBorder: it may not."""
        try:
            path = self.places.find(uri).path
        except MeshMissing as problem:
            raise UnreadableMesh(str(problem)) from problem
        if path in self._failures:
            raise UnreadableMesh(self._failures[path])
        return path

    def load(self, uri: str, scale: Scale) -> Mesh:
        """Return a mesh; raises UnreadableMesh: none, unreadable, empty; OutsideBorder: its files may not be read."""
        path = self.path_of(uri)
        if (path, scale) not in self._meshes:
            while len(self._meshes) >= _KEPT:
                self._meshes.pop(next(iter(self._meshes)))
            try:
                self._meshes[path, scale] = self._read(path, scale)
            except UnreadableMesh as problem:
                self._failures[path] = str(problem)
                raise
        return self._meshes[path, scale]

    def _read(self, path: Path, scale: Scale) -> Mesh:
        try:
            others, missing = self.places.needed_by(path)
        except OSError as problem:
            raise UnreadableMesh(
                message("base.cannot_be_read", "cannot be read ({problem})", problem=problem.strerror or problem)
            ) from problem
        source = read_mesh(path, others)
        faces, place = face_count(source.parts), np.diag([*scale, 1.0])
        mended = [part for part in (clean(part.transform(place)) for part in source.parts) if len(part.faces)]
        source.parts.clear()  # of a million faces it takes a sixth of a gigabyte
        if not mended:
            raise UnreadableMesh(message("importer.no_area", "holds no triangle with an area"))
        parts = decimate(mended)
        good, few = face_count(mended), face_count(parts)
        changes: list[str] = (
            [
                message(
                    "importer.textures_missing", "textures or materials missing: {missing}", missing=", ".join(missing)
                )
            ]
            if missing
            else []
        )
        changes += (
            [message("importer.degenerate_faces", "{faces} degenerate faces left out", faces=faces - good)]
            if good < faces
            else []
        )
        changes += (
            [message("importer.decimated", "decimated from {before} to {after} faces", before=good, after=few)]
            if few < good
            else []
        )
        unchanged = not changes and not source.notes and len(parts) == 1
        stays = path.suffix.lower() == ".obj" and unchanged and scale == (1, 1, 1) and may_stay(source.data)
        size = float(size_of(parts).max())
        advice = message(
            "importer.drawn_in_millimetres",
            'is {size:.0f} m large; if it was drawn in millimetres, write scale="0.001 0.001 0.001"',
            size=size,
        )
        remarks = [*source.notes, *([advice] if size > _LARGE else [])]
        return Mesh(path, parts, faces, source.data if stays else None, changes, remarks)


_CODE = [Path(__file__).parent]


def drake_mesh(file: Path) -> Path:
    """Return an OBJ file with the triangles of a mesh file, faces outwards; colours and textures are left out.

    It lies in the cache, in a folder whose name follows from the file's content. Other files that the mesh names, as
    the buffers of a glTF, are read from its own folder only. Raises InvalidModel: the file is missing, too large, of
    another format, garbage, or holds no triangles; OutputError: the cache cannot be written.
    """
    kind = file.suffix.lower()
    if kind not in MESH_FORMATS:
        raise InvalidModel(
            file,
            "",
            message(
                "importer.no_mesh_of_piece",
                "is no mesh that a piece can have; {formats} are",
                formats=", ".join(MESH_FORMATS),
            ),
        )
    try:
        others, _ = MeshPlaces(file.resolve(), ()).needed_by(file.resolve())
        content = [mesh_content(path) for path in (file, *others.values())]
        converted = cache_entry("pieces", made_of=[kind.encode(), *content], made_by=_CODE) / "mesh.obj"
        if not converted.is_file():
            part = clean(combine_without_look(read_mesh(file, others).parts))
            if not len(part.faces):
                raise UnreadableMesh(message("importer.no_area", "holds no triangle with an area"))
            written_at_once(converted, obj_text(_outside_out(part)).decode())
    except OSError as problem:
        raise InvalidModel(
            file, "", message("base.cannot_be_read", "cannot be read ({problem})", problem=problem.strerror or problem)
        ) from problem
    except (UnreadableMesh, OutsideBorder) as problem:
        raise InvalidModel(file, "", str(problem)) from problem
    return converted


@heard_afterwards()
def _outside_out(part: MeshPart) -> MeshPart:
    """Return a closed mesh with its faces outwards, which its volume depends on; an open one stays as it is."""
    from trimesh import Trimesh

    mesh = Trimesh(part.vertices, part.faces, process=False)
    if not mesh.is_watertight:
        return part
    mesh.fix_normals()
    return replace(part, faces=mesh.faces, normals=None)


FOLDER = "meshes"
_MATERIAL = "texture"
_KEYWORDS = {b"v", b"vn", b"vt", b"f", b"o", b"g", b"s", b"usemtl", b"mtllib"}
"""Lines of an OBJ file that every reader understands."""


@dataclass
class MeshWriter:
    """The mesh files of one import."""

    folder: Path | None  # the output folder; None writes nothing, but names are given all the same
    _written: dict[tuple[str, str], str] = field(default_factory=dict, init=False)

    def write(self, part: MeshPart, *, role: str, stem: str, original: bytes | None = None) -> str:
        """Write a part, unless the same was written before, and return the file's name relative to the folder.

        ``role`` is ``visual`` or ``collision``, each with files of its own; ``stem`` is the file's name without its
        ending, ``original`` the OBJ file that the part was read from, if that is to be kept as it is.
        """
        library = f"{stem}.mtl"
        kept = None if original is None else _relabelled(original, library if part.image else "")
        text = kept if kept is not None else obj_text(part, library)
        png = b"" if part.image is None else as_png(part.image)
        content = hashlib.sha256(text.replace(library.encode(), b"") + b"\0" + png).hexdigest()
        name = self._written.setdefault((role, content), f"{FOLDER}/{stem}.obj")
        if name == f"{FOLDER}/{stem}.obj":
            self._save(f"{stem}.obj", text)
            if part.image is not None:
                self._save(library, f"newmtl {_MATERIAL}\nKd 1 1 1\nmap_Kd {stem}.png\n".encode())
                self._save(f"{stem}.png", png)
        return name

    def _save(self, name: str, data: bytes) -> None:
        if self.folder is not None:
            (self.folder / FOLDER).mkdir(exist_ok=True)
            (self.folder / FOLDER / name).write_bytes(data)


def may_stay(data: bytes) -> bool:
    """Return whether an OBJ file holds nothing but what every reader understands."""
    lines = (line.split() for line in data.splitlines() if line.strip() and not line.lstrip().startswith(b"#"))
    return all(words[0] in _KEYWORDS and (words[0] != b"v" or len(words) == 4) for words in lines)


def _relabelled(data: bytes, library: str) -> bytes:
    data = re.sub(rb"^[ \t]*mtllib\b.*$", f"mtllib {library}".encode(), data, flags=re.MULTILINE) if library else data
    if library:
        return re.sub(rb"^[ \t]*usemtl\b.*$", f"usemtl {_MATERIAL}".encode(), data, flags=re.MULTILINE)
    return re.sub(rb"^[ \t]*(mtllib|usemtl)\b[^\n]*\n?", b"", data, flags=re.MULTILINE)


def obj_text(part: MeshPart, library: str = "") -> bytes:
    """Return a part as an OBJ file; the library is named only if there is a texture."""
    lit = with_normals(part)
    assert lit.normals is not None
    blocks = [f"mtllib {library}\nusemtl {_MATERIAL}\n"] if part.image is not None else []
    blocks.append(_rows("v", lit.vertices))
    normals, normal_index = distinct_rows(lit.normals.reshape(-1, 3), 4)
    blocks.append(_rows("vn", normals))
    columns = [lit.faces.reshape(-1), normal_index]
    corner = "%d//%d"
    if part.image is not None and lit.uv is not None:
        uv, uv_index = distinct_rows(lit.uv.reshape(-1, 2), 6)
        blocks.append(_rows("vt", uv))
        columns.insert(1, uv_index)
        corner = "%d/%d/%d"
    indices = (np.stack(columns, axis=1) + 1).reshape(-1).tolist()
    blocks.append((f"f {corner} {corner} {corner}\n" * len(lit.faces)) % tuple(indices))
    return "".join(blocks).encode()


def _rows(keyword: str, values: Vector) -> str:
    row = f"{keyword}{' %r' * values.shape[1]}\n"
    return (row * len(values)) % tuple(values.reshape(-1).tolist())
