"""Distances between concave meshes, computed with convex parts instead of convex hulls.

For collisions, Drake replaces a mesh by its convex hull, which fills holes and bends. So two hulls
may overlap although the meshes do not touch. `FineShapes` decides such cases: it cuts the concave
meshes of a station into convex parts and measures the distance between the parts.

A *shape* is a collision geometry of a station, given by its ``GeometryId`` in Drake's scene graph.
It is fixed to a *body*, which is a link of a robot or a piece.
"""

from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import (
    CollisionFilterDeclaration,
    Convex,
    FrameId,
    FramePoseVector,
    GeometryFrame,
    GeometryId,
    GeometryInstance,
    GeometrySet,
    HalfSpace,
    Mesh,
    ProximityProperties,
    QueryObject,
    SceneGraph,
    SceneGraphInspector,
    Shape,
)
from pydrake.math import RigidTransform

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.convex_parts import cached_convex_parts
from simrob_drake.importer.meshes.parts import Faces, clean, combine_without_look
from simrob_drake.importer.meshes.reading import read_mesh
from simrob_drake.parts.station_plant import StationPlant

_SAME_HULL = 5e-3
"""Two meshes have the same hull if their extents differ by less than this in every direction [m].
A simplified collision mesh differs from the visible mesh by a few millimetres."""

# Unit vectors along the edges, face diagonals and space diagonals of a cube, shape (26, 3).
_GRID_POINTS = [point for point in product((-1.0, 0.0, 1.0), repeat=3) if point != (0.0, 0.0, 0.0)]
_DIRECTIONS = np.array(_GRID_POINTS)
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)

_FARTHEST = 10.0  # larger distances are not computed [m]; robots are smaller than this


class PosedShape(NamedTuple):
    """A convex shape and its pose in the frame of its body."""

    shape: Shape
    pose: RigidTransform


class Triangles(NamedTuple):
    """Triangles of a mesh, in the frame of its body."""

    vertices: Vector  # (n, 3) [m]
    faces: Faces  # (m, 3), three indices of vertices for each triangle


class PairOfBodies:
    """Distance between two bodies, each of which is a rigid set of convex shapes.

    The two bodies are copied to a scene graph of their own, so a query finds nothing else.
    """

    def __init__(self, first: list[PosedShape], second: list[PosedShape]) -> None:
        """Create the scene graph.

        Args:
            first: shapes of the first body.
            second: shapes of the second body.
        """
        self._scene = SceneGraph()
        self._source = self._scene.RegisterSource("parts")
        self._first_frame = self._add_body("first", first)
        self._second_frame = self._add_body("second", second)
        self._context = self._scene.CreateDefaultContext()

    def _add_body(self, name: str, shapes: list[PosedShape]) -> FrameId:
        """Add a frame with the shapes of one body, which do not collide with each other.

        Returns the frame.
        """
        frame = self._scene.RegisterFrame(self._source, GeometryFrame(name))
        registered = []
        for index, posed in enumerate(shapes):
            instance = GeometryInstance(posed.pose, posed.shape, f"part_{index}")
            # Drake only finds overlaps of shapes that have proximity properties; empty ones suffice.
            instance.set_proximity_properties(ProximityProperties())
            shape_id = self._scene.RegisterGeometry(self._source, frame, instance)
            registered.append(shape_id)
        not_with_each_other = CollisionFilterDeclaration()
        not_with_each_other.ExcludeWithin(GeometrySet(registered))
        self._scene.collision_filter_manager().Apply(not_with_each_other)
        return frame

    def distance(self, pose: RigidTransform) -> float:
        """Signed distance between the two bodies [m], at most 10 m.

        If no shapes overlap, it is the distance of the nearest two shapes. Otherwise it is minus
        the depth of the deepest overlap.

        Args:
            pose: pose of the second body in the frame of the first.
        """
        poses = FramePoseVector()
        poses.set_value(self._first_frame, RigidTransform())
        poses.set_value(self._second_frame, pose)
        port = self._scene.get_source_pose_port(self._source)
        port.FixValue(self._context, Value[FramePoseVector](poses))
        query: QueryObject = self._scene.get_query_output_port().Eval(self._context)

        overlaps = query.ComputePointPairPenetration()
        if overlaps:
            return -max(float(overlap.depth) for overlap in overlaps)
        near_pairs = query.ComputeSignedDistancePairwiseClosestPoints(_FARTHEST)
        distances = [float(pair.distance) for pair in near_pairs]
        return min(distances, default=_FARTHEST)


