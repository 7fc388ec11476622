"""The file behind a mesh's name, and that nothing else can be read."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from simrob_drake.base.packages import OutsideBorder, package_root
from simrob_drake.importer.meshes.places import MeshMissing, MeshPlaces, mesh_files
from simrob_drake.robots.imports import ImportOptions

MANIFEST = "<package><name>{}</name></package>"


def put(path: Path, text: str = "solid") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A workspace with the package `arm` in a folder of another name, and a URDF in it."""
    package = tmp_path / "src" / "group" / "arm-main"
    put(package / "package.xml", MANIFEST.format("arm"))
    put(package / "Meshes" / "Base.STL")
    put(package / "meshes two" / "upper.stl")
    put(package / "meshes two" / "50%25.stl")
    return put(package / "urdf" / "arm.urdf", "<robot/>")


def found(source: Path, uri: str, *mesh_path: Path) -> str:
    path = MeshPlaces(source, mesh_path).find(uri).path
    return str(path.relative_to(package_root(source)))


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ("package://arm/Meshes/Base.STL", "Meshes/Base.STL"),
        ("model://arm/Meshes/Base.STL", "Meshes/Base.STL"),
        ("$(find arm)/Meshes/Base.STL", "Meshes/Base.STL"),
        ("package://arm-main/Meshes/Base.STL", "Meshes/Base.STL"),
        ("../Meshes/Base.STL", "Meshes/Base.STL"),
        ("file://../Meshes/Base.STL", "Meshes/Base.STL"),
        ("  ../Meshes/./Base.STL ", "Meshes/Base.STL"),
        ("..\\Meshes\\Base.STL", "Meshes/Base.STL"),
        ("package://arm/meshes%20two/upper.stl", "meshes two/upper.stl"),
        ("package://arm/meshes two/upper.stl", "meshes two/upper.stl"),
        ("package://arm/meshes two/50%25.stl", "meshes two/50%25.stl"),
    ],
)
def test_a_name_that_is_right_is_followed_without_a_word(
    robot: Path, uri: str, expected: str
) -> None:
    assert found(robot, uri) == expected
    assert MeshPlaces(robot).find(uri).note == ""


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ("package://arm/meshes/base.stl", "Meshes/Base.STL"),
        ("package://Meshes/Base.STL", "Meshes/Base.STL"),
        ("../MESHES TWO/Upper.stl", "meshes two/upper.stl"),
        ("package://old_name/Meshes/Base.STL", "Meshes/Base.STL"),
        ("/home/author/ws/src/arm/Meshes/Base.STL", "Meshes/Base.STL"),
        ("file:///home/author/Meshes/base.stl", "Meshes/Base.STL"),
        ("C:\\Users\\author\\arm\\Meshes\\Base.STL", "Meshes/Base.STL"),
        ("Meshes/Base.STL", "Meshes/Base.STL"),
    ],
)
def test_a_name_that_is_wrong_is_mended_and_told(robot: Path, uri: str, expected: str) -> None:
    assert found(robot, uri) == expected
    assert expected in MeshPlaces(robot).find(uri).note


def test_absolute_names_inside_the_package_are_read(robot: Path) -> None:
    file = robot.parent.parent / "Meshes" / "Base.STL"
    assert found(robot, str(file)) == found(robot, f"file://{file}") == "Meshes/Base.STL"


@pytest.mark.parametrize(
    "uri",
    [
        "package://arm/meshes/none.stl",
        "",
        ".",
        "..",
        "package://",
        "package://arm",
        "package://arm/",
        "Meshes",
        "a\0b.stl",
        "x" * 5000,
        "/" * 300,
        "%00.stl",
        "%zz.stl",
        "package://../../x.stl",
        "package://.hidden/x.stl",
        "data:,x",
        "~/x.stl",
    ],
)
def test_what_is_nowhere_is_missing(robot: Path, uri: str) -> None:
    with pytest.raises(MeshMissing, match="no such file"):
        MeshPlaces(robot).find(uri)


@pytest.mark.parametrize(
    "uri", ["http://example.org/a.stl", "HTTPS://example.org/a.stl", "ftp://example.org/a.stl"]
)
def test_nothing_is_read_from_the_network(robot: Path, uri: str) -> None:
    with pytest.raises(MeshMissing, match="network"):
        MeshPlaces(robot).find(uri)


