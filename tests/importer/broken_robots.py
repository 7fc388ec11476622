"""Two sound robots, and a table of everything that published URDFs get wrong: one defect each.

A defect is a name, what it does to a sound robot, and what an import makes of it: ``"<kind>: <words>"`` is a line that
its report must hold, ``"error: <words>"`` the refusal. Most defects are `swap`\\ s in the text of the arm.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh

from simrob_drake.robots.imports import ImportOptions


def _inertial(mass: float, moments: tuple[float, float, float], height: float) -> str:
    xx, yy, zz = moments
    inertia = f'<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>'
    return f'<inertial><origin xyz="0 0 {height}"/><mass value="{mass}"/>{inertia}</inertial>'


def _joint(name: str, parent: str, child: str, kind: str = "fixed", inside: str = "") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def _drive(joint: str) -> str:
    kind = "<type>transmission_interface/SimpleTransmission</type>"
    return f'<transmission name="{joint}_t">{kind}<joint name="{joint}"/><actuator name="{joint}_m"/></transmission>'


END = "</robot>"
FOOT_MESH = 'filename="package://arm_support/meshes/foot.stl"'
FOOT_MATERIAL = '<material name="orange"/>'
ORANGE = '<material name="orange"><color rgba="1 0.5 0 1"/></material>'
UPPER_BOX = '<box size="0.08 0.08 0.4"/>'
UPPER_INERTIAL = _inertial(2.5, (0.034, 0.035, 0.003), 0.2)
HAND_INERTIAL = _inertial(0.5, (0.0011, 0.0012, 0.0013), 0.04)
HAND_POINT = _inertial(0.5, (0, 0, 0), 0.04)
SHOULDER_LIMIT = '<limit lower="-2.5" upper="2.6" effort="80" velocity="3"/>'
ELBOW = '<joint name="elbow" type="revolute">'
ELBOW_LIMIT = '<limit lower="-1.5" upper="2" effort="40" velocity="4"/>'
ELBOW_DRIVE = _drive("elbow")
FLANGE = _joint("flange", "hand", "tcp", inside='<origin xyz="0 0 0.1"/>')

ARM = f"""<?xml version="1.0"?>
<robot name="arm">
  {ORANGE}
  <link name="foot">
    {_inertial(4, (0.021, 0.022, 0.023), 0.05)}
    <visual><geometry><mesh {FOOT_MESH}/></geometry>{FOOT_MATERIAL}</visual>
    <collision><geometry><cylinder radius="0.1" length="0.06"/></geometry></collision>
  </link>
  <link name="upper">
    {UPPER_INERTIAL}
    <visual><geometry><mesh filename="package://arm_support/meshes/upper.dae"/></geometry></visual>
    <collision><origin xyz="0 0 0.2"/><geometry>{UPPER_BOX}</geometry></collision>
  </link>
  <link name="lower">
    {_inertial(1.5, (0.011, 0.012, 0.002), 0.15)}
    <visual><geometry><mesh filename="../meshes/lower.obj"/></geometry></visual>
    <collision><geometry><mesh filename="../meshes/lower.obj"/></geometry></collision>
  </link>
  <link name="hand">
    {HAND_INERTIAL}
    <visual><geometry><mesh filename="package://arm_support/meshes/hand.glb" scale="0.5 0.5 0.5"/></geometry></visual>
    <collision><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <link name="tcp"/>
  <joint name="shoulder" type="revolute">
    <parent link="foot"/><child link="upper"/>
    <origin xyz="0 0 0.1" rpy="0 0 0"/><axis xyz="0 1 0"/>{SHOULDER_LIMIT}<dynamics damping="0.2"/>
  </joint>
  {ELBOW}
    <parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.4" rpy="0 0 0.1"/><axis xyz="0 0.6 0.8"/>{ELBOW_LIMIT}<dynamics damping="0.1"/>
  </joint>
  <joint name="wrist" type="continuous">
    <parent link="lower"/><child link="hand"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/><limit effort="10" velocity="5"/>
  </joint>
  {FLANGE}
  {_drive("shoulder")}
  {ELBOW_DRIVE}
  {_drive("wrist")}
{END}
"""
"""Three joints, meshes of four formats, nothing wrong."""


def _leg(side: str, y: float) -> str:
    limit = '<limit lower="-1" upper="1.2" effort="30" velocity="9"/>'
    text, parent = "", "trunk"
    for part, place in (("hip", f"0 {y} 0"), ("thigh", "0 0 -0.05"), ("shin", "0 0 -0.2")):
        link = f"{side}_{part}"
        collision = '<collision><origin xyz="0 0 -0.1"/><geometry><box size="0.04 0.04 0.2"/></geometry></collision>'
        inside = f'<origin xyz="{place}"/><axis xyz="0 1 0"/>{limit}'
        text += f'<link name="{link}">{_inertial(0.4, (0.0014, 0.0014, 0.0002), -0.1)}{collision}</link>'
        text += _joint(f"{link}_joint", parent, link, "revolute", inside) + _drive(f"{link}_joint")
        parent = link
    return text


TRUNK_BOX = '<box size="0.3 0.2 0.1"/>'
LEGS = f"""<robot name="legs">
<link name="trunk">{_inertial(6, (0.03, 0.05, 0.07), 0)}
<visual><geometry>{TRUNK_BOX}</geometry></visual><collision><geometry>{TRUNK_BOX}</geometry></collision></link>
{_leg("left", 0.1)}
{_leg("right", -0.1)}
{END}
"""
"""Two legs of three joints, and nothing but primitives: the base floats."""


def exported(mesh: trimesh.Trimesh, kind: str) -> bytes:
    content = mesh.export(file_type=kind)
    return content.encode() if isinstance(content, str) else bytes(content)


HAND = exported(trimesh.creation.box((0.1, 0.2, 0.16)), "glb")


def binary_stl(triangles: np.ndarray) -> bytes:
    """Return an STL of triangles (n, 3, 3), good ones or not."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    faces = np.zeros(len(triangles), record)
    faces["corners"] = triangles
    return bytes(80) + len(faces).to_bytes(4, "little") + faces.tobytes()


