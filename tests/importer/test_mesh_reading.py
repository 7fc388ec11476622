"""Every mesh format as plain parts: volumes, bounds, colours, units and directions as they were written."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from pydrake.geometry import Mesh as DrakeMesh
from trimesh.visual.material import PBRMaterial

from simrob_drake.base.packages import OutsideBorder
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.library import Mesh, MeshLibrary
from simrob_drake.importer.meshes.parts import points_of
from simrob_drake.importer.meshes.places import MeshPlaces
from simrob_drake.importer.meshes.reading import _rgba

RED, BLUE = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
BOUNDS = np.array([[0.25, 0.4, 0.5], [0.35, 0.6, 0.9]])  # of the box, in metres
TURN = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # glTF's Y upwards becomes Z


def box() -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=BOUNDS)


def coloured(rgba: tuple[float, ...], mesh: trimesh.Trimesh | None = None) -> trimesh.Trimesh:
    mesh = mesh or box()
    mesh.visual = trimesh.visual.TextureVisuals(
        material=PBRMaterial(baseColorFactor=[round(255 * c) for c in rgba])
    )
    return mesh


def read(path: Path, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Mesh:
    return MeshLibrary(MeshPlaces(path.parent / "arm.urdf")).load(path.name, scale)


def bounds(mesh: Mesh) -> np.ndarray:
    points = points_of(mesh.parts)
    return np.array([points.min(axis=0), points.max(axis=0)])


def volume(mesh: Mesh) -> float:
    return float(
        sum(trimesh.Trimesh(part.vertices, part.faces, process=False).volume for part in mesh.parts)
    )


def write(path: Path, data: bytes | str) -> Path:
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


DAE = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="x" meter="{unit}"/><up_axis>{up}</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="t"><phong><diffuse><color>1 0 0 1</color></diffuse>
</phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4" material="s"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 2 1 0 1 3 1 2 3 2 0 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"""
NODE = """<node><translate>{x} 0 0</translate><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="s" target="#m"/></technique_common></bind_material></instance_geometry></node>"""


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "obj", "ply", "off", "dae", "glb"])
def test_a_box_is_the_same_in_every_format(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path / f"box.{kind.removesuffix('_ascii')}", box().export(file_type=kind))
    mesh = read(path)

    expected = np.sort(BOUNDS @ TURN.T, axis=0) if kind == "glb" else BOUNDS
    np.testing.assert_allclose(bounds(mesh), expected, atol=1e-7)
    assert volume(mesh) == pytest.approx(0.1 * 0.2 * 0.4, rel=1e-6)
    assert sum(len(part.faces) for part in mesh.parts) == 12
    # those of STL's faces at one place are one
    assert sum(len(part.vertices) for part in mesh.parts) == 8


def test_stl_whose_header_says_solid_is_known_as_binary(tmp_path: Path) -> None:
    data = box().export(file_type="stl")
    assert (
        volume(read(write(tmp_path / "a.stl", b"solid of facets by a CAD".ljust(80) + data[80:])))
        > 0.007
    )


def test_stl_with_bytes_behind_its_end_is_read(tmp_path: Path) -> None:
    mesh = read(write(tmp_path / "a.stl", box().export(file_type="stl") + b"made by a CAD"))
    assert volume(mesh) == pytest.approx(0.008, rel=1e-6)
    assert mesh.remarks == ["has 13 bytes after its last face, which are ignored"]


@pytest.mark.parametrize(
    ("name", "data", "problem"),
    [
        (
            "a.stl",
            box().export(file_type="stl")[:-20],
            "is cut off: it contains 11 of its 12 faces",
        ),
        ("a.stl", b"\0" * 84, "is empty"),
        ("a.stl", b"x" * 80 + b"\0" * 4, "contains no triangles"),
        ("a.stl", b"solid a\nendsolid a", "contains no triangles"),
        ("a.stl", b"short", "less than an STL header"),
        ("a.stl", b"", "is empty"),
        ("a.obj", b"v 0 0 0\n", "contains no triangles"),
        ("a.obj", b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "contains no triangles"),
        ("a.obj", b"v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n", "contains no triangle with an area"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n",
            "cut off",
        ),
        ("a.dae", b"<COLLADA>", "is not readable as DAE"),
        ("a.dae", b"PK\x03\x04 an archive", "is not readable as DAE"),
        ("a.glb", b"glTF\2\0\0\0", "is not readable as glTF"),
        ("a.gltf", b"[1, 2]", "is not readable as glTF"),
        (
            "a.gltf",
            b'{"accessors": [{"count": 1000000000000, "type": "VEC3"}]}',
            "declares more data",
        ),
        (
            "a.gltf",
            b'{"asset": {"version": "2.0"}, "buffers": [{"uri": "no.bin"}]}',
            "is not readable as GLTF",
        ),
        (
            "a.step",
            b"ISO-10303-21;",
            "has the format '.step', which is not read; the formats are .stl, .dae, .obj",
        ),
        ("a", b"solid", "has the format '', which is not read"),
    ],
)
def test_what_holds_no_mesh_is_named(tmp_path: Path, name: str, data: bytes, problem: str) -> None:
    write(tmp_path / name, data)

    with pytest.raises(UnreadableMesh) as error:
        read(tmp_path / name)
    assert problem in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "a.stl").open("wb") as file:
        file.truncate(200_000_000)  # takes no room on the disk
    with pytest.raises(UnreadableMesh, match=r"it is larger than 100 MB\); decimate the mesh"):
        read(tmp_path / "a.stl")


