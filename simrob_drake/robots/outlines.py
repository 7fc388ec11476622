"""Points that stand for a shape that collides: its corners, its lowest ones, those that are farthest out."""

from itertools import product

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    Mesh,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.frames import Vector

_RIM = np.arange(16) * np.pi / 8  # angles of the points that stand for the rim of a cylinder
_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))
_TURNS = [  # which bring each of 26 directions down
    RigidTransform(RotationMatrix.MakeFromOneVector(-np.array(way), 2).inverse(), np.zeros(3))
    for way in product((-1.0, 0.0, 1.0), repeat=3)
    if any(way)
]


def shape_outline(inspector: SceneGraphInspector, shape_id: GeometryId) -> Vector:
    """Return points of a convex shape that are farthest out, in the frame of what it belongs to, shape (k, 3) [m]."""
    pose, corners = inspector.GetPoseInFrame(shape_id), shape_corners(inspector, shape_id)
    if len(corners):
        return np.asarray((pose @ corners.T).T)
    shape = inspector.GetShape(shape_id)
    points = [(turn.inverse() @ lowest_points(shape, turn @ pose, corners).T).T for turn in _TURNS]
    return np.vstack(points)


def lowest_points(shape: Shape, pose: RigidTransform, corners: Vector) -> Vector:
    """Return points of a convex shape at a pose, of which one is its lowest, shape (k, 3) [m].

    What is no sphere, cylinder, capsule or ellipsoid is described by its ``corners`` in its frame, shape (m, 3) [m].
    """
    up = pose.rotation().matrix()[2]  # the world's z axis in the frame of the shape
    match shape:
        case Sphere():
            points = -shape.radius() * up[np.newaxis]
        case Ellipsoid():
            axes = np.array([shape.a(), shape.b(), shape.c()])
            points = -(axes**2 * up / np.linalg.norm(axes * up))[np.newaxis]
        case Capsule():
            ends = np.array([[0.0, 0.0, side * shape.length() / 2] for side in (-1, 1)])
            points = ends - shape.radius() * up
        case Cylinder():
            turns = np.arctan2(-up[1], -up[0]) + _RIM  # the first is the lowest of the rim
            rim = shape.radius() * np.column_stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))])
            middle = np.array([0.0, 0.0, shape.length() / 2])
            points = np.vstack([rim - middle, rim + middle])
        case _:
            points = corners
    return np.asarray((pose @ points.T).T)


def shape_corners(inspector: SceneGraphInspector, shape_id: GeometryId) -> Vector:
    """Return the corners of a box or a mesh's convex hull in the shape's frame, (m, 3) [m]; none of other shapes."""
    shape = inspector.GetShape(shape_id)
    if isinstance(shape, Box):
        return np.asarray(_SIGNS * shape.size() / 2)
    if isinstance(shape, Mesh | Convex):
        hull = inspector.GetConvexHull(shape_id)
        return np.array([hull.vertex(index) for index in range(hull.num_vertices())])
    return np.zeros((0, 3))