class FineShapes:
    """Distances between the shapes of a station, measured with convex parts of concave meshes.

    The parts come from the collision mesh itself if it is concave. The import of a robot keeps
    only the convex hulls of its collision meshes, though. For such a hull the parts come from the
    visible meshes of the link, provided that these have the same hull.
    """

    def __init__(self, station: StationPlant) -> None:
        """Create the object without cutting any mesh: a mesh is cut when a distance first needs it.

        Args:
            station: plant and scene graph of the station.
        """
        self._station = station
        # Results that are kept. None is a result, too: a shape without convex parts, a pair of two
        # such shapes, or a pair with a half-space. Recorded as None, it is not examined again.
        self._parts: dict[GeometryId, list[PosedShape] | None] = {}
        self._pairs: dict[tuple[GeometryId, GeometryId], PairOfBodies | None] = {}

    def distance(
        self,
        query: QueryObject,
        first: GeometryId,
        second: GeometryId,
    ) -> float | None:
        """Signed distance of two shapes [m], measured with their convex parts; negative if parts overlap.

        Returns None if neither shape has convex parts, or if one is a half-space. Drake's own
        distance, between the hulls, is then the best available.

        Args:
            query: Drake's query object of the station, which contains the poses of the shapes.
            first: one shape.
            second: the other shape.
        """
        inspector = query.inspector()
        # Making a pair takes a scene graph of its own, so that each pair is made once.
        if (first, second) not in self._pairs:
            self._pairs[first, second] = self._make_pair(inspector, first, second)
        pair = self._pairs[first, second]
        if pair is None:
            return None
        # The convex parts of a shape are given in the frame of its body.
        first_body = query.GetPoseInWorld(inspector.GetFrameId(first))
        second_body = query.GetPoseInWorld(inspector.GetFrameId(second))
        return pair.distance(first_body.inverse() @ second_body)

    def _make_pair(
        self,
        inspector: SceneGraphInspector,
        first: GeometryId,
        second: GeometryId,
    ) -> PairOfBodies | None:
        """Prepare the distance between the convex parts of two shapes.

        A shape without convex parts is used as it is. Returns None if neither shape has convex
        parts, or if one of the shapes is a half-space: the hull of a mesh reaches exactly as
        deep into a half-space as the mesh itself, so parts would not change the distance.
        """
        for shape in (first, second):
            if isinstance(inspector.GetShape(shape), HalfSpace):
                return None
        first_parts = self._parts_of(inspector, first)
        second_parts = self._parts_of(inspector, second)
        if first_parts is None and second_parts is None:
            return None
        if first_parts is None:
            first_parts = [_posed_shape(inspector, first)]
        if second_parts is None:
            second_parts = [_posed_shape(inspector, second)]
        return PairOfBodies(first_parts, second_parts)

    def _parts_of(
        self,
        inspector: SceneGraphInspector,
        shape: GeometryId,
    ) -> list[PosedShape] | None:
        """Convex parts of a shape, or None, as `_cut` returns them. They are kept after the first call."""
        if shape not in self._parts:
            self._parts[shape] = self._cut(inspector, shape)
        return self._parts[shape]

    def _cut(
        self,
        inspector: SceneGraphInspector,
        shape: GeometryId,
    ) -> list[PosedShape] | None:
        """Cut a shape into convex parts, given in the frame of its body.

        If the shape is the convex hull of the visible meshes of its body, these meshes are cut.

        Returns None if the shape is not a mesh, if the file of the mesh cannot be read, or if the
        mesh is convex and is not the hull of concave visible meshes.
        """
        if not isinstance(inspector.GetShape(shape), Mesh | Convex):
            return None
        try:
            triangles = triangles_of(inspector, shape)
            corners_of_parts = convex_parts_of(triangles)
            if len(corners_of_parts) == 1:
                # A convex mesh may be the hull that an import made of a concave mesh.
                visible = self._visible_triangles(inspector, shape)
                if visible is None or not have_same_hull(triangles, visible):
                    return None
                corners_of_parts = convex_parts_of(visible)
        except (UnreadableMesh, OSError):
            return None  # Drake was able to read the file, so its convex hull is used
        if len(corners_of_parts) == 1:
            return None
        # Drake expects the corners as columns. They are in the frame of the body already.
        shapes = [Convex(corners.T, "part") for corners in corners_of_parts]
        return [PosedShape(convex, RigidTransform()) for convex in shapes]

    def _visible_triangles(
        self,
        inspector: SceneGraphInspector,
        shape: GeometryId,
    ) -> Triangles | None:
        """Triangles of all visible meshes of the body that a collision shape belongs to.

        Returns None if the body has other collision shapes, no visible mesh, or a visible
        shape that is not a mesh.
        """
        plant = self._station.plant
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        if body is None or len(plant.GetCollisionGeometriesForBody(body)) > 1:
            return None  # several collision shapes are convex parts already
        visuals = plant.GetVisualGeometriesForBody(body)
        has_meshes_only = all(
            isinstance(inspector.GetShape(visual), Mesh | Convex) for visual in visuals
        )
        if not visuals or not has_meshes_only:
            return None

        # Join the meshes. The vertices of a mesh are moved behind those of the meshes before it,
        # so the indices in its faces grow by the count of vertices before it.
        vertices = []
        faces = []
        vertex_count = 0
        for visual in visuals:
            mesh = triangles_of(inspector, visual)
            vertices.append(mesh.vertices)
            faces.append(mesh.faces + vertex_count)
            vertex_count += len(mesh.vertices)
        return Triangles(np.concatenate(vertices), np.concatenate(faces))


