"""The shapes of a robot, rewritten: what Drake then sees, what is told, and what stays as it is."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from pydrake.geometry import Convex, Role
from pydrake.geometry import Mesh as DrakeMesh
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from trimesh.visual.material import PBRMaterial

from simrob_drake.base.errors import InvalidModel
from simrob_drake.importer.repairs.shapes import import_shapes
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import pose_of

BOUNDS = [[0.25, 0.4, 0.5], [0.35, 0.6, 0.9]]
MESH = '<geometry><mesh filename="{}"/></geometry>'


class Imported:
    """A robot after its shapes were rewritten."""

    def __init__(self, folder: Path, robot: ET.Element, report: ImportReport) -> None:
        self.folder, self.robot, self.report = folder, robot, report
        self.file = folder / "arm.urdf"
        self.file.write_bytes(ET.tostring(robot))

    def meshes(self, tag: str) -> list[str]:
        return [
            mesh.get("filename", "") for mesh in self.robot.iterfind(f"link/{tag}/geometry/mesh")
        ]

    def mesh(self, name: str) -> trimesh.Trimesh:
        return trimesh.load_mesh(self.folder / name)

    def files(self) -> dict[str, bytes]:
        return {
            str(f.relative_to(self.folder)): f.read_bytes()
            for f in sorted(self.folder.rglob("*"))
            if f.is_file()
        }

    def told(self) -> str:
        return "\n".join(
            f"{entry.kind}: {entry.element}: {entry.text}" for entry in self.report.entries
        )


Import = Callable[..., Imported]


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder with meshes of the same box in several formats."""
    folder = tmp_path / "arm"
    folder.mkdir()
    box = trimesh.creation.box(bounds=BOUNDS)
    (folder / "box.stl").write_bytes(box.export(file_type="stl"))
    (folder / "box.obj").write_text("# mine\n" + box.export(file_type="obj"))
    torus = trimesh.creation.torus(0.1, 0.02, 24, 12)
    (folder / "torus.stl").write_bytes(torus.export(file_type="stl"))
    parts = []
    for index, colour in enumerate([(255, 0, 0, 255), (0, 0, 255, 255)]):
        part = trimesh.creation.box(bounds=BOUNDS).apply_translation((index, 0, 0))
        part.visual = trimesh.visual.TextureVisuals(material=PBRMaterial(baseColorFactor=colour))
        parts.append(part)
    (folder / "two.dae").write_bytes(trimesh.exchange.dae.export_collada(parts))
    return folder


@pytest.fixture
def imported(package: Path, tmp_path: Path) -> Import:
    """Import the links in a text, or a URDF that is there, into a new folder."""

    def run(text: str | Path, **options: object) -> Imported:
        source = text if isinstance(text, Path) else package / "arm.urdf"
        if isinstance(text, str):
            source.write_text(
                f'<robot name="arm" xmlns:drake="http://drake.mit.edu">{text}</robot>'
            )
        robot, report = ET.parse(source).getroot(), ImportReport(source)
        folder = tmp_path / f"out{len(list(tmp_path.glob('out*')))}"
        folder.mkdir()
        import_shapes(
            robot, source=source, folder=folder, options=ImportOptions(**options), report=report
        )
        return Imported(folder, robot, report)

    return run


def shapes_in_drake(result: Imported, role: Role) -> list[object]:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    Parser(plant).AddModels(str(result.file))
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    return [inspector.GetShape(found) for found in inspector.GetAllGeometryIds(role)]


def test_stl_becomes_obj_that_drake_shows_and_collides_with(imported: Import) -> None:
    result = imported(
        f'<link name="base"><visual>{MESH.format("torus.stl")}<material name="m"><color rgba="1 0 0 1"/></material>'
        f"</visual><collision>{MESH.format('torus.stl')}</collision></link>"
    )
    assert sorted(result.files()) == [
        "arm.urdf",
        "meshes/base_collision_1.obj",
        "meshes/base_visual_1.obj",
    ]

    source = trimesh.creation.torus(0.1, 0.02, 24, 12)
    assert result.mesh("meshes/base_visual_1.obj").volume == pytest.approx(source.volume, rel=1e-5)

    hull = result.mesh("meshes/base_collision_1.obj")
    assert hull.is_convex
    assert hull.volume == pytest.approx(source.convex_hull.volume, rel=0.02)

    (visual,), (collision,) = (
        shapes_in_drake(result, Role.kIllustration),
        shapes_in_drake(result, Role.kProximity),
    )
    assert isinstance(visual, DrakeMesh)
    assert isinstance(collision, Convex)
    # STL has no colour of its own
    assert result.robot.find("link/visual/material/color") is not None
    assert (
        "repaired: link 'base' <visual>: mesh 'torus.stl' (576 faces) becomes meshes/base_visual_1.obj"
        in result.told()
    )
    assert "its convex hull of" in result.told()


