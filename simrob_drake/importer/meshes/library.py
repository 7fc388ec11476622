"""The meshes of one robot: found, read, scaled and mended, each file once."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.mending import decimate, mend
from simrob_drake.importer.meshes.parts import MeshPart, face_count, size_of
from simrob_drake.importer.meshes.places import MeshMissing, MeshPlaces
from simrob_drake.importer.meshes.reading import read_mesh
from simrob_drake.importer.meshes.writing import may_stay

Scale = tuple[float, float, float]
_KEPT = 4
"""How many meshes are kept in memory: the same file is mostly used again at once, for the collision."""
_LARGE = 50.0
"""A robot's part that is larger was drawn in millimetres [m]."""


@dataclass(frozen=True)
class Mesh:
    """A mesh that can be used.

    Attributes:
        path: its file.
        parts: one for each colour or texture, mended, in metres.
        faces: how many the file has.
        original: the bytes of the file if it can stay as it is, else None.
        changes: what was mended, in words.
        remarks: what is worth knowing, in words.
    """

    path: Path
    parts: list[MeshPart]
    faces: int
    original: bytes | None
    changes: list[str]
    remarks: list[str]

    def remembered(self) -> Mesh:
        """Return what is worth keeping when the mesh is written: not its content, and its remarks are told."""
        return replace(self, parts=[], original=None if self.original is None else b"", remarks=[])


@dataclass
class MeshLibrary:
    """Reads the meshes of one robot.

    Attributes:
        places: where they may lie.
    """

    places: MeshPlaces
    _meshes: dict[tuple[Path, Scale], Mesh] = field(default_factory=dict, init=False)
    _failures: dict[Path, str] = field(default_factory=dict, init=False)

    def path_of(self, uri: str) -> Path:
        """Return the file of a mesh.

        Raises:
            UnreadableMesh: it is nowhere, or can't be read.
            MeshOutside: it may not be read.
        """
        try:
            path = self.places.find(uri).path
        except MeshMissing as problem:
            raise UnreadableMesh(str(problem)) from problem
        if path in self._failures:
            raise UnreadableMesh(self._failures[path])
        return path

    def load(self, uri: str, scale: Scale) -> Mesh:
        """Return a mesh.

        Raises:
            UnreadableMesh: it is nowhere, can't be read, or is empty.
            MeshOutside: it, or a file that it names, may not be read.
        """
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
            raise UnreadableMesh(f"cannot be read ({problem.strerror or problem})") from problem
        source = read_mesh(path, others)
        faces, place = face_count(source.parts), np.diag([*scale, 1.0])
        mended = [part for part in (mend(part.moved(place)) for part in source.parts) if len(part.faces)]
        source.parts.clear()  # of a million faces it takes a sixth of a gigabyte
        if not mended:
            raise UnreadableMesh("holds no triangle with an area")
        parts = decimate(mended)
        good, few = face_count(mended), face_count(parts)
        changes = [f"textures or materials missing: {', '.join(missing)}"] if missing else []
        changes += [f"{faces - good} degenerate faces left out"] if good < faces else []
        changes += [f"decimated from {good} to {few} faces"] if few < good else []
        unchanged = not changes and not source.notes and len(parts) == 1
        stays = path.suffix.lower() == ".obj" and unchanged and scale == (1, 1, 1) and may_stay(source.data)
        remarks = [*source.notes, *_size_remark(parts)]
        return Mesh(path, parts, faces, source.data if stays else None, changes, remarks)


def _size_remark(parts: list[MeshPart]) -> list[str]:
    size = float(size_of(parts).max())
    advice = 'if it was drawn in millimetres, write scale="0.001 0.001 0.001"'
    return [f"is {size:.0f} m large; {advice}"] if size > _LARGE else []
