"""Read a URDF safely, tell what is in it, and write its elements: poses, shapes, inertias, joints and motors.

Lengths are in metres, masses in kg, angles in radians; numbers are written without loss.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Cylinder, Shape, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import RotationalInertia

from simrob_drake.base.errors import InvalidModel, one_of, shortened
from simrob_drake.base.files import NotRead, models_root, text_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message

MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


@lru_cache(maxsize=10_000)  # most numbers of a robot are equal to others, such as the zeros of its poses
def written(value: float) -> str:
    """Write a number as short as possible without loss."""
    return repr(float(value) + 0.0).removesuffix(".0")


def text(values: Iterable[float]) -> str:
    """Return numbers as one attribute."""
    return " ".join(map(written, values))


def pose_of(element: ET.Element) -> RigidTransform:
    """Read the pose in an element's ``<origin>``, or in its own attributes. Without any, it is the identity."""
    origin = element.find("origin")
    source = element if origin is None else origin
    xyz = np.array(source.get("xyz", "0 0 0").split(), dtype=float)
    rpy = np.array(source.get("rpy", "0 0 0").split(), dtype=float)
    return RigidTransform(RollPitchYaw(rpy), xyz)


def child_of(element: ET.Element, tag: str) -> ET.Element:
    """Return the first child of a tag, which is added if there is none."""
    child = element.find(tag)
    return ET.SubElement(element, tag) if child is None else child


def place(element: ET.Element, pose: RigidTransform) -> None:
    """Write a pose into an element's ``<origin>``, or into a ``frame`` itself."""
    origin = element if element.tag == "frame" else child_of(element, "origin")
    origin.set("xyz", text(pose.translation()))
    origin.set("rpy", text(RollPitchYaw(pose.rotation()).vector()))


def add_frame(robot: ET.Element, name: str, link: str, pose: RigidTransform) -> ET.Element:
    """Add a named frame to a link, by Drake's element for it, and return that."""
    frame = ET.SubElement(robot, "frame", name=name, link=link)
    place(frame, pose)
    return frame


def add_joint(
    robot: ET.Element, name: str, *, parent: str, child: str, pose: RigidTransform, kind: str = "fixed"
) -> ET.Element:
    """Add a joint between two links, without axis and limits, and return it."""
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    place(joint, pose)
    return joint


def add_motor(robot: ET.Element, joint: str, *, drive: str, motor: str = "") -> ET.Element:
    """Add a motor for a joint in a transmission that Drake reads, and return its ``<actuator>``."""
    transmission = ET.SubElement(robot, "transmission", name=drive)
    ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
    ET.SubElement(transmission, "joint", name=joint)
    return ET.SubElement(transmission, "actuator", name=motor or f"{joint}_motor")


def remove_motors(robot: ET.Element, joints: Collection[str]) -> None:
    """Remove the transmissions that drive some joints, by their names, in place: the joints become passive."""
    for transmission in robot.findall("transmission"):
        if any(name_of(joint) in joints for joint in transmission.iterfind("joint")):
            robot.remove(transmission)


@dataclass(frozen=True)
class Solid:
    """A body somewhere: one of Drake's shapes, or a mesh file with a scale."""

    pose: RigidTransform
    shape: Shape | Path
    scale: float = 1.0


def add_solid(link: ET.Element, tag: str, name: str, solid: Solid) -> ET.Element:
    """Add a body to a link, as a ``visual`` or a ``collision`` element, and return that."""
    element = ET.SubElement(link, tag, name=name)
    place(element, solid.pose)
    ET.SubElement(element, "geometry").append(shape_element(solid.shape, solid.scale))
    return element


def shape_element(shape: Shape | Path, scale: float = 1.0) -> ET.Element:
    """Return the element of a box, cylinder or sphere of Drake, or of a mesh file."""
    if isinstance(shape, Box):
        return ET.Element("box", size=text(shape.size()))
    if isinstance(shape, Cylinder):
        return ET.Element("cylinder", radius=written(shape.radius()), length=written(shape.length()))
    if isinstance(shape, Sphere):
        return ET.Element("sphere", radius=written(shape.radius()))
    return ET.Element("mesh", filename=f"file://{shape}", scale=text([scale] * 3))