def test_a_file_without_permission_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, flags: int) -> int:
        raise PermissionError(13, "Permission denied", str(path))

    write(tmp_path / "a.stl", box().export(file_type="stl"))
    monkeypatch.setattr("os.open", refuse)  # tests may run as root, who may read all
    with pytest.raises(UnreadableMesh, match="Permission denied"):
        read(tmp_path / "a.stl")


def test_collada_is_scaled_by_its_unit_and_its_up_axis_is_told(tmp_path: Path) -> None:
    mesh = read(
        write(tmp_path / "a.dae", DAE.format(unit="0.001", up="Y_UP", nodes=NODE.format(x=1)))
    )

    np.testing.assert_allclose(bounds(mesh), [[0.001, 0, 0], [0.002, 0.001, 0.001]], atol=1e-12)
    assert mesh.parts[0].rgba == RED
    assert mesh.remarks == ["has the up axis Y_UP, which is ignored, as in ROS"]
    assert (
        read(
            write(tmp_path / "b.dae", DAE.format(unit="1", up="Z_UP", nodes=NODE.format(x=0)))
        ).remarks
        == []
    )


def test_all_nodes_of_a_collada_scene_are_read(tmp_path: Path) -> None:
    inner = (
        f"<node><scale>1 1 -1</scale>{NODE.format(x=0)}</node>"  # a mirrored node keeps its outside
    )
    mesh = read(
        write(tmp_path / "a.dae", DAE.format(unit="1", up="Z_UP", nodes=NODE.format(x=5) + inner))
    )

    np.testing.assert_allclose(bounds(mesh), [[0, 0, -1], [6, 1, 1]], atol=1e-12)
    assert volume(mesh) == pytest.approx(2 / 6)
    assert len(mesh.parts) == 1  # both are red


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize(
    "head",
    [
        '<!DOCTYPE COLLADA [<!ENTITY a "b">]>',
        '<!DOCTYPE COLLADA SYSTEM "http://example.org/x.dtd">',
    ],
)
def test_collada_with_entities_is_refused_before_it_is_parsed(
    tmp_path: Path, head: str, encoding: str
) -> None:
    text = DAE.format(unit="1", up="Z_UP", nodes=NODE.format(x=0)).replace(
        '<?xml version="1.0"?>', head
    )
    with pytest.raises(UnreadableMesh, match="declares entities or a document type"):
        read(write(tmp_path / "a.dae", text.encode(encoding)))


def test_collada_nodes_that_multiply_or_go_in_a_circle_are_refused(tmp_path: Path) -> None:
    ten = [f'<instance_node url="#n{level + 1}"/>' * 10 for level in range(9)] + [NODE.format(x=0)]
    levels = "".join(f'<node id="n{level}">{inner}</node>' for level, inner in enumerate(ten))

    circle = '<node id="n"><instance_node url="#n"/></node>'

    for nodes in (levels, circle):
        with pytest.raises(
            UnreadableMesh, match="more than 20000 nodes, or a node that contains itself"
        ):
            read(write(tmp_path / "a.dae", DAE.format(unit="1", up="Z_UP", nodes=nodes)))


def test_each_colour_of_a_mesh_is_a_part(tmp_path: Path) -> None:
    other = box().apply_translation((1, 0, 0))
    again = box().apply_translation((2, 0, 0))

    scene = trimesh.Scene([coloured(RED), coloured(BLUE, other), coloured(RED, again)])

    for kind in ("glb", "dae", "obj"):
        if kind == "obj":
            files, libraries = scene.export(file_type=kind, return_texture=True)
            for name, data in libraries.items():
                write(tmp_path / name, data)
        elif kind == "dae":
            files = trimesh.exchange.dae.export_collada(list(scene.geometry.values()))
        else:
            files = scene.export(file_type=kind)
        mesh = read(write(tmp_path / f"a.{kind}", files))
        assert {part.rgba: len(part.faces) for part in mesh.parts} == {RED: 24, BLUE: 12}, kind


