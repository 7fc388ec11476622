"""Read the meshes of a robot, and write them as OBJ files.

:class:`MeshLibrary` finds, reads, scales and cleans meshes. :class:`MeshWriter` writes them into the output folder of
an import, where equal meshes share one file. :func:`drake_mesh` converts a single file for Drake.
"""

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
"""Factors along x, y and z by which a mesh is scaled, as in a URDF's ``<mesh scale>``."""

_MOST_LOADED = 4
"""Count of meshes kept in memory. A mesh is mostly used again at once, for the collision after the visual."""

_LARGE = 50.0
"""A mesh larger than this was probably drawn in millimetres [m]."""

_NO_SCALE = (1, 1, 1)


@dataclass(frozen=True)
class Mesh:
    """A mesh that was read, scaled and cleaned.

    Attributes:
        path: its file.
        parts: one for each colour or texture [m].
        faces: count of the faces in the file.
        original: the bytes of the file if it can be copied without a change; else None.
        changes: sentences about the differences from the file.
        remarks: further sentences for the user.
    """

    path: Path
    parts: list[MeshPart]
    faces: int
    original: bytes | None
    changes: list[str]
    remarks: list[str]

    def without_content(self) -> "Mesh":
        """Copy of this mesh for later uses of the same mesh, after its file is written.

        It needs no triangles any more, and its remarks were reported once. Empty bytes show that the file was copied.
        """
        return replace(self, parts=[], original=None if self.original is None else b"", remarks=[])


@dataclass
class MeshLibrary:
    """Reads the meshes of one robot, and keeps the last few.

    Attributes:
        places: finds the files of the meshes.
    """

    places: MeshPlaces
    _meshes: dict[tuple[Path, Scale], Mesh] = field(default_factory=dict, init=False)
    _failures: dict[Path, str] = field(default_factory=dict, init=False)

    def path_of(self, uri: str) -> Path:
        """Find the file of a mesh by its name in the URDF.

        Raises:
            UnreadableMesh: there is no such file, or an earlier attempt to read it failed.
            OutsideBorder: the file is outside of the folders from which files may be read.
        """
        try:
            path = self.places.find(uri).path
        except MeshMissing as problem:
            raise UnreadableMesh(str(problem)) from problem
        # A damaged file is read once, though visual and collision name it.
        if path in self._failures:
            raise UnreadableMesh(self._failures[path])
        return path

    def load(self, uri: str, scale: Scale) -> Mesh:
        """Read a mesh, or return it again if it is among the last few.

        Args:
            uri: its name in the URDF.
            scale: factors along x, y and z.

        Raises:
            UnreadableMesh: there is no such file, or it contains no usable mesh.
            OutsideBorder: the file, or one to which it refers, is outside of the folders from which files may be read.
        """
        path = self.path_of(uri)
        # The collision shape of a link is often the mesh of its visual, which was read just before.
        if (path, scale) in self._meshes:
            return self._meshes[path, scale]
        # The oldest are released before the next is read, because meshes take much memory.
        while len(self._meshes) >= _MOST_LOADED:
            oldest = next(iter(self._meshes))
            self._meshes.pop(oldest)
        try:
            mesh = self._read(path, scale)
        except UnreadableMesh as problem:
            self._failures[path] = str(problem)
            raise
        # The scale belongs to the key, since a mirrored link uses the same file with another scale.
        self._meshes[path, scale] = mesh
        return mesh

    def _read(self, path: Path, scale: Scale) -> Mesh:
        """Read, scale, clean and simplify a mesh, and describe the changes.

        Args:
            path: file of the mesh.
            scale: factors along x, y and z.

        Raises:
            UnreadableMesh: the file cannot be read, or contains no triangle with an area.
            OutsideBorder: a file to which it refers is outside of the folders from which files may be read.
        """
        try:
            # The files to which the mesh refers are found here, with their permission, as the parser may open these
            # only.
            others, missing = self.places.needed_by(path)
        except OSError as problem:
            raise UnreadableMesh(
                message(
                    "base.cannot_be_read",
                    "cannot be read ({problem})",
                    problem=problem.strerror or problem,
                )
            ) from problem
        source = read_mesh(path, others)
        face_total = face_count(source.parts)
        # Scaled before it is cleaned: limits of sizes and of equal vertices are in metres.
        scaling = np.diag([*scale, 1.0])
        cleaned = [clean(part.transform(scaling)) for part in source.parts]
        # A part of degenerate faces only is empty now.
        cleaned = [part for part in cleaned if len(part.faces)]
        source.parts.clear()  # a million faces take a sixth of a gigabyte
        if not cleaned:
            raise UnreadableMesh(message("importer.no_area", "contains no triangle with an area"))
        parts = decimate(cleaned)

        changes = _describe_changes(
            missing,
            before=face_total,
            cleaned=face_count(cleaned),
            after=face_count(parts),
        )
        # A file that would be written with the same content is copied, so that its comments and digits stay.
        is_unchanged = not changes and not source.notes and len(parts) == 1 and scale == _NO_SCALE
        can_be_copied = (
            path.suffix.lower() == ".obj" and is_unchanged and has_common_lines_only(source.data)
        )
        return Mesh(
            path,
            parts,
            faces=face_total,
            original=source.data if can_be_copied else None,
            changes=changes,
            remarks=[*source.notes, *_advice_on_size(parts)],
        )


