"""Convex parts that a mesh is cut into: together they lie closer to it than its hull.

A plane cuts the mesh in two, and the convex hull of each half encloses what the mesh
bounds on that side. So the parts always enclose the mesh, open or closed, and lie in
its hull. Each cut is the one of a few planes that leaves the least volume.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simrob_drake.errors import OutputError
from simrob_drake.files import content_of
from simrob_drake.folders import cache_entry, written_at_once
from simrob_drake.frames import Vector
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.hulls import convex_hull
from simrob_drake.importer.meshes.parts import Faces
from simrob_drake.interrupts import heard_afterwards

MOST_PARTS = 12
"""A link of an arm is a tube or two with flanges: more parts hardly lie closer."""

_CUTS = (0.25, 0.5, 0.75)
"""Planes tried along each axis, as fractions of a part's extent."""

_LEAST_GAIN = 0.03
"""A cut removes at least this fraction of the whole hull's volume."""

_LEAST_THICKNESS = 0.03
"""No part is cut thinner [m]: the depth of a thin part in another is its thickness."""

_CONVEX = 2e-3
"""Depth of faces below the hull up to which a mesh counts as convex [m]: less than half
of the tolerance of collisions."""

_GRID = 1e-3
"""Vertices are rounded to this [m]: CAD meshes have many within a millimetre."""

_LARGEST_ENTRY = 50_000_000  # bytes of a cache entry; most have some ten kilobytes

_CODE = [Path(__file__).parent]

