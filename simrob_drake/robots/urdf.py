"""Read a URDF safely, look up its links and joints, and write its elements.

Lengths are in metres, masses in kg, angles in radians. Numbers are written without loss.
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

from simrob_drake.base.errors import InvalidModel, one_of, shorten
from simrob_drake.base.files import NotRead, models_root, text_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message

MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
"""Attributes of an ``<inertia>``, in the order in which six moments are listed here."""


# Most numbers of a robot are equal to others, such as the zeros of its poses.
@lru_cache(maxsize=10_000)
def format_number(value: float) -> str:
    """Write a number as short as possible without loss."""
    # Python's repr is the shortest text that is read as the same double. Adding 0 turns -0.0 into 0.0.
    return repr(float(value) + 0.0).removesuffix(".0")


def format_numbers(values: Iterable[float]) -> str:
    """Write numbers as the text of one attribute."""
    return " ".join(map(format_number, values))


def pose_of(element: ET.Element) -> RigidTransform:
    """Read the pose in an element's ``<origin>``, or in its own attributes ``xyz`` [m] and ``rpy`` [rad].

    What is missing is 0, so that an element without a pose has the identity.
    """
    # Drake's element <frame> has the pose in its own attributes. Joints and shapes have an <origin>.
    origin = element.find("origin")
    source = element if origin is None else origin
    xyz = np.array(source.get("xyz", "0 0 0").split(), dtype=float)
    rpy = np.array(source.get("rpy", "0 0 0").split(), dtype=float)
    return RigidTransform(RollPitchYaw(rpy), xyz)


def child_of(element: ET.Element, tag: str) -> ET.Element:
    """Return the first child with a tag. If there is none, it is added."""
    child = element.find(tag)
    return ET.SubElement(element, tag) if child is None else child


def place(element: ET.Element, pose: RigidTransform) -> None:
    """Write a pose into an element's ``<origin>``, which is added if it is missing, or into a ``frame`` itself."""
    origin = element if element.tag == "frame" else child_of(element, "origin")
    origin.set("xyz", format_numbers(pose.translation()))
    origin.set("rpy", format_numbers(RollPitchYaw(pose.rotation()).vector()))


def add_frame(robot: ET.Element, name: str, link: str, pose: RigidTransform) -> ET.Element:
    """Add a named frame to a link, as Drake's element ``<frame>``, and return this element."""
    frame = ET.SubElement(robot, "frame", name=name, link=link)
    place(frame, pose)
    return frame


def add_joint(
    robot: ET.Element,
    name: str,
    *,
    parent: str,
    child: str,
    pose: RigidTransform,
    kind: str = "fixed",
) -> ET.Element:
    """Add a joint between two links, without axis and limits, and return it.

    Args:
        robot: the ``robot`` element.
        name: name of the joint.
        parent: name of the link that carries the joint.
        child: name of the link that the joint carries.
        pose: pose of the joint, and of the child at the joint's zero, in the parent.
        kind: type of the joint.
    """
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    place(joint, pose)
    return joint


def add_motor(robot: ET.Element, joint: str, *, drive: str, motor: str = "") -> ET.Element:
    """Add a motor for a joint in a transmission that Drake reads, and return its ``<actuator>``.

    Args:
        robot: the ``robot`` element.
        joint: name of the joint.
        drive: name of the transmission.
        motor: name of the actuator; that of the joint with ``_motor`` unless given.
    """
    # Drake reads transmissions of this type only.
    transmission = ET.SubElement(robot, "transmission", name=drive)
    ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
    ET.SubElement(transmission, "joint", name=joint)
    return ET.SubElement(transmission, "actuator", name=motor or f"{joint}_motor")


def remove_motors(robot: ET.Element, joints: Collection[str]) -> None:
    """Remove the transmissions that drive some joints, by their names, in place: the joints become passive."""
    # A list of all transmissions, since the loop removes some of them from the robot.
    for transmission in robot.findall("transmission"):
        if any(name_of(joint) in joints for joint in transmission.iterfind("joint")):
            robot.remove(transmission)


@dataclass(frozen=True)
class Solid:
    """A shape at a pose.

    Attributes:
        pose: pose of the shape in the frame of its link.
        shape: one of Drake's shapes, or the file of a mesh.
        scale: factor for the lengths in the file of a mesh.
    """

    pose: RigidTransform
    shape: Shape | Path
    scale: float = 1.0


