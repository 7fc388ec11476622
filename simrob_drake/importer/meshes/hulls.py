"""Simple collision shapes around meshes: the convex hull, or the tightest box.

A convex hull has few corners, so that contact is computed quickly. Corners are chosen one round after another, those
that stick out farthest first, until the hull fits the mesh. A flat mesh has no volume, so it is thickened first.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

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
"""Largest count of corners of a hull. A convex body with n corners has at most 2 n - 4 faces, here 256."""

_CLOSE = 1e-3
"""A hull fits if no point sticks out by more than this share of the mesh's size, in each direction."""

_GROWTH = 0.3
"""Largest growth of the count of corners in a round, as a share. Small rounds spread corners better, but cost time."""

_THIN = 1e-4
"""Least thickness of a mesh, as a share of its size.

A mesh with less than half of it counts as flat and is made this thick. The result does not count as flat any more, so
that a second import leaves it unchanged.
"""

_LARGER_BOX = 1.02
"""A box along the axes of the frame is preferred up to this multiple of the tightest box's volume."""

_SAME_VOLUME = 1e-6
"""Largest difference between equal volumes, as a share."""

_LEAST_SPREAD = 1e-3
"""Points fill a volume if their smallest singular value is larger than this. Bodies are scaled to size 1 before."""

_DIGITS = 9
"""Digits to which results are rounded [m]."""


@dataclass(frozen=True)
class Hull:
    """A convex body around a mesh.

    Attributes:
        part: its surface.
        gap: distance by which the mesh's farthest point sticks out of it [m].
        thickened: thickness that a flat mesh was given [m]; 0 for a solid mesh.
    """

    part: MeshPart
    gap: float
    thickened: float


class TightBox(NamedTuple):
    """A box around a mesh.

    Attributes:
        size: lengths of the sides, shape (3,) [m].
        pose: pose of the box's centre, with its axes, in the frame of the mesh.
        thickened: thickness that a flat mesh was given [m]; 0 for a solid mesh.
    """

    size: Vector
    pose: RigidTransform
    thickened: float


def hull_of(points: Vector) -> Hull:
    """Compute a convex hull of points with few corners, at most `MOST_CORNERS`.

    The corners are some of the points, so that the hull is never larger than the full convex hull of the points. It has
    their bounding box. Points that are nearly in a plane or on a line are thickened first.

    Args:
        points: the points, shape (n, 3) [m].

    Raises:
        UnreadableMesh: the points are too close together.
    """
    solid, thickness = _with_thickness(points)
    corners = solid[convex_hull(solid).vertices]
    # Only corners of the full hull can be corners of a smaller hull.
    chosen, gap = _choose_corners(corners)
    # The sum turns -0 into 0.
    surface = _hull_surface(corners[chosen].round(_DIGITS) + 0.0)
    return Hull(surface, gap, thickness)


@heard_afterwards()
def is_hull(part: MeshPart) -> bool:
    """Whether a mesh is a convex body already, with no more corners than a hull may have, or two more."""
    from trimesh import Trimesh

    mesh = Trimesh(part.vertices, part.faces, process=False)
    is_closed = mesh.is_watertight and mesh.is_winding_consistent
    # The count of faces is a limit for the corners: a convex body with n corners has 2 n - 4 triangles.
    if len(part.faces) > 2 * MOST_CORNERS or not is_closed:
        return False
    solid, thickness = _with_thickness(part.vertices)
    # A flat mesh is no body yet: it needs a thickness, which `hull_of` gives it.
    if thickness:
        return False
    # A closed mesh is convex if it has the volume of its hull.
    difference = abs(mesh.volume - convex_hull(solid).volume)
    return bool(difference <= _SAME_VOLUME * mesh.volume)


@heard_afterwards()
def box_of(points: Vector) -> TightBox:
    """Compute the tightest box around points (n, 3) [m].

    A box along the axes of the frame is preferred if its volume is larger by 2 % at most, because its pose is easy to
    read.

    Raises:
        UnreadableMesh: the points are too close together.
    """
    from trimesh.bounds import oriented_bounds

    solid, thickness = _with_thickness(points)
    lower = solid.min(axis=0)
    upper = solid.max(axis=0)
    straight_size = upper - lower
    try:
        to_box, size = oriented_bounds(solid[convex_hull(solid).vertices])  # type: ignore[no-untyped-call]
    except TypeError:  # raised if the volume is lost in rounding
        to_box = np.eye(4)
        size = straight_size
    if np.prod(straight_size) <= _LARGER_BOX * np.prod(size):
        centre = ((lower + upper) / 2).round(_DIGITS) + 0.0
        return TightBox(straight_size.round(_DIGITS), RigidTransform(centre), thickness)

    pose = np.linalg.inv(to_box)
    if np.linalg.det(pose[:3, :3]) < 0:
        # A mirrored frame is no rotation. With one axis reversed it is one, and the box is the same.
        pose[:3, 0] *= -1
    rotation = RotationMatrix.ProjectToRotationMatrix(pose[:3, :3])
    centre = pose[:3, 3].round(_DIGITS) + 0.0
    return TightBox(np.asarray(size).round(_DIGITS), RigidTransform(rotation, centre), thickness)


