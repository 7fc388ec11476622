"""Pieces: rigid bodies with mass, tool centre point and shapes."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Box, Cylinder, Mesh, SceneGraph, Sphere
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FrameIndex

from simrob_drake.base.errors import InvalidConfig, InvalidModel, UnknownName
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.base.sections import validate_section
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.pieces import (
    PieceModel,
    described_piece,
    piece_file,
    piece_names,
    piece_robot,
    with_changes,
    with_mass_properties,
)
from tests.robots.known_pieces import load_piece

POSE = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)


def piece(**figures: Any) -> PieceModel:
    return validate_section(PieceModel, {"folder": Path(), **figures}, "piece.yaml")


def plant_with(model: PieceModel, *, collision: bool = False) -> tuple[MultibodyPlant, SceneGraph]:
    """Return a plant with a piece that stands alone, at POSE, and the scene graph of its shapes."""
    plant, scene_graph = MultibodyPlant(0.0), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    instance = add_urdf(
        plant, piece_robot("tool", model), name="tool", where="piece", collision=collision
    )
    plant.WeldFrames(
        plant.world_frame(), plant.GetFrameByName("tool", instance), transform_from_pose(POSE)
    )
    plant.Finalize()
    return plant, scene_graph


@pytest.mark.parametrize("name", piece_names())
def test_every_piece_of_the_package_can_be_added(name: str) -> None:
    model = load_piece(name)
    plant, _ = plant_with(model, collision=True)

    body = plant.GetBodyByName("tool")

    assert body.default_mass() == pytest.approx(model.mass, rel=1e-12)
    assert (
        len(plant.GetVisualGeometriesForBody(body))
        == sum(shape.visible for shape in model.shapes)
        > 0
    )
    assert len(plant.GetCollisionGeometriesForBody(body)) == sum(
        shape.collides for shape in model.shapes
    )


@pytest.mark.parametrize(
    ("name", "inertia", "reach"),
    [("gripper", [1e-3, 1e-3, 1e-3], 0.070), ("pencil", [0, 0, 0], 0.148)],
)
def test_tool_and_load_have_the_figures_of_the_original(
    name: str, inertia: list[float], reach: float
) -> None:
    # script D30: 1 kg each, the pencil a point mass; centre of mass copied from link_6
    model = load_piece(name)

    assert model.mass == 1.0
    np.testing.assert_array_equal(model.inertia, inertia)
    np.testing.assert_array_equal(model.com, [-0.00706, -0.00017, -1.32e-6])
    np.testing.assert_array_equal(model.tcp, [0, 0, reach, 0, 0, 0])


def test_an_unknown_piece_brings_the_nearest_one() -> None:
    with pytest.raises(UnknownName, match="there is no piece 'griper'; did you mean 'gripper'"):
        load_piece("griper")


def test_the_tool_centre_point_is_the_pose_times_the_tcp() -> None:
    tcp = (0.0, 0.01, 0.07, 0.0, np.pi / 4, 0.0)
    plant, _ = plant_with(piece(tcp=tcp))
    expected = transform_from_pose(POSE) @ transform_from_pose(tcp)

    found = plant.GetFrameByName("tool_tcp").CalcPoseInWorld(plant.CreateDefaultContext())

    np.testing.assert_allclose(found.GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-14)


def test_moments_are_about_the_centre_of_mass() -> None:
    plant, _ = plant_with(piece(mass=2.0, com=(0.1, 0.0, 0.0), inertia=(0.01, 0.02, 0.03)))
    about_origin = plant.GetBodyByName("tool").default_rotational_inertia().CopyToFullMatrix3()
    np.testing.assert_allclose(
        np.diag(about_origin), [0.01, 0.02 + 2 * 0.1**2, 0.03 + 2 * 0.1**2], atol=1e-15
    )


def test_without_collision_only_visuals_are_added() -> None:
    plant, _ = plant_with(piece(shapes=[{"sphere": 0.1}]))
    body = plant.GetBodyByName("tool")

    assert len(plant.GetVisualGeometriesForBody(body)) == 1
    assert plant.GetCollisionGeometriesForBody(body) == []


def test_a_massless_piece_adds_no_mass() -> None:
    plant, _ = plant_with(piece(inertia=(0.1, 0.1, 0.1)))
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == 0.0


@pytest.mark.parametrize(
    ("shape", "kind"),
    [
        ({"box": [1, 2, 3]}, Box),
        ({"cylinder": [1, 2]}, Cylinder),
        ({"sphere": 1}, Sphere),
        ({"mesh": "a.obj"}, Mesh),
    ],
)
def test_each_kind_of_shape_is_the_one_of_drake(
    shape: dict[str, Any], kind: type, tmp_path: Path
) -> None:
    (tmp_path / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    )
    pose = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    plant, scene_graph = plant_with(piece(folder=tmp_path, shapes=[{**shape, "pose": pose}]))
    (geometry,) = plant.GetVisualGeometriesForBody(plant.GetBodyByName("tool"))

    inspector = scene_graph.model_inspector()

    assert isinstance(inspector.GetShape(geometry), kind)
    assert inspector.GetPoseInFrame(geometry).IsNearlyEqualTo(transform_from_pose(pose), 1e-12)


def test_a_piece_can_be_touched_with_the_friction_of_the_library() -> None:
    plant, scene_graph = plant_with(piece(shapes=[{"sphere": 0.1}]), collision=True)
    (geometry,) = plant.GetCollisionGeometriesForBody(plant.GetBodyByName("tool"))

    friction = (
        scene_graph.model_inspector()
        .GetProximityProperties(geometry)
        .GetProperty("material", "coulomb_friction")
    )

    assert (friction.static_friction(), friction.dynamic_friction()) == (1.0, 0.9)


@pytest.mark.parametrize("shape", [{}, {"sphere": 1, "box": [1, 1, 1]}, {"pose": [0] * 6}])
def test_a_shape_is_exactly_one_of_its_kinds(shape: dict[str, Any]) -> None:
    with pytest.raises(InvalidConfig, match=r"piece\.yaml: shapes\[0\]: .*exactly one of"):
        piece(shapes=[shape])


@pytest.mark.parametrize(
    ("figures", "key"),
    [
        ({"mass": -1.0}, "mass"),
        ({"mass": "1"}, "mass"),
        ({"mass": float("nan")}, "mass"),
        ({"com": [0, 0]}, "com"),
        ({"inertia": [-1, 1, 1]}, "inertia"),
        ({"inertia": [1, 1, 3]}, "inertia"),
        ({"inertia": [1, 1]}, "inertia"),
        ({"inertia": [1, 1, 1, 2, 0, 0]}, "inertia"),
        ({"tcp": [0, 0, 0]}, "tcp"),
        ({"colour": [2, 0, 0, 1]}, "colour"),
        ({"colour": "red"}, "colour"),
        ({"shapes": [{"sphere": 0}]}, "shapes[0].sphere"),
        ({"shapes": [{"box": [1, 1, -1]}]}, "shapes[0].box"),
        ({"shapes": [{"cylinder": [1]}]}, "shapes[0].cylinder"),
        ({"shapes": [{"mesh": "a.obj", "scale": -1}]}, "shapes[0].scale"),
        ({"density": 0}, "density"),
        ({"weight": 1}, "weight"),
    ],
)
def test_a_figure_that_cannot_be_names_its_key(figures: dict[str, Any], key: str) -> None:
    with pytest.raises(InvalidConfig, match=rf"^piece\.yaml: {re.escape(key)}: "):
        piece(**figures)


def inertia_in_plant(model: PieceModel) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, centre of mass and moments about it as the plant has them."""
    plant, _ = plant_with(model)
    inertia = plant.GetBodyByName("tool").default_spatial_inertia()
    about_com = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    return inertia.get_mass(), inertia.get_com(), about_com