def test_transparency_of_a_material_library_is_kept(tmp_path: Path) -> None:
    write(tmp_path / "a.mtl", "newmtl m\nKd 0.2 0.4 0.6\nd 0.5\nnewmtl n\nKd 0.2 0.4 0.6\nTr 0.2\n")
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl m\nf 1 3 2\nf 1 2 4\nusemtl n\nf 2 3 4\nf 3 1 4\n"

    parts = read(write(tmp_path / "a.obj", text)).parts

    assert sorted(part.rgba or () for part in parts) == [(0.2, 0.4, 0.6, 0.5), (0.2, 0.4, 0.6, 0.8)]


def test_a_few_colours_of_vertices_are_kept_and_many_become_their_mean(tmp_path: Path) -> None:
    two = trimesh.util.concatenate([box(), box().apply_translation((1, 0, 0))])
    two.visual.face_colors = [(255, 0, 0, 255)] * 12 + [(0, 0, 255, 255)] * 12

    mesh = read(write(tmp_path / "a.ply", two.export(file_type="ply")))

    assert {part.rgba: len(part.faces) for part in mesh.parts} == {RED: 12, BLUE: 12}

    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.visual.vertex_colors = [(index % 250, 0, 0, 255) for index in range(len(ball.vertices))]

    mesh = read(write(tmp_path / "b.ply", ball.export(file_type="ply")))

    assert len(mesh.parts) == 1
    assert "which their mean replaces" in mesh.remarks[0]