def add_solid(link: ET.Element, tag: str, name: str, solid: Solid) -> ET.Element:
    """Add a shape to a link, and return the new element.

    Args:
        link: the link.
        tag: tag of the new element: ``visual`` or ``collision``.
        name: name of the shape, unique in its link.
        solid: the shape, with its pose in the link.
    """
    element = ET.SubElement(link, tag, name=name)
    place(element, solid.pose)
    ET.SubElement(element, "geometry").append(shape_element(solid.shape, solid.scale))
    return element


def shape_element(shape: Shape | Path, scale: float = 1.0) -> ET.Element:
    """Make the element of a shape, a child of ``<geometry>``.

    Args:
        shape: a box, cylinder or sphere of Drake, or the file of a mesh.
        scale: factor for the lengths in the file of a mesh.
    """
    if isinstance(shape, Box):
        return ET.Element("box", size=format_numbers(shape.size()))
    if isinstance(shape, Cylinder):
        return ET.Element(
            "cylinder", radius=format_number(shape.radius()), length=format_number(shape.length())
        )
    if isinstance(shape, Sphere):
        return ET.Element("sphere", radius=format_number(shape.radius()))
    return ET.Element("mesh", filename=f"file://{shape}", scale=format_numbers([scale] * 3))


def add_colour(owner: ET.Element, name: str, rgba: Iterable[float]) -> ET.Element:
    """Add a material with a colour to a visual or a robot, and return it."""
    material = ET.SubElement(owner, "material", name=name)
    ET.SubElement(material, "color", rgba=format_numbers(rgba))
    return material


def add_contact(collision: ET.Element, values: Mapping[str, float | None]) -> None:
    """Add Drake's contact properties to a ``collision``.

    Args:
        collision: the element.
        values: properties by their names in Drake; None for a property without a value.
    """
    properties = ET.SubElement(collision, f"{DRAKE}proximity_properties")
    for key, value in values.items():
        ET.SubElement(
            properties, f"{DRAKE}{key}", {} if value is None else {"value": format_number(value)}
        )


def set_inertia(
    link: ET.Element, *, mass: float, moments: Sequence[float] | Vector, pose: RigidTransform
) -> None:
    """Write the inertia of a link. An inertia that the link has is replaced.

    Args:
        link: the link.
        mass: the mass [kg].
        moments: moments of inertia about the centre of mass [kg m²]: a matrix (3, 3), or Ixx Iyy Izz, or these and
            Ixy Ixz Iyz.
        pose: pose of the frame in the centre of mass in which the moments are given, in the frame of the link.
    """
    for old in link.findall("inertial"):
        link.remove(old)
    # Published files have the inertia before the shapes.
    inertial = ET.Element("inertial")
    link.insert(0, inertial)
    place(inertial, pose)
    ET.SubElement(inertial, "mass", value=format_number(mass))
    set_moments(inertial, moments)


def set_moments(inertial: ET.Element, moments: Sequence[float] | Vector) -> None:
    """Write moments of inertia into an ``<inertial>``, in place of those that it has.

    Args:
        inertial: the element.
        moments: the moments [kg m²]: a matrix (3, 3), or Ixx Iyy Izz, or these and Ixy Ixz Iyz.
    """
    element = child_of(inertial, "inertia")
    if isinstance(moments, np.ndarray) and moments.ndim == 2:
        numbers = six_moments(moments)
    else:
        # Three moments are followed by products of 0; of six moments, the zeros behind them are not used.
        numbers = np.array([*moments, 0.0, 0.0, 0.0])
    for key, value in zip(MOMENTS, numbers, strict=False):
        element.set(key, format_number(value))


def moments_of(inertial: ET.Element) -> Vector:
    """Read the matrix of moments (3, 3) [kg m²] in an ``<inertial>``. Moments that are missing are zero."""
    element = inertial.find("inertia")
    attributes = {} if element is None else element.attrib
    moments = {key: float(attributes.get(key, 0)) for key in MOMENTS}
    xy = moments["ixy"]
    xz = moments["ixz"]
    yz = moments["iyz"]
    return np.array([[moments["ixx"], xy, xz], [xy, moments["iyy"], yz], [xz, yz, moments["izz"]]])