def test_a_density_gives_mass_centre_and_inertia_of_the_shapes() -> None:
    pose = (0.1, 0.0, 0.2, 0.3, -0.4, 0.5)
    model = with_mass_properties(
        piece(density=500.0, shapes=[{"box": [0.1, 0.2, 0.3], "pose": pose}])
    )

    mass, com, moments = inertia_in_plant(model)

    assert mass == model.mass == pytest.approx(3.0)
    np.testing.assert_allclose(com, pose[:3], atol=1e-15)

    turn = transform_from_pose(pose).rotation().matrix()
    own = 3.0 / 12 * np.diag([0.2**2 + 0.3**2, 0.1**2 + 0.3**2, 0.1**2 + 0.2**2])
    np.testing.assert_allclose(moments, turn @ own @ turn.T, atol=1e-15)


def test_shapes_add_up_by_the_parallel_axis_theorem() -> None:
    whole = with_mass_properties(piece(density=1000.0, shapes=[{"box": [0.2, 0.1, 0.1]}]))
    halves = [{"box": [0.1, 0.1, 0.1], "pose": [x, 0, 0, 0, 0, 0]} for x in (-0.05, 0.05)]

    two = with_mass_properties(piece(density=1000.0, shapes=halves))

    for found, expected in zip(inertia_in_plant(two), inertia_in_plant(whole), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-15)


