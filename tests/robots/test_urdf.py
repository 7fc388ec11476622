"""URDFs with one defect each: every one is an InvalidModel that names the file and the element."""

import os
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.base.errors import InvalidModel, UnknownName
from simrob_drake.robots.bodies import links_without_inertia, tool_links
from simrob_drake.robots.catalog import Axis, load_robot_from_urdf
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.urdf import (
    joint_limits,
    joint_value,
    movable_joints,
    read_urdf,
    root_link,
    with_absolute_meshes,
)
from simrob_drake.robots.urdf_check import check_urdf, checked_urdf

Write = Callable[[str], Path]

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
BOX = '<box size="0.1 0.1 0.2"/>'
CYLINDER = '<cylinder radius="0.02" length="0.3"/>'
MASS = '<mass value="1"/>'
INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
ORIGIN = '<origin xyz="0 0 0.2" rpy="0 0 0"/>'
END = "</robot>"


def inertia(xx: float, yy: float, zz: float, xy: float = 0.0) -> str:
    return f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="0" iyz="0"/>'


def joint(name: str, parent: str, child: str) -> str:
    return f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'


def finding(path: Path) -> str:
    with pytest.raises(InvalidModel) as problem:
        check_urdf(read_urdf(path), path)
    message = str(problem.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def parsed(root: ET.Element, folder: Path, *, collision: bool) -> MultibodyPlant:
    plant, scene_graph = MultibodyPlant(0.0), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    add_urdf(
        plant,
        with_absolute_meshes(root, folder),
        name="robot",
        where="arm.urdf",
        collision=collision,
    )
    plant.Finalize()
    return plant


def test_a_clean_urdf_passes_and_drake_reads_it(write_urdf: Write, one_joint_urdf: str) -> None:
    path = write_urdf(one_joint_urdf)
    root = read_urdf(path)
    check_urdf(root, path)

    plant = parsed(root, path.parent, collision=True)

    assert plant.num_actuators() == 1
    assert plant.GetJointByName("shoulder").position_upper_limits() == [2.0]


@pytest.mark.parametrize(
    "before",
    ["", "\ufeff", '<?xml version="1.0"?>\n', "<!-- the <robot> of -->\n<!-- <robot -->\n"],
)
@pytest.mark.parametrize(
    "declared", ["", ' xmlns:drake="http://drake.mit.edu"', " xmlns:drake = 'drake'"]
)
def test_elements_of_drake_are_read_whatever_stands_before(
    write_urdf: Write, one_joint_urdf: str, before: str, declared: str
) -> None:
    text = one_joint_urdf.replace('velocity="3"/>', 'velocity="3" drake:acceleration="7"/>')
    root = read_urdf(write_urdf(before + text.replace("<robot", f"<robot{declared}")))

    limit = root.find("joint/limit")

    assert limit is not None
    assert limit.get("{http://drake.mit.edu}acceleration") == "7"


def test_a_clean_urdf_tells_its_joints_and_ends(write_urdf: Write, one_joint_urdf: str) -> None:
    root = read_urdf(write_urdf(one_joint_urdf))

    assert movable_joints(root) == ["shoulder"]

    shoulder, flange = (root.find(f"joint[@name='{name}']") for name in ("shoulder", "flange"))
    assert joint_limits(shoulder) == (-1.0, 2.0)
    assert joint_limits(flange) == (-np.inf, np.inf)
    assert joint_value(shoulder, "effort") == 10.0
    assert joint_value(flange, "effort") == 0.0
    assert root_link(root) == "base"
    assert tool_links(root) == ["tip"]


def test_a_continuous_joint_needs_an_effort_but_no_range(
    write_urdf: Write, one_joint_urdf: str
) -> None:
    text = one_joint_urdf.replace("revolute", "continuous").replace(LIMIT, '<limit effort="10"/>')
    path = write_urdf(text)

    check_urdf(read_urdf(path), path)

    assert joint_limits(read_urdf(path).find("joint[@name='shoulder']")) == (-np.inf, np.inf)


def test_an_unknown_joint_brings_the_nearest_one(write_urdf: Write, one_joint_urdf: str) -> None:
    robot = load_robot_from_urdf(write_urdf(one_joint_urdf))
    wrong = robot.model_copy(update={"axes": {"axis": Axis(joint="sholder")}})
    with pytest.raises(UnknownName, match="did you mean 'shoulder'"):
        _ = wrong.axis_limits


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "is not XML"),
        ("hello", "is not XML"),
        ("<robot><link></robot>", "is not XML"),
        ('<robot name="a"><x:link/></robot>', "is not XML"),
        ('<sdf version="1.9"/>', "<sdf>: the outermost element of a URDF must be <robot>"),
        ('<robot xmlns="http://example.org"/>', "the outermost element of a URDF must be <robot>"),
        (
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"/>',
            "is a xacro file; convert it to a URDF",
        ),
        ('<!DOCTYPE robot SYSTEM "x.dtd"><robot/>', "declares entities or a document type"),
        (
            '<!DOCTYPE r [<!ENTITY a "b">]><robot>&a;</robot>',
            "declares entities or a document type",
        ),
        ('<robot name="a"/>', "has 0 root links"),
    ],
)
def test_what_is_no_urdf_is_named(write_urdf: Write, text: str, expected: str) -> None:
    assert expected in finding(write_urdf(text))


