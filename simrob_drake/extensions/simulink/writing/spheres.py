"""The spheres with which solids of robots touch: in corners, on rims, on the convex hulls of meshes."""

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics.shapes import load_mesh
from simrob_drake.extensions.simulink.mechanics.solids import SolidBody
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.hulls import hull_of

if TYPE_CHECKING:
    from trimesh import Trimesh

POINT = 1e-3  # m: radius of a sphere that stands for a point
_RIM = 8  # spheres on each rim of a cylinder
_CORNERS, _ROUND = (
    40,
    0.05,
)  # of a mesh that touch at most, and by what part of its radius a ball may be off
_FLAT = 1e-3  # part of its size by which the corners of a side may be off
_SMALL = 10  # radii of these spheres in the thickness of a mesh


class Spheres(NamedTuple):
    """The spheres that a solid touches with."""

    middles: list[Vector]
    radius: float
    share: int  # how many of them carry it
    what: str  # what they stand for


def spheres_of(solid: SolidBody) -> Spheres:
    """Return the spheres that a solid touches with; raises UnreadableMesh: it has no shape that is known."""
    shape = solid.shape
    if shape is None or shape.kind == "mesh":
        return _mesh_spheres(solid)
    if shape.kind == "sphere":
        return Spheres([np.zeros(3)], shape.size[0], 1, "sphere")
    if shape.kind == "cylinder":  # rims: it stands on eight, and lies and rolls on few
        reach, end = shape.size[0], shape.size[1] / 2
        flat = end < reach / 10  # a disk, of one rim
        radius = end if flat else min(reach, end) / 5
        turns = 2 * np.pi * np.arange(_RIM) / _RIM
        rim = (reach - radius) * np.column_stack([np.cos(turns), np.sin(turns)])
        levels = (0.0,) if flat else (radius - end, end - radius)
        return Spheres(
            [np.array([x, y, z]) for z in levels for x, y in rim], radius, _RIM, "cylinder"
        )
    half = np.array(shape.size) / 2
    radius = float(half.min() / 5)
    corners = [np.array(signs) * (half - radius) for signs in product((-1, 1), repeat=3)]
    return Spheres(corners, radius, 4, "box")


def _mesh_spheres(solid: SolidBody) -> Spheres:
    """Return the corners of a mesh's convex hull as spheres, or one sphere of a mesh that is nearly a ball.

    As many of them carry it as there are on the hull's largest side.
    """
    from trimesh import Trimesh

    if solid.shape is not None and solid.shape.mesh is not None:
        points = solid.shape.mesh.vertices
    elif solid.file is not None:
        points = solid.scale * load_mesh(solid.file).vertices
    else:
        raise UnreadableMesh(message("simulink.mesh_not_found", "its mesh was not found"))
    hull = hull_of(points).part
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    surface = Trimesh(hull.vertices, hull.faces, process=False)
    reach = float(np.linalg.norm(hull.vertices - middle, axis=1).max())
    depths = np.sum(surface.face_normals * (surface.triangles[:, 0] - middle), axis=1)
    if depths.min() > (1 - _ROUND) * reach:
        return Spheres([middle], reach, 1, "sphere")
    sides = surface.facets or [[face] for face in range(len(hull.faces))]
    largest = max(sides, key=lambda side: float(surface.area_faces[side].sum()))[0]
    radius = float(surface.extents.min() / _SMALL)
    taken = far_apart(hull.vertices, _CORNERS)
    above = (hull.vertices[taken] - surface.triangles[largest, 0]) @ surface.face_normals[largest]
    carrying = int(np.count_nonzero(np.abs(above) < _FLAT * reach))
    middles = [hull.vertices[corner] - radius * _outward(surface, corner) for corner in taken]
    return Spheres(middles, radius, max(carrying, 1), "mesh")


def _outward(surface: "Trimesh", corner: int) -> Vector:
    """Return the way out of a corner, shape (3,), at which all its faces are 1 away, or nearly so."""
    faces = surface.vertex_faces[corner]
    normals = surface.face_normals[faces[faces >= 0]]
    way = np.linalg.lstsq(normals, np.ones(len(normals)), rcond=1e-3)[0]
    return np.asarray(way * min(1.0, 3.0 / float(np.linalg.norm(way))))


def far_apart(points: Vector, most: int) -> list[int]:
    """Return which of points (n, 3) are farthest apart."""
    taken, away = [0], np.linalg.norm(points - points[0], axis=1)
    while len(taken) < min(most, len(points)) and away.max() > 0:
        taken.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[taken[-1]], axis=1))
    return taken