@pytest.mark.long
def test_an_import_of_an_import_changes_nothing(imported: Import, package: Path) -> None:
    Image.new("RGB", (2000, 20), (9, 200, 9)).save(package / "skin.png")
    (package / "skin.mtl").write_text("newmtl a\nKd 1 1 1\nmap_Kd skin.png\n")
    text = "mtllib skin.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 0.5 0\nvt 0 0.25\nusemtl a\nf 1/1 2/2 3/3\n"
    (package / "skin.obj").write_text(text)
    names = ["torus.stl", "two.dae", "none.stl", "skin.obj", "box.obj", "box.stl", "torus.stl"]

    links = "".join(
        f'<link name="l/{index % 3}{index}"><visual name="v">{MESH.format(name)}</visual>'
        f"<visual>{MESH.format('torus.stl')}</visual><collision>{MESH.format(name)}</collision>"
        f"<collision>{MESH.format('box.stl')}</collision></link>"
        for index, name in enumerate(names)
    )

    for collision in ("hull", "box", "none"):
        first = imported(links, collision=collision)
        again = imported(first.file, collision=collision)
        assert again.files() == first.files()
        assert not again.report.has_changes, again.told()
        assert {entry.kind for entry in again.report.entries} == {"read"}
        # the same bytes each time
        assert imported(links, collision=collision).files() == first.files()


def test_a_clean_obj_is_copied_byte_for_byte(imported: Import, package: Path) -> None:
    shape = MESH.format("box.obj")
    result = imported(
        f'<link name="a"><visual>{shape}</visual><collision>{shape}</collision></link>'
    )

    data = (package / "box.obj").read_bytes()

    assert result.files()["meshes/a_visual_1.obj"] == data
    assert result.files()["meshes/a_collision_1.obj"] == data  # it is convex
    assert [entry.kind for entry in result.report.entries] == ["read", "read"]


def test_each_colour_becomes_a_visual_as_in_rviz(imported: Import) -> None:
    result = imported(
        f'<material name="base_visual_1"><color rgba="0 1 0 1"/></material><link name="base"><visual name="v">'
        f'<origin xyz="0 0 1"/>{MESH.format("two.dae")}<material name="base_visual_1"/></visual>'
        '<visual name="v_2"><geometry><sphere radius="1"/></geometry></visual></link>'
    )
    visuals = result.robot.findall("link/visual")

    assert [visual.get("name") for visual in visuals] == ["v", "v_3", "v_2"]
    assert [pose_of(visual).translation()[2] for visual in visuals] == [1, 1, 0]

    colours = [visual.find("material/color") for visual in visuals]
    assert [colour.get("rgba") for colour in colours if colour is not None] == [
        "1 0 0 1",
        "0 0 1 1",
    ]

    names = [material.get("name") for material in result.robot.iter("material")]
    assert len(set(names)) == 3
    assert (
        "divided into 2 visuals, one for each colour or texture; its own colours replace"
        in result.told()
    )
    assert len(shapes_in_drake(result, Role.kIllustration)) == 3


def test_a_texture_stays_with_its_mesh(imported: Import, package: Path) -> None:
    Image.new("RGB", (64, 64), (200, 30, 30)).save(package / "Skin File.png")
    (package / "a.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd Skin File.png\n")
    vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 0.5 0\nvt 0 0.25\n"
    text = f"mtllib a.mtl\n{vertices}usemtl m\nf 1/1 2/2 3/3\nf 1/1 1/1 2/2\n"
    (package / "a.obj").write_text(text)

    result = imported(
        f'<link name="base"><visual>{MESH.format("a.obj")}<material name="x"/></visual></link>'
    )

    assert {"meshes/base_visual_1.mtl", "meshes/base_visual_1.png"} < set(result.files())
    assert b"map_Kd base_visual_1.png" in result.files()["meshes/base_visual_1.mtl"]
    assert result.robot.find("link/visual/material") is None  # Drake would complain that it has two

    written = result.mesh("meshes/base_visual_1.obj")
    np.testing.assert_allclose(written.visual.uv[written.faces[0]], [[0, 0], [0.5, 0], [0, 0.25]])
    assert written.visual.material.image.getpixel((5, 5)) == (200, 30, 30)