def test_gltf_is_turned_as_drake_turns_it(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(box(), transform=trimesh.transformations.rotation_matrix(0.5, [1, 2, 3]))
    for name, data in scene.export(file_type="gltf").items():
        write(tmp_path / name, data)
    hull = DrakeMesh(str(tmp_path / "model.gltf")).GetConvexHull()

    corners = np.array([hull.vertex(index) for index in range(hull.num_vertices())])

    np.testing.assert_allclose(
        bounds(read(tmp_path / "model.gltf")), [corners.min(axis=0), corners.max(axis=0)], atol=1e-6
    )


def test_gltf_colours_are_light_and_become_what_a_screen_shows(tmp_path: Path) -> None:
    scene = trimesh.Scene([coloured((0.2140411, 0, 1, 0.4))])  # the light of a grey of 0.5
    rgba = read(write(tmp_path / "a.glb", scene.export(file_type="glb"))).parts[0].rgba
    assert rgba == pytest.approx((0.5, 0, 1, 0.4), abs=5e-3)  # eight bits


def test_buffers_and_textures_outside_of_the_package_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "package"
    folder.mkdir()
    secret = write(tmp_path / "secret.bin", bytes(100))
    gltf = {"asset": {"version": "2.0"}, "buffers": [{"uri": "../secret.bin", "byteLength": 100}]}
    (folder / "linked.mtl").symlink_to(secret)

    write(folder / "x.mtl", f"newmtl m\nmap_Kd {secret}\n")

    for name, data in (
        ("a.gltf", json.dumps(gltf)),
        (
            "a.glb",
            b"glTF"
            + struct.pack("<IIII", 2, 0, len(json.dumps(gltf)), 0x4E4F534A)
            + json.dumps(gltf).encode(),
        ),
        ("a.dae", f"<COLLADA><image><init_from>{secret}</init_from></image></COLLADA>"),
        ("a.obj", "mtllib ../secret.bin\n"),
        ("b.obj", "mtllib linked.mtl\n"),
        ("c.obj", "mtllib x.mtl\n"),
    ):
        with pytest.raises(OutsideBorder, match=f"--mesh-path {tmp_path}"):
            read(write(folder / name, data))


def test_texts_in_an_old_encoding_are_read(tmp_path: Path) -> None:
    write(tmp_path / "piel.mtl", "newmtl cañón\nKd 1 0 0\n".encode("latin-1"))
    text = "# cañón\nmtllib piel.mtl\nusemtl cañón\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    assert read(write(tmp_path / "a.obj", text.encode("latin-1"))).parts[0].rgba == RED


def test_a_missing_material_library_is_told(tmp_path: Path) -> None:
    text = "mtllib none.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    mesh = read(write(tmp_path / "a.obj", text))

    assert mesh.changes == ["textures or materials missing: none.mtl"]
    assert mesh.original is None


@pytest.mark.parametrize("name", ["image.png", "image.jpg", "image.tga"])
def test_a_texture_and_its_places_are_read(tmp_path: Path, name: str) -> None:
    Image.new("RGB", (3000, 1000), (200, 30, 30)).save(tmp_path / name)
    write(tmp_path / "a.mtl", f"newmtl m\nKd 1 1 1\nmap_Kd {name}\n")
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 0.5 0\nvt 0 0.25\nusemtl m\nf 1/1 2/2 3/3\n"

    (part,) = read(write(tmp_path / "a.obj", text)).parts

    assert part.image is not None
    assert part.uv is not None
    assert part.image.size == (1024, 341)
    np.testing.assert_allclose(part.uv[0], [[0, 0], [0.5, 0], [0, 0.25]])


def test_an_image_that_is_none_or_a_bomb_leaves_the_colour(tmp_path: Path) -> None:
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 0.5 0\nvt 0 0.25\nusemtl m\nf 1/1 2/2 3/3\n"
    write(tmp_path / "a.obj", text)
    write(tmp_path / "a.mtl", "newmtl m\nKd 1 0 0\nmap_Kd a.png\n")
    Image.new("1", (12000, 12000)).save(tmp_path / "bomb.png")

    half = (tmp_path / "bomb.png").read_bytes()

    for data in (
        b"no image",
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n",
        half,
        half[:300],
    ):
        write(tmp_path / "a.png", data)
        (part,) = read(tmp_path / "a.obj").parts
        assert part.image is None
        assert part.rgba == RED


def test_a_mirroring_scale_keeps_the_outside(tmp_path: Path) -> None:
    path = write(tmp_path / "a.obj", box().export(file_type="obj", include_normals=True))
    mesh = read(path, (-2.0, 1.0, 0.5))

    assert volume(mesh) == pytest.approx(0.008)
    np.testing.assert_allclose(bounds(mesh), [[-0.7, 0.4, 0.25], [-0.5, 0.6, 0.45]], atol=1e-9)
    (part,) = mesh.parts
    outward = part.vertices[part.faces] - part.vertices.mean(axis=0)
    assert part.normals is not None
    assert (np.einsum("ijk,ijk->ij", part.normals, outward) > 0).all()


def test_what_is_no_triangle_is_mended_and_told(tmp_path: Path) -> None:
    text = box().export(file_type="obj", include_normals=False)
    text += "\nv nan 0 0\nv 1e30 0 0\nv 9 9 9\nf 1 1 2\nf 1 2 9\nf 1 2 10\nf 1 2 2\n"

    mesh = read(write(tmp_path / "a.obj", text))

    np.testing.assert_allclose(bounds(mesh), BOUNDS)
    assert mesh.changes == ["4 degenerate faces left out"]
    assert mesh.original is None


def test_a_large_mesh_is_decimated_within_its_bounds(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.1)  # 81920 faces
    mesh = read(write(tmp_path / "a.stl", ball.export(file_type="stl")))

    count = sum(len(part.faces) for part in mesh.parts)

    assert count <= 50_000
    assert mesh.changes == [f"decimated from 81920 to {count} faces"]
    np.testing.assert_allclose(bounds(mesh), ball.bounds, atol=0.002 * 0.99)
    assert volume(mesh) == pytest.approx(ball.volume, rel=1e-3)


def test_a_mesh_in_millimetres_is_told_and_left(tmp_path: Path) -> None:
    mesh = read(write(tmp_path / "a.stl", box().apply_scale(1000).export(file_type="stl")))
    assert mesh.remarks == [
        'is 400 m large; if it was drawn in millimetres, write scale="0.001 0.001 0.001"'
    ]
    assert volume(mesh) == pytest.approx(8e6, rel=1e-5)


@pytest.mark.parametrize(
    ("colour", "expected"),
    [
        ((0.5, 1.7, -0.2, 0.4), (0.5, 1.0, 0.0, 0.4)),
        ((0.1, 0.2, 0.3, 2.0), (0.1, 0.2, 0.3, 1.0)),
        ((0.1, 0.2, 0.3, 0.0), (0.1, 0.2, 0.3, 1.0)),
        ((np.nan, 0.2, 0.3, 1.0), (1.0, 0.2, 0.3, 1.0)),
    ],
)
def test_a_colour_has_numbers_from_zero_to_one_and_is_seen(
    colour: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    assert _rgba(colour) == expected
