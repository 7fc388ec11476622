"""Cut a mesh into convex parts, which together fit the mesh more closely than its convex hull.

A plane cuts the mesh in two, and each half is replaced by its convex hull; the halves are cut
again in the same way. The parts always enclose the mesh, also if the mesh is not closed, and
lie inside its convex hull. Each cut uses the plane, out of a few, that removes most volume.
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

from simrob_drake.base.errors import OutputError
from simrob_drake.base.files import content_of
from simrob_drake.base.folders import cache_entry, written_at_once
from simrob_drake.base.frames import Vector
from simrob_drake.base.interrupts import heard_afterwards
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.hulls import convex_hull
from simrob_drake.importer.meshes.parts import Faces

MOST_PARTS = 12
"""Largest count of parts. The link of an arm is one or two tubes with flanges, so more parts
hardly improve the fit."""

_CUTS = (0.25, 0.5, 0.75)
"""Positions of the planes that are tried along each axis, as fractions of the part's size."""

_LEAST_GAIN = 0.03
"""Least volume that a cut must remove, as a fraction of the volume of the mesh's convex hull."""

_LEAST_THICKNESS = 0.03
"""Least thickness of a part [m]. The overlap that is computed for a thin part is at most its
thickness, so deep collisions would seem to be small."""

_CONVEX = 2e-3
"""A mesh counts as convex if no face lies deeper below its convex hull [m]. This is less than
half of the collision tolerance of 5 mm between links of one robot."""

_GRID = 1e-3
"""Grid to which vertices are rounded [m]: CAD meshes often have many vertices within a millimetre."""

_LARGEST_ENTRY = 50_000_000
"""Largest size of a cache entry [bytes]. Most have about ten kilobytes."""

_CODE = [Path(__file__).parent]
"""Folder with the code that makes the cached parts. A change of this code makes them invalid."""

