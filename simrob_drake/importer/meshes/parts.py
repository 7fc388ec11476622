"""Triangles of meshes as arrays: combined, cleaned, shaded, and simplified where there are too many.

A mesh is a list of :class:`MeshPart`, one for each colour or texture. A colour and a texture together are called the
look of a part. A face is a triangle, a corner is one of its three ends, and a vertex is a point that several corners
share.
"""

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

_IMAGE_FORMATS = ("PNG", "JPEG", "BMP", "TGA", "GIF", "TIFF", "WEBP")
"""Formats that only need Pillow's decoder. Others start programs (EPS) or are never used for textures."""

_LARGEST_SIDE = 1024
"""Largest width and height of a texture [pixels]. Larger textures are scaled down."""

_MOST_PIXELS = 50_000_000
"""Textures with more pixels are not decoded, because a small file can hold an image that fills the memory."""

MOST_FACES = 50_000
"""Meshes with more faces are simplified."""

_TEXTURED_FACTOR = 4
"""A mesh with a texture may have this many times more faces, because simplification loses its texture."""

_DECIMALS = 9
"""Digits to which vertices are rounded [m]. STL stores single precision, so that nothing of it is lost."""

_BLOCK = 100_000
"""Largest count of faces whose areas are computed at once, to save memory."""

_FARTHEST = 1e6
"""Vertices farther from the origin cannot belong to a robot [m]."""

_SMOOTH_ANGLE = np.deg2rad(35.0)
"""Neighbouring faces with a smaller angle between them are shaded as one curved surface [rad]."""

_LEAST_SINE = 1e-9
"""A face is degenerate if its doubled area is less than this share of its longest side squared."""

Faces = NDArray[np.int64]
"""Indices of vertices, shape (m, 3), or one index for each of n rows, shape (n,)."""

Rgba = tuple[float, float, float, float]
"""Red, green, blue and opacity, each from 0 to 1."""


def decode_texture(image: Any) -> "Image | None":
    """Decode an image that Pillow has opened, and scale it down to at most 1024 pixels in width and height.

    Returns:
        the image in mode RGB or RGBA. None if there is no image, or if it is damaged, too large, or of a format that
        textures do not have.
    """
    from PIL import Image as Pillow

    if (
        image is None
        or image.format not in _IMAGE_FORMATS
        or image.width * image.height > _MOST_PIXELS
    ):
        return None
    has_opacity = "A" in image.getbands() or "transparency" in image.info
    try:
        decoded = image.convert("RGBA" if has_opacity else "RGB")
    except (OSError, SyntaxError, ValueError, MemoryError):
        # Pillow raises these for damaged files.
        return None
    decoded.thumbnail((_LARGEST_SIDE, _LARGEST_SIDE))
    # The new image has the pixels only, without the comments and colour profiles of the file.
    return Pillow.frombytes(decoded.mode, decoded.size, decoded.tobytes())


def mean_colour(image: "Image") -> Rgba:
    """Compute the mean colour of an image, with full opacity."""
    pixels = np.asarray(image.convert("RGB"), dtype=float).reshape(-1, 3)
    mean = pixels.mean(axis=0) / 255
    red, green, blue = mean.round(4).tolist()
    return red, green, blue, 1.0


def as_png(image: "Image") -> bytes:
    """Encode an image as the bytes of a PNG file."""
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=False)
    return buffer.getvalue()


@dataclass(frozen=True, eq=False)
class MeshPart:
    """Triangles with one colour or one texture.

    Attributes:
        vertices: positions, shape (n, 3) [m, or the length unit of the file].
        faces: indices of vertices, shape (m, 3). Corners run counterclockwise, seen from outside.
        normals: a unit vector for each corner, shape (m, 3, 3). None if the file has none.
        uv: the point of the texture at each corner, shape (m, 3, 2), with the origin at the lower left of the image.
            None if there is no texture.
        rgba: the colour that the file gives. None if it gives none.
        image: the texture. None if there is none.
    """

    vertices: Vector
    faces: Faces
    normals: Vector | None = None
    uv: Vector | None = None
    rgba: Rgba | None = None
    image: "Image | None" = None

    def only(self, kept: NDArray[np.bool_] | Faces) -> "MeshPart":
        """Copy of this part with some of its faces: a mask (m,) or the indices of the faces. All vertices stay."""
        normals = None if self.normals is None else self.normals[kept]
        uv = None if self.uv is None else self.uv[kept]
        return replace(self, faces=self.faces[kept], normals=normals, uv=uv)

    def transform(self, matrix: Vector) -> "MeshPart":
        """This part after an affine transform, such as a rotation, a scale or a mirroring. The part itself stays.

        Args:
            matrix: homogeneous transform, shape (4, 4).
        """
        if np.array_equal(matrix, np.eye(4)):
            return self
        linear = matrix[:3, :3]
        vertices = self.vertices @ linear.T + matrix[:3, 3]
        transformed = replace(
            self, vertices=vertices, normals=_transform_normals(self.normals, linear)
        )
        is_mirrored = np.linalg.det(linear) < 0
        return transformed._turned_inside_out() if is_mirrored else transformed

    def _turned_inside_out(self) -> "MeshPart":
        """Copy of this part with the corners of each face in reverse order, which exchanges inside and outside."""
        return replace(
            self,
            faces=self.faces[:, ::-1],
            normals=None if self.normals is None else self.normals[:, ::-1],
            uv=None if self.uv is None else self.uv[:, ::-1],
        )


