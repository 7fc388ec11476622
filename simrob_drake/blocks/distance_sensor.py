"""The distances between shapes, and a block that measures that of two bodies."""

from collections.abc import Collection
from itertools import product

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    Mesh,
    QueryObject,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context

from simrob_drake.blocks.block import Block
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.lifetime import weakly

_RIM = np.arange(16) * np.pi / 8  # angles of the points that stand for the rim of a cylinder
_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))


Pair = tuple[GeometryId, GeometryId]


class Distances:
    """The signed distances of pairs of shapes, wherever they are.

    Drake finds them for all pairs of convex shapes (a mesh counts as its convex hull), but of half spaces for spheres
    alone; of other shapes the lowest point is looked up here.

    Attributes:
        pairs: in the order of the distances: those with half spaces come last.
    """

    def __init__(self, pairs: Collection[Pair], inspector: SceneGraphInspector) -> None:
        """Look at the shapes of pairs that can touch."""
        flat = [self._is_flat(inspector, *pair) for pair in pairs]
        self._above = [self._over_plane(inspector, *pair) for pair, is_flat in zip(pairs, flat, strict=True) if is_flat]
        self._between = [pair for pair, is_flat in zip(pairs, flat, strict=True) if not is_flat]
        self.pairs = [*self._between, *(pair for pair, is_flat in zip(pairs, flat, strict=True) if is_flat)]

    def of(self, query: QueryObject) -> Vector:
        """Return the distances, negative where shapes are in each other, shape (k,) [m]."""
        found = [query.ComputeSignedDistancePairClosestPoints(*pair).distance for pair in self._between]
        for shape_id, shape, corners, plane in self._above:
            base = query.GetPoseInWorld(plane).inverse() if isinstance(plane, GeometryId) else plane
            found.append(lowest_points(shape, base @ query.GetPoseInWorld(shape_id), corners)[:, 2].min())
        return np.array(found)

    @staticmethod
    def _is_flat(inspector: SceneGraphInspector, first: GeometryId, second: GeometryId) -> bool:
        return any(isinstance(inspector.GetShape(shape), HalfSpace) for shape in (first, second))

    @staticmethod
    def _over_plane(
        inspector: SceneGraphInspector, first: GeometryId, second: GeometryId
    ) -> tuple[GeometryId, Shape, Vector, GeometryId | RigidTransform]:
        """Return the shape over a half space, its corners, and the half space, or the world in it where it stands."""
        if isinstance(inspector.GetShape(first), HalfSpace):
            first, second = second, first
        stands = inspector.GetFrameId(second) == inspector.world_frame_id()
        plane = inspector.GetPoseInFrame(second).inverse() if stands else second
        return first, inspector.GetShape(first).Clone(), shape_corners(inspector, first), plane


class DistanceSensor(Block):
    """Measure the signed distance between two sets of shapes: that of the nearest, or deepest, pair.

    Ports:
        in  ``query``: of the scene graph.
        out ``distance`` (1): [m], negative where the shapes are in each other.
    """

    def __init__(
        self, *, body: Collection[GeometryId], other: Collection[GeometryId], inspector: SceneGraphInspector
    ) -> None:
        """Make the block for the shapes of ``body`` and ``other``.

        Raises:
            InvalidParameter: no pair whose distance can be measured: shapes of one robot, or of one body.
        """
        super().__init__()
        pairs = [(a, b) for a in body for b in other if a != b and not inspector.CollisionFiltered(a, b)]
        if not pairs:
            names = " and ".join(inspector.GetName(next(iter(shapes))) for shapes in (body, other))
            expected = "two things that can touch; parts of one robot can with contact.self_collision: true"
            raise InvalidParameter("distance sensor", f"between {names}", expected)
        self._distances = Distances(pairs, inspector)
        self._query = self.DeclareAbstractInputPort("query", Value[QueryObject]())
        self.DeclareVectorOutputPort("distance", 1, weakly(self._calc_distance))

    def _calc_distance(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._distances.of(self._query.Eval(context)).min())


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