def _principal_axes(centred: Vector) -> Vector:
    """Principal axes of points (n, 3) around zero, as the columns of a matrix (3, 3)."""
    return np.asarray(np.linalg.eigh(np.cov(centred.T))[1])


def _with_thickness(points: Vector) -> tuple[Vector, float]:
    """Give thickness to points (n, 3) that are all in a plane or on a line, or nearly so, so that they fill a volume.

    Returns:
        the points, or copies of them on both sides of the plane, and the thickness [m]. The thickness is 0 if the
        points fill a volume as they are.
    """
    centred = points - points.mean(axis=0)
    axes = _principal_axes(centred)
    # Measured along the principal axes: a plate may be oblique in the frame of the mesh.
    lengths = np.ptp(centred @ axes, axis=0)
    least = _THIN * float(lengths.max())
    is_flat = lengths < least / 2
    for axis in np.flatnonzero(is_flat):
        offset = axes[:, axis] * least / 2
        points = np.concatenate([points - offset, points + offset])
    return points, least if is_flat.any() else 0.0


@heard_afterwards()
def convex_hull(points: Vector) -> "ConvexHull":
    """Compute the convex hull of points (n, 3).

    Raises:
        UnreadableMesh: the points do not fill a volume.
    """
    # Imported here because it is slow to load, and only imports of meshes need it.
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(points)
    except QhullError as problem:
        raise UnreadableMesh(
            message("importer.too_thin_for_hull", "is too thin or too small for a convex hull")
        ) from problem


def _choose_corners(corners: Vector) -> tuple[list[int], float]:
    """Choose some corners of a convex body whose hull fits the body, at most `MOST_CORNERS`.

    Args:
        corners: all corners of the body, shape (n, 3) [m].

    Returns:
        the indices of the chosen corners in ascending order, and the distance by which the others stick out at most
        [m].
    """
    # Along each principal axis the body is scaled to length 1, so that a needle becomes as round as a ball.
    centred = corners - corners.mean(axis=0)
    along_axes = centred @ _principal_axes(centred)
    scaled = along_axes / np.ptp(along_axes, axis=0)

    # The extremes along the frame's axes keep the bounding box of the mesh.
    chosen = _extremes(np.hstack([corners, scaled]))
    rest = np.arange(len(corners))
    while len(rest) and len(chosen) < MOST_CORNERS:
        planes = convex_hull(scaled[chosen]).equations
        heights = _heights(scaled[rest], planes)
        distance_out = heights.max(axis=1)
        # As in quickhull, the candidates are the farthest points over each face.
        tops = np.unique(heights.argmax(axis=0))
        tops = tops[distance_out[tops] > max(_CLOSE, 0.5 * distance_out.max())]
        farthest_first = tops[np.argsort(-distance_out[tops], kind="stable")]
        round_size = min(MOST_CORNERS - len(chosen), max(1, int(_GROWTH * len(chosen))))
        chosen += rest[farthest_first[:round_size]].tolist()
        # The hull only grows, so that a point within it stays within it.
        rest = rest[distance_out > _CLOSE]

    gap = _heights(corners, convex_hull(corners[chosen]).equations).max()
    return sorted(chosen), max(0.0, float(gap))


def _heights(points: Vector, planes: Vector) -> Vector:
    """Compute the signed distance of n points from m planes, shape (n, m), positive on the outer side.

    Args:
        points: the points, shape (n, 3).
        planes: for each plane its outer unit normal a and its offset b, shape (m, 4). Its points have a . x + b = 0.
    """
    return np.asarray(np.einsum("ik,jk->ij", points, planes[:, :3]) + planes[:, 3])


def _extremes(points: Vector) -> list[int]:
    """Find points at the ends of a body that together fill a volume.

    Args:
        points: coordinates of the points, shape (n, 6): in the frame of the mesh, and scaled along the body's axes.

    Returns:
        the indices, in ascending order, of the first points at both ends of each coordinate, and of further points if
        these lie in a plane.
    """
    chosen = {int(index) for index in (*points.argmin(axis=0), *points.argmax(axis=0))}
    scaled = points[:, -3:]
    for _ in range(3):
        # The singular values are the extents of the chosen points along their own axes, the smallest last.
        middle = scaled[sorted(chosen)].mean(axis=0)
        _, extents, axes = np.linalg.svd(scaled[sorted(chosen)] - middle, full_matrices=True)
        if len(extents) == 3 and extents[2] > _LEAST_SPREAD:
            break
        # The point farthest from the plane of the chosen ones.
        chosen.add(int(abs((scaled - middle) @ axes[2]).argmax()))
    return sorted(chosen)


def _hull_surface(points: Vector) -> MeshPart:
    """Convert the convex hull of points (n, 3) to a mesh, with corners counterclockwise as seen from outside."""
    hull = convex_hull(points)
    vertices = points[hull.vertices]
    faces = np.searchsorted(hull.vertices, hull.simplices)
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    outward = hull.equations[:, :3]
    # qhull does not order the corners. Faces whose normal points inwards are reversed.
    points_inward = np.einsum("ij,ij->i", np.cross(second - first, third - first), outward) < 0
    faces[points_inward] = faces[points_inward, ::-1]
    return MeshPart(vertices, faces.astype(np.int64))