def _describe_changes(missing: list[str], *, before: int, cleaned: int, after: int) -> list[str]:
    """Sentences about the differences between a mesh and its file.

    Args:
        missing: names of missing textures and material libraries.
        before: count of the faces in the file.
        cleaned: count of the faces without degenerate ones.
        after: count of the faces after simplification.
    """
    changes: list[str] = []
    if missing:
        names = ", ".join(missing)
        changes.append(
            message(
                "importer.textures_missing",
                "textures or materials missing: {missing}",
                missing=names,
            ),
        )
    if cleaned < before:
        changes.append(
            message(
                "importer.degenerate_faces",
                "{faces} degenerate faces left out",
                faces=before - cleaned,
            ),
        )
    if after < cleaned:
        changes.append(
            message(
                "importer.decimated",
                "decimated from {before} to {after} faces",
                before=cleaned,
                after=after,
            ),
        )
    return changes


def _advice_on_size(parts: list[MeshPart]) -> list[str]:
    """A sentence about the unit if a mesh is too large for a robot; an empty list if it is not."""
    size = float(size_of(parts).max())
    if size <= _LARGE:
        return []
    return [
        message(
            "importer.drawn_in_millimetres",
            'is {size:.0f} m large; if it was drawn in millimetres, write scale="0.001 0.001 0.001"',
            size=size,
        )
    ]


_CODE = [Path(__file__).parent]
"""Folder with the code that makes the cached files. A change of this code makes all of them invalid."""


def drake_mesh(file: Path) -> Path:
    """Convert a mesh file to an OBJ file that Drake reads, without colours and textures, and with faces outwards.

    The OBJ file is kept in the cache, in a folder whose name follows from the content of the mesh file and of the files
    to which it refers, such as the buffers of a glTF. These are read from the package of the mesh, see `package_root`,
    and from the folders that the environment or an earlier command allows.

    Raises:
        InvalidModel: the file is missing, too large or damaged, has another format, contains no triangles, or refers to
            a file that may not be read.
        OutputError: the cache cannot be written.
    """
    suffix = file.suffix.lower()
    if suffix not in MESH_FORMATS:
        raise InvalidModel(
            file,
            "",
            message(
                "importer.no_mesh_of_piece",
                "is not a mesh that a piece can have; the formats are {formats}",
                formats=", ".join(MESH_FORMATS),
            ),
        )
    try:
        source = file.resolve()
        # A piece has no option that could allow further folders.
        others, _ = MeshPlaces(source, ()).needed_by(source)
        # Also the files to which the mesh refers: a change of a buffer changes the result.
        content = [mesh_content(path) for path in (file, *others.values())]
        entry = cache_entry("pieces", made_of=[suffix.encode(), *content], made_by=_CODE)
        converted = entry / "mesh.obj"
        if not converted.is_file():
            part = clean(combine_without_look(read_mesh(file, others).parts))
            if not len(part.faces):
                raise UnreadableMesh(
                    message("importer.no_area", "contains no triangle with an area")
                )
            # Two processes may convert the same mesh at the same time, and neither may read half a file.
            written_at_once(converted, obj_text(_orient_outwards(part)).decode())
    except OSError as problem:
        raise InvalidModel(
            file,
            "",
            message(
                "base.cannot_be_read",
                "cannot be read ({problem})",
                problem=problem.strerror or problem,
            ),
        ) from problem
    except (UnreadableMesh, OutsideBorder) as problem:
        raise InvalidModel(file, "", str(problem)) from problem
    return converted


@heard_afterwards()
def _orient_outwards(part: MeshPart) -> MeshPart:
    """Orient the faces of a closed mesh outwards, because its volume and mass are computed from them.

    An open mesh has no outside and is returned as it is.
    """
    from trimesh import Trimesh

    mesh = Trimesh(part.vertices, part.faces, process=False)
    if not mesh.is_watertight:
        return part
    mesh.fix_normals()
    return replace(part, faces=mesh.faces, normals=None)


FOLDER = "meshes"
"""Folder of the mesh files, in the output folder of an import."""

_MATERIAL = "texture"
"""Name of the material in the material libraries that are written."""

_KEYWORDS = {b"v", b"vn", b"vt", b"f", b"o", b"g", b"s", b"usemtl", b"mtllib"}
"""First words of the lines of an OBJ file that every reader understands."""

_NORMAL_DIGITS = 4
"""Digits to which normals are written. Equal normals are written once, which makes files much smaller."""

_UV_DIGITS = 6
"""Digits to which texture coordinates are written: less than a thousandth of a pixel of the largest texture."""