def test_a_circle_of_links_is_no_file(robot: Path) -> None:
    (robot.parent / "round.stl").symlink_to("round.stl")
    (robot.parent / "loop").symlink_to("../urdf/loop")
    for uri in ("round.stl", "loop/x.stl", "LOOP/x.stl"):
        with pytest.raises(MeshMissing):
            MeshPlaces(robot).find(uri)


def test_files_outside_are_refused_with_the_way_to_allow_them(robot: Path, tmp_path: Path) -> None:
    outside = put(tmp_path / "elsewhere" / "secret.stl")
    (robot.parent / "linked.stl").symlink_to(outside)

    (robot.parent / "folder").symlink_to(outside.parent)

    for uri in (
        str(outside),
        f"file://{outside}",
        "../../../../elsewhere/secret.stl",
        "linked.stl",
        "package://arm/../../../elsewhere/secret.stl",
        "folder/secret.stl",
        "FOLDER/Secret.stl",
        "..\\..\\..\\..\\elsewhere\\secret.stl",
        "%2e%2e/%2e%2e/%2e%2e/%2e%2e/elsewhere/secret.stl",
    ):
        with pytest.raises(OutsideBorder) as problem:
            MeshPlaces(robot).find(uri)
        assert "is outside the allowed folders" in str(problem.value)
        assert f"--mesh-path {outside.parent}" in str(problem.value)
        assert MeshPlaces(robot, (outside.parent,)).find(uri).path == outside


def test_a_package_beside_is_found_by_its_name_or_its_manifest(robot: Path) -> None:
    group = robot.parent.parent.parent
    put(group / "arm_meshes" / "a.stl")
    put(group / "renamed" / "b.stl")
    put(group / "renamed" / "package.xml", MANIFEST.format("gripper"))
    put(group.parent / "sensors" / "camera" / "package.xml", MANIFEST.format("camera"))
    put(group.parent / "tool" / "package.xml", MANIFEST.format("tool"))
    put(group.parent / "tool" / "c.stl")

    places = MeshPlaces(robot)

    assert places.find("package://arm_meshes/a.stl").path == group / "arm_meshes" / "a.stl"
    assert places.find("package://gripper/b.stl").path == group / "renamed" / "b.stl"
    assert places.find("package://tool/c.stl").path == group.parent / "tool" / "c.stl"


def test_a_folder_farther_away_is_no_package_without_a_manifest(robot: Path) -> None:
    put(robot.parents[3] / "private" / "keys.stl")
    with pytest.raises(
        MeshMissing, match="package 'private' is not found; give its folder with --mesh-path"
    ):
        MeshPlaces(robot).find("package://private/keys.stl")


def test_the_top_folders_of_a_system_are_no_packages() -> None:
    with pytest.raises(MeshMissing):
        MeshPlaces(Path("/robot/urdf/arm.urdf")).find("package://etc/hostname")
    with pytest.raises(MeshMissing):
        MeshPlaces(Path("/etc/robot/urdf/arm.urdf")).find("package://etc/hostname")


@pytest.mark.parametrize(
    ("variable", "place"),
    [
        ("ROS_PACKAGE_PATH", "src/stack/legs"),
        ("AMENT_PREFIX_PATH", "share/legs"),
        ("GZ_SIM_RESOURCE_PATH", "models/legs"),
        ("ROBOT_DESCRIPTIONS_CACHE", "repository/legs"),
    ],
)
def test_packages_are_found_where_ros_and_robot_descriptions_keep_them(
    robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, place: str
) -> None:
    mesh = put(tmp_path / "ros" / place / "leg.stl")
    put(mesh.parent / "package.xml", MANIFEST.format("legs"))

    secret = put(tmp_path / "ros" / "secret.stl")

    with pytest.raises(MeshMissing):
        MeshPlaces(robot).find("package://legs/leg.stl")

    monkeypatch.setenv(variable, str(tmp_path / "ros"))
    places = MeshPlaces(robot)

    assert places.find("package://legs/leg.stl").path == mesh
    with pytest.raises(OutsideBorder):  # what a package is found in is not its part
        places.find(str(secret))