TETRAHEDRON = (
    np.array(
        [[[0, 0, 0], [0, 1, 0], [1, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 1]]] * 2, dtype=float
    )
    / 10
)
TETRAHEDRON[2:] = (
    np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 0], [0, 0, 0], [0, 0, 1]]]) / 10
)

OBJ = (
    """mtllib lower.mtl
v -30 -30 0\nv 30 -30 0\nv 0 40 0\nv 0 0 300
usemtl body\nf 1 3 2\nf 1 2 4\nusemtl tip\nf 2 3 4\nf 3 1 4
""".replace("30 ", ".03 ")
    .replace("40 ", ".04 ")
    .replace(" 300", " .3")
)
MTL = "newmtl body\nKd 0.2 0.2 0.8\nnewmtl tip\nKd 0.9 0.9 0.9\n"

_LOOK = """<effect id="{0}_fx"><profile_COMMON><technique sid="t"><lambert>
<diffuse><color>{1}</color></diffuse></lambert></technique></profile_COMMON></effect>"""
_FACES = '<triangles count="2" material="{0}"><input semantic="VERTEX" source="#v" offset="0"/><p>{1}</p></triangles>'
DAE = f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="millimeter" meter="0.001"/><up_axis>Z_UP</up_axis></asset>
<library_effects>{_LOOK.format("red", "1 0 0 1")}{_LOOK.format("grey", "0.5 0.5 0.5 1")}</library_effects>
<library_materials><material id="red"><instance_effect url="#red_fx"/></material>
<material id="grey"><instance_effect url="#grey_fx"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">-40 -40 0 40 -40 0 0 50 0 0 0 400</float_array>
<technique_common><accessor source="#pa" count="4" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
{_FACES.format("a", "0 2 1 0 1 3")}{_FACES.format("b", "1 2 3 2 0 3")}
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="a" target="#red"/><instance_material symbol="b" target="#grey"/>
</technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""
FOOT = exported(trimesh.creation.cylinder(radius=0.1, height=0.06, sections=12), "stl")


@dataclass
class Package:
    """The files of a robot before they are written, for a defect to change.

    Attributes:
        text: of the URDF.
        content: of the URDF where it is no text in UTF-8.
        files: by their path in the package; ``../`` leads out of it.
        links: symbolic ones, by path, to where they lead.
    """

    text: str = ARM
    content: bytes | None = None
    files: dict[str, bytes] = field(
        default_factory=lambda: {
            "package.xml": b"<package format='2'><name>arm_support</name></package>",
            "meshes/foot.stl": FOOT,
            "meshes/upper.dae": DAE.encode(),
            "meshes/lower.obj": OBJ.encode(),
            "meshes/lower.mtl": MTL.encode(),
            "meshes/hand.glb": HAND,
            "../plate_pkg/package.xml": b"<package><name>plate_support</name></package>",
            "../plate_pkg/plate.stl": FOOT,
            "../../secret.stl": FOOT,
        }
    )
    links: dict[str, str] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write all into ``folder/ros/arm_support`` and return the URDF."""
        root = folder / "ros" / "arm_support"
        urdf = root / "urdf" / "arm.urdf"
        urdf.parent.mkdir(parents=True)
        for name, content in self.files.items():
            file = root / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        for name, target in self.links.items():
            (root / name).symlink_to(target)
        urdf.write_bytes(self.text.encode() if self.content is None else self.content)
        return urdf


Harm = Callable[[Package], None]


@dataclass(frozen=True)
class Defect:
    """One thing that is wrong or odd.

    Attributes:
        name: in words.
        harm: puts it into a sound robot.
        expected: a line of the report, ``<kind>: <words>``, or the refusal, ``error: <words>``.
        sound: the robot's text before.
        options: of the import.
    """

    name: str
    harm: Harm
    expected: str
    sound: str = ARM
    options: ImportOptions = field(default_factory=ImportOptions)

    def package(self) -> Package:
        """Return the broken robot."""
        package = Package(self.sound)
        self.harm(package)
        return package


class Absent(Exception):
    """A text that a defect changes is not there: another defect came first."""


@dataclass(frozen=True)
class Swap:
    """A harm that changes only the text: one piece of it for another."""

    good: str
    bad: str

    def __call__(self, package: Package) -> None:
        """Change the first one."""
        if self.good not in package.text:
            raise Absent(self.good)
        package.text = package.text.replace(self.good, self.bad, 1)


def swap(good: str, bad: str) -> Swap:
    return Swap(good, bad)


def add(more: str) -> Swap:
    """Put something at the end of the robot."""
    return Swap(END, more + END)


def foot(uri: str) -> Swap:
    """Name the mesh of the foot otherwise."""
    return Swap(FOOT_MESH, f'filename="{uri}"')


def foot_scale(scale: str) -> Swap:
    return Swap(FOOT_MESH, f'{FOOT_MESH} scale="{scale}"')


def upper_inertia(xx: object, yy: object, zz: object, xy: object = 0) -> Swap:
    moments = f'<inertia ixx="{xx}" ixy="{xy}" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>'
    return Swap(UPPER_INERTIAL[UPPER_INERTIAL.index("<inertia ") :], f"{moments}</inertial>")


def elbow_limit(text: str) -> Swap:
    return Swap(ELBOW_LIMIT, text)


def file(name: str, content: bytes | str) -> Harm:
    """Put a file into the package, or another in its place."""

    def harm(package: Package) -> None:
        package.files[name] = content.encode() if isinstance(content, str) else content

    return harm


def link(name: str, target: str) -> Harm:
    def harm(package: Package) -> None:
        package.links[name] = target

    return harm


def without(name: str) -> Harm:
    def harm(package: Package) -> None:
        del package.files[name]

    return harm


def content(make: Callable[[str], bytes]) -> Harm:
    """Make other bytes of the URDF's text."""

    def harm(package: Package) -> None:
        package.content = make(package.text)

    return harm