def test_a_scale_is_baked_in(imported: Import) -> None:
    shape = '<geometry><mesh filename="box.stl" scale="-0.5 2 1"/></geometry>'
    result = imported(
        f'<link name="a"><visual>{shape}</visual><collision>{shape}</collision></link>'
    )

    for name in (*result.meshes("visual"), *result.meshes("collision")):
        assert result.mesh(name).volume == pytest.approx(0.008, rel=1e-5)
        np.testing.assert_allclose(
            result.mesh(name).bounds, [[-0.175, 0.8, 0.5], [-0.125, 1.2, 0.9]], atol=1e-6
        )
    assert not [mesh for mesh in result.robot.iter("mesh") if "scale" in mesh.attrib]
    assert "scaled by -0.5 2 1" in result.told()


@pytest.mark.parametrize(
    "scale", ["0 0 0", "1 0 1", "nan", "1 1", "", "big", "1e999", "1 1 1 1", "1e-200"]
)
def test_a_scale_that_is_none_counts_as_one(imported: Import, scale: str) -> None:
    result = imported(
        f'<link name="a"><visual><geometry><mesh filename="box.stl" scale="{scale}"/></geometry></visual></link>'
    )
    np.testing.assert_allclose(result.mesh("meshes/a_visual_1.obj").bounds, BOUNDS, atol=1e-6)
    assert f'scale="{scale}" is not one or three numbers other than 0; 1 is used' in result.told()


def test_a_collision_mesh_becomes_a_box_at_its_place(imported: Import) -> None:
    result = imported(
        f'<link name="a"><collision><origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>{MESH.format("box.stl")}'
        "</collision></link>",
        collision="box",
    )

    assert sorted(result.files()) == ["arm.urdf"]

    (box,) = result.robot.iterfind("link/collision/geometry/box")
    np.testing.assert_allclose(
        [float(word) for word in box.get("size", "").split()], [0.1, 0.2, 0.4], atol=1e-7
    )

    collision = result.robot.find("link/collision")
    assert collision is not None
    np.testing.assert_allclose(pose_of(collision).translation(), [1 - 0.5, 0.3, 0.7], atol=1e-7)


def test_without_collision_nothing_is_left_to_touch(imported: Import) -> None:
    sphere = '<geometry><sphere radius="1"/></geometry>'
    result = imported(
        f'<link name="a"><collision>{sphere}</collision><collision>{MESH.format("box.stl")}</collision></link>',
        collision="none",
    )

    assert result.robot.find("link/collision") is None
    assert sorted(result.files()) == ["arm.urdf"]
    assert (
        result.told()
        == "dropped: : 2 collision shapes are left out by `collision: none`; the robot touches nothing"
    )


def test_a_robot_without_collision_shapes_gets_them_from_its_visuals(imported: Import) -> None:
    sphere = '<geometry><sphere radius="1"/></geometry>'
    links = (
        f'<link name="a"><visual><origin xyz="1 2 3"/>{MESH.format("torus.stl")}</visual></link>'
        f'<link name="b"><visual>{sphere}</visual><visual>{MESH.format("none.stl")}</visual></link><link name="c"/>'
    )

    result = imported(links)

    assert len(shapes_in_drake(result, Role.kProximity)) == 2
    assert result.robot.find("link[@name='b']/collision/geometry/sphere") is not None

    collision = result.robot.find("link[@name='a']/collision")
    assert collision is not None
    assert pose_of(collision).translation().tolist() == [1, 2, 3]
    assert (
        result.report.of("defaulted")[0].text
        == "no link has a collision shape; 2 are made from the visuals"
    )
    assert imported(links, collision="none").report.of("defaulted") == []


