"""The elements that a URDF is made of: how poses, shapes, inertias, joints and motors are written, and read back.

Lengths are in metres, masses in kg, angles in radians; numbers are written without loss.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Cylinder, Shape, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import RotationalInertia

from simrob_drake.frames import Vector
from simrob_drake.robots.solids import Solid
from simrob_drake.robots.urdf import DRAKE

MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def written(value: float) -> str:
    """Return a number as short as it can be without loss."""
    return repr(float(value) + 0.0).removesuffix(".0")


def text(values: Iterable[float]) -> str:
    """Return numbers as one attribute."""
    return " ".join(map(written, values))


def pose_of(element: ET.Element) -> RigidTransform:
    """Return the pose that an element's ``<origin>``, or its own attributes, give; none is the identity."""
    origin = element.find("origin")
    source = element if origin is None else origin
    xyz, rpy = (np.array(source.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy"))
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
    """Return the moments (3, 3) [kg m²] in an ``<inertial>``; those that are missing are zero."""
    element = inertial.find("inertia")
    xx, yy, zz, xy, xz, yz = (0.0 if element is None else float(element.get(key, 0)) for key in MOMENTS)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def six_moments(matrix: Vector) -> Vector:
    """Return Ixx Iyy Izz Ixy Ixz Iyz of a matrix of moments (3, 3)."""
    return matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def impossible(moments: Vector) -> str:
    """Return why no body has these moments, (3, 3) [kg m²]; empty if one can have them, as Drake judges it."""
    if RotationalInertia(*six_moments(moments)).CouldBePhysicallyValid():
        return ""
    listed = ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(moments))
    return f"no body has the principal moments {listed} kg m²: none is negative, none exceeds the others' sum"
