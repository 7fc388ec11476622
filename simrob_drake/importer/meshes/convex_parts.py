"""Convex parts that a mesh is cut into: together they lie closer to it than its hull.

A plane cuts the mesh in two, and the convex hull of each half encloses what the mesh
bounds on that side. So the parts always enclose the mesh, open or closed, and lie in
its hull. Each cut is the one of a few planes that leaves the least volume.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
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
from simrob_drake.importer.meshes.parts import Faces, distinct
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

_DIGITS = 6  # corners nearer than a micrometre are one

_LARGEST_ENTRY = 50_000_000  # bytes of a cache entry; most have some hundred kilobytes

_CODE = [Path(__file__).parent]


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a mesh on one side of all cuts so far."""

    vertices: Vector  # (n, 3) [m]
    faces: Faces  # (m, 3), indices of vertices

    @cached_property
    def corners(self) -> Vector:
        """Corners (k, 3) of the part's convex hull [m]."""
        used = self.vertices[np.unique(self.faces)]
        points, _ = distinct(used, _DIGITS)
        return np.asarray(points[convex_hull(points).vertices])

    @cached_property
    def volume(self) -> float:
        """Volume of the part's convex hull [m³]."""
        return float(convex_hull(self.corners).volume)

    def halves(self, cuts: tuple[float, ...] = _CUTS) -> "Iterator[tuple[_Part, _Part]]":
        """Yield the two halves that each plane leaves, if both are solid."""
        from trimesh.intersections import slice_faces_plane

        lower = self.corners.min(axis=0)
        size = self.corners.max(axis=0) - lower
        for axis in range(3):
            normal = np.eye(3)[axis]
            for cut in cuts:
                if min(cut, 1.0 - cut) * size[axis] < _LEAST_THICKNESS:
                    continue
                origin = lower + cut * size
                halves = []
                for side in (1.0, -1.0):
                    vertices, faces, _ = slice_faces_plane(  # type: ignore[no-untyped-call]
                        self.vertices, self.faces, side * normal, origin
                    )
                    halves.append(_Part(np.asarray(vertices), np.asarray(faces)))
                if all(half.is_solid for half in halves):
                    yield halves[0], halves[1]

    @cached_property
    def is_solid(self) -> bool:
        """Whether the part has a volume."""
        try:
            return len(self.faces) > 0 and self.volume > 0.0
        except UnreadableMesh:
            return False

    @cached_property
    def best_cut(self) -> "_Cut":
        """The cut that removes most volume."""
        cuts = [_Cut(self._gain(halves), halves) for halves in self.halves()]
        return max(cuts, key=lambda cut: cut.gain, default=_Cut(0.0, None))

    def best_first_cut(self) -> "_Cut":
        """Find the middle cut that, with the best cuts of its halves, removes most.

        A single cut of a ring removes nothing, since the hulls of the halves fill it.
        """
        cuts = []
        for halves in self.halves((0.5,)):
            later = halves[0].best_cut.gain + halves[1].best_cut.gain
            cuts.append(_Cut(self._gain(halves) + later, halves))
        return max(cuts, key=lambda cut: cut.gain, default=_Cut(0.0, None))

    def _gain(self, halves: "tuple[_Part, _Part]") -> float:
        """Volume that a cut removes [m³]."""
        return self.volume - halves[0].volume - halves[1].volume

    @property
    def is_convex(self) -> bool:
        """Whether all faces lie on the part's convex hull, but for a small depth."""
        planes = convex_hull(self.corners).equations
        centres = self.vertices[self.faces].mean(axis=1)
        heights = centres @ planes[:, :3].T + planes[:, 3]
        return bool((heights.max(axis=1) > -_CONVEX).all())


class _Cut(NamedTuple):
    """A cut of a part."""

    gain: float  # volume that it removes, later cuts included if they were sought [m³]
    halves: tuple[_Part, _Part] | None  # None if no cut leaves two solid halves


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
    whole = _Part(vertices, faces)
    parts = [whole]
    least = _LEAST_GAIN * whole.volume
    if whole.is_convex:
        return [whole.corners]
    while len(parts) < MOST_PARTS:
        index = int(np.argmax([part.best_cut.gain for part in parts]))
        cut = parts[index].best_cut
        if cut.gain < least:
            ahead = [part.best_first_cut() for part in parts]
            index = int(np.argmax([each.gain for each in ahead]))
            cut = ahead[index]
        if cut.halves is None or cut.gain < least:
            break
        parts[index : index + 1] = cut.halves
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