def triangles_of(inspector: SceneGraphInspector, shape: GeometryId) -> Triangles:
    """Read the triangles of a mesh in the frame of its body.

    Args:
        inspector: of the scene graph that contains the mesh.
        shape: a collision or visual geometry that is a mesh.

    Raises:
        UnreadableMesh: the mesh has no file, or the file is too large, damaged, in a format that is not read, or
            contains no triangles.
        OSError: the file does not exist any more.
    """
    mesh = inspector.GetShape(shape)
    if not mesh.source().is_path():
        raise UnreadableMesh(message("stations.in_memory_only", "is in memory only"))
    file = read_mesh(Path(mesh.source().path()), {})
    # All parts of the file as one mesh, without colours, equal vertices and faces without an area.
    part = clean(combine_without_look(file.parts))
    # The file's vertices are scaled, then moved from the frame of the shape to that of the body.
    pose_in_body = inspector.GetPoseInFrame(shape)
    scaled = part.vertices * mesh.scale3()
    vertices = np.asarray((pose_in_body @ scaled.T).T)
    return Triangles(vertices, part.faces)


def convex_parts_of(triangles: Triangles) -> list[Vector]:
    """Cut a mesh into convex parts, and return the corners (k, 3) of each part [m].

    A convex mesh gives a single part. Corners are in the frame of the mesh. Results are kept in a cache on the disk.

    Raises:
        UnreadableMesh: the mesh is flat, or too small.
    """
    return cached_convex_parts(triangles.vertices, triangles.faces)


def have_same_hull(first: Triangles, second: Triangles) -> bool:
    """Whether the convex hulls of two meshes extend equally far, up to 5 mm, in 26 directions."""
    # The farthest that a mesh extends from the origin in each direction, shape (26,) [m].
    first_extents = (first.vertices @ _DIRECTIONS.T).max(axis=0)
    second_extents = (second.vertices @ _DIRECTIONS.T).max(axis=0)
    differences = np.abs(first_extents - second_extents)
    return bool((differences < _SAME_HULL).all())


def _posed_shape(inspector: SceneGraphInspector, shape: GeometryId) -> PosedShape:
    """Make a posed shape of a shape in a scene graph, which must be convex for Drake."""
    return PosedShape(inspector.GetShape(shape), inspector.GetPoseInFrame(shape))
