"""A mesh as plain numbers: one part for every colour or texture."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simrob_drake.frames import Vector

if TYPE_CHECKING:
    from PIL.Image import Image

_FORMATS = ("PNG", "JPEG", "BMP", "TGA", "GIF", "TIFF", "WEBP")
"""Formats that need nothing but the decoder; others start programs (EPS) or are never a texture."""
_LARGEST_SIDE = 1024
_MOST_PIXELS = 50_000_000

Faces = NDArray[np.int64]
Rgba = tuple[float, float, float, float]


def usable(image: Any) -> Image | None:
    """Return an image, as opened by Pillow, if it can be shown, at most 1024 pixels wide and high; else None."""
    from PIL import Image as Pillow

    if image is None or image.format not in _FORMATS or image.width * image.height > _MOST_PIXELS:
        return None
    try:
        decoded = image.convert("RGBA" if "A" in image.getbands() or "transparency" in image.info else "RGB")
    except (OSError, SyntaxError, ValueError, MemoryError):  # what Pillow raises on damaged files
        return None
    decoded.thumbnail((_LARGEST_SIDE, _LARGEST_SIDE))
    return Pillow.frombytes(decoded.mode, decoded.size, decoded.tobytes())  # without the source's notes and profiles


def mean_colour(image: Image) -> tuple[float, float, float, float]:
    """Return the mean colour of an image, opaque."""
    mean = np.asarray(image.convert("RGB"), dtype=float).reshape(-1, 3).mean(axis=0) / 255
    red, green, blue = mean.round(4).tolist()
    return red, green, blue, 1.0


def as_png(image: Image) -> bytes:
    """Return an image as the bytes of a PNG file."""
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=False)
    return buffer.getvalue()


@dataclass(frozen=True, eq=False)
class MeshPart:
    """Triangles of one look.

    Attributes:
        vertices: (n, 3) [m, or what the file is written in].
        faces: (m, 3), indices of vertices; the outside sees the corners counterclockwise.
        normals: (m, 3, 3), a unit vector for each corner; None where the file gives none.
        uv: (m, 3, 2), the place of each corner in the image, the origin at its lower left; None without image.
        rgba: the file's own colour; None where it gives none.
        image: the texture; None without.
    """

    vertices: Vector
    faces: Faces
    normals: Vector | None = None
    uv: Vector | None = None
    rgba: Rgba | None = None
    image: Image | None = None

    def only(self, kept: NDArray[np.bool_] | Faces) -> MeshPart:
        """Return the part with some of its faces."""
        normals = None if self.normals is None else self.normals[kept]
        return replace(self, faces=self.faces[kept], normals=normals, uv=None if self.uv is None else self.uv[kept])

    def moved(self, matrix: Vector) -> MeshPart:
        """Return the part after a transform (4, 4): turned, scaled and moved; a mirrored one keeps its outside."""
        if np.array_equal(matrix, np.eye(4)):
            return self
        vertices = self.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        moved = replace(self, vertices=vertices, normals=_moved_normals(self.normals, matrix[:3, :3]))
        if np.linalg.det(matrix[:3, :3]) >= 0:
            return moved
        normals, uv = (None if array is None else array[:, ::-1] for array in (moved.normals, moved.uv))
        return replace(moved, faces=moved.faces[:, ::-1], normals=normals, uv=uv)


def points_of(parts: Iterable[MeshPart]) -> Vector:
    """Return the corners (n, 3) of all faces of a mesh, each once."""
    return np.concatenate([part.vertices[np.unique(part.faces)] for part in parts])


def size_of(parts: Iterable[MeshPart]) -> Vector:
    """Return the extents (3,) of the box along the axes around a mesh [m]."""
    extents: Vector = np.ptp(points_of(parts), axis=0)
    return extents


def face_count(parts: Iterable[MeshPart]) -> int:
    """Return the number of faces of a mesh."""
    return sum(len(part.faces) for part in parts)


def of_one_look(parts: Iterable[MeshPart]) -> list[MeshPart]:
    """Return one part for each colour or texture, in the order in which they appear."""
    groups: dict[tuple[Rgba | None, bytes], list[MeshPart]] = {}
    for part in parts:
        picture = b"" if part.image is None else hashlib.sha256(part.image.tobytes()).digest()
        groups.setdefault((part.rgba, picture), []).append(part)
    return [group[0] if len(group) == 1 else joined(group) for group in groups.values()]


def joined(parts: list[MeshPart]) -> MeshPart:
    """Return all parts as one, of the first one's look."""
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=True)])
    normals = [part.normals for part in parts if part.normals is not None]
    uv = [part.uv for part in parts if part.uv is not None]
    return replace(
        parts[0],
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=faces,
        normals=np.concatenate(normals) if len(normals) == len(parts) else None,
        uv=np.concatenate(uv) if len(uv) == len(parts) else None,
    )


def _moved_normals(normals: Vector | None, turn: Vector) -> Vector | None:
    """Return normals as a transform leaves them: with its inverse, transposed."""
    if normals is None or abs(np.linalg.det(turn)) < 1e-30:
        return None
    return unit(normals @ np.linalg.inv(turn))


def unit(vectors: Vector) -> Vector:
    """Return vectors (..., 3) with length 1; zeros stay."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    scaled: Vector = vectors / np.where(lengths > 0, lengths, 1.0)
    return scaled
