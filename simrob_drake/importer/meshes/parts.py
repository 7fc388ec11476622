"""A mesh as plain numbers, one part for every colour or texture; mended, and made smaller where it is huge."""

import hashlib
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simrob_drake.base.frames import Vector
from simrob_drake.base.interrupts import heard_afterwards

if TYPE_CHECKING:
    from PIL.Image import Image

_FORMATS = ("PNG", "JPEG", "BMP", "TGA", "GIF", "TIFF", "WEBP")
"""Formats that need nothing but the decoder; others start programs (EPS) or are never a texture."""
_LARGEST_SIDE = 1024
_MOST_PIXELS = 50_000_000

Faces = NDArray[np.int64]
Rgba = tuple[float, float, float, float]


def usable(image: Any) -> "Image | None":
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


def mean_colour(image: "Image") -> tuple[float, float, float, float]:
    """Return the mean colour of an image, opaque."""
    mean = np.asarray(image.convert("RGB"), dtype=float).reshape(-1, 3).mean(axis=0) / 255
    red, green, blue = mean.round(4).tolist()
    return red, green, blue, 1.0


def as_png(image: "Image") -> bytes:
    """Return an image as the bytes of a PNG file."""
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=False)
    return buffer.getvalue()


@dataclass(frozen=True, eq=False)
class MeshPart:
    """Triangles of one look."""

    vertices: Vector  # (n, 3) [m, or what the file is written in]
    faces: Faces  # (m, 3), indices of vertices; the outside sees the corners counterclockwise
    normals: Vector | None = None  # (m, 3, 3), a unit vector for each corner; None where the file gives none
    uv: Vector | None = None
    """(m, 3, 2), the place of each corner in the image, the origin at its lower left; None without image."""
    rgba: Rgba | None = None  # the file's own colour; None where it gives none
    image: "Image | None" = None  # the texture; None without

    def only(self, kept: NDArray[np.bool_] | Faces) -> "MeshPart":
        """Return the part with some of its faces."""
        normals = None if self.normals is None else self.normals[kept]
        return replace(self, faces=self.faces[kept], normals=normals, uv=None if self.uv is None else self.uv[kept])

    def moved(self, matrix: Vector) -> "MeshPart":
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
    return np.asarray(np.ptp(points_of(parts), axis=0))


def face_count(parts: Iterable[MeshPart]) -> int:
    """Return the number of faces of a mesh."""
    return sum(len(part.faces) for part in parts)


def grouped_by_look(parts: Iterable[MeshPart]) -> list[MeshPart]:
    """Return one part for each colour or texture, in the order in which they appear."""
    groups: dict[tuple[Rgba | None, bytes], list[MeshPart]] = {}
    for part in parts:
        picture = b"" if part.image is None else hashlib.sha256(part.image.tobytes()).digest()
        groups.setdefault((part.rgba, picture), []).append(part)
    return [group[0] if len(group) == 1 else joined(group) for group in groups.values()]


def plain(parts: Iterable[MeshPart]) -> MeshPart:
    """Return all parts as one without any look."""
    return joined([replace(part, uv=None, rgba=None, image=None) for part in parts])


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
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1.0))


MOST_FACES = 50_000
"""A shape with more is decimated; with its own texture, which decimation loses, from four times as many on."""
_TEXTURED = 4
_DECIMALS = 9  # vertices are rounded to nanometres: STL's single figures keep all they know, and files get shorter
_BLOCK = 100_000
_FARTHEST = 1e6  # vertices farther out are no shape of a robot [m]
_SMOOTH = np.deg2rad(35.0)  # faces that meet at less are one curved surface and shaded as such


def mend(part: MeshPart) -> MeshPart:
    """Return a part with finite, distinct, used vertices and faces with an area; corners keep normals and texture."""
    near = np.all(abs(part.vertices) < _FARTHEST, axis=1)
    kept = part if near.all() else part.only(near[part.faces].all(axis=1))
    if not len(kept.faces):
        return kept
    vertices, index = distinct(np.where(near[:, None], part.vertices, 0.0), _DECIMALS)
    merged = replace(kept, vertices=vertices, faces=index[kept.faces])
    merged = merged.only(_with_area(vertices, merged.faces))
    used = np.zeros(len(vertices), dtype=bool)
    used[merged.faces] = True
    return replace(merged, vertices=vertices[used], faces=(np.cumsum(used) - 1)[merged.faces])


