"""The looks of the legged robots: no shards of one colour in a face of another."""

import itertools

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Mesh, Role
from scipy.spatial import cKDTree

from simrob_drake import load_station
from simrob_drake.results.animation.scene import ViewedStation

SPACING = 0.001  # m between the points that stand for a surface
SAME = 0.00015  # m: faces that are nearer than this flicker


def surfaces(station):
    """Return points, normals and colour of every visible mesh of a station in its initial posture."""
    scene = ViewedStation(load_station(station))
    query = scene.query()
    inspector = query.inspector()
    for geometry in inspector.GetAllGeometryIds(Role.kIllustration):
        shape = inspector.GetShape(geometry)
        if isinstance(shape, Mesh):
            mesh = trimesh.load(str(shape.source().path()), force="mesh")
            mesh.apply_transform(
                query.GetPoseInWorld(geometry).GetAsMatrix4() @ np.diag([*shape.scale3(), 1.0])
            )
            points, faces = trimesh.sample.sample_surface(mesh, int(mesh.area / SPACING**2), seed=1)
            colour = inspector.GetIllustrationProperties(geometry).GetProperty("phong", "diffuse")
            yield points, mesh.face_normals[faces], colour.rgba.tolist()


def shared(first, second):
    """Return how many points of one surface lie in a face of the other that looks to the same side."""
    (points, normals, _), (others, facing, _) = first, second
    close = ((points > others.min(axis=0) - SAME) & (points < others.max(axis=0) + SAME)).all(
        axis=1
    )
    if not close.any():
        return 0
    points, normals = points[close], normals[close]
    near, at = cKDTree(others).query(points, distance_upper_bound=1.5 * SPACING)
    found = np.isfinite(near)
    apart = np.abs(((others[at[found]] - points[found]) * normals[found]).sum(axis=1))
    return int(((apart < SAME) & ((facing[at[found]] * normals[found]).sum(axis=1) > 0.998)).sum())


@pytest.mark.long
@pytest.mark.parametrize("robot", ["humanoid", "roid1", "zjudancer", "yobotics"])
def test_no_faces_of_two_colours_share_a_plane(robot):
    pairs = itertools.combinations(surfaces(f"{robot}_dynamic"), 2)
    assert max(shared(first, second) for first, second in pairs if first[2] != second[2]) < 10
