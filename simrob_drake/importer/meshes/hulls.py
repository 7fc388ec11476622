"""Shapes to collide with: the convex hull of a mesh, or the tightest box around it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.frames import Vector
from simrob_drake.base.interrupts import heard_afterwards
from simrob_drake.base.messages import message
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.parts import MeshPart

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

MOST_CORNERS = 130
"""A convex body with that many corners has at most 256 faces: contact stays quick, and no robot needs more."""
_CLOSE = 1e-3  # corners are left out while the hull stays within this part of the mesh's size, in each direction
_GROWTH = 0.3
"""By which part the corners of a hull may grow in a round: slow growth spreads them better, and takes longer."""
_THIN = 1e-4
"""A mesh thinner than half of this part of its size is flat, and made this thick: the next import finds it solid."""


@dataclass(frozen=True)
class Hull:
    """A convex body."""

    part: MeshPart  # its surface
    gap: float  # how far the farthest point of the mesh sticks out [m]
    thickened: float  # how thick a flat mesh was made [m]; 0 for a solid one


def hull_of(points: Vector) -> Hull:
    """Return the convex hull of points (n, 3), with as many corners as it needs but no more than `MOST_CORNERS`.

    The corners are points of the mesh, so the hull is never larger; its bounding box is the mesh's. Raises
    UnreadableMesh: the points are too close together.
    """
    solid, thickness = _thick(points)
    corners = solid[convex_hull(solid).vertices]
    chosen, gap = _fewest(corners)
    return Hull(_surface(corners[chosen].round(9) + 0.0), gap, thickness)


@heard_afterwards()
def is_hull(part: MeshPart) -> bool:
    """Return whether a mesh is a convex body already, with no more corners than contact should have."""
    from trimesh import Trimesh

    mesh = Trimesh(part.vertices, part.faces, process=False)
    if len(part.faces) > 2 * MOST_CORNERS or not (mesh.is_watertight and mesh.is_winding_consistent):
        return False
    solid, thickness = _thick(part.vertices)
    return not thickness and bool(abs(mesh.volume - convex_hull(solid).volume) <= 1e-6 * mesh.volume)


@heard_afterwards()
def box_of(points: Vector) -> tuple[Vector, RigidTransform, float]:
    """Return the size (3,) [m] and the pose of the tightest box around points (n, 3), and how thick it was made.

    The box stands along the axes where that costs less than 2 % of its volume: such figures can be read.
    """
    from trimesh.bounds import oriented_bounds

    solid, thickness = _thick(points)
    lower, upper = solid.min(axis=0), solid.max(axis=0)
    straight = upper - lower
    try:
        to_box, size = oriented_bounds(solid[convex_hull(solid).vertices])  # type: ignore[no-untyped-call]
    except TypeError:  # it finds none where the volume is lost in rounding
        to_box, size = np.eye(4), straight
    if np.prod(straight) <= 1.02 * np.prod(size):
        return straight.round(9), RigidTransform(((lower + upper) / 2).round(9) + 0.0), thickness
    pose = np.linalg.inv(to_box)
    if np.linalg.det(pose[:3, :3]) < 0:
        pose[:3, 0] *= -1  # a box looks the same mirrored
    turn = RotationMatrix.ProjectToRotationMatrix(pose[:3, :3])
    return np.asarray(size).round(9), RigidTransform(turn, pose[:3, 3].round(9) + 0.0), thickness


def _thick(points: Vector) -> tuple[Vector, float]:
    """Return points that fill a volume, and how thick flat ones were made for that [m]."""
    centre = points.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov((points - centre).T))
    along = (points - centre) @ axes
    least = _THIN * float(np.ptp(along, axis=0).max())
    flat = np.ptp(along, axis=0) < least / 2
    for axis in np.flatnonzero(flat):
        offset = axes[:, axis] * least / 2
        points = np.concatenate([points - offset, points + offset])
    return points, least if flat.any() else 0.0


@heard_afterwards()
def convex_hull(points: Vector) -> "ConvexHull":
    """Return the convex hull of points (n, 3); raises UnreadableMesh: they fill no volume."""
    from scipy.spatial import ConvexHull, QhullError  # slow to load, and only imports of meshes need it

    try:
        return ConvexHull(points)
    except QhullError as problem:
        raise UnreadableMesh(
            message("importer.too_thin_for_hull", "is too thin or too small for a convex hull")
        ) from problem


def _fewest(corners: Vector) -> tuple[list[int], float]:
    """Choose corners, the farthest out first, until the hull of the chosen ones is close or they are many.

    How far out is measured in the directions of the body's own axes, along each as a part of its length there: a needle
    stays as round as a ball. Returns their indices in order, and how far others stick out at most [m].
    """
    centred = corners - corners.mean(axis=0)
    along = centred @ np.linalg.eigh(np.cov(centred.T))[1]
    even = along / np.ptp(along, axis=0)
    chosen, rest = _extremes(np.hstack([corners, even])), np.arange(len(corners))
    while len(rest) and len(chosen) < MOST_CORNERS:
        planes = convex_hull(even[chosen]).equations
        above = _heights(even[rest], planes)
        out = above.max(axis=1)
        tops = np.unique(above.argmax(axis=0))  # the farthest over each face, as quickhull does
        tops = tops[out[tops] > max(_CLOSE, 0.5 * out.max())]
        room = min(MOST_CORNERS - len(chosen), max(1, int(_GROWTH * len(chosen))))
        chosen += rest[tops[np.argsort(-out[tops], kind="stable")][:room]].tolist()
        rest = rest[out > _CLOSE]  # the hull only grows: what is within stays within
    gap = _heights(corners, convex_hull(corners[chosen]).equations).max()
    return sorted(chosen), max(0.0, float(gap))


def _heights(points: Vector, planes: Vector) -> Vector:
    """Return how far each point (n, 3) is over each plane (m, 4), as (n, m)."""
    return np.asarray(np.einsum("ik,jk->ij", points, planes[:, :3]) + planes[:, 3])


def _extremes(points: Vector) -> list[int]:
    """Return the first points at each end of each column, and more until they fill a volume of the last three."""
    chosen = {int(index) for index in (*points.argmin(axis=0), *points.argmax(axis=0))}
    even = points[:, -3:]
    for _ in range(3):
        middle = even[sorted(chosen)].mean(axis=0)
        _, sizes, axes = np.linalg.svd(even[sorted(chosen)] - middle, full_matrices=True)
        if len(sizes) == 3 and sizes[2] > 1e-3:
            break
        chosen.add(int(abs((even - middle) @ axes[2]).argmax()))
    return sorted(chosen)


def _surface(points: Vector) -> MeshPart:
    """Return the surface of the convex hull of points, its faces seen counterclockwise from outside."""
    hull = convex_hull(points)
    vertices, faces = points[hull.vertices], np.searchsorted(hull.vertices, hull.simplices)
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    inward = np.einsum("ij,ij->i", np.cross(second - first, third - first), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward, ::-1]
    return MeshPart(vertices, faces.astype(np.int64))