# 98 directions, evenly enough: for the volumes by which cuts are compared, the points
# farthest out in these directions stand for all.
_AROUND = np.array([way for way in product((-2, -1, 0, 1, 2), repeat=3) if 2 in map(abs, way)])
_DIRECTIONS = _AROUND / np.linalg.norm(_AROUND, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a mesh on one side of all cuts so far."""

    vertices: Vector  # (n, 3) [m], each used by a face
    faces: Faces  # (m, 3), indices of vertices

    @cached_property
    def corners(self) -> Vector:
        """Corners (k, 3) of the part's convex hull [m]."""
        return np.asarray(self.vertices[convex_hull(self.vertices).vertices])

    @cached_property
    def volume(self) -> float:
        """About the volume of the part's convex hull [m³]."""
        return _volume_of(self.vertices)

    @cached_property
    def _edges(self) -> tuple[Vector, Vector]:
        """Both ends of each edge of each face, (3 m, 3) each [m]."""
        first, second, third = self.faces.T
        starts = np.concatenate([first, second, third])
        ends = np.concatenate([second, third, first])
        return self.vertices[starts], self.vertices[ends]

    def planes(self, cuts: tuple[float, ...]) -> Iterator[tuple[int, float]]:
        """Yield the planes to try: the axis across each, and its position there [m]."""
        lower = self.vertices.min(axis=0)
        size = np.ptp(self.vertices, axis=0)
        for axis, cut in product(range(3), cuts):
            if min(cut, 1.0 - cut) * size[axis] >= _LEAST_THICKNESS:
                yield axis, float(lower[axis] + cut * size[axis])

    def gain(self, axis: int, level: float) -> float:
        """Volume that a cut removes [m³]."""
        starts, ends = self._edges
        heights = starts[:, axis] - level
        other_heights = ends[:, axis] - level
        crosses = heights * other_heights < 0.0
        fractions = heights[crosses] / (heights[crosses] - other_heights[crosses])
        ways = ends[crosses] - starts[crosses]
        section = starts[crosses] + fractions[:, np.newaxis] * ways
        above = self.vertices[:, axis] > level
        halves = (self.vertices[above], self.vertices[~above])
        return self.volume - sum(_volume_of(np.vstack([half, section])) for half in halves)

    def halves(self, axis: int, level: float) -> "list[_Part]":
        """Cut the part in two by a plane."""
        from trimesh.intersections import slice_faces_plane

        origin = np.zeros(3)
        origin[axis] = level
        found = []
        for side in (1.0, -1.0):
            normal = side * np.eye(3)[axis]
            vertices, faces, _ = slice_faces_plane(  # type: ignore[no-untyped-call]
                self.vertices, self.faces, normal, origin
            )
            found.append(_without_unused(np.asarray(vertices), np.asarray(faces)))
        return found

    @cached_property
    def best_cut(self) -> "_Cut":
        """The cut that removes most volume."""
        cuts = [_Cut(self.gain(axis, level), axis, level) for axis, level in self.planes(_CUTS)]
        return max(cuts, key=lambda cut: cut.gain, default=_NO_CUT)

    @cached_property
    def best_first_cut(self) -> "_Cut":
        """The middle cut that, with the best cuts of its halves, removes most.

        A single cut of a ring removes nothing, since the hulls of the halves fill it.
        """
        cuts = []
        for axis, level in self.planes((0.5,)):
            later = sum(half.best_cut.gain for half in self.halves(axis, level))
            cuts.append(_Cut(self.gain(axis, level) + later, axis, level))
        return max(cuts, key=lambda cut: cut.gain, default=_NO_CUT)

    @property
    def is_convex(self) -> bool:
        """Whether all faces lie on the part's convex hull, but for a small depth."""
        planes = np.unique(convex_hull(self.vertices).equations.round(6), axis=0)
        centres = self.vertices[self.faces].mean(axis=1)
        highest = np.full(len(centres), -np.inf)
        for plane in planes:
            np.maximum(highest, centres @ plane[:3] + plane[3], out=highest)
        return bool((highest > -_CONVEX).all())


class _Cut(NamedTuple):
    """A cut of a part by a plane."""

    gain: float  # volume that it removes, later cuts included if they were sought [m³]
    axis: int  # axis across the plane
    level: float  # position of the plane along the axis [m]


_NO_CUT = _Cut(0.0, 0, 0.0)


def _volume_of(points: Vector) -> float:
    """Volume of the convex hull of points (n, 3), of those farthest out [m³]."""
    if len(points) < 4:
        return 0.0
    farthest = np.unique((points @ _DIRECTIONS.T).argmax(axis=0))
    try:
        return float(convex_hull(points[farthest]).volume)
    except UnreadableMesh:  # flat
        return 0.0


def _without_unused(vertices: Vector, faces: Faces) -> _Part:
    """Return a part of a mesh without the vertices that no face uses."""
    used, faces_of_used = np.unique(faces, return_inverse=True)
    return _Part(vertices[used], faces_of_used.reshape(faces.shape))


def _rounded(vertices: Vector, faces: Faces) -> _Part:
    """Return a mesh with its vertices on a grid, and without faces that vanish."""
    points, index = np.unique(np.round(vertices / _GRID), axis=0, return_inverse=True)
    corners = index.reshape(-1)[faces]
    first, second, third = corners.T
    is_face = (first != second) & (second != third) & (third != first)
    kept = np.unique(np.sort(corners[is_face], axis=1), axis=0)
    return _without_unused(points * _GRID, kept)


@heard_afterwards()
def convex_parts(vertices: Vector, faces: NDArray[np.int64]) -> list[Vector]:
    """Cut a mesh into convex parts.

    Args:
        vertices: shape (n, 3) [m].
        faces: indices of vertices, shape (m, 3).

    Returns:
        the corners (k, 3) [m] of each part's hull; one part if the mesh is convex.

    Raises:
        UnreadableMesh: the mesh is flat or too small for a hull.
    """
    whole = _rounded(vertices, faces)
    parts = [whole]
    if whole.is_convex:
        return [whole.corners]
    least = _LEAST_GAIN * whole.volume
    while len(parts) < MOST_PARTS:
        index = int(np.argmax([part.best_cut.gain for part in parts]))
        cut = parts[index].best_cut
        if cut.gain < least:
            index = int(np.argmax([part.best_first_cut.gain for part in parts]))
            cut = parts[index].best_first_cut
        if cut.gain < least:
            break
        parts[index : index + 1] = parts[index].halves(cut.axis, cut.level)
    return [part.corners for part in parts]


def cached_convex_parts(vertices: Vector, faces: NDArray[np.int64]) -> list[Vector]:
    """Return :func:`convex_parts` from the cache, or cut the mesh and keep the parts.

    Raises:
        UnreadableMesh: the mesh is flat or too small for a hull.
    """
    content = [vertices.tobytes(), faces.tobytes()]
    entry = cache_entry("convex_parts", made_of=content, made_by=_CODE)
    file = entry / "corners.txt"
    if file.is_file():
        text = content_of(file, _LARGEST_ENTRY).decode()
        rows = np.array([line.split() for line in text.splitlines()], dtype=float)
        ends = np.flatnonzero(np.diff(rows[:, 0])) + 1
        return [np.asarray(part[:, 1:]) for part in np.split(rows, ends)]
    parts = convex_parts(vertices, faces)
    lines = [f"{number} {x!r} {y!r} {z!r}" for number, part in enumerate(parts) for x, y, z in part.tolist()]
    with suppress(OutputError):  # a cache that cannot be written only costs time
        written_at_once(file, "\n".join(lines) + "\n")
    return parts
