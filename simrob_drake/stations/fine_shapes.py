"""Distances between bodies whose meshes are concave: convex parts instead of hulls.

Drake takes the convex hull of a mesh, which closes its holes and fills its bends. Where
two hulls overlap, the convex parts of the meshes tell whether the meshes do.
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

_DIRECTIONS = np.array([way for way in product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)

_FARTHEST = 10.0  # m; robots are smaller, so no distance of interest is larger


class PosedShape(NamedTuple):
    """A convex shape at a pose in the frame of its body."""

    shape: Shape
    pose: RigidTransform


class Triangles(NamedTuple):
    """Triangles of a mesh in the frame of its body."""

    vertices: Vector  # (n, 3) [m]
    faces: Faces  # (m, 3), indices of vertices


class FineShapes:
    """Convex parts of the shapes of a station.

    A mesh's parts are those of its own file. An imported robot has only the hulls of its
    collision meshes: there the link's visible meshes are cut, if they have the same hull.
    """

    def __init__(self, station: StationPlant) -> None:
        """Start without any parts: they are made when two hulls overlap."""
        self._station = station
        self._parts: dict[GeometryId, list[PosedShape] | None] = {}
        self._pairs: dict[tuple[GeometryId, GeometryId], PairOfBodies | None] = {}

    def distance(self, query: QueryObject, first: GeometryId, second: GeometryId) -> float | None:
        """Signed distance of two shapes by their convex parts [m].

        Returns None if neither shape has parts: their hulls are all that is known.
        """
        key = first, second
        if key not in self._pairs:
            self._pairs[key] = self._pair(query.inspector(), first, second)
        pair = self._pairs[key]
        if pair is None:
            return None
        inspector = query.inspector()
        poses = [query.GetPoseInWorld(inspector.GetFrameId(shape)) for shape in key]
        return pair.distance(poses[0].inverse() @ poses[1])

    def _pair(self, inspector: SceneGraphInspector, first: GeometryId, second: GeometryId) -> "PairOfBodies | None":
        """Return the parts of two shapes for queries; None if neither has any."""
        shapes = [inspector.GetShape(shape) for shape in (first, second)]
        if any(isinstance(shape, HalfSpace) for shape in shapes):
            return None  # a hull is as deep in a half-space as its mesh
        fine = [self._parts_of(inspector, shape) for shape in (first, second)]
        if fine == [None, None]:
            return None
        sides = []
        for shape, parts in zip((first, second), fine, strict=True):
            own = PosedShape(inspector.GetShape(shape), inspector.GetPoseInFrame(shape))
            sides.append([own] if parts is None else parts)
        return PairOfBodies(sides[0], sides[1])

    def _parts_of(self, inspector: SceneGraphInspector, shape: GeometryId) -> list[PosedShape] | None:
        """Return the convex parts of a shape in its body's frame; None if it has none."""
        if shape not in self._parts:
            self._parts[shape] = self._made_parts(inspector, shape)
        return self._parts[shape]

    def _made_parts(self, inspector: SceneGraphInspector, shape: GeometryId) -> list[PosedShape] | None:
        """Cut a mesh into convex parts; None if it is no mesh, or convex."""
        if not isinstance(inspector.GetShape(shape), Mesh | Convex):
            return None
        try:
            own = triangles_of(inspector, shape)
            corners = convex_parts_of(own)
            if len(corners) == 1:
                visible = self._visible_triangles(inspector, shape)
                if visible is None or not have_same_hull(own, visible):
                    return None
                corners = convex_parts_of(visible)
        except (UnreadableMesh, OSError):
            return None  # Drake has read the file, so its hull stays
        if len(corners) == 1:
            return None
        origin = RigidTransform()
        return [PosedShape(Convex(part.T, "part"), origin) for part in corners]

    def _visible_triangles(self, inspector: SceneGraphInspector, shape: GeometryId) -> Triangles | None:
        """Return the visible meshes of a link whose only collision shape this is."""
        plant = self._station.plant
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        if body is None or len(plant.GetCollisionGeometriesForBody(body)) > 1:
            return None  # several meshes are convex parts already
        visuals = plant.GetVisualGeometriesForBody(body)
        shapes = [inspector.GetShape(visual) for visual in visuals]
        if not shapes or not all(isinstance(each, Mesh | Convex) for each in shapes):
            return None
        found = [triangles_of(inspector, visual) for visual in visuals]
        offsets = np.cumsum([0, *(len(each.vertices) for each in found)])
        faces = [each.faces + offset for each, offset in zip(found, offsets[:-1], strict=True)]
        vertices = [each.vertices for each in found]
        return Triangles(np.concatenate(vertices), np.concatenate(faces))


def triangles_of(inspector: SceneGraphInspector, shape: GeometryId) -> Triangles:
    """Read the triangles of a mesh in the frame of its body.

    Raises:
        UnreadableMesh: the mesh is in memory only, or its file holds no triangles.
        OSError: its file is gone.
    """
    mesh = inspector.GetShape(shape)
    if not mesh.source().is_path():
        raise UnreadableMesh("is in memory only")
    part = mend(plain(read_mesh(Path(mesh.source().path()), {}).parts))
    pose = inspector.GetPoseInFrame(shape)
    vertices = np.asarray((pose @ (part.vertices * mesh.scale3()).T).T)
    return Triangles(vertices, part.faces)


def convex_parts_of(triangles: Triangles) -> list[Vector]:
    """Cut triangles into convex parts: the corners (k, 3) of each [m]."""
    return cached_convex_parts(triangles.vertices, triangles.faces)


def have_same_hull(one: Triangles, other: Triangles) -> bool:
    """Whether the hulls of two meshes reach equally far in every direction."""
    reaches = [(each.vertices @ _DIRECTIONS.T).max(axis=0) for each in (one, other)]
    return bool((np.abs(reaches[0] - reaches[1]) < _SAME_HULL).all())


class PairOfBodies:
    """Two rigid sets of convex shapes, for distances between the sets."""

    def __init__(self, first: list[PosedShape], second: list[PosedShape]) -> None:
        """Put each set on a frame of a scene graph of their own."""
        self._scene = SceneGraph()
        self._source = self._scene.RegisterSource("parts")
        self._frames = [self._add_frame(side) for side in (first, second)]
        self._context = self._scene.CreateDefaultContext()

    def _add_frame(self, shapes: list[PosedShape]) -> FrameId:
        """Register a frame with shapes that ignore each other."""
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
        """Signed distance of the nearest, or deepest, two shapes [m].

        Args:
            pose: pose of the second set in the frame of the first.
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