def all_of(*harms: Harm) -> Harm:
    def harm(package: Package) -> None:
        for one in harms:
            one(package)

    return harm


def foot_file(name: str, content: bytes | str) -> Harm:
    """Give the foot a mesh of its own."""
    return all_of(file(f"meshes/{name}", content), foot(f"package://arm_support/meshes/{name}"))


ESTIMATE = ImportOptions(estimate_inertia=True)
NAN_STL = TETRAHEDRON.copy()
NAN_STL[0, 0, 0] = np.nan
FLAT = (
    np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=float)
    / 10
)
NEEDLES = np.repeat(np.array([[[0, 0, 0], [1, 0, 0], [2, 0, 0]]], dtype=float), 4, axis=0)
MIXED = binary_stl(np.concatenate([TETRAHEDRON, NEEDLES]))
ASCII_STL = exported(trimesh.creation.box((0.2, 0.2, 0.06)), "stl_ascii")
GLB = exported(trimesh.creation.box((0.1, 0.2, 0.16)), "glb")
CIRCLE = DAE.replace("<instance_geometry", '<instance_node url="#n"/><instance_geometry')
TEXTURE = '<material name="orange"><texture filename="wood.png"/></material>'
CONTROL = '<ros2_control name="c" type="system"><joint name="elbow"/></ros2_control>'
ROS2_DRIVE = ELBOW_DRIVE.replace("<type>", "<plugin>").replace("</type>", "</plugin>")
UNTYPED_DRIVE = ELBOW_DRIVE.replace("<type>transmission_interface/SimpleTransmission</type>", "")
FOUR_BAR_DRIVE = ELBOW_DRIVE.replace("transmission_interface/Simple", "FourBarLinkage")
DIFFERENTIAL = ELBOW_DRIVE.replace("Simple", "Differential").replace(
    "<act", '<joint name="wrist"/><act'
)
BOMB = '<!DOCTYPE COLLADA [<!ENTITY a "lol"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
FINGER = '<link name="finger"/>' + _joint("grip", "hand", "finger", "revolute", "{}")
ANOTHER_ARM = '<link name="a"/><link name="b"/>' + _joint("c", "a", "b", "continuous")


def huge_foot(package: Package) -> None:
    sphere = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    foot_file("a.stl", exported(sphere, "stl"))(package)


def fixed_all(package: Package) -> None:
    for kind in ("revolute", "continuous"):
        package.text = package.text.replace(f'type="{kind}"', 'type="fixed"')


def bare(package: Package) -> None:
    """Take all inertias out."""
    package.text = re.sub("<inertial>.*?</inertial>", "", package.text)


def on_world(package: Package) -> None:
    add('<link name="world"/>' + _joint("stand", "world", "trunk"))(package)


def slide(kind: str, limit: str) -> Harm:
    """Make the elbow slide, within these limits."""
    return all_of(swap(ELBOW, ELBOW.replace(kind, "prismatic")), elbow_limit(limit))


