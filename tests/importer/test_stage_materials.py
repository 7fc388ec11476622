"""Materials: every name has one colour, and every visual looks as its file says."""

import pytest
from pydrake.geometry import Rgba, Role, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from repair_stages import ARM, Repaired, with_defect

from simrob_drake.importer.importing import import_robot, robot_from_file
from simrob_drake.importer.repairs.materials import DEFAULT_RGBA
from simrob_drake.robots.parse import add_urdf

RED = '<material name="red"><color rgba="1 0 0 1"/></material>'
USE = '<material name="red"/>'
GREY = tuple(DEFAULT_RGBA)


def colours(done: Repaired) -> list[tuple[float, ...]]:
    """Return the colours of the shapes that Drake shows, in file order."""
    plant, scene_graph = MultibodyPlant(0.0), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    add_urdf(plant, done.robot, name="robot", where="arm.urdf")
    inspector = scene_graph.model_inspector()
    shapes = plant.GetVisualGeometriesForBody(plant.GetBodyByName("base"))
    found = [inspector.GetProperties(shape, Role.kIllustration) for shape in shapes]
    rgba = [
        properties.GetPropertyOrDefault("phong", "diffuse", Rgba(1, 1, 1, 0))
        for properties in found
    ]
    return [(value.r(), value.g(), value.b(), value.a()) for value in rgba]


def visual(material: str) -> str:
    return f'<visual><geometry><sphere radius="0.1"/></geometry>{material}</visual>'


def with_visual(material: str, text: str = ARM) -> str:
    return with_defect('<link name="base">', f'<link name="base">{visual(material)}', text)


@pytest.mark.parametrize(
    ("text", "kind", "words", "first"),
    [
        pytest.param(
            with_visual('<material name="blue"/>'),
            "defaulted",
            "material 'blue': is not defined; a grey, 0.7 0.7 0.7 1, is used",
            GREY,
            id="undefined",
        ),
        pytest.param(
            with_visual("<material/>"),
            "dropped",
            "neither name nor colour",
            (1, 1, 1, 0),
            id="nothing",
        ),
        pytest.param(
            with_defect(RED, RED * 2),
            "dropped",
            "twice, with the same colour",
            (1, 0, 0, 1),
            id="twice",
        ),
        pytest.param(
            with_defect(RED, RED + RED.replace("1 0 0 1", "0 1 0 1")),
            "dropped",
            "is defined again with the colour 0 1 0 1; the first colour, 1 0 0 1, is used",
            (1, 0, 0, 1),
            id="redefined",
        ),
        pytest.param(
            with_defect(RED, '<material name="red"/>'),
            "dropped",
            "has no colour",
            GREY,
            id="colourless",
        ),
        pytest.param(
            with_defect(RED, RED.replace(' name="red"', "")),
            "dropped",
            "has no name",
            GREY,
            id="nameless",
        ),
        pytest.param(
            with_visual('<material name="t"><texture filename="a.png"/></material>'),
            "dropped",
            "its texture 'a.png'",
            GREY,
            id="texture",
        ),
        pytest.param(
            with_visual('<material name="t"><color/></material>'),
            "dropped",
            "its colour has no rgba",
            GREY,
            id="rgba",
        ),
        pytest.param(
            with_visual('<material name="red"><color rgba="0 0 1 1"/></material>'),
            "repaired",
            "is also used with the colour 0 0 1 1; this use is renamed to 'red_2'",
            (0, 0, 1, 1),
            id="another colour",
        ),
        pytest.param(
            with_defect("1 0 0 1", "1.5 -1 0 1"),
            "repaired",
            'written as "1 0 0 1"',
            (1, 0, 0, 1),
            id="out of range",
        ),
        pytest.param(
            with_defect("1 0 0 1", "255 0 51 255"),
            "repaired",
            'written as "1 0 0.2 1"',
            (1, 0, 0.2, 1),
            id="8 bits",
        ),
        pytest.param(
            with_defect("1 0 0 1", "1 0 0"),
            "repaired",
            'written as "1 0 0 1"',
            (1, 0, 0, 1),
            id="three",
        ),
    ],
)
def test_a_material_is_mended_and_told(tmp_path, text, kind, words, first):
    done = Repaired(text, tmp_path)
    assert any(words in line for line in done.told(kind)), done.report.entries
    assert colours(done)[0] == pytest.approx(first)


def test_nameless_colours_of_visuals_need_no_repair(tmp_path):
    blue = '<material name=""><color rgba="0 0 1 1"/></material>'
    done = Repaired(with_visual(blue, with_visual(blue.replace("0 0 1", "0 1 0"))), tmp_path)

    assert not done.report.has_changes
    assert colours(done)[:2] == [(0, 0, 1, 1), (0, 1, 0, 1)]


def test_one_new_name_serves_all_visuals_of_that_colour(tmp_path):
    blue = '<material name="red"><color rgba="0 0 1 1"/></material>'
    done = Repaired(with_visual(blue, with_visual(blue)), tmp_path)

    names = [material.get("name") for material in done.robot.iterfind("link/visual/material")]

    assert names == ["red_2", "red_2", "red"]
    assert colours(done) == [(0, 0, 1, 1), (0, 0, 1, 1), (1, 0, 0, 1)]


def test_a_material_may_be_defined_after_its_use(tmp_path):
    done = Repaired(with_defect("</robot>", f"{RED}</robot>", with_defect(RED, "")), tmp_path)
    assert not done.report.has_changes
    assert colours(done) == [(1, 0, 0, 1)]


def test_a_colour_that_one_visual_defines_outlives_it(tmp_path):
    """A visual whose mesh is missing is dropped; what it defined is used by others all the same."""
    missing = '<visual><geometry><mesh filename="none.stl"/></geometry>{}</visual>'
    blue = '<material name="blue"><color rgba="0 0 1 1"/></material>'
    text = with_visual('<material name="blue"/>')
    text = text.replace('<link name="base">', f'<link name="base">{missing.format(blue)}')
    source = tmp_path / "arm.urdf"
    source.write_text(text)

    imported = import_robot(source, tmp_path.parent / f"{tmp_path.name}_out")

    assert "there is no such file" in imported.report.of("dropped")[0].text

    material = imported.model.element.find("material[@name='blue']/color")
    assert material.get("rgba") == "0 0 1 1"


@pytest.mark.parametrize(
    "material",
    [
        '<material name="x"/>',
        '<material name="x"><texture filename="a.png"/></material>',
        "<material/>",
    ],
)
def test_a_material_without_colour_is_no_reason_to_refuse_a_robot(tmp_path, material):
    source = tmp_path / "arm.urdf"
    source.write_text(with_defect("</robot>", f"{material}</robot>"))
    robot = robot_from_file(source)

    add_urdf(MultibodyPlant(0.0), robot.element, name="robot", where=source)
