"""The shapes of a station's plant, as MJCF has them: those that touch, and those that are only seen."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    Mesh,
    Rgba,
    Role,
    Shape,
    Sphere,
)

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationPlant
from simrob_drake.parts.targets import own_name
from simrob_drake.stations.mujoco.names import Names, free_name

_SEEN = 1  # the group of shapes that are only seen, as viewers of MuJoCo have them; those that touch are of group 3
_TOUCHES = 3
_TRIANGLES = (".obj", ".stl")


def add_shapes(spec: mujoco.MjSpec, station: StationPlant, names: Names, *, seen: bool) -> dict[GeometryId, str]:
    """Add the shapes that touch others, and with ``seen`` the pictures of all bodies too.

    None of them touches by itself: which pairs do is for whoever adds contacts.

    Returns:
        the names of the shapes that can touch.

    Raises:
        InvalidParameter: a shape that MJCF does not know.
    """
    inspector, known = station.scene_graph.model_inspector(), dict[GeometryId, str]()
    for shape in _touching(station):
        known[shape] = free_name(own_name(inspector, shape), known.values())
        _add_geom(spec, station, names, shape, name=known[shape], group=_TOUCHES, rgba=[0.6, 0.6, 0.6, 0.5])
    for shape in inspector.GetAllGeometryIds(Role.kIllustration) if seen else ():
        file = _file(inspector.GetShape(shape))
        if file is None or file.suffix.lower() in _TRIANGLES:
            look = inspector.GetIllustrationProperties(shape)
            colour = look.GetPropertyOrDefault("phong", "diffuse", Rgba(0.7, 0.7, 0.7, 1.0))
            rgba = [colour.r(), colour.g(), colour.b(), colour.a()]
            _add_geom(spec, station, names, shape, name="", group=_SEEN, rgba=rgba)
    return known


def _touching(station: StationPlant) -> list[GeometryId]:
    """Return the shapes of the pairs that may touch, in the order in which they were made."""
    inspector = station.scene_graph.model_inspector()
    paired = {shape for pair in touching_pairs(station) for shape in pair}
    return [shape for shape in inspector.GetAllGeometryIds(Role.kProximity) if shape in paired]


def touching_pairs(station: StationPlant) -> list[tuple[GeometryId, GeometryId]]:
    """Return the pairs of shapes that may touch, by their numbers: one of two at least is moved."""
    inspector, plant = station.scene_graph.model_inspector(), station.plant

    def moves(shape: GeometryId) -> bool:
        return not plant.IsAnchored(plant.GetBodyFromFrameId(inspector.GetFrameId(shape)))

    pairs = [tuple(sorted(pair, key=GeometryId.get_value)) for pair in inspector.GetCollisionCandidates()]
    return sorted((pair for pair in pairs if any(map(moves, pair))), key=lambda pair: [s.get_value() for s in pair])


def _add_geom(
    spec: mujoco.MjSpec,
    station: StationPlant,
    names: Names,
    shape: GeometryId,
    *,
    name: str,
    group: int,
    rgba: list[float],
) -> None:
    inspector = station.scene_graph.model_inspector()
    body = station.plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
    onto = spec.worldbody if body is station.plant.world_body() else spec.body(names.body(body))
    pose, form = inspector.GetPoseInFrame(shape), inspector.GetShape(shape)
    geom = onto.add_geom(name=name, group=group, rgba=rgba, contype=0, conaffinity=0, mass=0)
    geom.pos, geom.quat = pose.translation(), pose.rotation().ToQuaternion().wxyz()
    if (file := _file(form)) is not None:
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, _mesh(spec, file, form.scale3())
        return
    geom.type, size = _primitive(form)
    geom.size = np.resize([*size, 0.0, 0.0], 3)


def _file(shape: Shape) -> Path | None:
    """Return the file of a mesh; None of other shapes."""
    return Path(shape.source().path()) if isinstance(shape, Mesh | Convex) and shape.source().is_path() else None


def _mesh(spec: mujoco.MjSpec, file: Path, scale: Vector) -> str:
    """Return the name of a mesh of a size, and add it where it is not known."""
    same = [mesh for mesh in spec.meshes if mesh.file == str(file)]
    for mesh in same:
        if np.array_equal(mesh.scale, scale):
            return str(mesh.name)
    name = free_name(file.stem, [mesh.name for mesh in spec.meshes])
    spec.add_mesh(name=name, file=str(file), scale=scale)
    return name


def _primitive(shape: Shape) -> tuple[mujoco.mjtGeom, list[float]]:
    """Return MuJoCo's type and size of a shape.

    Raises:
        InvalidParameter: it has none.
    """
    kinds = mujoco.mjtGeom
    match shape:
        case Sphere():
            return kinds.mjGEOM_SPHERE, [shape.radius()]
        case Box():
            return kinds.mjGEOM_BOX, [shape.width() / 2, shape.depth() / 2, shape.height() / 2]
        case Cylinder():
            return kinds.mjGEOM_CYLINDER, [shape.radius(), shape.length() / 2]
        case Capsule():
            return kinds.mjGEOM_CAPSULE, [shape.radius(), shape.length() / 2]
        case Ellipsoid():
            return kinds.mjGEOM_ELLIPSOID, [shape.a(), shape.b(), shape.c()]
        case HalfSpace():
            return kinds.mjGEOM_PLANE, [0.0, 0.0, 1.0]
    raise InvalidParameter("a shape", type(shape).__name__, "a sphere, box, cylinder, capsule, ellipsoid or mesh")