def add_colour(owner: ET.Element, name: str, rgba: Iterable[float]) -> ET.Element:
    """Add a material with a colour to a visual or a robot, and return it."""
    material = ET.SubElement(owner, "material", name=name)
    ET.SubElement(material, "color", rgba=text(rgba))
    return material


def add_contact(collision: ET.Element, values: Mapping[str, float | None]) -> None:
    """Add Drake's contact figures to a ``collision``, by their names there; None for one that is a name alone."""
    properties = ET.SubElement(collision, f"{DRAKE}proximity_properties")
    for key, value in values.items():
        ET.SubElement(properties, f"{DRAKE}{key}", {} if value is None else {"value": written(value)})


def set_inertia(link: ET.Element, *, mass: float, moments: Sequence[float] | Vector, pose: RigidTransform) -> None:
    """Write a mass [kg] and the moments about its centre into a link; those that it has are replaced.

    The moments are a matrix (3, 3), or Ixx Iyy Izz and, where they are not zero, Ixy Ixz Iyz [kg m²]; the pose is that
    of the centre of mass and of their axes.
    """
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = ET.Element("inertial")
    link.insert(0, inertial)
    place(inertial, pose)
    ET.SubElement(inertial, "mass", value=written(mass))
    set_moments(inertial, moments)


def set_moments(inertial: ET.Element, moments: Sequence[float] | Vector) -> None:
    """Write moments into an ``<inertial>``, as :func:`set_inertia` does."""
    element = child_of(inertial, "inertia")
    numbers = six_moments(moments) if isinstance(moments, np.ndarray) and moments.ndim == 2 else (*moments, 0, 0, 0)
    for key, value in zip(MOMENTS, numbers, strict=False):
        element.set(key, written(value))


def moments_of(inertial: ET.Element) -> Vector:
    """Read the matrix of moments (3, 3) [kg m²] in an ``<inertial>``. Moments that are missing are zero."""
    element = inertial.find("inertia")
    attributes = {} if element is None else element.attrib
    xx, yy, zz, xy, xz, yz = [float(attributes.get(key, 0)) for key in MOMENTS]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def six_moments(matrix: Vector) -> Vector:
    """Return Ixx Iyy Izz Ixy Ixz Iyz of a matrix of moments (3, 3)."""
    return matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def impossible(moments: Vector) -> str:
    """Return why no body has these moments, (3, 3) [kg m²]; empty if one can have them, as Drake judges it."""
    if RotationalInertia(*six_moments(moments)).CouldBePhysicallyValid():
        return ""
    listed = ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(moments))
    return message(
        "robots.impossible_principal_moments",
        "no body has the principal moments {moments} kg m²: none is negative, none exceeds the others' sum",
        moments=listed,
    )


LARGEST_URDF = 10_000_000  # of a description [bytes]: published ones stay far below, for meshes are files of their own
MOST_TAGS = 300_000  # of a description: a robot of a thousand links has some forty thousand
MOVABLE_JOINTS = ("revolute", "continuous", "prismatic")
LIMITED_JOINTS = ("revolute", "prismatic")
ENDLESS = 1e4  # some files write larger limits for joints without limits [rad or m]
_STRONG, _LIGHT = 500.0, 5.0  # N·m that a link below so many kg does not have
DRAKE = "{http://drake.mit.edu}"  # what stands before the names of Drake's own elements, such as acceleration limits

ET.register_namespace("drake", DRAKE.strip("{}"))
MESH_FORMATS = (".obj", ".gltf", ".vtk")
_OUTERMOST = re.compile(r"\A\ufeff?(?>\s+|<!--.*?-->|<\?.*?\?>)*+<robot\b", re.DOTALL)  # comments may name a <robot>