# 98 directions, distributed over all sides: the grid points on the surface of a cube. The
# volumes of cuts are compared with the outermost points in these directions only, to save time.
_GRID_POINTS = np.array(
    [point for point in product((-2, -1, 0, 1, 2), repeat=3) if 2 in map(abs, point)]
)
_DIRECTIONS = _GRID_POINTS / np.linalg.norm(_GRID_POINTS, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class _Part:
    """The part of a mesh that lies between the cuts made so far."""

    vertices: Vector  # (n, 3) [m], each vertex belongs to a face
    faces: Faces  # (m, 3), indices of vertices

    @cached_property
    def corners(self) -> Vector:
        """Corners (k, 3) of the part's convex hull [m]."""
        return np.asarray(self.vertices[convex_hull(self.vertices).vertices])

    @cached_property
    def volume(self) -> float:
        """Approximate volume of the part's convex hull [m³]."""
        return _volume_of(self.vertices)

    @cached_property
    def _edges(self) -> tuple[Vector, Vector]:
        """Start points and end points of the edges of all m faces, each of shape (3 m, 3) [m]."""
        first, second, third = self.faces.T
        starts = np.concatenate([first, second, third])
        ends = np.concatenate([second, third, first])
        return self.vertices[starts], self.vertices[ends]

    def planes(self, cuts: tuple[float, ...]) -> Iterator[tuple[int, float]]:
        """Yield the planes to try: index of the axis normal to the plane, and position on this axis [m].

        A plane that would make a half thinner than _LEAST_THICKNESS is left out.

        Args:
            cuts: positions of the planes as fractions of the part's size.
        """
        lower = self.vertices.min(axis=0)
        size = np.ptp(self.vertices, axis=0)
        for axis, cut in product(range(3), cuts):
            thinner_half = min(cut, 1.0 - cut) * size[axis]
            if thinner_half >= _LEAST_THICKNESS:
                yield axis, float(lower[axis] + cut * size[axis])

    def gain(self, axis: int, level: float) -> float:
        """Volume that a cut removes [m³]: the part's hull without the hulls of the two halves.

        Args:
            axis: index of the axis normal to the plane.
            level: position of the plane on the axis [m].
        """
        # Heights above the plane have opposite signs at the two ends of an edge that crosses the plane.
        starts, ends = self._edges
        start_heights = starts[:, axis] - level
        end_heights = ends[:, axis] - level
        crosses = start_heights * end_heights < 0.0
        # Fraction of the edge at which it crosses the plane.
        fractions = start_heights[crosses] / (start_heights[crosses] - end_heights[crosses])
        edges = ends[crosses] - starts[crosses]
        crossing_points = starts[crosses] + fractions[:, np.newaxis] * edges

        # The crossing points belong to both halves.
        is_above = self.vertices[:, axis] > level
        volume_above = _volume_of(np.vstack([self.vertices[is_above], crossing_points]))
        volume_below = _volume_of(np.vstack([self.vertices[~is_above], crossing_points]))
        return self.volume - (volume_above + volume_below)

    def halves(self, axis: int, level: float) -> "list[_Part]":
        """Cut the part in two by a plane that is normal to an axis, at a level [m] on this axis."""
        from trimesh.intersections import slice_faces_plane

        origin = np.zeros(3)
        origin[axis] = level
        halves = []
        for side in (1.0, -1.0):
            normal = side * np.eye(3)[axis]
            vertices, faces, _ = slice_faces_plane(  # type: ignore[no-untyped-call]
                self.vertices, self.faces, normal, origin
            )
            halves.append(_without_unused_vertices(np.asarray(vertices), np.asarray(faces)))
        return halves

    @cached_property
    def best_cut(self) -> "_Cut":
        """The cut that removes most volume. Its gain is 0 if the part is too thin for a cut."""
        cuts = [_Cut(self.gain(axis, level), axis, level) for axis, level in self.planes(_CUTS)]
        return max(cuts, key=lambda cut: cut.gain, default=_NO_CUT)

    @cached_property
    def best_first_cut(self) -> "_Cut":
        """The cut through the middle that removes most volume together with the next cuts of its halves.

        A single cut of a ring removes hardly any volume, since the hulls of the two halves
        still fill the hole. Cuts of these halves do. If no plane can be tried, the result is _NO_CUT.
        """
        cuts = []
        for axis, level in self.planes((0.5,)):
            first_half, second_half = self.halves(axis, level)
            later_gain = first_half.best_cut.gain + second_half.best_cut.gain
            cuts.append(_Cut(self.gain(axis, level) + later_gain, axis, level))
        return max(cuts, key=lambda cut: cut.gain, default=_NO_CUT)

    @property
    def is_convex(self) -> bool:
        """Whether the centres of all faces lie on the part's convex hull, up to a depth of 2 mm."""
        # The triangles of a flat side of the hull have the same plane, up to rounding errors.
        planes = np.unique(convex_hull(self.vertices).equations.round(6), axis=0)
        centres = self.vertices[self.faces].mean(axis=1)

        # Height of each centre above the nearest plane; negative below the hull's surface.
        # The loop over planes needs less memory than one product of all planes and centres.
        highest = np.full(len(centres), -np.inf)
        for plane in planes:
            np.maximum(highest, centres @ plane[:3] + plane[3], out=highest)
        return bool((highest > -_CONVEX).all())


class _Cut(NamedTuple):
    """A cut of a part by a plane.

    Attributes:
        gain: volume that the cut removes [m³]. For `best_first_cut` this includes the next cuts of the halves.
        axis: index of the axis normal to the plane.
        level: position of the plane on the axis [m].
    """

    gain: float
    axis: int
    level: float


_NO_CUT = _Cut(0.0, 0, 0.0)


def _volume_of(points: Vector) -> float:
    """Approximate volume of the convex hull of points (n, 3) [m³], from the outermost points in 98 directions.

    The volume is 0 if the points are flat.
    """
    if len(points) < 4:  # fewer points than the corners of a tetrahedron enclose no volume
        return 0.0
    farthest = np.unique((points @ _DIRECTIONS.T).argmax(axis=0))
    try:
        return float(convex_hull(points[farthest]).volume)
    except UnreadableMesh:  # the points lie in a plane
        return 0.0


def _without_unused_vertices(vertices: Vector, faces: Faces) -> _Part:
    """Remove the vertices (n, 3) that belong to none of the faces (m, 3)."""
    used, new_indices = np.unique(faces, return_inverse=True)
    return _Part(vertices[used], new_indices.reshape(faces.shape))


def _round_to_grid(vertices: Vector, faces: Faces) -> _Part:
    """Round the vertices of a mesh to a grid, and remove faces that become lines or points, and duplicates.

    Args:
        vertices: vertices of the mesh, shape (n, 3) [m].
        faces: indices of the vertices of each face, shape (m, 3).
    """
    grid_points, new_indices = np.unique(np.round(vertices / _GRID), axis=0, return_inverse=True)
    new_faces = new_indices.reshape(-1)[faces]
    first, second, third = new_faces.T
    has_three_corners = (first != second) & (second != third) & (third != first)
    # Faces with the same corners are equal if the corners are sorted. The order, which gives a face its outer side, is
    # lost, but no hull depends on it.
    distinct_faces = np.unique(np.sort(new_faces[has_three_corners], axis=1), axis=0)
    return _without_unused_vertices(grid_points * _GRID, distinct_faces)


@heard_afterwards()  # an interrupt by the user (Ctrl-C) takes effect when the function returns
def convex_parts(vertices: Vector, faces: NDArray[np.int64]) -> list[Vector]:
    """Cut a mesh into convex parts.

    Args:
        vertices: vertices of the mesh, shape (n, 3) [m].
        faces: indices of the vertices of each face, shape (m, 3).

    Returns:
        the corners of each part's convex hull, shape (k, 3) [m], of at most `MOST_PARTS` parts. There is only one part
        if the mesh is convex or if no cut removes enough volume.

    Raises:
        UnreadableMesh: the mesh is flat or too small for a hull.
    """
    whole = _round_to_grid(vertices, faces)
    if whole.is_convex:
        return [whole.corners]
    least_gain = _LEAST_GAIN * whole.volume
    parts = [whole]
    while len(parts) < MOST_PARTS:
        index = int(np.argmax([part.best_cut.gain for part in parts]))
        cut = parts[index].best_cut
        if cut.gain < least_gain:
            # No single cut helps. Two cuts, one after the other, may: see `best_first_cut`.
            index = int(np.argmax([part.best_first_cut.gain for part in parts]))
            cut = parts[index].best_first_cut
        if cut.gain < least_gain:
            break
        parts[index : index + 1] = parts[index].halves(cut.axis, cut.level)  # in place of the part
    return [part.corners for part in parts]


def cached_convex_parts(vertices: Vector, faces: NDArray[np.int64]) -> list[Vector]:
    """Read the result of :func:`convex_parts` from the cache, or compute it and write it to the cache.

    The cache entry depends on the mesh and on the code of this package.

    Args:
        vertices: vertices of the mesh, shape (n, 3) [m].
        faces: indices of the vertices of each face, shape (m, 3).

    Raises:
        UnreadableMesh: the mesh is flat or too small for a hull.
    """
    content = [vertices.tobytes(), faces.tobytes()]
    entry = cache_entry("convex_parts", made_of=content, made_by=_CODE)
    file = entry / "corners.txt"
    if file.is_file():
        return _parts_of_text(content_of(file, _LARGEST_ENTRY).decode())
    parts = convex_parts(vertices, faces)
    with suppress(OutputError):  # a cache that cannot be written only costs time
        written_at_once(file, _text_of_parts(parts))
    return parts


def _text_of_parts(parts: list[Vector]) -> str:
    """Text of a cache entry. Each line holds the number of the part and the position of one corner [m]."""
    lines = []
    for number, corners in enumerate(parts):
        for x, y, z in corners.tolist():
            lines.append(f"{number} {x!r} {y!r} {z!r}")
    return "\n".join(lines) + "\n"


def _parts_of_text(text: str) -> list[Vector]:
    """Read the parts from the text of a cache entry."""
    rows = np.array([line.split() for line in text.splitlines()], dtype=float)
    # A part begins at a line whose number differs from that of the line before.
    part_starts = np.flatnonzero(np.diff(rows[:, 0])) + 1
    return [np.asarray(part[:, 1:]) for part in np.split(rows, part_starts)]