@heard_afterwards()
def shaded(part: MeshPart) -> MeshPart:
    """Return a part with normals: its own, or smooth ones over curved surfaces with edges where faces meet sharply."""
    if part.normals is not None:
        return part
    from trimesh import Trimesh
    from trimesh.graph import connected_component_labels

    mesh = Trimesh(part.vertices, part.faces, process=False)
    flat = mesh.face_adjacency[mesh.face_adjacency_angles < _SMOOTH]
    surface: Faces = connected_component_labels(  # type: ignore[no-untyped-call]
        flat, node_count=len(part.faces)
    )
    first, second, third = (part.vertices[part.faces[:, corner]] for corner in range(3))
    weighted = np.cross(second - first, third - first)  # as long as twice the area
    keys = part.faces.astype(np.int64) * (int(surface.max()) + 1) + surface[:, None]
    _, group = np.unique(keys, return_inverse=True)
    group = group.reshape(-1)
    sums: Vector = np.stack([np.bincount(group, np.repeat(weighted[:, axis], 3)) for axis in range(3)], axis=1)
    normals = unit(sums[group].reshape(-1, 3, 3))
    own = np.repeat(unit(weighted)[:, None], 3, axis=1)
    lost = np.linalg.norm(normals, axis=-1, keepdims=True) < 0.5  # faces back to back cancel out
    return replace(part, normals=np.where(lost, own, normals))


def decimate(parts: Sequence[MeshPart]) -> list[MeshPart]:
    """Return a mesh with at most about `MOST_FACES` faces, its bounding box kept within 1 %."""
    total = face_count(parts)
    limit = MOST_FACES * (_TEXTURED if any(part.image is not None for part in parts) else 1)
    if total <= limit:
        return list(parts)
    return [_fewer_faces(part, max(100, len(part.faces) * MOST_FACES // total)) for part in parts]


@heard_afterwards()
def _fewer_faces(part: MeshPart, target: int) -> MeshPart:
    from fast_simplification import simplify

    size = size_of([part])
    for count in (target, 2 * target, 4 * target):
        if count >= len(part.faces):
            break
        vertices, faces = simplify(part.vertices, part.faces, target_count=count)
        bare = replace(
            part, normals=None, uv=None, image=None, rgba=part.rgba if part.image is None else mean_colour(part.image)
        )
        fewer = mend(replace(bare, vertices=np.asarray(vertices, dtype=float), faces=np.asarray(faces, np.int64)))
        if len(fewer.faces) and bool((abs(size_of([fewer]) - size) <= 0.01 * size.max()).all()):
            return fewer
    return part


def distinct(rows: Vector, digits: int) -> tuple[Vector, Faces]:
    """Return the rows that differ by so many digits, in the order in which they first appear, and which each is."""
    from trimesh.grouping import unique_rows

    rounded = rows.round(digits) + 0.0  # -0 and 0 are the same
    first, index = unique_rows(rounded, digits=digits, keep_order=True)  # type: ignore[no-untyped-call]
    return rounded[first], index


def _with_area(vertices: Vector, faces: Faces) -> NDArray[np.bool_]:
    """Return which faces have an area: corners in a line, as far as figures tell, have none."""
    if len(faces) > _BLOCK:  # to save memory
        blocks = [faces[start : start + _BLOCK] for start in range(0, len(faces), _BLOCK)]
        return np.concatenate([_with_area(vertices, block) for block in blocks])
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    sides = (second - first, third - second, first - third)
    longest = np.max([np.einsum("ij,ij->i", side, side) for side in sides], axis=0)
    return np.asarray(np.linalg.norm(np.cross(sides[0], sides[2]), axis=1) > 1e-9 * longest)