def _glb(header: str) -> bytes:
    data = header.encode().ljust(-(-len(header) // 4) * 4)
    sizes = (2, 20 + len(data), len(data))
    return b"glTF" + b"".join(size.to_bytes(4, "little") for size in sizes) + b"JSON" + data


BILLIONS = _glb('{"asset": {"version": "2.0"}, "accessors": [{"count": 4000000000}]}')

RESOLVING = [
    Defect(
        "package of a sibling folder",
        foot("package://plate_support/plate.stl"),
        "repaired: plate.stl' (48 faces)",
    ),
    Defect(
        "model",
        foot("model://arm_support/meshes/foot.stl"),
        "repaired: foot.stl' (48 faces) becomes",
    ),
    Defect("relative path", foot("../meshes/foot.stl"), "repaired: foot.stl' (48 faces) becomes"),
    Defect(
        "no way up",
        foot("meshes/foot.stl"),
        "repaired: (48 faces) becomes meshes/foot_visual_1.obj; found as",
    ),
    Defect(
        "path of its author",
        foot("file:///home/ann/arm/meshes/foot.stl"),
        "repaired: found as meshes/foot.stl",
    ),
    Defect(
        "path of Windows", foot(r"C:\ann\meshes\foot.stl"), "repaired: found as meshes/foot.stl"
    ),
    Defect(
        "wrong case",
        foot("package://arm_support/Meshes/Foot.STL"),
        "repaired: found as meshes/foot.stl",
    ),
    Defect(
        "backslashes",
        foot(r"package://arm_support\meshes\foot.stl"),
        "repaired: foot.stl' (48 faces) becomes",
    ),
    Defect(
        "xacro's find",
        foot("$(find arm_support)/meshes/foot.stl"),
        "repaired: foot.stl' (48 faces) becomes",
    ),
    Defect(
        "blanks in percent",
        foot_file("my%20foot.stl", FOOT),
        "repaired: my%20foot.stl' (48 faces) becomes",
    ),
    Defect(
        "unknown package",
        foot("package://other/meshes/foot.stl"),
        "repaired: found as meshes/foot.stl",
    ),
    Defect(
        "missing mesh",
        foot("package://arm_support/none.stl"),
        "dropped: none.stl' there is no such file",
    ),
    Defect(
        "missing mesh of a missing package",
        foot("package://other/x.stl"),
        "dropped: package 'other' is not found",
    ),
    Defect("mesh without a name", foot(""), "dropped: link 'foot' <visual>: mesh ''"),
    Defect(
        "mesh without a file name", swap(FOOT_MESH, ""), "dropped: link 'foot' <visual>: mesh ''"
    ),
    Defect(
        "mesh is a folder",
        foot("package://arm_support/meshes"),
        "dropped: mesh 'package://arm_support/meshes'",
    ),
    Defect("outside by dots", foot("../../../secret.stl"), "error: is outside the allowed folders"),
    Defect(
        "outside by package",
        foot("package://arm_support/../../secret.stl"),
        "error: is outside the allowed",
    ),
    Defect(
        "outside by a link",
        all_of(link("meshes/out.stl", "../../../secret.stl"), foot("../meshes/out.stl")),
        "error: mesh '../meshes/out.stl': is outside the allowed folders",
    ),
    Defect(
        "link in a circle",
        all_of(link("a.stl", "a.stl"), foot("../a.stl")),
        "dropped: there is no such file",
    ),
    Defect(
        "on the network", foot("https://example.org/meshes/foot.stl"), "dropped: is on the network"
    ),
    Defect("device", foot("/dev/zero"), "dropped: mesh '/dev/zero' there is no such file"),
    Defect("no manifest", without("package.xml"), "repaired: foot.stl' (48 faces) becomes"),
    Defect(
        "manifest is garbage",
        file("package.xml", b"\xff\0<"),
        "repaired: foot.stl' (48 faces) becomes",
    ),
]

MESHES = [
    Defect("STL in words", foot_file("a.stl", ASCII_STL), "repaired: a.stl' (12 faces) becomes"),
    Defect(
        "STL in words, cut off",
        foot_file("a.stl", ASCII_STL[:700]),
        "dropped: a.stl' contains no triangles",
    ),
    Defect(
        "binary STL that begins as words",
        foot_file("a.stl", b"solid" + FOOT[5:]),
        "repaired: a.stl' (48 faces)",
    ),
    Defect("STL in capitals", foot_file("A.STL", FOOT), "repaired: A.STL' (48 faces) becomes"),
    Defect(
        "STL cut off",
        foot_file("a.stl", FOOT[:700]),
        "dropped: a.stl' is cut off: it contains 12 of its 48 faces",
    ),
    Defect(
        "STL with more behind",
        foot_file("a.stl", FOOT + b"more"),
        "read: has 4 bytes after its last face, which are ignored",
    ),
    Defect(
        "STL of garbage", foot_file("a.stl", bytes(range(256)) * 9), "dropped: a.stl' is cut off"
    ),
    Defect("empty STL", foot_file("a.stl", b""), "dropped: a.stl' is empty"),
    Defect("STL of no faces", foot_file("a.stl", binary_stl(FLAT[:0])), "dropped: a.stl' is empty"),
    Defect(
        "faces without area",
        foot_file("a.stl", binary_stl(NEEDLES)),
        "dropped: contains no triangle with an area",
    ),
    Defect(
        "some faces without area",
        foot_file("a.stl", MIXED),
        "repaired: 4 degenerate faces left out",
    ),
    Defect(
        "corner that is no number",
        foot_file("a.stl", binary_stl(NAN_STL)),
        "repaired: 1 degenerate faces left",
    ),
    Defect("flat mesh", foot_file("a.stl", binary_stl(FLAT)), "repaired: a.stl' (2 faces) becomes"),
    Defect(
        "flat mesh to collide with",
        all_of(
            foot_file("a.stl", binary_stl(FLAT)),
            swap("</inertial>\n    <visual>", "</inertial><collision>"),
            swap(f"</geometry>{FOOT_MATERIAL}</visual>", "</geometry></collision>"),
        ),
        "repaired: thickened to",
    ),
    Defect(
        "huge mesh",
        huge_foot,
        "repaired: (81920 faces) becomes meshes/foot_visual_1.obj; decimated from 81920",
    ),
    Defect(
        "200 MB",
        foot_file("a.stl", bytes(200_000_000)),
        "dropped: a.stl' cannot be read (it is larger than 100 MB)",
    ),
    Defect(
        "unknown format",
        foot_file("foot.step", FOOT),
        "dropped: has the format '.step', which is not read",
    ),
    Defect("STL called OBJ", foot_file("foot.obj", FOOT), "dropped: foot.obj'"),
    Defect(
        "DAE with entities",
        file("meshes/upper.dae", DAE.replace("<COLL", f"{BOMB}<COLL")),
        "dropped: entities",
    ),
    Defect(
        "DAE cut off",
        file("meshes/upper.dae", DAE[:900]),
        "dropped: upper.dae' is not readable as DAE",
    ),
    Defect(
        "DAE with Y up",
        file("meshes/upper.dae", DAE.replace("Z_UP", "Y_UP")),
        "read: has the up axis Y_UP, which is ignored",
    ),
    Defect(
        "DAE in inches",
        file("meshes/upper.dae", DAE.replace('"0.001"', '"25.4"')),
        "read: is 10160 m large",
    ),
    Defect(
        "DAE of a circle",
        file("meshes/upper.dae", CIRCLE),
        "dropped: upper.dae' has more than 20000 nodes",
    ),
    Defect(
        "OBJ without its library",
        without("meshes/lower.mtl"),
        "repaired: materials missing: lower.mtl",
    ),
    Defect(
        "library outside",
        file("meshes/lower.obj", OBJ.replace("lower.mtl", "../../../secret.stl")),
        "error: outs",
    ),
    Defect(
        "OBJ of wrong corners", file("meshes/lower.obj", OBJ + "f 1 2 99\n"), "dropped: lower.obj'"
    ),
    Defect(
        "OBJ of points",
        file("meshes/lower.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        "dropped: contains no triangles",
    ),
    Defect("GLB cut off", file("meshes/hand.glb", GLB[:200]), "dropped: hand.glb'"),
    Defect(
        "GLB of garbage",
        file("meshes/hand.glb", b"glTF" + bytes(100)),
        "dropped: hand.glb' is not readable",
    ),
    Defect(
        "GLB of billions",
        file("meshes/hand.glb", BILLIONS),
        "dropped: declares more data than a mesh has",
    ),
    Defect("scale one number", foot_scale("0.5"), "repaired: scaled by 0.5"),
    Defect("scale mirrors", foot_scale("1 -1 1"), "repaired: scaled by 1 -1 1"),
    Defect(
        "scale zero",
        foot_scale("0 1 1"),
        'repaired: scale="0 1 1" is not one or three numbers other than 0',
    ),
    Defect("scale is no number", foot_scale("nan nan nan"), 'dropped: scale="nan nan nan" is not'),
    Defect(
        "scale of two numbers",
        foot_scale("1 1"),
        'dropped: scale="1 1" is not 1 or 3 finite numbers',
    ),
    Defect(
        "scale in commas",
        foot_scale("0,5 0,5 0,5"),
        'repaired: scale="0,5 0,5 0,5" written as "0.5 0.5 0.5"',
    ),
    Defect(
        "drawn in millimetres",
        foot_scale("1000 1000 1000"),
        "read: m large; if it was drawn in millimetres",
    ),
]

SHAPES = [
    Defect(
        "box of size zero",
        swap(UPPER_BOX, '<box size="0 0 0"/>'),
        "dropped: link 'upper' <collision>: <box> has",
    ),
    Defect(
        "box of two numbers",
        swap(UPPER_BOX, '<box size="1 1"/>'),
        'dropped: size="1 1" is not 3 finite numbers',
    ),
    Defect("box without size", swap(UPPER_BOX, "<box/>"), "dropped: <box> has no size"),
    Defect(
        "negative radius",
        swap('<sphere radius="0.05"/>', '<sphere radius="-0.05"/>'),
        "dropped: it must be positive",
    ),
    Defect(
        "cylinder of length nan",
        swap('length="0.06"', 'length="nan"'),
        "dropped: <cylinder> has no length",
    ),
    Defect("unknown shape", swap(UPPER_BOX, "<cone/>"), "dropped: <cone> in <geometry>: 1 ×"),
    Defect(
        "two shapes",
        swap(UPPER_BOX, f'{UPPER_BOX}<sphere radius="1"/>'),
        "dropped: <sphere> is left out: a <geometry> has one shape",
    ),
    Defect(
        "no geometry", swap(f"<geometry>{UPPER_BOX}</geometry>", ""), "dropped: has no <geometry>"
    ),
    Defect(
        "place of two numbers",
        swap('<origin xyz="0 0 0.2"/>', '<origin xyz="0 0.2"/>'),
        'defaulted: xyz="0 0.2"',
    ),
]

NAMES = [
    Defect(
        "robot without a name",
        swap('<robot name="arm">', "<robot>"),
        "repaired: has no name; named 'arm'",
    ),
    Defect(
        "joint without a name",
        swap(' name="elbow"', ""),
        "repaired: joint 'upper_to_lower': has no name in the file",
    ),
    Defect(
        "link without a name",
        swap('<link name="tcp"/>', "<link/>"),
        "repaired: link 'tcp': has no name in the file; joints refer",
    ),
    Defect(
        "two links without names",
        add("<link/><link/>"),
        "repaired: link 'link_2': has no name in the file",
    ),
    Defect(
        "blanks around a name",
        swap('link="tcp"', 'link=" tcp"'),
        "repaired: link=' tcp' has blanks at its ends",
    ),
    Defect(
        "name in another case",
        swap('child link="tcp"', 'child link="TCP"'),
        "repaired: which differs in case",
    ),
    Defect(
        "link twice, the same", add('<link name="tcp"/>'), "dropped: link 'tcp': is defined twice"
    ),
    Defect(
        "link twice, different",
        add('<link name="upper"><visual/></link>'),
        "error: link 'upper': is defined twice",
    ),
    Defect(
        "joint twice, the same",
        add(FLANGE),
        "dropped: joint 'flange': is defined twice with the same content",
    ),
    Defect(
        "joint twice, different",
        add(_joint("flange", "lower", "tcp")),
        "error: joint 'flange': is defined twice",
    ),
    Defect(
        "two joints of a name",
        add('<link name="pin"/>' + _joint("elbow", "hand", "pin")),
        "repaired: joint 'elbow_2': was a second joint with the name 'elbow'",
    ),
    Defect(
        "names of any letters",
        swap('name="elbow"', 'name="codo/é 1"'),
        "dropped: 'elbow': this is not a joint that moves",
    ),
    Defect(
        "name as Drake's world",
        swap('name="tcp"', 'name="world"'),
        "dropped: joint 'flange': its <child> 'tcp' is not",
    ),
    Defect(
        "material not defined",
        swap(ORANGE, ""),
        "defaulted: material 'orange': is not defined; a grey",
    ),
    Defect("material twice", swap(ORANGE, ORANGE * 2), "dropped: twice, with the same colour"),
    Defect(
        "material redefined",
        add(ORANGE.replace("0.5", "0.1")),
        "dropped: is defined again with the colour",
    ),
    Defect("colour of three", swap("1 0.5 0 1", "1 0.5 0"), 'repaired: written as "1 0.5 0 1"'),
    Defect("colour to 255", swap("1 0.5 0 1", "255 128 0 255"), "repaired: material 'orange'"),
    Defect(
        "colour in words",
        swap("1 0.5 0 1", "orange"),
        'dropped: rgba="orange" is not 3 or 4 finite numbers',
    ),
    Defect("texture", swap(ORANGE, TEXTURE), "dropped: its texture 'wood.png' is not imported"),
]

TREE = [
    Defect(
        "no parent", swap('<parent link="upper"/>', ""), "error: joint 'elbow': has no <parent>"
    ),
    Defect(
        "parent is no link",
        swap('<parent link="upper"/>', '<parent link="uper"/>'),
        "error: did you mean 'upper'?",
    ),
    Defect(
        "child is no link",
        swap('<child link="lower"/>', '<child link="none"/>'),
        "error: joint 'elbow': its <child>",
    ),
    Defect(
        "leaf is no link",
        swap('<child link="tcp"/>', '<child link="none"/>'),
        "dropped: its <child> 'none' is not",
    ),
    Defect(
        "link on its own",
        add('<link name="table"/>'),
        "dropped: link 'table': no joint connects this link with the robot; left out",
    ),
    Defect("two robots", add(ANOTHER_ARM), "error: has 2 root links (foot, a)"),
    Defect(
        "loop",
        add(_joint("back", "tcp", "foot")),
        "error: has a kinematic loop: foot - upper - lower - hand - tcp - foot",
    ),
    Defect(
        "two parents",
        add(_joint("b", "foot", "tcp")),
        "error: link 'tcp': is the child of two joints, 'flange'",
    ),
    Defect(
        "joint to itself",
        add(_joint("b", "tcp", "tcp")),
        "error: joint 'b': connects link 'tcp' to itself",
    ),
    Defect(
        "closing joint",
        add('<loop_joint name="l"/>'),
        "error: <loop_joint> 'l': does not fit into a robot",
    ),
    Defect(
        "joint not closed", swap("<joint", "<knot"), "error: is not XML: mismatched tag at line"
    ),
    Defect(
        "world below",
        add('<link name="world"/>' + _joint("b", "world", "foot")),
        "repaired: had the name 'world'",
    ),
    Defect(
        "world that is no link",
        add(_joint("b", "world", "foot")),
        "repaired: a joint starts at 'world'",
    ),
    Defect(
        "joint in a link",
        swap('<link name="tcp"/>', "<link name='tcp'>" + FLANGE + "</link>"),
        "repaired: moved",
    ),
    Defect(
        "joint commented out",
        swap(FLANGE, f"<!-- {FLANGE} -->"),
        "dropped: link 'tcp': no joint connects this link with the robot",
    ),
    Defect(
        "shape commented out",
        swap(UPPER_BOX, f"<!-- <visual><sphere/></visual> -->{UPPER_BOX}"),
        "read: 1 <visual>",
    ),
    Defect(
        "dashes in a comment",
        swap(UPPER_BOX, f"<!-- a -- b -->{UPPER_BOX}"),
        "repaired: 1 comment contains --",
    ),
    Defect(
        "gazebo",
        add('<gazebo reference="upper"><mu1>0.2</mu1></gazebo>'),
        "dropped: <gazebo> in <robot>: 1 ×",
    ),
    Defect("ros2_control", add(CONTROL), "dropped: <ros2_control> in <robot>: 1 ×"),
    Defect(
        "safety controller",
        swap(ELBOW_LIMIT, ELBOW_LIMIT + "<safety_controller/>"),
        "dropped: <safety_controller>",
    ),
    Defect(
        "calibration",
        swap(ELBOW_LIMIT, ELBOW_LIMIT + '<calibration rising="0"/>'),
        "dropped: <calibration> in",
    ),
    Defect(
        "sensor",
        add('<sensor name="s"><parent link="hand"/></sensor>'),
        "dropped: <sensor> in <robot>",
    ),
    Defect("foreign prefix", add("<mujoco:option/>"), "dropped: <mujoco:option>: 1 ×"),
]

JOINTS = [
    Defect(
        "no type",
        swap(ELBOW, ELBOW.replace(' type="revolute"', "")),
        "error: joint 'elbow': has no type",
    ),
    Defect(
        "type in capitals",
        swap(ELBOW, ELBOW.replace("rev", "Rev")),
        "repaired: joint 'elbow': has the type 'Rev",
    ),
    Defect(
        "unknown type",
        swap(ELBOW, ELBOW.replace("revolute", "ball")),
        "error: joint 'elbow': has the type 'ball'",
    ),
    Defect(
        "planar",
        swap(ELBOW, ELBOW.replace("revolute", "planar")),
        "error: joint 'elbow': has the type planar",
    ),
    Defect(
        "floating inside",
        swap(ELBOW, ELBOW.replace("revolute", "floating")),
        "error: joint 'elbow': has the type floating",
    ),
    Defect(
        "floating root",
        add('<link name="odom"/>' + _joint("float", "odom", "foot", "floating")),
        "repaired: joint 'float': floats at the empty root 'odom'",
    ),
    Defect("nothing moves", fixed_all, "error: has no joint that moves"),
    Defect(
        "mimic",
        add(FINGER.format('<axis xyz="1 0 0"/><mimic joint="elbow"/>')),
        "read: mimics 'elbow' with a multiplier of 1 and an offset of 0; stations couple",
    ),
    Defect(
        "mimic of nothing",
        swap(ELBOW_LIMIT, f"{ELBOW_LIMIT}<mimic/>"),
        "lost: joint 'elbow': mimics ''",
    ),
    Defect(
        "no axis",
        swap('<axis xyz="0 0.6 0.8"/>', ""),
        "defaulted: joint 'elbow': has no axis; 1 0 0",
    ),
    Defect(
        "axis zero",
        swap("0 0.6 0.8", "0 0 0"),
        "error: joint 'elbow' <axis>: xyz=\"0 0 0\" has no direction",
    ),
    Defect(
        "long axis",
        swap("0 0.6 0.8", "0 3 4"),
        "repaired: joint 'elbow' <axis>: xyz=\"0 3 4\" has the length 5",
    ),
    Defect(
        "axis in words",
        swap("0 0.6 0.8", "y"),
        "error: joint 'elbow' <axis>: xyz=\"y\" is not 3 finite numbers",
    ),
    Defect(
        "axis of nan",
        swap("0 0.6 0.8", "0 nan 1"),
        "error: joint 'elbow' <axis>: xyz=\"0 nan 1\" is not 3",
    ),
    Defect(
        "no limit", elbow_limit(""), "defaulted: joint 'elbow' <limit>: no limits; without a range"
    ),
    Defect(
        "limits equal",
        elbow_limit('<limit lower="1" upper="1"/>'),
        "repaired: lower and upper are both 1",
    ),
    Defect(
        "limits zero",
        elbow_limit('<limit lower="0" upper="0" effort="9"/>'),
        "defaulted: joint 'elbow' <limit>",
    ),
    Defect(
        "limits upside down",
        swap('lower="-1.5" upper="2"', 'lower="2" upper="-1.5"'),
        "repaired: exchanged",
    ),
    Defect(
        "limits in degrees",
        swap('lower="-1.5" upper="2"', 'lower="-90" upper="120"'),
        "read: degrees meant?",
    ),
    Defect(
        "limits without zero",
        swap('lower="-1.5"', 'lower="0.5"'),
        "defaulted: exclude zero, so the home posture is in the middle",
    ),
    Defect(
        "lower is nan",
        swap('lower="-1.5"', 'lower="nan"'),
        "dropped: joint 'elbow' <limit>: lower=\"nan\"",
    ),
    Defect(
        "upper is inf",
        swap('upper="2"', 'upper="inf"'),
        "dropped: joint 'elbow' <limit>: upper=\"inf\"",
    ),
    Defect(
        "upper missing", swap(' upper="2"', ""), "defaulted: joint 'elbow' <limit>: has no upper; 0"
    ),
    Defect(
        "slide without limits",
        slide("revolute", ""),
        "defaulted: set to ±1 m, as a prismatic joint needs a range",
    ),
    Defect(
        "effort zero",
        swap('effort="40"', 'effort="0"'),
        "read: joints 'elbow': passive: the file gives",
    ),
    Defect(
        "effort missing",
        swap('effort="40" ', ""),
        "defaulted: joint 'elbow' <limit>: has no effort",
    ),
    Defect(
        "effort negative",
        swap('effort="40"', 'effort="-40"'),
        "defaulted: effort -40 is not positive",
    ),
    Defect(
        "velocity zero",
        swap('velocity="4"', 'velocity="0"'),
        "defaulted: joints 'elbow' <limit>: no velocity",
    ),
    Defect(
        "velocity missing",
        swap(' velocity="4"', ""),
        "defaulted: joints 'elbow' <limit>: no velocity above 0",
    ),
    Defect(
        "velocity negative",
        swap('velocity="4"', 'velocity="-4"'),
        "defaulted: joints 'elbow' <limit>: no velocity",
    ),
    Defect(
        "friction",
        swap('damping="0.1"', 'damping="0.1" friction="0.3"'),
        "lost: friction 0.3 is not imported",
    ),
    Defect(
        "damping negative",
        swap('damping="0.1"', 'damping="-0.1"'),
        "repaired: damping -0.1 is negative; set to 0",
    ),
    Defect(
        "numbers with units",
        swap('xyz="0 0 0.4"', 'xyz="0 0 0.4m"'),
        'repaired: written as "0 0 0.4"',
    ),
    Defect(
        "numbers with commas",
        swap('rpy="0 0 0.1"', 'rpy="0,0,0.1"'),
        'repaired: written as "0 0 0.1"',
    ),
    Defect(
        "numbers in words",
        swap('rpy="0 0 0.1"', 'rpy="0 0 a bit"'),
        'defaulted: rpy="0 0 a bit" is not 3 finite',
    ),
    Defect(
        "number beyond all",
        swap('rpy="0 0 0.1"', 'rpy="0 0 1e400"'),
        'defaulted: rpy="0 0 1e400" is not 3 finite',
    ),
]

DRIVES = [
    Defect(
        "no drive", swap(ELBOW_DRIVE, ""), "read: joints 'elbow': passive: the file gives motors"
    ),
    Defect(
        "two drives",
        add(ELBOW_DRIVE.replace("_t", "_2")),
        "dropped: transmission 'elbow_2': 'elbow': another transmission drives this",
    ),
    Defect(
        "drive of ROS 2",
        swap(ELBOW_DRIVE, ROS2_DRIVE),
        "repaired: transmission 'elbow_t': does not have the form that Drake reads",
    ),
    Defect(
        "drive without type",
        swap(ELBOW_DRIVE, UNTYPED_DRIVE),
        "repaired: transmission 'elbow_t': has no type",
    ),
    Defect(
        "drive of no joint",
        add(_drive("none")),
        "dropped: transmission 'none_t': 'none': this is not a joint that moves",
    ),
    Defect(
        "drive of a fixed joint",
        add(_drive("flange")),
        "dropped: transmission 'flange_t': 'flange': this is not a joint",
    ),
    Defect(
        "gears",
        swap(ELBOW_DRIVE, FOUR_BAR_DRIVE),
        "repaired: has the type 'FourBarLinkageTransmission'",
    ),
    Defect(
        "differential",
        swap(ELBOW_DRIVE, DIFFERENTIAL),
        "repaired: drives 2 joints; each gets a motor of its own",
    ),
]

INERTIAS = [
    Defect("no inertia", swap(UPPER_INERTIAL, ""), "open: link 'upper': has no usable inertia"),
    Defect(
        "no inertia, estimated",
        swap(UPPER_INERTIAL, ""),
        "defaulted: kg/m³: 2.56 kg",
        options=ESTIMATE,
    ),
    Defect(
        "mass zero", swap('value="2.5"', 'value="0"'), "open: link 'upper': has no usable inertia"
    ),
    Defect(
        "mass negative",
        swap('value="2.5"', 'value="-1"'),
        "dropped: mass -1 kg is negative; left out",
    ),
    Defect(
        "mass negative, estimated",
        swap('value="2.5"', 'value="-1"'),
        "defaulted: mass -1",
        options=ESTIMATE,
    ),
    Defect(
        "mass missing",
        swap('<mass value="2.5"/>', ""),
        "dropped: has moments of inertia but no mass; left out",
    ),
    Defect(
        "mass is nan",
        swap('value="2.5"', 'value="nan"'),
        'dropped: value="nan" is not a finite number',
    ),
    Defect("mass of a star", swap('value="2.5"', 'value="2e29"'), "error: robot.yaml servo.kp"),
    Defect(
        "mass in tonnes",
        swap('value="2.5"', 'value="2500000"'),
        "read: link 'upper' <inertial>: a mass of 2.5e+06 kg",
    ),
    Defect(
        "moments zero on the axis",
        swap(HAND_INERTIAL, HAND_POINT),
        "dropped: has a mass but no moments of inertia",
    ),
    Defect(
        "moments zero, refused",
        swap(HAND_INERTIAL, HAND_POINT),
        "open: link 'hand': has no usable inertia",
    ),
    Defect(
        "moments zero, estimated",
        swap(HAND_INERTIAL, HAND_POINT),
        "defaulted: link 'hand'",
        options=ESTIMATE,
    ),
    Defect(
        "moments missing",
        upper_inertia("", "", ""),
        "dropped: has a mass but no moments of inertia; left out",
    ),
    Defect(
        "moments negative",
        upper_inertia(-0.1, 0.1, 0.1),
        "dropped: no body has the principal moments",
    ),
    Defect(
        "not positive definite",
        upper_inertia(0.03, 0.03, 0.003, xy=0.05),
        "dropped: no body has the principal",
    ),
    Defect(
        "triangle slightly wrong",
        upper_inertia(0.03, 0.03, 0.060003),
        "repaired: corrected as a rounding error",
    ),
    Defect(
        "triangle grossly wrong",
        upper_inertia(0.01, 0.01, 0.5),
        "dropped: none may exceed the sum of the other two; left out",
    ),
    Defect(
        "triangle, estimated",
        upper_inertia(0.01, 0.01, 0.5),
        "defaulted: scaled to its mass",
        options=ESTIMATE,
    ),
    Defect("moments in g mm²", upper_inertia(3e7, 3e7, 3e6), "read: times those of a solid body"),
    Defect(
        "centre in mm",
        swap(UPPER_INERTIAL, UPPER_INERTIAL.replace("0 0 0.2", "0 0 200")),
        "read: were millimetres meant?",
    ),
    Defect("legs without inertias", bare, "open: link 'left_shin': has no usable inertia", LEGS),
    Defect(
        "legs, estimated",
        bare,
        "defaulted: link 'left_shin': has no inertia; estimated from its shapes at 1000 kg/m³: 0.32 kg",
        LEGS,
        ESTIMATE,
    ),
    Defect("legs on the world", on_world, "read: fixed base: the root link is the world", LEGS),
    Defect(
        "legs that stay",
        bare,
        "read: link 'trunk': floating base: 2 branches of 'trunk' have names of legs",
        LEGS,
    ),
]

FILES = [
    Defect("empty", content(lambda text: b""), "error: arm.urdf: is empty"),
    Defect(
        "not XML", content(lambda text: b"robot: arm"), "error: is not XML: syntax error at line 1"
    ),
    Defect("XML cut off", content(lambda text: text[:900].encode()), "error: is not XML"),
    Defect("binary", content(lambda text: b"\x7fELF" + bytes(500)), "error: is a binary file"),
    Defect(
        "UTF-16",
        content(lambda text: text.encode("utf-16")),
        "repaired: byte order mark (UTF-16-LE)",
    ),
    Defect(
        "byte order mark",
        content(lambda text: b"\xef\xbb\xbf" + text.encode()),
        "repaired: byte order mark (UTF-8)",
    ),
    Defect(
        "Latin-1",
        content(lambda text: text.replace("tcp", "pié").encode("latin-1")),
        "repaired: cannot be decoded as utf-8",
    ),
    Defect(
        "late declaration",
        content(lambda text: b"\n" + text.encode()),
        "repaired: <?xml ...?> is not at the beginning",
    ),
    Defect(
        "entities",
        content(lambda text: text.replace("<robot", f"{BOMB}<robot", 1).encode()),
        "error: entities",
    ),
    Defect(
        "deep",
        content(lambda text: b"<robot>" + b"<link>" * 9999),
        "error: has elements in more than 60 levels",
    ),
    Defect(
        "SDF",
        content(lambda text: b"<sdf version='1.9'><model name='m'/></sdf>"),
        "error: has no link",
    ),
    Defect("MJCF", content(lambda text: b"<mujoco/>"), "error: has no joint that moves"),
    Defect("mesh", content(lambda text: DAE.encode()), "error: <COLLADA>: this is a COLLADA mesh"),
    Defect(
        "robot of nothing",
        content(lambda text: b"<robot name='r'/>"),
        "error: arm.urdf: has no link",
    ),
    Defect(
        "robot of one link",
        content(lambda text: b"<robot><link name='l'/></robot>"),
        "error: no joint that moves",
    ),
    Defect(
        "xacro leftover",
        swap('effort="40"', 'effort="${e}"'),
        "error: joint 'elbow' <limit>: effort=\"${e}\" is an",
    ),
    Defect("xacro", swap("</robot>", "<xacro:lost/></robot>"), "error: xacro"),
    Defect(
        "50 MB",
        content(lambda text: text.encode() + b" " * 50_000_000),
        "error: it is larger than 10 MB",
    ),
]

DEFECTS = [*RESOLVING, *MESHES, *SHAPES, *NAMES, *TREE, *JOINTS, *DRIVES, *INERTIAS, *FILES]
