"""Mend meshes: take out what is no triangle, and make huge ones smaller."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simrob_drake.frames import Vector
from simrob_drake.importer.meshes.parts import Faces, MeshPart, face_count, mean_colour, size_of, unit
from simrob_drake.interrupts import heard_afterwards

MOST_FACES = 50_000
"""A shape with more is decimated; with its own texture, which decimation loses, from four times as many on."""
_TEXTURED = 4
_DECIMALS = 9
"""Vertices are rounded to nanometres: STL's single figures keep all they know, and files get shorter."""
_MIXER = np.uint64(0x9E3779B97F4A7C15)
"""An odd number whose multiples spread evenly over 64 bits (the golden ratio's digits)."""
_BLOCK = 100_000
_FARTHEST = 1e6
"""Vertices farther out are no shape of a robot [m]."""
_SMOOTH = np.deg2rad(35.0)
"""Faces that meet at less are one curved surface and shaded as such."""


def mend(part: MeshPart) -> MeshPart:
    """Return a part with finite, distinct and used vertices, and faces that have an area.

    Vertices at the same place become one; normals and texture belong to the corners of the faces and stay.
    """
    near = np.all(abs(part.vertices) < _FARTHEST, axis=1)
    kept = part if near.all() else part.only(near[part.faces].all(axis=1))
    if not len(kept.faces):
        return kept
    rounded = np.where(near[:, None], part.vertices, 0.0)
    vertices, index = distinct(rounded.round(_DECIMALS, out=rounded))
    del rounded  # large meshes have large copies
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


def distinct(rows: Vector) -> tuple[Vector, Faces]:
    """Return the different rows in the order in which they first appear, and which of them each is.

    The argument is changed where it holds -0, which becomes 0.

    Sorting one number made of each row takes a tenth of the time and memory that sorting rows takes.
    """
    rows += 0.0  # -0 and 0 are the same
    keys = np.zeros(len(rows), dtype=np.uint64)
    for column in rows.view(np.uint64).T:
        keys = (keys ^ column) * _MIXER
        keys ^= keys >> np.uint64(29)
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    found, index = rows[first[order]], rank[inverse]
    same = all(np.array_equal(found[index, column], rows[:, column]) for column in range(rows.shape[1]))
    if not same:  # two different rows have the same number: once in a million meshes
        found, index = np.unique(rows, axis=0, return_inverse=True)
    return found, index.reshape(-1)


def _with_area(vertices: Vector, faces: Faces) -> NDArray[np.bool_]:
    """Return which faces have an area: corners in a line, as far as figures tell, have none."""
    blocks = [faces[start : start + _BLOCK] for start in range(0, len(faces), _BLOCK)]  # to save memory
    return np.concatenate([_block_with_area(vertices, block) for block in blocks])


def _block_with_area(vertices: Vector, faces: Faces) -> NDArray[np.bool_]:
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    sides = (second - first, third - second, first - third)
    longest = np.max([np.einsum("ij,ij->i", side, side) for side in sides], axis=0)
    large: NDArray[np.bool_] = np.linalg.norm(np.cross(sides[0], sides[2]), axis=1) > 1e-9 * longest
    return large