def six_moments(matrix: Vector) -> Vector:
    """Extract Ixx Iyy Izz Ixy Ixz Iyz from a matrix of moments (3, 3)."""
    return matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def impossible(moments: Vector) -> str:
    """Write why no body can have moments of inertia (3, 3) [kg m²]. Returns an empty text if a body can have them.

    The judgement is Drake's. A sum of two principal moments is at least the third one, since each is an integral of
    squared distances.
    """
    if RotationalInertia(*six_moments(moments)).CouldBePhysicallyValid():
        return ""
    listed = ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(moments))
    return message(
        "robots.impossible_principal_moments",
        "no body has the principal moments {moments} kg m²: each must be positive or zero, and none may exceed the sum "
        "of the other two",
        moments=listed,
    )


LARGEST_URDF = 10_000_000
"""Largest size of a URDF [bytes]. Published ones are far smaller, since meshes are files of their own."""

MOST_TAGS = 300_000
"""Largest count of tags of a URDF. A robot of a thousand links has about forty thousand."""

MOVABLE_JOINTS = ("revolute", "continuous", "prismatic")
"""Types of joints that move."""

LIMITED_JOINTS = ("revolute", "prismatic")
"""Types of joints that must have limits."""

ENDLESS = 1e4
"""Limit above which a joint counts as one without limits [rad or m]. Some files write such numbers."""

_STRONG = 500.0
"""Torque above which an effort limit of a light link is doubtful [N·m]."""

_LIGHT = 5.0
"""Mass below which a link counts as light [kg]."""

DRAKE = "{http://drake.mit.edu}"
"""Namespace of Drake's own elements, such as acceleration limits, as ElementTree writes it before their names."""

# ElementTree would otherwise write the prefix "ns0:", which Drake does not read.
ET.register_namespace("drake", DRAKE.strip("{}"))
MESH_FORMATS = (".obj", ".gltf", ".vtk")
"""Formats of meshes that Drake reads."""

# The tag of the robot, behind spaces, comments and declarations. Comments may contain a <robot>, too. The expression
# gives nothing back that it has matched, or a file of many comments would take it forever.
_OUTERMOST = re.compile(r"\A\ufeff?(?>\s+|<!--.*?-->|<\?.*?\?>)*+<robot\b", re.DOTALL)


def read_urdf(path: Path) -> ET.Element:
    """Read the ``robot`` element of a URDF.

    Raises:
        InvalidModel: the file cannot be read, is too large or has too many tags, is a xacro file or no XML, declares
            entities or a document type, or its outermost element is not ``robot``.
    """
    try:
        text = text_of(path, LARGEST_URDF)
    except NotRead as problem:
        raise InvalidModel(
            path, "", message("base.cannot_be_read", "cannot be read ({problem})", problem=problem)
        ) from None
    # The checks of the text come before the parser, whose memory and time a hostile file could use up.
    if text.count("<") > MOST_TAGS:
        raise InvalidModel(
            path, "", message("robots.too_many_tags", "has more than {most} tags", most=MOST_TAGS)
        )
    if path.suffix.lower() == ".xacro" or "xmlns:xacro" in text:
        raise InvalidModel(
            path,
            "",
            message(
                "robots.expand_xacro", "is a xacro file; convert it to a URDF with `simrob import`"
            ),
        )
    # Entities that contain each other can grow to gigabytes, and an external one can read any file.
    if "<!ENTITY" in text or "<!DOCTYPE" in text:
        raise InvalidModel(
            path,
            "",
            message(
                "robots.has_entities",
                "declares entities or a document type, which are not accepted in a URDF; remove them",
            ),
        )
    try:
        # Files declare the prefix ``drake:`` in several ways or, since Drake accepts that, not at all. So all of them
        # get the same declaration.
        text = re.sub(r"""\sxmlns:drake\s*=\s*(".*?"|'.*?')""", "", text)
        declared = rf'\g<0> xmlns:drake="{DRAKE.strip("{}")}"'
        root = ET.fromstring(_OUTERMOST.sub(declared, text) if "drake:" in text else text)
    except ET.ParseError as problem:
        raise InvalidModel(
            path, "", message("robots.not_xml", "is not XML: {problem}", problem=problem)
        ) from None
    if root.tag != "robot":
        raise InvalidModel(
            path,
            f"<{root.tag}>",
            message("robots.outermost_robot", "the outermost element of a URDF must be <robot>"),
        )
    return root


def movable_joints(root: ET.Element) -> list[str]:
    """List the names of the joints that move, in file order."""
    return [
        name_of(joint) for joint in root.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS
    ]


def transmissions_of(root: ET.Element) -> dict[str, list[ET.Element]]:
    """Find the transmissions that drive each joint, by the joint's name, in file order."""
    transmissions: dict[str, list[ET.Element]] = {}
    for transmission in root.iterfind("transmission"):
        for joint in transmission.iterfind("joint"):
            transmissions.setdefault(name_of(joint), []).append(transmission)
    return transmissions


