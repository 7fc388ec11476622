"""Pieces: rigid bodies with mass, tool centre point and shapes."""

import runpy
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Box, Cylinder, Mesh, SceneGraph, Sphere
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame

from simrob_drake.errors import InvalidConfig, UnknownName
from simrob_drake.frames import transform_from_pose
from simrob_drake.paths import models_root
from simrob_drake.robots.pieces import PieceModel, PieceShape, add_piece, load_piece, piece_names
from simrob_drake.yaml_files import validated

POSE = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)


def piece(**figures: Any) -> PieceModel:
    return validated(PieceModel, {"folder": Path(), **figures}, "piece.yaml")


def plant_with(model: PieceModel, *, collision: bool = False) -> tuple[MultibodyPlant, Frame]:
    plant, scene_graph = MultibodyPlant(0.0), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    instance = plant.AddModelInstance("tool")
    tip = add_piece(
        plant,
        name="tool",
        piece=model,
        parent=plant.world_frame(),
        pose=POSE,
        instance=instance,
        collision=collision,
    )
    plant.Finalize()
    return plant, tip


@pytest.mark.parametrize("name", piece_names())
def test_every_piece_of_the_package_can_be_added(name: str) -> None:
    model = load_piece(name)
    plant, _ = plant_with(model, collision=True)
    body = plant.GetBodyByName("tool")
    assert body.default_mass() == model.mass
    assert len(plant.GetVisualGeometriesForBody(body)) == len(model.shapes) > 0
    assert len(plant.GetCollisionGeometriesForBody(body)) == len(model.shapes)


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
    plant, tip = plant_with(piece(tcp=tcp))
    expected = transform_from_pose(POSE) @ transform_from_pose(tcp)
    found = tip.CalcPoseInWorld(plant.CreateDefaultContext())
    assert tip.name() == "tool_tcp"
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
def test_each_kind_of_shape_is_the_one_of_drake(shape: dict[str, Any], kind: type) -> None:
    assert isinstance(validated(PieceShape, shape, "piece.yaml").geometry(Path()), kind)


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