@dataclass
class MeshWriter:
    """Writes the mesh files of one import, each content once.

    Attributes:
        folder: output folder of the import. If it is None, no files are written, but they get names as if they were.
    """

    folder: Path | None
    # Names of the files by role and hash of the content.
    _name_of: dict[tuple[str, str], str] = field(default_factory=dict, init=False)

    def write(self, part: MeshPart, *, role: str, stem: str, original: bytes | None = None) -> str:
        """Write a part, unless the same content was written for this role before.

        Args:
            part: the part.
            role: ``visual`` or ``collision``. The two do not share files.
            stem: name for the file, without its extension.
            original: an OBJ file with this part, if its text is to be kept.

        Returns:
            the file's name, relative to the output folder. It has the name of the first file with this content.
        """
        library = f"{stem}.mtl"
        if original is None:
            text = obj_text(part, library)
        else:
            # The texture is written under a new name, so that the file must refer to the new library.
            text = _set_material_library(original, library if part.image else "")
        png = b"" if part.image is None else as_png(part.image)

        # The name of the library differs between equal meshes, so it does not belong to the content.
        content = hashlib.sha256(text.replace(library.encode(), b"") + b"\0" + png).hexdigest()
        own_name = f"{FOLDER}/{stem}.obj"
        name = self._name_of.setdefault((role, content), own_name)
        if name != own_name:
            return name
        self._save(f"{stem}.obj", text)
        if part.image is not None:
            # White, Kd 1 1 1, shows the texture in its own colours.
            self._save(library, f"newmtl {_MATERIAL}\nKd 1 1 1\nmap_Kd {stem}.png\n".encode())
            self._save(f"{stem}.png", png)
        return name

    def _save(self, name: str, data: bytes) -> None:
        """Write a file into the folder of the meshes, if there is an output folder."""
        if self.folder is not None:
            (self.folder / FOLDER).mkdir(exist_ok=True)
            (self.folder / FOLDER / name).write_bytes(data)


def has_common_lines_only(data: bytes) -> bool:
    """Whether every line of an OBJ file is understood by all readers, so that the file can be copied."""
    for line in data.splitlines():
        words = line.split()
        if not words or words[0].startswith(b"#"):
            continue
        # Vertices with more than three numbers have colours, which not all readers understand.
        is_odd_vertex = words[0] == b"v" and len(words) != 4
        if words[0] not in _KEYWORDS or is_odd_vertex:
            return False
    return True


def _set_material_library(data: bytes, library: str) -> bytes:
    """Make an OBJ file refer to another material library. If the new name is empty, its materials are removed."""
    if not library:
        return re.sub(rb"^[ \t]*(mtllib|usemtl)\b[^\n]*\n?", b"", data, flags=re.MULTILINE)
    data = re.sub(rb"^[ \t]*mtllib\b.*$", f"mtllib {library}".encode(), data, flags=re.MULTILINE)
    return re.sub(rb"^[ \t]*usemtl\b.*$", f"usemtl {_MATERIAL}".encode(), data, flags=re.MULTILINE)


def obj_text(part: MeshPart, library: str = "") -> bytes:
    """Write a part as the content of an OBJ file.

    Args:
        part: the part. Normals are computed if it has none.
        library: name of the material library. The file refers to it only if the part has a texture.
    """
    # Viewers shade faces without normals as if all were flat.
    part = with_normals(part)
    assert part.normals is not None
    blocks = []
    if part.image is not None:
        blocks.append(f"mtllib {library}\nusemtl {_MATERIAL}\n")
    blocks.append(_matrix_lines("v", part.vertices))

    normals, normal_index = distinct_rows(part.normals.reshape(-1, 3), _NORMAL_DIGITS)
    blocks.append(_matrix_lines("vn", normals))
    # A corner is written as vertex//normal, or as vertex/texture/normal.
    columns = [part.faces.reshape(-1), normal_index]
    corner = "%d//%d"
    if part.image is not None and part.uv is not None:
        uv, uv_index = distinct_rows(part.uv.reshape(-1, 2), _UV_DIGITS)
        blocks.append(_matrix_lines("vt", uv))
        columns.insert(1, uv_index)
        corner = "%d/%d/%d"

    # One format for all faces is many times faster than one for each. Indices in OBJ files begin at 1.
    indices = (np.stack(columns, axis=1) + 1).reshape(-1).tolist()
    face_line = f"f {corner} {corner} {corner}\n"
    blocks.append((face_line * len(part.faces)) % tuple(indices))
    return "".join(blocks).encode()


def _matrix_lines(keyword: str, values: Vector) -> str:
    """Write a matrix (n, k) as n lines of an OBJ file, each a keyword and k numbers."""
    line = f"{keyword}{' %r' * values.shape[1]}\n"
    # As for the faces, one format for all lines. %r writes the shortest text that reads as the same number.
    return (line * len(values)) % tuple(values.reshape(-1).tolist())