def test_a_repository_is_one_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one folder an arm, of its sibling a hand, both in a third: none has a manifest."""
    source = put(tmp_path / "work" / "repository" / "robots" / "both" / "both.urdf")
    hand = put(tmp_path / "work" / "repository" / "robots" / "hands" / "palm.stl")

    beside = put(tmp_path / "work" / "other" / "x.stl")
    with pytest.raises(OutsideBorder):
        MeshPlaces(source).find("../hands/palm.stl")

    (tmp_path / "work" / "repository" / ".git").mkdir()
    assert package_root(source) == tmp_path / "work" / "repository"

    places = MeshPlaces(source)
    assert (
        places.find("../hands/palm.stl").path
        == places.find("package://hands/palm.stl").path
        == hand
    )
    with pytest.raises(OutsideBorder):
        places.find(str(beside))

    put(source.parent / "package.xml", MANIFEST.format("both"))
    assert package_root(source) == source.parent

    monkeypatch.setattr(Path, "home", lambda: tmp_path / "work" / "repository")
    (source.parent / "package.xml").unlink()
    assert package_root(source) == source.parent  # a home with a repository for its dotfiles


def test_packages_and_files_are_found_below_a_mesh_path(robot: Path, tmp_path: Path) -> None:
    leg = put(tmp_path / "ros" / "share" / "legs" / "leg.stl")
    foot = put(tmp_path / "ros" / "src" / "stack" / "f" / "foot.stl")
    put(foot.parent / "package.xml", MANIFEST.format("feet"))

    places = MeshPlaces(robot, (tmp_path / "ros",))

    assert places.find("package://legs/leg.stl").path == leg
    assert places.find("package://feet/foot.stl").path == foot
    assert MeshPlaces(robot, (leg.parent,)).find("package://unknown/leg.stl").path == leg


@pytest.mark.parametrize(
    ("urdf", "root"),
    [
        ("arm/urdf/a.urdf", "arm"),
        ("arm/robots/a.urdf", "arm"),
        ("arm/a.urdf", "arm"),
        ("arm/my/a.urdf", "arm/my"),
    ],
)
def test_without_a_manifest_the_folder_or_the_one_above_is_the_package(
    tmp_path: Path, urdf: str, root: str
) -> None:
    assert package_root(tmp_path / urdf) == tmp_path / root


def test_the_files_of_a_robot_are_listed_once_with_what_they_name(robot: Path) -> None:
    folder = robot.parent
    put(folder / "a.obj", "mtllib a.mtl\nv 0 0 0\n")
    put(folder / "a.mtl", "newmtl m\nmap_Kd -s 1 1 1 Skin.PNG\nmap_Bump bump.png\n")
    put(folder / "skin.png")
    put(folder / "bump.png")
    put(
        folder / "b.dae",
        '<COLLADA><image id="i"><init_from>tex/b&amp;w.png</init_from></image></COLLADA>',
    )
    put(folder / "tex" / "b&w.png")
    put(
        folder / "c.gltf",
        '{"buffers": [{"uri": "c.bin"}, {"uri": "data:;base64,AA=="}], "images": [{"uri": "no.png"}]}',
    )
    put(folder / "c.bin")
    (folder / "d.dae").symlink_to("/etc/hostname")
    uris = [
        "a.obj",
        "b.dae",
        "c.gltf",
        "a.obj",
        "none.stl",
        "/etc/hostname",
        "d.dae",
        "http://a/b.stl",
    ]
    element = ET.Element("robot")
    for uri in uris:
        ET.SubElement(element, "mesh", filename=uri)

    listed = mesh_files(element, source=robot, options=ImportOptions())

    assert [path.name for path in listed] == [
        "a.obj",
        "a.mtl",
        "skin.png",
        "b.dae",
        "b&w.png",
        "c.gltf",
        "c.bin",
    ]


def test_what_the_name_of_a_package_leads_to_its_path_does_too(robot: Path) -> None:
    other = put(robot.parents[2] / "other-main" / "package.xml", MANIFEST.format("other")).parent
    mesh = put(other / "base.stl")

    # as a xacro writes `$(find other)/base.stl`
    assert MeshPlaces(robot).find(f"file://{mesh}").path == mesh

    (other / "package.xml").unlink()
    with pytest.raises(OutsideBorder):
        MeshPlaces(robot).find(f"file://{mesh}")


@pytest.mark.parametrize(("levels", "is_found"), [(0, True), (4, True), (5, False)])
def test_a_package_begins_at_most_four_folders_above_its_file(
    tmp_path: Path, levels: int, is_found: bool
) -> None:
    package = tmp_path / "package"
    put(package / "package.xml", MANIFEST.format("arm"))
    folder = package.joinpath(*("abcde"[:levels]))

    root = package_root(folder / "arm.urdf")

    assert root == (package if is_found else folder)