def test_a_mesh_weighs_what_its_scale_says() -> None:
    rook = load_piece("rook")
    shapes = [{"mesh": "figure.obj", "scale": 2.0}]

    large = with_mass_properties(piece(folder=rook.folder, density=800.0, shapes=shapes))

    assert large.mass == pytest.approx(8 * rook.mass)
    np.testing.assert_allclose(large.inertia, 32 * np.array(rook.inertia), atol=1e-12)

    plant, scene_graph = plant_with(large)
    (geometry,) = plant.GetVisualGeometriesForBody(plant.GetBodyByName("tool"))

    np.testing.assert_array_equal(
        scene_graph.model_inspector().GetShape(geometry).scale3(), [2.0, 2.0, 2.0]
    )


def test_a_mass_without_an_inertia_fills_the_shapes() -> None:
    model = with_mass_properties(
        piece(mass=2.0, shapes=[{"sphere": 0.1, "pose": [0.3, 0, 0, 0, 0, 0]}])
    )
    np.testing.assert_allclose(model.com, [0.3, 0, 0], atol=1e-15)
    np.testing.assert_allclose(model.inertia, [0.4 * 2.0 * 0.01] * 3 + [0.0] * 3, atol=1e-15)


def test_figures_that_are_given_stay() -> None:
    shapes = [{"sphere": 0.1}]
    point = with_mass_properties(piece(mass=2.0, inertia=(0.0, 0.0, 0.0), shapes=shapes))

    assert (point.mass, point.com, point.inertia) == (2.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert with_mass_properties(piece(mass=2.0, com=(0.0, 0.0, 1.0), shapes=shapes)).com == (
        0.0,
        0.0,
        1.0,
    )
    assert with_mass_properties(piece(shapes=shapes)).mass == 0.0


def test_products_of_inertia_reach_the_plant() -> None:
    inertia = (0.02, 0.03, 0.04, 0.001, -0.002, 0.003)
    _, _, moments = inertia_in_plant(piece(mass=2.0, inertia=inertia))

    expected = [[0.02, 0.001, -0.002], [0.001, 0.03, 0.003], [-0.002, 0.003, 0.04]]

    np.testing.assert_allclose(moments, expected, atol=1e-15)


def test_a_changed_mass_replaces_a_density_and_the_other_way_round() -> None:
    rook = described_piece(piece_file("rook"))
    heavy, plain = with_changes(rook, {"mass": 1.0}, "x"), load_piece("rook")

    assert heavy.mass == 1.0
    np.testing.assert_allclose(heavy.inertia, np.array(plain.inertia) / plain.mass, atol=1e-15)

    pencil = described_piece(piece_file("pencil"))
    full = with_changes(pencil, {"density": 700.0}, "x")

    assert 0.05 < full.mass < 0.1
    assert full.inertia[0] > 0
    # a point mass it stays
    assert with_changes(pencil, {"mass": 3.0}, "x").inertia == (
        0.0,
        0.0,
        0.0,
    )


def test_a_density_needs_shapes_and_no_mass() -> None:
    with pytest.raises(InvalidConfig, match="either a mass or a density"):
        piece(mass=1.0, density=1000.0, shapes=[{"sphere": 1}])
    with pytest.raises(InvalidModel, match="no shapes to fill"):
        with_mass_properties(piece(density=1000.0))


def test_an_open_mesh_has_a_hull_but_no_volume(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\n"
    )
    shapes = [{"mesh": "a.obj"}]

    with pytest.raises(InvalidModel, match=r"a\.obj: .*encloses a volume.*give the mass instead"):
        with_mass_properties(piece(folder=tmp_path, density=1.0, shapes=shapes))
    np.testing.assert_allclose(
        with_mass_properties(piece(folder=tmp_path, mass=1.0, shapes=shapes)).com,
        [0.25] * 3,
        atol=1e-12,
    )


def test_each_frame_is_one_of_the_plant() -> None:
    frames = {
        "side": [0.1, 0, 0, 0, 0, 1.0],
        "hole": {"pose": [0.2, 0, 0, 0, 0.3, 0], "series": [SIXTH, UP]},
    }
    plant, _ = plant_with(piece(frames=frames))
    context = plant.CreateDefaultContext()
    found = plant.GetFrameByName("tool_hole_2_1").CalcPoseInWorld(context)
    turned = transform_from_pose([0, 0, 0, np.deg2rad(120), 0, 0]) @ transform_from_pose(
        [0.2, 0, 0, 0, 0.3, 0]
    )

    expected = transform_from_pose(POSE) @ transform_from_pose([0, 0, 0.05, 0, 0, 0]) @ turned

    np.testing.assert_allclose(found.GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-12)
    assert plant.HasFrameNamed("tool_side")
    assert plant.HasFrameNamed("tool_tcp")
    assert (
        len(
            [
                index
                for index in range(plant.num_frames())
                if "hole" in plant.get_frame(FrameIndex(index)).name()
            ]
        )
        == 12
    )


SIXTH = {"count": 6, "step": [0, 0, 0, np.pi / 3, 0, 0]}
UP = {"count": 2, "step": [0, 0, 0.05, 0, 0, 0]}


@pytest.mark.parametrize(
    ("frames", "problem"),
    [
        ({"tcp": [0] * 6}, "there are two frames 'tcp'"),
        ({"a": {"pose": [0] * 6, "series": [UP]}, "a_1": [0] * 6}, "there are two frames 'a_1'"),
        ({"two words": [0] * 6}, "not a valid name"),
        ({"a": [0] * 3}, "frames"),
        ({"a": {"pose": [0] * 6}}, "frames.*required"),
        ({"a": {"pose": [0] * 6, "series": []}}, "at least 1"),
        ({"a": {"pose": [0] * 6, "series": [{"count": 0, "step": [0] * 6}]}}, "at least 1"),
        (
            {"a": {"pose": [0] * 6, "series": [{"count": 100, "step": [0] * 6}] * 2}},
            "1000 frames at most",
        ),
    ],
)
def test_frames_that_cannot_be_are_named(frames: dict[str, Any], problem: str) -> None:
    with pytest.raises(InvalidConfig, match=rf"^piece\.yaml: .*{problem}"):
        piece(frames=frames)


@pytest.mark.parametrize(
    ("mesh", "problem"),
    [
        ("../a.obj", "is outside"),
        ("/etc/hostname", "is outside"),
        ("b.obj", "there is no file"),
        ("a.stl", "Drake cannot read; convert"),
    ],
)
def test_a_mesh_that_a_piece_may_not_have_is_named(tmp_path: Path, mesh: str, problem: str) -> None:
    folder = tmp_path / "own"
    folder.mkdir()
    for file in (tmp_path / "a.obj", folder / "a.stl"):
        file.write_text("v 0 0 0")

    (folder / "piece.yaml").write_text(f"shapes: [{{mesh: {mesh}}}]")

    with pytest.raises(InvalidModel, match=problem):
        described_piece(folder / "piece.yaml")


def test_a_mesh_that_is_deleted_after_its_piece_was_read_is_missing(tmp_path: Path) -> None:
    file = tmp_path / "piece.yaml"
    file.write_text("shapes: [{mesh: a.obj}]")
    mesh = tmp_path / "a.obj"

    mesh.write_text("v 0 0 0")

    assert described_piece(file) is described_piece(file)

    mesh.unlink()
    with pytest.raises(InvalidModel, match=r"there is no file .*a\.obj"):
        described_piece(file)


@pytest.mark.parametrize(
    "text", ["", "garbage", "v 0 0 0\nf 1 2 3\n", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"]
)
def test_a_mesh_that_drake_cannot_read_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(InvalidModel, match=r"a\.obj"):
        with_mass_properties(piece(folder=tmp_path, density=1.0, shapes=[{"mesh": "a.obj"}]))
    with pytest.raises(InvalidModel, match=r"a\.obj"):
        with_mass_properties(piece(folder=tmp_path, mass=1.0, shapes=[{"mesh": "a.obj"}]))
