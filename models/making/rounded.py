"""Rounded bodies for the visuals of robots, and the OBJ files that hold them.

Every body is the convex hull of spheres or discs; a link is a few of them that run into each other. Lengths in metres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh
from urdf_writing import Shape, mesh

from simrob_drake.base.frames import Vector

Triple = tuple[float, float, float]

Parts = Mapping[str, Sequence[trimesh.Trimesh]]
"""The convex parts of a link, by the name of their colour."""

_CREASE = np.cos(np.deg2rad(38.0))  # faces that meet at a sharper edge than this are shaded apart
_FINE = (
    0.03,
    0.012,
)  # spheres of at least these radii get sixteen and four times the faces of the smallest [m]
_SIDES = 32  # of a disc
_DIGITS = 5  # of coordinates: 10 µm


def hull(points: npt.ArrayLike, radius: float) -> trimesh.Trimesh:
    """Return the convex hull of spheres of one radius about points, shape (k, 3)."""
    ball = trimesh.creation.icosphere(subdivisions=1 + sum(radius >= limit for limit in _FINE))
    return solid(
        (
            np.asarray(points, dtype=float)[:, np.newaxis] + radius * np.asarray(ball.vertices)
        ).reshape(-1, 3)
    )


def solid(points: npt.ArrayLike) -> trimesh.Trimesh:
    """Return the convex hull of points, shape (k, 3)."""
    found: trimesh.Trimesh = trimesh.convex.convex_hull(np.asarray(points, dtype=float))
    return found


def block(low: Triple, high: Triple, radius: float) -> trimesh.Trimesh:
    """Return a box with rounded edges between two corners."""
    spans = zip(np.add(low, radius), np.subtract(high, radius), strict=True)
    return hull(list(product(*spans)), radius)


def wedge(low: Sequence[Triple], radius: float) -> trimesh.Trimesh:
    """Return the rounded hull of points and their mirror images in x; the points say where the surface is.

    Args:
        low: corners of one side; each is moved inwards by the radius, towards the middle of all.
        radius: of the edges.
    """
    corners = np.array([*low, *((-x, y, z) for x, y, z in low)])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return hull(corners - radius * np.sign(corners - middle), radius)


def drum(
    radius: float,
    span: tuple[float, float],
    axis: str = "z",
    at: Triple = (0.0, 0.0, 0.0),
    fillet: float = 0.0015,
) -> trimesh.Trimesh:
    """Return a cylinder with bevelled edges along an axis; the span is measured from the point ``at``."""
    turn = 2 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    low, high = span
    heights = [
        (low, radius - fillet),
        (low + fillet, radius),
        (high - fillet, radius),
        (high, radius - fillet),
    ]
    rings = np.concatenate(
        [np.column_stack([r * ring, np.full(_SIDES, height)]) for height, r in heights]
    )
    order = {"z": [0, 1, 2], "x": [2, 0, 1], "y": [1, 2, 0]}[axis]
    return solid(rings[:, order] + np.asarray(at))


def mirrored(part: trimesh.Trimesh, axis: str = "x") -> trimesh.Trimesh:
    """Return a convex part's mirror image."""
    return solid(np.asarray(part.vertices) * np.where(np.array(list("xyz")) == axis, -1.0, 1.0))


def mirrored_parts(parts: Parts, axis: str = "x") -> Parts:
    """Return the mirror image of a link."""
    return {colour: [mirrored(part, axis) for part in solids] for colour, solids in parts.items()}


def write_parts(folder: Path, name: str, parts: Parts) -> list[tuple[Shape, str]]:
    """Write a link's parts, one OBJ file a colour in ``meshes`` of a robot's folder, and return them as visuals."""
    (folder / "meshes").mkdir(exist_ok=True)
    for colour, solids in parts.items():
        write_obj(folder / "meshes" / f"{name}_{colour}.obj", solids)
    return [(mesh(f"{name}_{colour}"), colour) for colour in parts]


def write_obj(file: Path, parts: Sequence[trimesh.Trimesh]) -> None:
    """Write parts as one OBJ file with normals, sharp at creases."""
    points, corners = _numbered([np.asarray(part.triangles) for part in parts], _DIGITS)
    normals, turns = _numbered([_corner_normals(part) for part in parts], 3)
    lines = [f"# made by making/{file.parent.parent.name}.py"]
    lines += ["v " + " ".join(f"{value:.5g}" for value in point) for point in points]
    lines += ["vn " + " ".join(f"{value:.3g}" for value in normal) for normal in normals]
    faces = (
        zip(*face, strict=True)
        for face in zip(corners, turns, strict=True)
        if len(set(face[0])) == 3
    )
    lines += ["f " + " ".join(f"{point}//{normal}" for point, normal in face) for face in faces]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _corner_normals(part: trimesh.Trimesh) -> Vector:
    """Mean the normals around every face's corners by area, across soft edges only; shape (faces, 3, 3)."""
    normals, areas = np.asarray(part.face_normals), np.asarray(part.area_faces)
    corners = np.zeros((len(part.faces), 3, 3))
    for face, vertices in enumerate(part.faces):
        for place, vertex in enumerate(vertices):
            around = np.array([other for other in part.vertex_faces[vertex] if other >= 0])
            soft = around[normals[around] @ normals[face] >= _CREASE]
            corners[face, place] = areas[soft] @ normals[soft]
    return np.asarray(corners / np.linalg.norm(corners, axis=2, keepdims=True))


def _numbered(rows: Sequence[Vector], digits: int) -> tuple[Vector, npt.NDArray[np.intp]]:
    """Round rows of shape (faces, 3, 3), list those that differ and number every face's three from 1."""
    rounded = np.round(np.concatenate(rows), digits).reshape(-1, 3) + 0.0  # + 0.0 turns -0 into 0
    different, number = np.unique(rounded, axis=0, return_inverse=True)
    return different, number.reshape(-1, 3) + 1
