"""What a mesh collides with: convex, closed, never larger than the mesh, and with few corners."""

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.hulls import MOST_CORNERS, box_of, hull_of, is_hull
from simrob_drake.importer.meshes.parts import MeshPart

TURN = RigidTransform(RollPitchYaw(0.3, -0.7, 1.1), [0.5, -0.2, 0.9])


def surface(part: MeshPart) -> trimesh.Trimesh:
    return trimesh.Trimesh(part.vertices, part.faces, process=False)


@pytest.mark.parametrize(
    ("mesh", "least"),
    [
        (trimesh.creation.box((0.1, 0.2, 0.3)), 1.0),
        (trimesh.creation.box((0.1, 0.2, 0.3)).subdivide().subdivide(), 1.0),
        (trimesh.creation.cylinder(0.05, 0.2, sections=200), 0.99),
        (trimesh.creation.cylinder(0.0005, 0.2, sections=40), 0.99),  # a needle stays round
        (trimesh.creation.torus(0.2, 0.05, 100, 40), 0.94),
        (trimesh.creation.icosphere(subdivisions=4), 0.93),
    ],
    ids=["box", "fine box", "cylinder", "needle", "torus", "ball"],
)
def test_a_hull_is_convex_within_the_mesh_and_fills_it(mesh: trimesh.Trimesh, least: float) -> None:
    points = TURN.multiply(mesh.vertices.T).T
    whole, hull = trimesh.Trimesh(points, mesh.faces).convex_hull, hull_of(points)

    found = surface(hull.part)

    assert found.is_watertight
    assert found.is_winding_consistent
    assert is_hull(hull.part)
    assert len(hull.part.vertices) <= MOST_CORNERS
    assert len(hull.part.faces) <= 256
    assert least * 0.99999 <= found.volume / whole.volume <= 1.00001
    np.testing.assert_allclose(found.bounds, whole.bounds, atol=1e-9)
    normals, on_face = found.face_normals, found.triangles[:, 0]
    out = np.max(points @ normals.T - np.sum(normals * on_face, axis=1), axis=0).max()
    assert out == pytest.approx(hull.gap, abs=1e-8)  # the farthest point of the mesh over any face
    assert hull.thickened == 0


def test_the_corners_of_a_flat_sole_all_stay() -> None:
    sole = trimesh.creation.box((0.2, 0.1, 0.02)).subdivide().subdivide()
    hull = hull_of(sole.vertices)

    assert len(hull.part.vertices) == 8
    assert hull.gap == pytest.approx(0, abs=1e-12)


def test_a_flat_mesh_becomes_a_thin_body() -> None:
    sheet = np.array([[0, 0, 0], [0.4, 0, 0], [0.4, 0.3, 0], [0, 0.3, 0]], dtype=float)
    hull = hull_of(TURN.multiply(sheet.T).T)

    assert hull.thickened == pytest.approx(0.4e-4, rel=1e-3)  # a ten thousandth of its length
    assert surface(hull.part).volume == pytest.approx(0.12 * hull.thickened, rel=1e-3)

    size, pose, thickened = box_of(TURN.multiply(sheet.T).T)
    assert thickened == hull.thickened
    np.testing.assert_allclose(np.sort(size), [thickened, 0.3, 0.4], rtol=1e-3)
    np.testing.assert_allclose(pose.translation(), TURN.multiply([0.2, 0.15, 0]), atol=1e-8)


def test_points_at_one_place_have_no_hull() -> None:
    with pytest.raises(UnreadableMesh, match="too thin or too small"):
        hull_of(np.zeros((8, 3)))


def test_a_box_stands_along_the_axes_where_that_costs_nothing() -> None:
    size, pose, _ = box_of(trimesh.creation.box(bounds=[[1, 2, 3], [1.5, 3, 5]]).vertices)
    np.testing.assert_allclose(size, [0.5, 1, 2])
    np.testing.assert_allclose(pose.GetAsMatrix4(), RigidTransform([1.25, 2.5, 4]).GetAsMatrix4())


def test_a_box_is_the_tightest_one() -> None:
    points = TURN.multiply(trimesh.creation.box((0.1, 0.2, 0.4)).vertices.T).T
    size, pose, _ = box_of(points)

    np.testing.assert_allclose(np.sort(size), [0.1, 0.2, 0.4], atol=1e-8)

    inside = pose.inverse().multiply(points.T).T
    np.testing.assert_allclose(abs(inside), np.tile(size / 2, (8, 1)), atol=1e-8)


def test_open_inverted_concave_or_fine_meshes_are_no_hulls() -> None:
    box = trimesh.creation.box((1, 1, 1))
    dented = trimesh.creation.icosphere(subdivisions=1)
    dented.vertices[0] *= 0.5

    fine = trimesh.creation.icosphere(subdivisions=4)

    for vertices, faces in (
        (box.vertices, box.faces[1:]),
        (box.vertices, box.faces[:, ::-1]),
        (dented.vertices, dented.faces),
        (fine.vertices, fine.faces),
    ):
        assert not is_hull(MeshPart(np.array(vertices), np.array(faces)))
    assert is_hull(MeshPart(np.array(box.vertices), np.array(box.faces)))