def driven_joints(root: ET.Element) -> set[str]:
    """Find the names of the moving joints of a checked robot that have a motor. The other moving joints are passive.

    As in Drake, a joint has a motor if a transmission drives it and its effort limit is positive.
    """
    with_transmission = transmissions_of(root)
    return {
        name_of(joint)
        for joint in root.iterfind("joint")
        if joint.get("type") in MOVABLE_JOINTS
        and name_of(joint) in with_transmission
        and joint_value(joint, "effort") > 0
    }


def joint_limits(joint: ET.Element) -> tuple[float, float]:
    """Read the lower and upper limit of a joint [rad or m]. Without limits, they are -inf and inf.

    Limits of a continuous joint count, as they do in Drake.
    """
    # The checks have made sure that a file gives both limits or neither.
    limit = joint.find("limit")
    if limit is None or "lower" not in limit.attrib:
        return -math.inf, math.inf
    return float(limit.attrib["lower"]), float(limit.attrib["upper"])


def joint_value(joint: ET.Element, key: str, tag: str = "limit") -> float:
    """Read a number of a joint in SI units. It is 0 if the URDF does not give it.

    Args:
        joint: the joint.
        key: attribute with the number.
        tag: child element with the attribute.
    """
    child = joint.find(tag)
    return 0.0 if child is None else float(child.get(key, 0.0))


def root_link(root: ET.Element) -> str:
    """Find the name of the root link of a checked URDF: the link that is no joint's child."""
    children = {link_of(joint, "child") for joint in root.iterfind("joint")}
    return next(name_of(link) for link in root.iterfind("link") if name_of(link) not in children)


def joints_at(root: ET.Element) -> dict[str, list[ET.Element]]:
    """Find the joints whose parent is each link, by the link's name, in file order."""
    joints: dict[str, list[ET.Element]] = {name_of(link): [] for link in root.iterfind("link")}
    for joint in root.iterfind("joint"):
        joints[link_of(joint, "parent")].append(joint)
    return joints


def outward(
    starts: Mapping[str, list[ET.Element]], link: str, *, rigid: bool = False
) -> list[ET.Element]:
    """Find all joints that a link of a tree carries. Each comes after the joints that carry it.

    Args:
        starts: the joints that start at each link, see :func:`joints_at`.
        link: name of the link.
        rigid: whether to stop at joints that move, so that only fixed joints are found.
    """
    joints = list[ET.Element]()
    links = [link]
    # The list grows while it is read: links behind the new joints follow.
    for name in links:
        next_joints = [joint for joint in starts[name] if not rigid or joint.get("type") == "fixed"]
        joints += next_joints
        links += [link_of(joint, "child") for joint in next_joints]
    return joints


def with_absolute_meshes(root: ET.Element, folder: Path) -> ET.Element:
    """Make a copy of a robot in which names of meshes are absolute, so that Drake can parse it from memory.

    Args:
        root: the ``robot`` element.
        folder: folder to which the names of meshes are relative.

    Raises:
        InvalidModel: a mesh is missing, is outside the folder, or has a format that Drake does not read.
    """
    robot = copy_of(root)
    for mesh in robot.iter("mesh"):
        file = mesh_file(mesh.get("filename", ""), folder)
        # Not Path.as_uri(), which writes a space as %20: Drake does not decode it.
        mesh.set("filename", f"file://{file}")
    return robot


def scale_masses(robot: ET.Element, factors: Mapping[str, float]) -> None:
    """Multiply masses and moments of inertia of links by factors, in place.

    Args:
        robot: the ``robot`` element.
        factors: factors by the name of the link.

    Raises:
        UnknownName: there is no link of such a name.
    """
    links = {name_of(link): link for link in robot.iterfind("link")}
    for name, factor in factors.items():
        link = links[
            one_of(
                message("robots.link_under_mass_factors", "link (under mass_factors)"), name, links
            )
        ]
        # All attributes of the two elements are in proportion to the mass. The centre of mass, in the element <origin>,
        # stays where it is.
        for element in (*link.iterfind("inertial/mass"), *link.iterfind("inertial/inertia")):
            element.attrib.update(
                {key: repr(factor * float(value)) for key, value in element.attrib.items()}
            )


def drop_collision(robot: ET.Element) -> None:
    """Remove the collision shapes of a robot, in place. A plant without any does not compute contacts."""
    for link in robot.iterfind("link"):
        for element in link.findall("collision"):
            link.remove(element)


