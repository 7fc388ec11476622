"""Closed solids for the pieces' meshes, and the writing of OBJ files.

A solid is points of shape (n, 3) [m] and triangles of shape (m, 3) that wind counterclockwise seen from outside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.intp]

CREASE = np.cos(np.radians(38.0))  # faces that meet at a sharper edge than this are shaded apart
DIGITS = 6  # of the coordinates: 1 µm


class Solid(NamedTuple):
    """Points and triangles."""

    points: Array
    faces: Faces

    def moved(
        self, offset: npt.ArrayLike = (0.0, 0.0, 0.0), turn: npt.ArrayLike | None = None
    ) -> Solid:
        """Return the solid turned by a rotation matrix about the origin and then moved."""
        points = self.points if turn is None else self.points @ np.asarray(turn).T
        return Solid(points + np.asarray(offset), self.faces)


def together(solids: Sequence[Solid]) -> Solid:
    """Put solids into one; points that agree to the last written digit become one."""
    starts = np.cumsum([0, *(len(solid.points) for solid in solids)])
    faces = np.concatenate(
        [solid.faces + start for solid, start in zip(solids, starts[:-1], strict=True)]
    )
    # + 0.0 turns -0 into 0
    points = np.round(np.concatenate([solid.points for solid in solids]), DIGITS) + 0.0
    points, number = np.unique(points, axis=0, return_inverse=True)
    faces = number[faces]
    a, b, c = faces.T
    return Solid(points, faces[(a != b) & (b != c) & (c != a)])


def sheet(rows: Array) -> Solid:
    """Join closed rings, shape (rows, n, 3), into an open surface; it faces out where rings turn left and rows rise."""
    count, size = rows.shape[:2]
    index = np.arange(count * size).reshape(count, size)
    a, b = index[:-1], np.roll(index, -1, axis=1)[:-1]
    c, d = np.roll(index, -1, axis=1)[1:], index[1:]
    faces = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    return Solid(rows.reshape(-1, 3), faces)


def circle(radius: npt.ArrayLike, sides: int, height: npt.ArrayLike = 0.0) -> Array:
    """Return a ring about z, shape (sides, 3); radius and height may differ from point to point."""
    turn = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack(
        [np.cos(turn) * radius, np.sin(turn) * radius, np.broadcast_to(height, sides)], axis=1
    )
    return np.asarray(ring, dtype=float)


def lathe(profile: Sequence[tuple[float, ...]], sides: int = 32) -> Solid:
    """Turn a profile of (radius, height), from the axis below to the axis above, about z."""
    return together(
        [sheet(np.array([circle(radius, sides, height) for radius, height in profile]))]
    )


def curve(
    points: Sequence[tuple[float, ...]], steps: int = 3, *, closed: bool = False
) -> list[tuple[float, ...]]:
    """Run a Catmull-Rom spline through points, with some steps from each to the next."""
    row = np.asarray(points, dtype=float)
    ends = (row[-1:], row[:2]) if closed else (2 * row[:1] - row[1:2], 2 * row[-1:] - row[-2:-1])
    row = np.concatenate([ends[0], row, ends[1]])
    t = np.arange(steps)[:, None] / steps
    smooth = [
        b + 0.5 * t * ((c - a) + t * ((2 * a - 5 * b + 4 * c - d) + t * (3 * (b - c) + d - a)))
        for a, b, c, d in zip(row, row[1:], row[2:], row[3:], strict=False)
    ]
    path = np.concatenate(smooth if closed else [*smooth, row[-2:-1]])
    return [tuple(point) for point in path.tolist()]


def ball(
    radius: float, height: float, below: float = -90.0, rows: int = 9
) -> list[tuple[float, ...]]:
    """Return the profile of a ball, from an angle below its middle [deg] to its top."""
    rise = np.radians(np.linspace(below, 90.0, rows))
    return [(float(radius * np.cos(t)), float(height + radius * np.sin(t))) for t in rise]


def plate(outline: Array, spine: Array, half_width: npt.ArrayLike, edge: float) -> Solid:
    """Extrude an outline in x-z to both sides of y, with rounded edges.

    Args:
        outline: closed curve, counterclockwise with x to the right and z up, shape (n, 2) [m].
        spine: the point inside towards which each point of the outline shrinks, shape (n, 2) [m].
        half_width: in y, a number or one for each point [m].
        edge: radius of the edges [m].
    """
    reach = np.linalg.norm(outline - spine, axis=1)
    turns = np.radians(np.linspace(0.0, 90.0, 4))
    inset = [reach, *(edge * (1.0 - np.sin(t)) for t in turns)]
    depth = [np.asarray(half_width), *(half_width - edge * (1.0 - np.cos(t)) for t in turns)]
    half = list(zip(inset, depth, strict=True))
    rings = [(shrink, y) for shrink, y in half] + [(shrink, -y) for shrink, y in half[::-1]]
    rows = np.zeros((len(rings), len(outline), 3))
    for row, (shrink, y) in zip(rows, rings, strict=True):
        row[:, [0, 2]] = spine + (1.0 - shrink / reach)[:, None] * (outline - spine)
        row[:, 1] = y
    return together([sheet(rows)])


def block(low: npt.ArrayLike, high: npt.ArrayLike) -> Solid:
    """Make a box with sharp edges between two corners."""
    x, y, z = np.stack([low, high], axis=1)
    corners = [(x[i], y[j]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return prism(np.array(corners), float(z[0]), float(z[1]))


def prism(outline: Array, low: float, high: float) -> Solid:
    """Extrude an outline in x-y that is seen whole from its mean, counterclockwise, shape (n, 2), from z to z [m]."""
    middle = np.broadcast_to(outline.mean(axis=0), outline.shape)
    layers = [(middle, low), (outline, low), (outline, high), (middle, high)]
    return together(
        [sheet(np.array([np.column_stack([ring, np.full(len(ring), z)]) for ring, z in layers]))]
    )


def rounded_cube(side: float, edge: float, corner_points: int = 4) -> Solid:
    """Make a cube around the origin with rounded edges and corners."""
    turns = np.radians(np.linspace(0.0, 90.0, corner_points))
    inner = side / 2 - edge

    def ring(rise: float, height: float) -> Array:
        radius = edge * np.cos(rise)
        corners = [
            (
                sx * inner + radius * np.cos(start + t),
                sy * inner + radius * np.sin(start + t),
                height,
            )
            for (sx, sy), start in zip(
                ((1, 1), (-1, 1), (-1, -1), (1, -1)), np.pi / 2 * np.arange(4), strict=True
            )
            for t in turns
        ]
        return np.array(corners)

    rows = [ring(t, inner + edge * np.sin(t)) for t in turns]
    below = [row * (1, 1, -1) for row in rows[::-1]]
    caps = [np.full_like(rows[0], (0, 0, z)) for z in (-side / 2, side / 2)]
    return together([sheet(np.array([caps[0], *below, *rows, caps[1]]))])


def pierced(rim: Array, radius: float, height: Callable[[Array], Array], rows: int) -> Array:
    """Return rings from a hole to the rim of the surface around it, shape (rows + 1, n, 3).

    Args:
        rim: closed curve around the hole, counterclockwise, in the plane across the hole, shape (n, 2) [m].
        radius: of the hole, whose axis is z [m].
        height: of the surface over points of that plane, (n, 2) to (n,) [m].
        rows: of quads between hole and rim.
    """
    hole = radius * rim / np.linalg.norm(rim, axis=1, keepdims=True)
    flat = [hole + part * (rim - hole) for part in np.linspace(0.0, 1.0, rows + 1)]
    return np.array([np.column_stack([ring, height(ring)]) for ring in flat])


def write_obj(path: Path, solid: Solid) -> None:
    """Write a solid as an OBJ file, with soft normals except across creases."""
    solid = together([solid])
    normals, turns = np.unique(
        np.round(_corner_normals(solid), 3).reshape(-1, 3) + 0.0, axis=0, return_inverse=True
    )
    lines = ["# made by make_meshes.py"]
    lines += ["v " + " ".join(f"{value:.{DIGITS}f}" for value in point) for point in solid.points]
    lines += ["vn " + " ".join(f"{value:.3f}" for value in normal) for normal in normals]
    corner = "{}//{}".format
    for face, turn in zip(solid.faces + 1, turns.reshape(-1, 3) + 1, strict=True):
        lines.append("f " + " ".join(map(corner, face, turn)))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _corner_normals(solid: Solid) -> Array:
    """Mean the normals around every face corner by angle, as far as soft edges lead; shape (faces, 3, 3)."""
    corners = solid.points[solid.faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = areas / np.linalg.norm(areas, axis=1, keepdims=True)
    sides = np.roll(corners, -1, axis=1) - corners
    sides /= np.linalg.norm(sides, axis=2, keepdims=True)
    angles = np.arccos(np.clip(-(sides * np.roll(sides, 1, axis=1)).sum(axis=2), -1.0, 1.0))
    result = np.zeros_like(corners)
    # all corners, those of one point together
    order = np.argsort(solid.faces, axis=None, kind="stable")
    points = solid.faces.reshape(-1)[order]
    for group in np.split(order, np.flatnonzero(np.diff(points)) + 1):
        faces, places = group // 3, group % 3
        around = solid.faces[faces]
        shared = (around[:, None, :, None] == around[None, :, None, :]).sum(
            axis=(2, 3)
        ) >= 2  # an edge
        soft = shared & (normals[faces] @ normals[faces].T >= CREASE)
        for _ in range(len(group).bit_length()):
            soft = (soft.astype(int) @ soft) > 0
        result[faces, places] = soft @ (angles[faces, places, None] * normals[faces])
    return np.asarray(result / np.linalg.norm(result, axis=2, keepdims=True))
