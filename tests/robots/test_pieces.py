"""Pieces: rigid bodies with mass, tool centre point and shapes."""

import runpy
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Box, Cylinder, Mesh, SceneGraph, Sphere
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.errors import InvalidConfig, UnknownName
from simrob_drake.frames import transform_from_pose
from simrob_drake.paths import models_root
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.piece_urdf import piece_robot
from simrob_drake.robots.pieces import PieceModel, load_piece, piece_names
from simrob_drake.yaml_files import validated

POSE = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)


def piece(**figures: Any) -> PieceModel:
    return validated(PieceModel, {"folder": Path(), **figures}, "piece.yaml")


def plant_with(model: PieceModel, *, collision: bool = False) -> tuple[MultibodyPlant, SceneGraph]:
    """Return a plant with a piece that stands alone, at POSE, and the scene graph of its shapes."""
    plant, scene_graph = MultibodyPlant(0.0), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    instance = add_urdf(plant, piece_robot("tool", model), name="tool", where="piece", collision=collision)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("tool", instance), transform_from_pose(POSE))
    plant.Finalize()
    return plant, scene_graph


@pytest.mark.parametrize("name", piece_names())
def test_every_piece_of_the_package_can_be_added(name: str) -> None:
    model = load_piece(name)
    plant, _ = plant_with(model, collision=True)
    body = plant.GetBodyByName("tool")
    assert body.default_mass() == model.mass
    assert len(plant.GetVisualGeometriesForBody(body)) == sum(shape.visible for shape in model.shapes) > 0
    assert len(plant.GetCollisionGeometriesForBody(body)) == sum(shape.collides for shape in model.shapes)


@pytest.mark.parametrize(
    ("name", "inertia", "reach"), [("gripper", [1e-3, 1e-3, 1e-3], 0.070), ("pencil", [0, 0, 0], 0.148)]
)
def test_tool_and_load_have_the_figures_of_the_original(name: str, inertia: list[float], reach: float) -> None:
    model = load_piece(name)  # script D30: 1 kg each, the pencil a point mass; centre of mass copied from link_6
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
    np.testing.assert_allclose(np.diag(about_origin), [0.01, 0.02 + 2 * 0.1**2, 0.03 + 2 * 0.1**2], atol=1e-15)


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
    [({"box": [1, 2, 3]}, Box), ({"cylinder": [1, 2]}, Cylinder), ({"sphere": 1}, Sphere), ({"mesh": "a.obj"}, Mesh)],
)
def test_each_kind_of_shape_is_the_one_of_drake(shape: dict[str, Any], kind: type, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
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
        scene_graph.model_inspector().GetProximityProperties(geometry).GetProperty("material", "coulomb_friction")
    )
    assert (friction.static_friction(), friction.dynamic_friction()) == (1.0, 0.9)


@pytest.mark.parametrize("shape", [{}, {"sphere": 1, "box": [1, 1, 1]}, {"pose": [0] * 6}])
def test_a_shape_is_exactly_one_of_its_kinds(shape: dict[str, Any]) -> None:
    with pytest.raises(InvalidConfig, match=r"piece\.yaml: shapes: .*exactly one of"):
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
        ({"tcp": [0, 0, 0]}, "tcp"),
        ({"colour": [2, 0, 0, 1]}, "colour"),
        ({"colour": "red"}, "colour"),
        ({"shapes": [{"sphere": 0}]}, "shapes.sphere"),
        ({"shapes": [{"box": [1, 1, -1]}]}, "shapes.box"),
        ({"shapes": [{"cylinder": [1]}]}, "shapes.cylinder"),
        ({"weight": 1}, "weight"),
    ],
)
def test_a_figure_that_cannot_be_names_its_key(figures: dict[str, Any], key: str) -> None:
    with pytest.raises(InvalidConfig, match=rf"^piece\.yaml: {key}: "):
        piece(**figures)


def test_the_point_of_the_pencil_is_what_the_script_makes(tmp_path: Path) -> None:
    folder = models_root() / "pieces" / "pencil"
    script = shutil.copy(folder / "make_meshes.py", tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    assert (tmp_path / "point.obj").read_bytes() == (folder / "point.obj").read_bytes()
