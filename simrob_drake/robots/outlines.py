"""Points of a collision shape: its corners, its lowest points, and the points that are farthest out.

Curved shapes have no corners. Their outermost points are computed for a given direction.
"""

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

_RIM_ANGLES = np.arange(16) * np.pi / 8
"""Angles of the points that represent the rim of a cylinder [rad]."""

_CORNER_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))
"""Signs of the coordinates of a box's corners, shape (8, 3)."""


def _turns_that_point_down() -> list[RigidTransform]:
    """Make rotations that turn each of 26 directions downwards (to -z).

    The directions are those from the centre of a cube to its 6 faces, 12 edges and 8 corners.
    """
    turns = []
    for direction in product((-1.0, 0.0, 1.0), repeat=3):
        if not any(direction):
            continue
        # A frame whose z axis (index 2) points against the direction. Its inverse turns the direction to -z.
        frame = RotationMatrix.MakeFromOneVector(-np.array(direction), 2)
        turns.append(RigidTransform(frame.inverse(), np.zeros(3)))
    return turns


_TURNS = _turns_that_point_down()
"""Rotations that turn each of 26 directions downwards."""


def shape_outline(inspector: SceneGraphInspector, shape_id: GeometryId) -> Vector:
    """Compute points on the surface of a convex shape that represent its extent.

    Args:
        inspector: inspector of the scene graph.
        shape_id: the shape.

    Returns:
        the corners or, of a curved shape, its outermost points in 26 directions, in the frame to which the shape is
        fixed, shape (k, 3) [m].
    """
    pose = inspector.GetPoseInFrame(shape_id)
    corners = shape_corners(inspector, shape_id)
    if len(corners):
        return np.asarray((pose @ corners.T).T)
    shape = inspector.GetShape(shape_id)
    points = []
    for turn in _TURNS:
        # The outermost points in a direction are the lowest ones of the shape that is turned with it.
        lowest = lowest_points(shape, turn @ pose, corners)
        points.append((turn.inverse() @ lowest.T).T)
    return np.vstack(points)


def lowest_points(shape: Shape, pose: RigidTransform, corners: Vector) -> Vector:
    """Compute points of a convex shape at a pose, one of which is its lowest point. "Low" is along the world's -z.

    Args:
        shape: the shape.
        pose: pose of the shape in the world.
        corners: corners in the frame of the shape, shape (m, 3) [m], for shapes other than spheres, cylinders, capsules
            and ellipsoids.

    Returns:
        the points in the world, shape (k, 3) [m].
    """
    # The world's z axis in the frame of the shape, in which all points are computed first.
    up = pose.rotation().matrix()[2]
    match shape:
        case Sphere():
            points = -shape.radius() * up[np.newaxis]
        case Ellipsoid():
            # With the semi-axes A = diag(a, b, c), the point farthest along u is A² u / |A u|.
            axes = np.array([shape.a(), shape.b(), shape.c()])
            points = -(axes**2 * up / np.linalg.norm(axes * up))[np.newaxis]
        case Capsule():
            # A capsule is the hull of two spheres, whose lowest points are below their centres.
            centres = np.array([[0.0, 0.0, side * shape.length() / 2] for side in (-1, 1)])
            points = centres - shape.radius() * up
        case Cylinder():
            # Angles about the axis. The first one points down, so that the lowest point of a rim is exact. The others
            # represent the rest of a rim, all of which touches the ground if it is level.
            first_angle = np.arctan2(-up[1], -up[0])
            angles = first_angle + _RIM_ANGLES
            circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
            rim = shape.radius() * circle
            half_axis = np.array([0.0, 0.0, shape.length() / 2])
            points = np.vstack([rim - half_axis, rim + half_axis])
        case _:
            # One of the corners of a polyhedron is its lowest point, whatever its orientation.
            points = corners
    return np.asarray((pose @ points.T).T)


def shape_corners(inspector: SceneGraphInspector, shape_id: GeometryId) -> Vector:
    """Compute the corners of a box, or of the convex hull of a mesh.

    Returns:
        the corners in the frame of the shape, shape (m, 3) [m]; no rows for other shapes.
    """
    shape = inspector.GetShape(shape_id)
    if isinstance(shape, Box):
        return np.asarray(_CORNER_SIGNS * shape.size() / 2)
    # In contacts a mesh counts as its convex hull, which Drake has computed.
    if isinstance(shape, Mesh | Convex):
        hull = inspector.GetConvexHull(shape_id)
        return np.array([hull.vertex(index) for index in range(hull.num_vertices())])
    return np.zeros((0, 3))
