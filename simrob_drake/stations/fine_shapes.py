"""Distances between concave meshes, computed with convex parts instead of convex hulls.

For collisions, Drake replaces a mesh by its convex hull, which fills holes and bends. If two
hulls overlap, the convex parts of the meshes show whether the meshes overlap too.
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

from simrob_drake.frames import Vector
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.convex_parts import cached_convex_parts
from simrob_drake.importer.meshes.parts import Faces, mend, plain
from simrob_drake.importer.meshes.reading import read_mesh
from simrob_drake.parts.site import StationPlant

_SAME_HULL = 5e-3
"""A link's visible meshes stand for its collision mesh if their hulls differ by less [m]
in every direction; a simplified collision mesh differs by a few millimetres."""

# Unit vectors along the edges, face diagonals and space diagonals of a cube, shape (26, 3).
_DIRECTIONS = np.array([direction for direction in product((-1.0, 0.0, 1.0), repeat=3) if any(direction)])
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)

_FARTHEST = 10.0  # larger distances are not computed [m]; robots are smaller than this


class PosedShape(NamedTuple):
    """A convex shape at a pose in the frame of its body."""

    shape: Shape
    pose: RigidTransform


class Triangles(NamedTuple):
    """Triangles of a mesh in the frame of its body."""

    vertices: Vector  # (n, 3) [m]
    faces: Faces  # (m, 3), indices of vertices


class FineShapes:
    """Convex parts of the concave collision meshes of a station.

    A concave collision mesh is cut into convex parts. The import of a robot keeps only the
    convex hulls of its collision meshes. For such a hull, the visible meshes of the link are
    cut instead, if they have the same hull.
    """

    def __init__(self, station: StationPlant) -> None:
        """Prepare the parts of a station's meshes; a mesh is cut when its hull first overlaps another shape."""
        self._station = station
        # Both are filled on demand. A shape without convex parts, and a pair of two such shapes,
        # is recorded as None, so that it is examined only once.
        self._parts: dict[GeometryId, list[PosedShape] | None] = {}
        self._pairs: dict[tuple[GeometryId, GeometryId], PairOfBodies | None] = {}

    def distance(self, query: QueryObject, first: GeometryId, second: GeometryId) -> float | None:
        """Signed distance of two shapes [m], measured with their convex parts.

        Returns None if neither shape has convex parts. Drake's own distance, between the
        hulls, is then the best available.
        """
        key = first, second
        if key not in self._pairs:
            self._pairs[key] = self._pair(query.inspector(), first, second)
        pair = self._pairs[key]
        if pair is None:
            return None
        inspector = query.inspector()
        # Poses of the bodies: the parts of a shape are given in the frame of its body.
        poses = [query.GetPoseInWorld(inspector.GetFrameId(shape)) for shape in key]
        return pair.distance(poses[0].inverse() @ poses[1])

    def _pair(self, inspector: SceneGraphInspector, first: GeometryId, second: GeometryId) -> "PairOfBodies | None":
        """Prepare distance queries between the convex parts of two shapes.

        A shape without parts is used as a whole. Returns None if neither shape has parts.
        """
        shapes = [inspector.GetShape(shape) for shape in (first, second)]
        if any(isinstance(shape, HalfSpace) for shape in shapes):
            return None  # a convex hull reaches exactly as deep into a half-space as its mesh
        fine = [self._parts_of(inspector, shape) for shape in (first, second)]
        if fine == [None, None]:
            return None
        sides = []
        for shape, parts in zip((first, second), fine, strict=True):
            whole = PosedShape(inspector.GetShape(shape), inspector.GetPoseInFrame(shape))
            sides.append([whole] if parts is None else parts)
        return PairOfBodies(sides[0], sides[1])

    def _parts_of(self, inspector: SceneGraphInspector, shape: GeometryId) -> list[PosedShape] | None:
        """Convex parts of a shape in the frame of its body, made on first use; None if the shape is convex."""
        if shape not in self._parts:
            self._parts[shape] = self._cut(inspector, shape)
        return self._parts[shape]

    def _cut(self, inspector: SceneGraphInspector, shape: GeometryId) -> list[PosedShape] | None:
        """Cut a shape into convex parts, given in the frame of its body.

        Returns None if the shape is no mesh, if the mesh is convex, or if its file cannot be
        read.
        """
        if not isinstance(inspector.GetShape(shape), Mesh | Convex):
            return None
        try:
            own = triangles_of(inspector, shape)
            corners = convex_parts_of(own)
            if len(corners) == 1:
                # A convex mesh may be the hull that an import made of a concave mesh.
                visible = self._visible_triangles(inspector, shape)
                if visible is None or not have_same_hull(own, visible):
                    return None
                corners = convex_parts_of(visible)
        except (UnreadableMesh, OSError):
            return None  # Drake was able to read the file, so its convex hull is used
        if len(corners) == 1:
            return None
        origin = RigidTransform()
        return [PosedShape(Convex(part.T, "part"), origin) for part in corners]

    def _visible_triangles(self, inspector: SceneGraphInspector, shape: GeometryId) -> Triangles | None:
        """Triangles of all visible meshes of the link that a collision shape belongs to.

        Returns None if the link has other collision shapes, no visible mesh, or a visible
        shape that is no mesh.
        """
        plant = self._station.plant
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        if body is None or len(plant.GetCollisionGeometriesForBody(body)) > 1:
            return None  # several collision shapes are convex parts already
        visuals = plant.GetVisualGeometriesForBody(body)
        shapes = [inspector.GetShape(visual) for visual in visuals]
        if not shapes or not all(isinstance(each, Mesh | Convex) for each in shapes):
            return None
        meshes = [triangles_of(inspector, visual) for visual in visuals]
        # The vertices are joined into one array, so the indices of each mesh are shifted.
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets[:-1], strict=True)]
        vertices = [mesh.vertices for mesh in meshes]
        return Triangles(np.concatenate(vertices), np.concatenate(faces))