def read_urdf(path: Path) -> ET.Element:
    """Return a URDF's ``robot`` element; raises InvalidModel: unreadable, a xacro, no XML, entities, or no robot."""
    try:
        text = text_of(path, LARGEST_URDF)
    except NotRead as problem:
        raise InvalidModel(
            path, "", message("base.cannot_be_read", "cannot be read ({problem})", problem=problem)
        ) from None
    if text.count("<") > MOST_TAGS:
        raise InvalidModel(path, "", message("robots.too_many_tags", "has more than {most} tags", most=MOST_TAGS))
    if path.suffix.lower() == ".xacro" or "xmlns:xacro" in text:
        raise InvalidModel(
            path, "", message("robots.expand_xacro", "is a xacro file; expand it first, with simrob import")
        )
    if "<!ENTITY" in text or "<!DOCTYPE" in text:
        raise InvalidModel(
            path, "", message("robots.has_entities", "declares entities or a document type, which a URDF never needs")
        )
    try:
        # the prefix ``drake:`` is declared in several ways or, since Drake does not mind, not at all
        text = re.sub(r"""\sxmlns:drake\s*=\s*(".*?"|'.*?')""", "", text)
        declared = rf'\g<0> xmlns:drake="{DRAKE.strip("{}")}"'
        root = ET.fromstring(_OUTERMOST.sub(declared, text) if "drake:" in text else text)
    except ET.ParseError as problem:
        raise InvalidModel(path, "", message("robots.not_xml", "is not XML: {problem}", problem=problem)) from None
    if root.tag != "robot":
        raise InvalidModel(
            path, f"<{root.tag}>", message("robots.outermost_robot", "the outermost element of a URDF is <robot>")
        )
    return root


def movable_joints(root: ET.Element) -> list[str]:
    """Return the names of the joints that move, in file order."""
    return [name_of(j) for j in root.iterfind("joint") if j.get("type") in MOVABLE_JOINTS]


def transmissions_of(root: ET.Element) -> dict[str, list[ET.Element]]:
    """Find the transmissions that drive each joint, by the joint's name, in file order."""
    transmissions: dict[str, list[ET.Element]] = {}
    for transmission in root.iterfind("transmission"):
        for joint in transmission.iterfind("joint"):
            transmissions.setdefault(name_of(joint), []).append(transmission)
    return transmissions


def driven_joints(root: ET.Element) -> set[str]:
    """Names of the moving joints of a checked robot that have a motor. The other moving joints are passive.

    As in Drake, a joint has a motor if a transmission drives it and its effort limit is positive.
    """
    with_transmission = transmissions_of(root)
    return {
        name_of(joint)
        for joint in root.iterfind("joint")
        if joint.get("type") in MOVABLE_JOINTS
        and name_of(joint) in with_transmission
        and joint_figure(joint, "effort") > 0
    }


def joint_limits(joint: ET.Element) -> tuple[float, float]:
    """Return a joint's lower and upper limit [rad or m]; without them -inf, inf. Drake heeds a continuous joint's."""
    limit = joint.find("limit")
    if limit is None or "lower" not in limit.attrib:
        return -math.inf, math.inf
    return float(limit.attrib["lower"]), float(limit.attrib["upper"])


def joint_figure(joint: ET.Element, key: str, tag: str = "limit") -> float:
    """Return a figure of a joint's ``<limit>``, or of another child of it, in SI units; 0 where the URDF gives none."""
    child = joint.find(tag)
    return 0.0 if child is None else float(child.get(key, 0.0))


def root_link(root: ET.Element) -> str:
    """Return the link that is no joint's child."""
    children = {link_of(j, "child") for j in root.iterfind("joint")}
    return next(name_of(link) for link in root.iterfind("link") if name_of(link) not in children)


def joints_at(root: ET.Element) -> dict[str, list[ET.Element]]:
    """Return the joints that start at each link, in file order."""
    joints: dict[str, list[ET.Element]] = {name_of(link): [] for link in root.iterfind("link")}
    for joint in root.iterfind("joint"):
        joints[link_of(joint, "parent")].append(joint)
    return joints


def outward(starts: Mapping[str, list[ET.Element]], link: str, *, rigid: bool = False) -> list[ET.Element]:
    """Return the joints that hang on a link of a tree, each after those that carry it.

    ``starts`` are the joints at each link (:func:`joints_at`); ``rigid`` goes only as far as joints are fixed.
    """
    links, found = [link], list[ET.Element]()
    for name in links:
        further = [joint for joint in starts[name] if not rigid or joint.get("type") == "fixed"]
        found += further
        links += [link_of(joint, "child") for joint in further]
    return found


def with_absolute_meshes(root: ET.Element, folder: Path) -> ET.Element:
    """Return a copy of a robot that can be parsed from memory: its mesh names, relative to a folder, are absolute.

    Raises InvalidModel: a mesh is missing, outside the folder, or in a format that Drake does not read.
    """
    robot = copied(root)
    for mesh in robot.iter("mesh"):
        mesh.set("filename", f"file://{mesh_file(mesh.get('filename', ''), folder)}")  # Drake decodes no %20
    return robot