def mesh_file(uri: str, folder: Path) -> Path:
    """Find the file of a mesh that is named relative to the folder of its robot or piece.

    Args:
        uri: name of the file, with or without ``file://``.
        folder: the folder. Meshes must be in it; robots of the package may also use those of each other.

    Raises:
        InvalidModel: the name is no possible name of a file, or names a package; or the mesh is missing, is outside the
            folder, or has a format that Drake does not read.
    """
    try:
        path = (folder / uri.removeprefix("file://")).resolve()
        exists = path.is_file()
    # A name that no file can have, such as one with a zero byte, or symbolic links in a circle.
    except (OSError, RuntimeError, ValueError) as problem:
        raise InvalidModel(
            folder,
            message("robots.mesh_called", "mesh '{uri}'", uri=shorten(uri)),
            message("robots.no_name_of_file", "cannot be the name of a file"),
        ) from problem
    if "://" in uri.removeprefix("file://"):
        raise InvalidModel(
            folder,
            message("robots.mesh_called", "mesh '{uri}'", uri=uri),
            message(
                "robots.no_packages_here",
                "names of packages are not resolved here; write a path relative to the URDF",
            ),
        )
    # Robots of the package share meshes with each other. A user's file must not read other folders of the disk. This
    # check comes before the one for existence, which would show otherwise which files the disk has.
    is_of_package = folder.resolve().is_relative_to(models_root())
    allowed_folder = models_root() if is_of_package else folder.resolve()
    if not path.is_relative_to(allowed_folder):
        raise InvalidModel(
            folder,
            message("robots.mesh_called", "mesh '{uri}'", uri=uri),
            message(
                "robots.mesh_outside_folder",
                "is outside the robot's folder; copy it into that folder",
            ),
        )
    if not exists:
        raise InvalidModel(
            folder,
            message("robots.mesh_called", "mesh '{uri}'", uri=uri),
            message("robots.no_file", "there is no file {path}", path=path),
        )
    if path.suffix.lower() not in MESH_FORMATS:
        raise InvalidModel(
            folder,
            message("robots.mesh_called", "mesh '{uri}'", uri=uri),
            message(
                "robots.mesh_format",
                "has a format that Drake cannot read; convert it to one of {formats}",
                formats=", ".join(MESH_FORMATS),
            ),
        )
    return path


def mass_of(link: ET.Element) -> float:
    """Read the mass of a link [kg]. It is 0 for a link without mass."""
    mass = link.find("inertial/mass")
    return 0.0 if mass is None else float(mass.get("value", 0))


def doubtful_efforts(robot: ET.Element) -> dict[str, tuple[float, float]]:
    """Find the joints of a checked robot with an effort limit that is too high for the link that they move.

    The joint turns, its limit is above 500 N·m, and its link has a mass below 5 kg. Such limits are often made up by
    authors who want no limit. Links without mass are not judged.

    Returns:
        the effort limit [N·m] and the mass of the link [kg], by the name of the joint.
    """
    masses = {name_of(link): mass_of(link) for link in robot.iterfind("link")}
    doubtful = {}
    for joint in robot.iterfind("joint"):
        effort = joint_value(joint, "effort")
        mass = masses.get(link_of(joint, "child"), 0.0)
        # Forces of sliding joints are not compared: a spindle can be strong and light.
        is_revolute = joint.get("type") in ("revolute", "continuous")
        if is_revolute and effort > _STRONG and 0 < mass < _LIGHT:
            doubtful[name_of(joint)] = (effort, mass)
    return doubtful


def copy_of(element: ET.Element) -> ET.Element:
    """Copy an element with its attributes, texts and children. ``deepcopy`` takes ten times as long."""
    whole = ET.Element(element.tag, element.attrib)
    # Elements whose children are still to be copied, with their copies. The list grows while it is read, in place of a
    # recursion: a file may be nested deeper than Python allows calls to be.
    pairs = [(element, whole)]
    for source, copy in pairs:
        copy.text = source.text
        copy.tail = source.tail
        pairs += [(child, ET.SubElement(copy, child.tag, child.attrib)) for child in source]
    return whole


def name_of(element: ET.Element) -> str:
    """Read the name of an element. It is empty if the element has no name."""
    return element.get("name", "")


def link_of(joint: ET.Element, end: str) -> str:
    """Read the name of the link at an end of a joint, ``parent`` or ``child``. It is empty if there is no such end."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")