def triangles_of(inspector: SceneGraphInspector, shape: GeometryId) -> Triangles:
    """Read the triangles of a mesh in the frame of its body.

    Raises:
        UnreadableMesh: the mesh has no file, or the file contains no triangles.
        OSError: the file does not exist any more.
    """
    mesh = inspector.GetShape(shape)
    if not mesh.source().is_path():
        raise UnreadableMesh("is in memory only")
    part = mend(plain(read_mesh(Path(mesh.source().path()), {}).parts))
    pose = inspector.GetPoseInFrame(shape)
    vertices = np.asarray((pose @ (part.vertices * mesh.scale3()).T).T)
    return Triangles(vertices, part.faces)


def convex_parts_of(triangles: Triangles) -> list[Vector]:
    """Cut a mesh into convex parts. Returns the corners (k, 3) of each part [m]."""
    return cached_convex_parts(triangles.vertices, triangles.faces)


def have_same_hull(one: Triangles, other: Triangles) -> bool:
    """Whether the convex hulls of two meshes reach equally far in 26 directions, up to a few millimetres."""
    reaches = [(each.vertices @ _DIRECTIONS.T).max(axis=0) for each in (one, other)]
    return bool((np.abs(reaches[0] - reaches[1]) < _SAME_HULL).all())


class PairOfBodies:
    """Two bodies, each a rigid set of convex shapes, for distance queries between the bodies."""

    def __init__(self, first: list[PosedShape], second: list[PosedShape]) -> None:
        """Create a scene graph that contains only the two bodies, each with a frame of its own."""
        self._scene = SceneGraph()
        self._source = self._scene.RegisterSource("parts")
        self._frames = [self._add_frame(side) for side in (first, second)]
        self._context = self._scene.CreateDefaultContext()

    def _add_frame(self, shapes: list[PosedShape]) -> FrameId:
        """Register a frame with the shapes of one body; the shapes do not collide with each other."""
        frame = GeometryFrame(f"frame_{self._scene.model_inspector().num_frames()}")
        frame_id = self._scene.RegisterFrame(self._source, frame)
        ids = []
        for number, (shape, pose) in enumerate(shapes):
            instance = GeometryInstance(pose, shape, f"part_{number}")
            instance.set_proximity_properties(ProximityProperties())
            registered = self._scene.RegisterGeometry(self._source, frame_id, instance)
            ids.append(registered)
        filters = self._scene.collision_filter_manager()
        filters.Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet(ids)))
        return frame_id

    def distance(self, pose: RigidTransform) -> float:
        """Signed distance between the two bodies [m].

        It is the distance of the nearest two shapes, or minus the depth of the deepest
        overlap. It is at most 10 m.

        Args:
            pose: pose of the second body in the frame of the first.
        """
        poses = FramePoseVector()
        poses.set_value(self._frames[0], RigidTransform())
        poses.set_value(self._frames[1], pose)
        port = self._scene.get_source_pose_port(self._source)
        port.FixValue(self._context, Value[FramePoseVector](poses))
        query = self._scene.get_query_output_port().Eval(self._context)
        penetrations = query.ComputePointPairPenetration()
        if penetrations:
            return -max(float(pair.depth) for pair in penetrations)
        near = query.ComputeSignedDistancePairwiseClosestPoints(_FARTHEST)
        return min((float(pair.distance) for pair in near), default=_FARTHEST)