def test_a_mesh_that_is_nowhere_is_dropped_with_what_follows(imported: Import) -> None:
    result = imported(
        f'<link name="a"><visual>{MESH.format("none.stl")}</visual><visual>{MESH.format("http://x.org/a.stl")}</visual>'
        f"<collision>{MESH.format('package://other/none.stl')}</collision></link>"
    )

    assert result.robot.find("link/visual") is None
    assert result.robot.find("link/collision") is None
    assert (
        "dropped: link 'a' <visual> 1: mesh 'none.stl' there is no such file; this visual is left out"
        in result.told()
    )
    assert "is on the network, from which nothing is read" in result.told()
    assert (
        "package 'other' is not found; give its folder with --mesh-path DIR; the link has no other"
        in result.told()
    )


def test_a_collision_mesh_that_cannot_be_read_gives_way_to_the_visuals(
    imported: Import, package: Path
) -> None:
    (package / "bad.stl").write_bytes(b"garbage")
    result = imported(
        f'<link name="a"><visual><origin xyz="1 0 0"/>{MESH.format("torus.stl")}</visual>'
        f"<collision>{MESH.format('bad.stl')}</collision><collision>{MESH.format('none.stl')}</collision></link>"
    )

    (collision,) = result.robot.iterfind("link/collision")

    assert pose_of(collision).translation().tolist() == [1, 0, 0]
    assert result.mesh("meshes/a_collision_1.obj").is_convex
    assert "less than an STL header; the link's visuals are used instead" in result.told()
    assert "dropped: link 'a' <collision> 2: mesh 'none.stl' there is no such file" in result.told()


def test_a_mesh_outside_of_the_package_refuses_the_robot(
    imported: Import, package: Path, tmp_path: Path
) -> None:
    secret = tmp_path / "secret.stl"
    secret.write_bytes((package / "box.stl").read_bytes())

    (package / "linked.stl").symlink_to(secret)

    for tag in ("visual", "collision"):
        for name in ("../secret.stl", "linked.stl"):
            text = f'<link name="a"><{tag}>{MESH.format(name)}</{tag}></link>'
            with pytest.raises(InvalidModel) as problem:
                imported(text)
            assert f"arm.urdf: link 'a': mesh '{name}': is outside the allowed folders" in str(
                problem.value
            )
            assert f"allow it with --mesh-path {tmp_path}" in str(problem.value)
            assert imported(text, mesh_path=(tmp_path,)).meshes(tag) == [f"meshes/a_{tag}_1.obj"]


def test_the_same_mesh_is_written_once(imported: Import) -> None:
    scaled = '<geometry><mesh filename="box.stl" scale="2 2 2"/></geometry>'
    result = imported(
        f'<link name="a"><visual>{MESH.format("box.stl")}</visual></link>'
        f'<link name="b"><visual>{MESH.format("./box.stl")}</visual><visual>{scaled}</visual></link>',
        collision="none",
    )

    assert result.meshes("visual") == [
        "meshes/a_visual_1.obj",
        "meshes/a_visual_1.obj",
        "meshes/b_visual_2.obj",
    ]
    assert sorted(result.files()) == ["arm.urdf", "meshes/a_visual_1.obj", "meshes/b_visual_2.obj"]


def test_files_are_named_by_links_and_nothing_is_written_elsewhere(
    imported: Import, tmp_path: Path
) -> None:
    before = {path for path in tmp_path.rglob("*") if "out" not in str(path)}
    names = ["../../evil", "a b", "a_b", "A_B", "", "手", "x" * 300]
    meshes = ["box.stl", "torus.stl"]

    result = imported(
        "".join(
            f'<link name="{name}"><visual><geometry><mesh filename="{meshes[index % 2]}" scale="{index + 1}"/>'
            "</geometry></visual></link>"
            for index, name in enumerate(names)
        )
    )

    assert len({name.lower() for name in result.meshes("visual")}) == len(names)
    assert "meshes/______evil_visual_1.obj" in result.files()
    assert all(len(Path(name).name) < 120 for name in result.files())
    assert {path for path in tmp_path.rglob("*") if "out" not in str(path)} - before == {
        tmp_path / "arm" / "arm.urdf"
    }


def test_without_a_folder_all_is_told_and_nothing_written(package: Path) -> None:
    text = f'<robot name="arm"><link name="a"><visual>{MESH.format("torus.stl")}</visual></link></robot>'
    robot, report = ET.fromstring(text), ImportReport(package / "arm.urdf")
    before = sorted(package.rglob("*"))

    import_shapes(
        robot, source=package / "arm.urdf", folder=None, options=ImportOptions(), report=report
    )

    assert len(report.of("repaired")) == 1
    assert len(report.of("defaulted")) == 1
    assert sorted(package.rglob("*")) == before