def _transform_normals(normals: Vector | None, linear: Vector) -> Vector | None:
    """Transform the normals of corners, shape (m, 3, 3), by the linear part (3, 3) of a transform of the vertices.

    Returns None if there are no normals, or if the transform flattens the mesh.
    """
    # A transform that flattens the mesh has no inverse.
    if normals is None or abs(np.linalg.det(linear)) < 1e-30:
        return None
    # A normal n stays perpendicular to its transformed face as inv(A)^T n. For rows this is n^T inv(A).
    return unit(normals @ np.linalg.inv(linear))


def unit(vectors: Vector) -> Vector:
    """Scale vectors (..., 3) to length 1. Zero vectors stay zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1.0))


def points_of(parts: Iterable[MeshPart]) -> Vector:
    """Vertices (n, 3) of a mesh that belong to a face. Each part contributes each of its vertices once."""
    return np.concatenate([part.vertices[np.unique(part.faces)] for part in parts])


def size_of(parts: Iterable[MeshPart]) -> Vector:
    """Extents (3,) of a mesh along the axes of its frame [m]."""
    return np.asarray(np.ptp(points_of(parts), axis=0))


def face_count(parts: Iterable[MeshPart]) -> int:
    """Count the faces of a mesh."""
    return sum(len(part.faces) for part in parts)


def group_by_look(parts: Iterable[MeshPart]) -> list[MeshPart]:
    """Combine the parts with equal colour and texture, in the order in which the colours and textures appear."""
    groups: dict[tuple[Rgba | None, bytes], list[MeshPart]] = {}
    for part in parts:
        image_hash = b"" if part.image is None else hashlib.sha256(part.image.tobytes()).digest()
        groups.setdefault((part.rgba, image_hash), []).append(part)
    return [group[0] if len(group) == 1 else combine(group) for group in groups.values()]


def combine_without_look(parts: Iterable[MeshPart]) -> MeshPart:
    """Combine the parts of a mesh into one without colour and texture."""
    return combine([replace(part, uv=None, rgba=None, image=None) for part in parts])


def combine(parts: list[MeshPart]) -> MeshPart:
    """Combine parts into one with the colour and texture of the first.

    Normals and texture coordinates are kept only if all parts have them.
    """
    # Indices of vertices begin at 0 in each part.
    faces = []
    offset = 0  # index of the part's first vertex among the vertices of all parts
    for part in parts:
        faces.append(part.faces + offset)
        offset += len(part.vertices)
    normals = [part.normals for part in parts if part.normals is not None]
    uv = [part.uv for part in parts if part.uv is not None]
    return replace(
        parts[0],
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate(faces),
        normals=np.concatenate(normals) if len(normals) == len(parts) else None,
        uv=np.concatenate(uv) if len(uv) == len(parts) else None,
    )


def clean(part: MeshPart) -> MeshPart:
    """Remove faces that are degenerate or far away, merge equal vertices, and remove unused vertices.

    The remaining faces keep the normals and texture coordinates of their corners. The result may have no faces. If all
    faces are far away, it keeps all vertices.
    """
    # The comparison is false for NaN, so that vertices without a finite position count as far away.
    is_near = np.all(abs(part.vertices) < _FARTHEST, axis=1)
    near_part = part if is_near.all() else part.only(is_near[part.faces].all(axis=1))
    if not len(near_part.faces):
        return near_part

    # Far vertices belong to no face any more. At zero they do not disturb the search for equal vertices.
    near_vertices = np.where(is_near[:, None], part.vertices, 0.0)
    vertices, index_of = distinct_rows(near_vertices, _DECIMALS)
    merged = replace(near_part, vertices=vertices, faces=index_of[near_part.faces])
    merged = merged.only(_has_area(vertices, merged.faces))

    is_used = np.zeros(len(vertices), dtype=bool)
    is_used[merged.faces] = True
    # A used vertex gets the index k if it is used vertex number k + 1.
    new_index = np.cumsum(is_used) - 1
    return replace(merged, vertices=vertices[is_used], faces=new_index[merged.faces])


@heard_afterwards()
def with_normals(part: MeshPart) -> MeshPart:
    """Give a part normals if it has none: smooth ones on curved surfaces, with edges where faces meet sharply."""
    if part.normals is not None:
        return part
    from trimesh import Trimesh
    from trimesh.graph import connected_component_labels

    # Neighbouring faces with a small angle between them belong to one surface. Surfaces are numbered.
    mesh = Trimesh(part.vertices, part.faces, process=False)
    smooth_pairs = mesh.face_adjacency[mesh.face_adjacency_angles < _SMOOTH_ANGLE]
    surface: Faces = connected_component_labels(  # type: ignore[no-untyped-call]
        smooth_pairs, node_count=len(part.faces)
    )

    # The cross product of two sides is as long as twice the face's area, which weights large faces more.
    first, second, third = (part.vertices[part.faces[:, corner]] for corner in range(3))
    face_normals = np.cross(second - first, third - first)

    # Corners at the same vertex of the same surface get the sum of their faces' normals. A corner's key is
    # vertex * (number of surfaces) + surface, which differs for each such pair.
    surface_count = int(surface.max()) + 1
    keys = part.faces.astype(np.int64) * surface_count + surface[:, None]
    _, group = np.unique(keys, return_inverse=True)
    group = group.reshape(-1)
    sums: Vector = np.stack(
        [np.bincount(group, np.repeat(face_normals[:, axis], 3)) for axis in range(3)],
        axis=1,
    )
    normals = unit(sums[group].reshape(-1, 3, 3))

    # Faces that lie back to back cancel out in the sum: their corners get the normal of the face itself.
    own_normals = np.repeat(unit(face_normals)[:, None], 3, axis=1)
    is_cancelled = np.linalg.norm(normals, axis=-1, keepdims=True) < 0.5
    return replace(part, normals=np.where(is_cancelled, own_normals, normals))


def decimate(parts: Sequence[MeshPart]) -> list[MeshPart]:
    """Simplify a mesh to about `MOST_FACES` faces if it has more; the size of each part changes by 1 % at most.

    A part whose size would change by more stays as it is. A mesh with a texture is simplified only if it has more than
    four times as many faces; its textures then become colours.
    """
    total = face_count(parts)
    has_texture = any(part.image is not None for part in parts)
    limit = MOST_FACES * (_TEXTURED_FACTOR if has_texture else 1)
    if total <= limit:
        return list(parts)
    # Each part gets its share of the faces, but so many that its form survives.
    return [_simplify(part, max(100, len(part.faces) * MOST_FACES // total)) for part in parts]


# The library would take Ctrl+C for an error of its own: it is heard after the call.
@heard_afterwards()
def _simplify(part: MeshPart, target: int) -> MeshPart:
    """Simplify a part to about ``target`` faces, or up to four times as many if its size would change by over 1 %.

    The result has no normals and no texture; the mean colour of the texture takes its place. The part itself is
    returned if it has no more than ``target`` faces, and if no simplification keeps its size.
    """
    from fast_simplification import simplify

    size = size_of([part])
    colour = part.rgba if part.image is None else mean_colour(part.image)
    # Thin parts, such as a plate of two triangles, may disappear. More faces keep them.
    for count in (target, 2 * target, 4 * target):
        if count >= len(part.faces):
            break
        vertices, faces = simplify(part.vertices, part.faces, target_count=count)
        simplified = MeshPart(
            vertices=np.asarray(vertices, dtype=float),
            faces=np.asarray(faces, np.int64),
            rgba=colour,
        )
        simplified = clean(simplified)
        if not len(simplified.faces):
            continue
        change = abs(size_of([simplified]) - size)
        if bool((change <= 0.01 * size.max()).all()):
            return simplified
    return part


def distinct_rows(rows: Vector, digits: int) -> tuple[Vector, Faces]:
    """Find the rows of a matrix (n, k) that differ when they are rounded to some decimal digits.

    Returns:
        the distinct rows, rounded, in the order in which they first appear, and for each of the n rows the index of
        its distinct row.
    """
    from trimesh.grouping import unique_rows

    rounded = rows.round(digits) + 0.0  # the sum turns -0 into 0
    first, index = unique_rows(rounded, digits=digits, keep_order=True)  # type: ignore[no-untyped-call]
    return rounded[first], index


def _has_area(vertices: Vector, faces: Faces) -> NDArray[np.bool_]:
    """Find the faces that have an area, as a mask (m,). Faces with all corners on a line have none."""
    if len(faces) > _BLOCK:
        blocks = [faces[start : start + _BLOCK] for start in range(0, len(faces), _BLOCK)]
        return np.concatenate([_has_area(vertices, block) for block in blocks])
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    sides = (second - first, third - second, first - third)
    longest_squared = np.max([np.einsum("ij,ij->i", side, side) for side in sides], axis=0)
    # The cross product of two sides is as long as twice the area of the triangle.
    doubled_area = np.linalg.norm(np.cross(sides[0], sides[2]), axis=1)
    return np.asarray(doubled_area > _LEAST_SINE * longest_squared)