def test_a_xacro_file_is_known_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf.xacro"
    path.write_text("<robot/>")
    assert "is a xacro file" in finding(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert "cannot be read" in finding(tmp_path / "nowhere.urdf")


@pytest.mark.parametrize("content", [b"\x89PNG\xff\xfe\x00", "<robot/>".encode("utf-16")])
def test_a_binary_file_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(content)
    assert "cannot be read (it is not text in UTF-8" in finding(path)


def test_a_path_that_no_file_can_have_is_named() -> None:
    with pytest.raises(InvalidModel, match="cannot be read"):
        read_urdf(Path("a\0b.urdf"))


DEFECTS = [
    pytest.param('name="tip"', 'name="base"', "link 'base': is defined twice", id="link twice"),
    pytest.param(
        'name="flange"', 'name="shoulder"', "joint 'shoulder': is defined twice", id="joint twice"
    ),
    pytest.param(
        '<link name="tip"/>', "<link/>", "<link> number 3: has no name", id="link without name"
    ),
    pytest.param(
        '<joint name="shoulder" type',
        "<joint type",
        "<joint> number 1: has no name",
        id="joint without name",
    ),
    pytest.param(
        '<parent link="base"/>',
        '<parent link="bas"/>',
        "its parent 'bas' is not a link of the robot",
        id="unknown parent",
    ),
    pytest.param(
        '<child link="tip"/>',
        '<child link="tool"/>',
        "its child 'tool' is not a link of the robot",
        id="unknown child",
    ),
    pytest.param(
        '<parent link="base"/>',
        "",
        "joint 'shoulder': its parent '' is not a link of the robot",
        id="no parent",
    ),
    pytest.param(
        '<child link="tip"/>',
        "<child/>",
        "joint 'flange': its child '' is not a link of the robot",
        id="no child",
    ),
    pytest.param(
        END,
        joint("b", "base", "tip") + END,
        "link 'tip': is the child of two joints, 'flange' and 'b'; a URDF must be a tree",
        id="two parents",
    ),
    pytest.param(END, '<link name="island"/>' + END, "has 2 root links", id="two roots"),
    pytest.param(
        END,
        joint("back", "tip", "base") + END,
        "has a kinematic loop: base - upper - tip - base",
        id="loop",
    ),
    pytest.param(
        LIMIT, "", "joint 'shoulder': a revolute or prismatic joint needs a <limit>", id="no limit"
    ),
    pytest.param(
        'upper="2"',
        'upper="-2"',
        "joint 'shoulder' <limit>: lower -1 is not below upper -2",
        id="limits swapped",
    ),
    pytest.param('upper="2"', 'upper="-1"', "lower -1 is not below upper -1", id="limits equal"),
    pytest.param(
        'upper="2"', 'upper="nan"', "joint 'shoulder' <limit>: 'nan' is not finite", id="limit nan"
    ),
    pytest.param(
        'upper="2"', 'upper="inf"', "joint 'shoulder' <limit>: 'inf' is not finite", id="limit inf"
    ),
    pytest.param(
        'upper="2"',
        'upper="1e999"',
        "joint 'shoulder' <limit>: '1e999' is not finite",
        id="limit overflow",
    ),
    pytest.param(
        'lower="-1"',
        'lower="low"',
        "joint 'shoulder' <limit>: 'low' is not a number",
        id="limit text",
    ),
    pytest.param(
        'lower="-1"',
        'lower="-1,5"',
        "joint 'shoulder' <limit>: '-1,5' is not a number",
        id="decimal comma",
    ),
    pytest.param(
        'effort="10"',
        'effort="0"',
        "joint 'shoulder' <limit>: the effort must be positive",
        id="effort 0",
    ),
    pytest.param(
        'effort="10"',
        'effort="-1"',
        "joint 'shoulder' <limit>: effort -1 is negative",
        id="effort negative",
    ),
    pytest.param(
        'velocity="3"', 'velocity="-1"', "<limit>: velocity -1 is negative", id="velocity negative"
    ),
    pytest.param('lower="-1"', "", "joint 'shoulder' <limit>: has no lower", id="no lower limit"),
    pytest.param('lower="-1"', 'lower="-1_0"', "'-1_0' is not a number", id="underscore"),
    pytest.param(
        'effort="10"', 'effort=""', 'effort="" has 0 numbers; it must have 1', id="empty effort"
    ),
    pytest.param(
        'xyz="0 1 0"',
        'xyz="0 1"',
        "joint 'shoulder' <axis>: xyz=\"0 1\" has 2 numbers",
        id="short axis",
    ),
    pytest.param('xyz="0 1 0"', 'xyz="0 0 0"', "joint 'shoulder' <axis>: is zero", id="zero axis"),
    pytest.param(
        'type="revolute"', 'type="floating"', "its type is 'floating'", id="floating joint"
    ),
    pytest.param('type="revolute"', "", "joint 'shoulder': its type is ''", id="no type"),
    pytest.param(
        LIMIT,
        LIMIT + '<mimic joint="flange"/>',
        "joint 'shoulder': mimics another joint",
        id="mimic",
    ),
    pytest.param(
        LIMIT,
        LIMIT + '<mimic joint="flange" multiplier="two"/>',
        "'two' is not a number",
        id="multiplier",
    ),
    pytest.param(
        '<parent link="base"/>',
        '<parent link="upper"/>',
        "link 'upper' to itself",
        id="its own parent",
    ),
    pytest.param(
        'name="base"', 'name="world"', "link 'world': has the name of Drake's own world", id="world"
    ),
    pytest.param(
        "</robot>",
        '<material name="red"/></robot>',
        "material 'red': needs a name and",
        id="no colour",
    ),
    pytest.param(
        "SimpleTransmission",
        "FourBarLinkage",
        "must be SimpleTransmission",
        id="other transmission",
    ),
    pytest.param(BOX, '<box size="0.1 0.2"/>', "has 2 numbers; it must have 3", id="flat box"),
    pytest.param(BOX, "<box/>", "link 'base' <box>: has no size", id="box without size"),
    pytest.param(
        CYLINDER,
        '<mesh filename="m.obj" scale="2 2"/>',
        "has 2 numbers; it must have 1 or 3",
        id="scale of two",
    ),
    pytest.param(
        END,
        '<link name="a"/><link name="b"/>' + joint("ab", "a", "b") + joint("ba", "b", "a") + END,
        "has a kinematic loop: a - b - a",
        id="loop apart",
    ),
    pytest.param(
        END,
        '<transmission name="two"><type>SimpleTransmission</type><joint name="shoulder"/></transmission>'
        + END,
        "joint 'shoulder': has two transmissions",
        id="two transmissions",
    ),
    pytest.param(
        'effort="10"', "", "joint 'shoulder' <limit>: the effort must be positive", id="no effort"
    ),
    pytest.param('effort="10"', 'effort="strong"', "'strong' is not a number", id="effort text"),
    pytest.param(
        'xyz="0 1 0"',
        'xyz="0 one 0"',
        "joint 'shoulder' <axis>: '0 one 0' is not a number",
        id="axis text",
    ),
    pytest.param(
        'xyz="0 0 0.2"',
        'xyz="0 0 nan"',
        "joint 'shoulder' <origin>: '0 0 nan' is not finite",
        id="origin nan",
    ),
    pytest.param(
        'rpy="0 0 0"',
        'rpy="0 inf 0"',
        "joint 'shoulder' <origin>: '0 inf 0' is not finite",
        id="angle inf",
    ),
    pytest.param(
        'damping="0.1"',
        'damping="-1"',
        "joint 'shoulder' <dynamics>: damping is negative",
        id="damping",
    ),
    pytest.param(MASS, "", "link 'upper' <inertial>: needs <mass> and <inertia>", id="no mass"),
    pytest.param(
        INERTIA, "", "link 'upper' <inertial>: needs <mass> and <inertia>", id="no inertia"
    ),
    pytest.param(
        MASS,
        '<mass value="-1"/>',
        "link 'upper' <inertial>: mass -1 kg is negative",
        id="mass negative",
    ),
    pytest.param(
        MASS,
        '<mass value="1kg"/>',
        "link 'upper' <mass>: '1kg' is not a number",
        id="mass with unit",
    ),
    pytest.param(
        MASS, '<mass value="inf"/>', "link 'upper' <mass>: 'inf' is not finite", id="mass inf"
    ),
    pytest.param(
        MASS,
        '<mass value="0"/>',
        "link 'upper' <inertial>: has moments of inertia but no mass",
        id="mass 0",
    ),
    pytest.param(
        MASS,
        "<mass/>",
        "link 'upper' <inertial>: has moments of inertia but no mass",
        id="mass without value",
    ),
    pytest.param(
        'ixx="0.01"', 'ixx="a"', "link 'upper' <inertia>: 'a' is not a number", id="inertia text"
    ),
    pytest.param(
        INERTIA,
        inertia(-0.01, 0.01, 0.01),
        "link 'upper' <inertial>: no body has",
        id="inertia negative",
    ),
    pytest.param(
        INERTIA,
        inertia(0.01, 0.01, 0.03),
        "no body has the principal moments 0.01, 0.01, 0.03",
        id="triangle",
    ),
    pytest.param(
        INERTIA,
        inertia(0.01, 0.01, 0.02000001),
        "no body has the principal",
        id="triangle by rounding",
    ),
    pytest.param(
        INERTIA,
        inertia(0.01, 0.01, 0.01, 0.02),
        "no body has the principal",
        id="products too large",
    ),
    pytest.param(
        BOX,
        '<box size="0 0.1 0.2"/>',
        'has size="0 0.1 0.2"; it must be positive',
        id="box of size 0",
    ),
    pytest.param(
        'length="0.3"',
        'length="-0.3"',
        '<cylinder>: has length="-0.3"; it must be',
        id="length",
    ),
    pytest.param(
        CYLINDER,
        '<sphere radius="big"/>',
        "link 'upper' <sphere>: 'big' is not a number",
        id="radius text",
    ),
    pytest.param(
        CYLINDER,
        '<sphere radius="nan"/>',
        "link 'upper' <sphere>: 'nan' is not finite",
        id="radius nan",
    ),
    pytest.param(
        CYLINDER,
        '<mesh filename="m.obj" scale="x"/>',
        "<mesh>: 'x' is not a number",
        id="scale text",
    ),
    pytest.param(
        '<joint name="shoulder"/>',
        "",
        "joint 'shoulder': has no <transmission>",
        id="no transmission",
    ),
]


@pytest.mark.parametrize(("good", "bad", "expected"), DEFECTS)
def test_a_defect_is_found_and_named(
    write_urdf: Write, one_joint_urdf: str, good: str, bad: str, expected: str
) -> None:
    assert good in one_joint_urdf
    assert expected in finding(write_urdf(one_joint_urdf.replace(good, bad, 1)))


def test_a_flat_body_may_have_one_moment_equal_to_the_others_sum(
    write_urdf: Write, one_joint_urdf: str
) -> None:
    path = write_urdf(one_joint_urdf.replace(INERTIA, inertia(0.01, 0.02, 0.03)))
    root = read_urdf(path)
    check_urdf(root, path)
    moments = (
        parsed(root, path.parent, collision=False).GetBodyByName("upper").default_spatial_inertia()
    )

    about_com = moments.Shift(moments.get_com()).CopyToFullMatrix6()[:3, :3]

    np.testing.assert_allclose(np.diag(about_com), [0.01, 0.02, 0.03], atol=1e-15)


def test_moving_links_without_mass_are_listed(write_urdf: Write, one_joint_urdf: str) -> None:
    assert links_without_inertia(read_urdf(write_urdf(one_joint_urdf))) == []

    start, end = (
        one_joint_urdf.index("<inertial>"),
        one_joint_urdf.index("</inertial>") + len("</inertial>"),
    )
    text = one_joint_urdf.replace(one_joint_urdf[start:end], "")

    assert links_without_inertia(read_urdf(write_urdf(text))) == ["upper"]


def test_mass_behind_a_fixed_joint_counts_for_the_link_that_moves(
    write_urdf: Write, one_joint_urdf: str
) -> None:
    start, end = (
        one_joint_urdf.index("<inertial>"),
        one_joint_urdf.index("</inertial>") + len("</inertial>"),
    )
    inertial = one_joint_urdf[start:end]

    text = one_joint_urdf.replace(inertial, "").replace(
        '<link name="tip"/>', f'<link name="tip">{inertial}</link>'
    )

    assert links_without_inertia(read_urdf(write_urdf(text))) == []


@pytest.mark.parametrize(
    ("filename", "expected"),
    [
        ("missing.obj", "there is no file"),
        ("", "there is no file"),
        ("folder.obj", "there is no file"),
        ("../outside.obj", "is outside the robot's folder"),
        ("linked.obj", "is outside the robot's folder"),
        ("/etc/hostname", "is outside the robot's folder"),
        ("file:///etc/hostname", "is outside the robot's folder"),
        ("mesh.stl", "Drake cannot read; convert it to one of .obj, .gltf, .vtk"),
        ("package://arm/mesh.obj", "packages are not resolved here"),
        ("http://example.org/mesh.obj", "packages are not resolved here"),
    ],
)
def test_a_mesh_that_cannot_be_used_is_named(
    write_urdf: Write, one_joint_urdf: str, filename: str, expected: str
) -> None:
    path = write_urdf(one_joint_urdf.replace(CYLINDER, f'<mesh filename="{filename}"/>'))
    (path.parent / "mesh.stl").write_text("solid")
    (path.parent / "folder.obj").mkdir()
    outside = path.parent.parent / "outside.obj"
    outside.write_text(TETRAHEDRON)
    (path.parent / "linked.obj").symlink_to(outside)
    root = read_urdf(path)

    check_urdf(root, path)

    with pytest.raises(InvalidModel, match=f"mesh '{filename}'") as problem:
        with_absolute_meshes(root, path.parent)
    assert expected in str(problem.value)


@pytest.mark.parametrize(
    "name", ["mesh.obj", "two words.obj", "cañón.obj", "50%20.obj", "a&amp;b.obj", "./sub/mesh.obj"]
)
@pytest.mark.parametrize("role", ["visual", "collision"])
def test_a_mesh_in_the_folder_reaches_drake_whatever_its_name(
    write_urdf: Write, one_joint_urdf: str, name: str, role: str
) -> None:
    shape = f'<{role}><geometry><mesh filename="{name}"/></geometry></{role}>'
    path = write_urdf(
        one_joint_urdf.replace('<link name="tip"/>', f'<link name="tip">{shape}</link>')
    )
    file = path.parent / name.replace("&amp;", "&")
    file.parent.mkdir(exist_ok=True)
    file.write_text(TETRAHEDRON)
    plant = parsed(read_urdf(path), path.parent, collision=True)
    body = plant.GetFrameByName(
        "tip"
    ).body()  # it is fixed to "upper", which has a visual of its own

    visuals, collisions = (
        plant.GetVisualGeometriesForBody(body),
        plant.GetCollisionGeometriesForBody(body),
    )

    assert (len(visuals), len(collisions)) == ((2, 0) if role == "visual" else (1, 1))


def test_without_collision_only_the_visuals_stay(write_urdf: Write, one_joint_urdf: str) -> None:
    path = write_urdf(one_joint_urdf)
    root = read_urdf(path)

    plant = parsed(root, path.parent, collision=False)

    assert plant.num_collision_geometries() == 0
    assert len(plant.GetVisualGeometriesForBody(plant.GetBodyByName("upper"))) == 1
    assert root.find("link/collision") is not None  # the element that was given is not changed


def test_names_that_no_mesh_can_have_are_refused(write_urdf: Write, one_joint_urdf: str) -> None:
    path = write_urdf(one_joint_urdf.replace(CYLINDER, f'<mesh filename="{"a" * 300}.obj"/>'))

    with pytest.raises(InvalidModel, match="cannot be the name of a file"):
        with_absolute_meshes(read_urdf(path), path.parent)

    (path.parent / "round.obj").symlink_to("round.obj")
    path = write_urdf(one_joint_urdf.replace(CYLINDER, '<mesh filename="round.obj"/>'))

    with pytest.raises(InvalidModel, match="round"):
        with_absolute_meshes(read_urdf(path), path.parent)


@pytest.mark.parametrize(
    "declared", ["", ' xmlns:drake="http://drake.mit.edu"', " xmlns:drake='elsewhere'"]
)
def test_elements_of_drake_itself_are_kept(
    write_urdf: Write, one_joint_urdf: str, declared: str
) -> None:
    text = one_joint_urdf.replace('velocity="3"/>', 'velocity="3" drake:acceleration="7"/>')
    path = write_urdf(text.replace('<robot name="arm">', f'<robot name="arm"{declared}>'))

    plant = parsed(read_urdf(path), path.parent, collision=True)

    assert plant.GetJointByName("shoulder").acceleration_upper_limits() == [7.0]


def test_a_file_of_the_same_name_elsewhere_is_another(
    tmp_path: Path, one_joint_urdf: str, monkeypatch
) -> None:
    """Also where both are as large and as old: what was read of one is not what is remembered of the other."""
    for folder, link in (("one", "upper"), ("two", "other")):
        (tmp_path / folder).mkdir()
        file = tmp_path / folder / "arm.urdf"
        file.write_text(one_joint_urdf.replace('"upper"', f'"{link}"'))
        os.utime(file, (1e9, 1e9))
        monkeypatch.chdir(tmp_path / folder)
        links = [one.get("name") for one in checked_urdf(Path("arm.urdf")).iterfind("link")]
        assert links == ["base", link, "tip"]