@pytest.mark.parametrize("tag", ["visual", "collision"])
@pytest.mark.parametrize(
    ("geometry", "problem"),
    [
        (
            '<geometry><box size="0 1 1"/></geometry>',
            '<box> has size="0 1 1"; it must be positive',
        ),
        (
            '<geometry><box size="1 1"/></geometry>',
            '<box> has size="1 1"; it must have 3 positive numbers',
        ),
        ('<geometry><box size="1 1 inf"/></geometry>', "it must have 3 positive numbers"),
        ("<geometry><box/></geometry>", "<box> has no size"),
        ('<geometry><sphere radius="-1"/></geometry>', "it must be positive"),
        ('<geometry><sphere radius="nan"/></geometry>', "it must have 1 positive number"),
        ('<geometry><cylinder radius="1"/></geometry>', "<cylinder> has no length"),
        (
            '<geometry><cylinder radius="1" length="1_0"/></geometry>',
            "it must have 1 positive number",
        ),
        ('<geometry><capsule length="1"/></geometry>', "<capsule> has no radius"),
        ('<geometry><drake:ellipsoid a="1" b="0" c="1"/></geometry>', '<ellipsoid> has b="0"'),
        ('<geometry><plane normal="0 0 1"/></geometry>', "<plane> is not a known shape"),
        ("<geometry/>", "its <geometry> is empty"),
        ("", "has no <geometry>"),
    ],
)
def test_a_shape_that_is_none_is_dropped(
    imported: Import, tag: str, geometry: str, problem: str
) -> None:
    result = imported(f'<link name="a"><{tag}>{geometry}</{tag}></link>')

    assert result.robot.find(f"link/{tag}") is None
    assert f"dropped: link 'a' <{tag}>: " in result.told()
    assert problem in result.told()


def test_shapes_that_are_right_stay_as_they_are(imported: Import) -> None:
    shapes = (
        '<box size="1 2 3"/>',
        '<sphere radius="1"/>',
        '<cylinder radius="1" length="2"/>',
        '<capsule radius="1" length="2"/>',
        '<drake:ellipsoid a="1" b="2" c="3"/>',
    )
    result = imported(
        "".join(
            f'<link name="l{index}"><visual><geometry>{shape}</geometry></visual>'
            f"<collision><geometry>{shape}</geometry></collision></link>"
            for index, shape in enumerate(shapes)
        )
    )

    assert result.report.entries == []
    assert len(shapes_in_drake(result, Role.kProximity)) == len(shapes)


def test_of_several_shapes_in_a_geometry_the_first_stays(imported: Import) -> None:
    result = imported(
        '<link name="a"><collision><geometry><odd/><sphere radius="1"/><box size="1 1 1"/></geometry></collision>'
        "</link>"
    )
    (geometry,) = result.robot.iterfind("link/collision/geometry")

    assert [child.tag for child in geometry] == ["sphere"]
    assert result.told().count("a <geometry> has one shape, here <sphere>") == 2


def test_wrong_case_and_packages_are_told_as_repaired(imported: Import) -> None:
    result = imported(
        f'<link name="a"><visual>{MESH.format("package://arm/BOX.OBJ")}</visual></link>'
    )
    assert result.report.of("repaired")[0].text.endswith(
        "becomes meshes/a_visual_1.obj; found as box.obj"
    )


def test_collision_shapes_have_no_texture(imported: Import, package: Path) -> None:
    box = trimesh.creation.box((1, 1, 1))
    box.visual = trimesh.visual.TextureVisuals(
        uv=box.vertices[:, :2] + 0.5,
        material=PBRMaterial(baseColorTexture=Image.new("RGB", (8, 8), (1, 200, 3))),
    )
    (package / "box.glb").write_bytes(trimesh.Scene([box]).export(file_type="glb"))
    result = imported(f'<link name="a"><visual>{MESH.format("box.glb")}</visual></link>')

    names = {name.removeprefix("meshes/") for name in result.files()} - {"arm.urdf"}

    assert names == {"a_collision_1.obj", "a_visual_1.mtl", "a_visual_1.obj", "a_visual_1.png"}
    assert b"mtl" not in result.files()["meshes/a_collision_1.obj"]
