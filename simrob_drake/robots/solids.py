"""Volume, centre of mass and moments of bodies that are filled evenly."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydrake.geometry import Convex, Mesh, ReadObjToTriangleSurfaceMesh
from pydrake.multibody.tree import CalcSpatialInertia, SpatialInertia

from simrob_drake.errors import InvalidModel
from simrob_drake.frames import Vector
from simrob_drake.robots.urdf import Solid

_NOTHING = 1e-12
"""Products of inertia smaller than this part of the largest moment are rounding."""


@dataclass(frozen=True)
class SolidInertia:
    """What follows from a body's form alone.

    Attributes:
        volume: [m³], positive.
        centre: of mass, shape (3,) [m].
        moments: about the centre, for a density of 1 kg/m³: Ixx Iyy Izz Ixy Ixz Iyz, shape (6,) [m⁵].
    """

    volume: float
    centre: Vector
    moments: Vector


def solid_inertia(solids: Sequence[Solid], *, closed: bool) -> SolidInertia:
    """Return the figures of bodies, at least one, as one; where two overlap, both count.

    Every mesh must enclose a volume if ``closed``; if not, one that doesn't counts as its convex hull.

    Raises:
        InvalidModel: a mesh that Drake cannot read, or that must enclose a volume and doesn't.
    """
    parts = [_spatial_inertia(solid, closed).ReExpress(solid.pose.rotation()) for solid in solids]
    volumes = np.array([part.get_mass() for part in parts])
    centres = np.array([s.pose.translation() + part.get_com() for s, part in zip(solids, parts, strict=True)])
    centre = volumes @ centres / volumes.sum()
    about_centre = [
        part.Shift(centre - solid.pose.translation()).CalcRotationalInertia().CopyToFullMatrix3()
        for solid, part in zip(solids, parts, strict=True)
    ]
    moments = np.sum(about_centre, axis=0)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return SolidInertia(float(volumes.sum()), centre, np.where(abs(moments) < _NOTHING * moments.max(), 0.0, moments))


def _spatial_inertia(solid: Solid, closed: bool) -> SpatialInertia:
    if isinstance(solid.shape, Path):
        return _mesh_inertia(solid.shape, solid.scale, closed, solid.shape.stat().st_mtime_ns)
    return CalcSpatialInertia(solid.shape, 1.0)


@lru_cache(maxsize=64)
def _mesh_inertia(file: Path, scale: float, closed: bool, changed: int) -> SpatialInertia:
    """Return the inertia of what a mesh encloses; ``changed`` makes a mesh that was written anew be read anew."""
    try:
        whole = _is_closed(file)
        if closed and not whole:
            problem = "is no OBJ that encloses a volume, so a density does not tell its mass; give the mass instead"
            raise InvalidModel(file, "", problem)
        return CalcSpatialInertia(Mesh(str(file), scale) if whole else Convex(str(file), scale), 1.0)
    except (RuntimeError, ValueError, SystemExit) as problem:  # failed assertions come as SystemExit
        if isinstance(problem, InvalidModel):
            raise
        raise InvalidModel(file, "", f"Drake cannot read it: {' '.join(str(problem).split())}") from problem


def _is_closed(file: Path) -> bool:
    """Return whether every edge of an OBJ mesh has a face on either side, and the faces look outwards."""
    if file.suffix.lower() != ".obj":
        return False
    surface = ReadObjToTriangleSurfaceMesh(str(file))
    faces = np.array([[face.vertex(corner) for corner in range(3)] for face in surface.triangles()])
    points = np.array(surface.vertices())
    if faces.max() >= len(points):  # a face of points that are not there, which Drake lets pass
        return False
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    a, b, c = points[faces.T]
    inside_out = np.einsum("ij,ij->", a, np.cross(b, c)) <= 0
    return not inside_out and np.array_equal(_sorted_rows(edges), _sorted_rows(edges[:, ::-1]))


def _sorted_rows(
    rows: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    return rows[np.lexsort(rows.T)]
