"""Meshes cut into convex parts: they enclose the mesh, and lie closer than its hull."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from simrob_drake.importer.meshes.convex_parts import (
    MOST_PARTS,
    cached_convex_parts,
    convex_parts,
)

RING = trimesh.creation.annulus(0.08, 0.1, 0.2)
ANGLE = trimesh.util.concatenate(
    [
        trimesh.creation.box((0.3, 0.05, 0.05)),
        trimesh.creation.box(
            (0.05, 0.05, 0.3), trimesh.transformations.translation_matrix([0.125, 0, 0.175])
        ),
    ]
)
BOX = trimesh.creation.box((1.0, 0.1, 0.1))


def parts_of(mesh: trimesh.Trimesh) -> list[np.ndarray]:
    return convex_parts(np.asarray(mesh.vertices), np.asarray(mesh.faces))


@pytest.mark.parametrize("mesh", [RING, ANGLE, BOX])
def test_parts_enclose_the_mesh(mesh):
    points, _ = trimesh.sample.sample_surface(mesh, 2000, seed=0)
    outside = np.full(len(points), np.inf)

    for corners in parts_of(mesh):
        planes = ConvexHull(corners).equations
        heights = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        outside = np.minimum(outside, heights)

    # Vertices are rounded to a millimetre, so by up to half of it in each direction.
    assert outside.max() < 0.5e-3 * np.sqrt(3)


@pytest.mark.parametrize(("mesh", "excess"), [(RING, 0.25), (ANGLE, 0.02), (BOX, 0.001)])
def test_parts_have_little_more_volume_than_the_mesh(mesh, excess):
    """The hull of the ring has 2.8 times its volume, that of the angle about 4 times."""
    parts = parts_of(mesh)
    volume = sum(ConvexHull(corners).volume for corners in parts)

    solid = mesh.volume
    assert solid * 0.99 < volume < solid * (1 + excess)
    assert len(parts) <= MOST_PARTS


def test_a_convex_mesh_stays_whole():
    assert len(parts_of(BOX)) == 1
    assert len(parts_of(trimesh.creation.icosphere(radius=0.1))) == 1


def test_the_cache_has_the_same_numbers():
    vertices = np.asarray(ANGLE.vertices)
    faces = np.asarray(ANGLE.faces)
    first = cached_convex_parts(vertices, faces)

    again = cached_convex_parts(vertices, faces)

    assert len(first) == len(again) > 1
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)