def scale_masses(robot: ET.Element, factors: Mapping[str, float]) -> None:
    """Make links, by name, so many times as heavy, moments of inertia as well; raises UnknownName: no such link."""
    links = {name_of(link): link for link in robot.iterfind("link")}
    for name, factor in factors.items():
        link = links[one_of(message("robots.link_under_mass_factors", "link (under mass_factors)"), name, links)]
        for element in (*link.iterfind("inertial/mass"), *link.iterfind("inertial/inertia")):
            element.attrib.update({key: repr(factor * float(value)) for key, value in element.attrib.items()})


def drop_collision(robot: ET.Element) -> None:
    """Take a robot's collision geometry away: a plant without any never asks the scene graph for contacts."""
    for link in robot.iterfind("link"):
        for element in link.findall("collision"):
            link.remove(element)


def mesh_file(uri: str, folder: Path) -> Path:
    """Return the file of a mesh that is named relative to a folder; robots that ship may share theirs.

    Raises InvalidModel: it is missing, outside the folder, or in a format that Drake does not read.
    """
    try:
        path = (folder / uri.removeprefix("file://")).resolve()
        found = path.is_file()
    except (OSError, RuntimeError, ValueError) as problem:  # names that no file can have, links that go in a circle
        raise InvalidModel(
            folder,
            message("robots.mesh_called", "mesh '{uri}'", uri=shortened(uri)),
            message("robots.no_name_of_file", "cannot be a file's name"),
        ) from problem
    if "://" in uri.removeprefix("file://"):
        raise InvalidModel(
            folder,
            message("robots.mesh_called", "mesh '{uri}'", uri=uri),
            message("robots.no_packages_here", "packages are not resolved here; name the mesh relative to the URDF"),
        )
    border = models_root() if folder.resolve().is_relative_to(models_root()) else folder.resolve()
    if not path.is_relative_to(border):
        raise InvalidModel(
            folder,
            message("robots.mesh_called", "mesh '{uri}'", uri=uri),
            message("robots.mesh_outside_folder", "lies outside the robot's folder; copy it there"),
        )
    if not found:
        raise InvalidModel(
            folder,
            message("robots.mesh_called", "mesh '{uri}'", uri=uri),
            message("robots.no_file", "there is no file {path}", path=path),
        )
    if path.suffix.lower() not in MESH_FORMATS:
        raise InvalidModel(
            folder,
            message("robots.mesh_called", "mesh '{uri}'", uri=uri),
            message("robots.mesh_format", "Drake reads {formats}; convert the mesh", formats=", ".join(MESH_FORMATS)),
        )
    return path


def mass_of(link: ET.Element) -> float:
    """Return a link's own mass [kg]; 0 where it has none."""
    mass = link.find("inertial/mass")
    return 0.0 if mass is None else float(mass.get("value", 0))


def doubtful_efforts(robot: ET.Element) -> dict[str, tuple[float, float]]:
    """Return the joints of a checked robot whose torques no motor of their links has, with them [N·m] and masses [kg].

    Such figures are often made up, as for "no limit".
    """
    masses = {name_of(link): mass_of(link) for link in robot.iterfind("link")}
    found = {}
    for joint in robot.iterfind("joint"):
        limit, mass = joint.find("limit"), masses.get(link_of(joint, "child"), 0.0)
        effort = 0.0 if limit is None else float(limit.get("effort", 0))
        if joint.get("type") in ("revolute", "continuous") and effort > _STRONG and 0 < mass < _LIGHT:
            found[name_of(joint)] = effort, mass
    return found


def copied(element: ET.Element) -> ET.Element:
    """Return a copy of an element with all below it; ``deepcopy`` takes ten times as long."""
    whole = ET.Element(element.tag, element.attrib)
    pairs = [(element, whole)]
    for source, copy in pairs:  # which grow meanwhile: a file may nest deeper than Python calls
        copy.text, copy.tail = source.text, source.tail
        pairs += [(child, ET.SubElement(copy, child.tag, child.attrib)) for child in source]
    return whole


def name_of(element: ET.Element) -> str:
    """Return an element's name; empty where it has none."""
    return element.get("name", "")


def link_of(joint: ET.Element, end: str) -> str:
    """Return the link at the ``parent`` or ``child`` end of a joint; empty where there is none."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")
