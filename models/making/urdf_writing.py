"""Write a URDF from its figures: links, joints, colours, and a motor for every joint that moves.

For the scripts beside this file, which hold the figures of one robot each. Lengths are in metres, masses
in kg, angles in radians; all numbers are written as given.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from simrob_drake.robots.urdf import DRAKE, MOMENTS, add_motor

Numbers = Sequence[float]
ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Shape:
    """A box, cylinder, sphere or mesh somewhere on a link."""

    tag: str
    attributes: Mapping[str, str]
    xyz: Numbers = ZERO
    rpy: Numbers = ZERO


def box(size: Numbers, xyz: Numbers = ZERO, rpy: Numbers = ZERO) -> Shape:
    """Return a box of a size, shape (3,) [m], about its centre."""
    return Shape("box", {"size": text(size)}, xyz, rpy)


def sphere(radius: float, xyz: Numbers = ZERO) -> Shape:
    """Return a sphere about its centre."""
    return Shape("sphere", {"radius": text([radius])}, xyz)


def shape_element(link: ET.Element, tag: str, shape: Shape) -> ET.Element:
    """Add a shape to a link, as a ``visual`` or a ``collision`` element, and return that."""
    element = ET.SubElement(link, tag)
    add_origin(element, shape.xyz, shape.rpy)
    ET.SubElement(ET.SubElement(element, "geometry"), shape.tag, dict(shape.attributes))
    return element


def add_origin(element: ET.Element, xyz: Numbers, rpy: Numbers) -> None:
    """Add a place and a turn to an element, where they are not zero."""
    if any(xyz) or any(rpy):
        turned = {"rpy": text(rpy)} if any(rpy) else {}
        ET.SubElement(element, "origin", {"xyz": text(xyz), **turned})


def text(values: Numbers) -> str:
    """Return numbers as an attribute of a URDF."""
    return " ".join(f"{float(value):.12g}" for value in values)


def cylinder(radius: float, length: float, xyz: Numbers = ZERO, rpy: Numbers = ZERO) -> Shape:
    """Return a cylinder along z about its centre."""
    return Shape("cylinder", {"radius": text([radius]), "length": text([length])}, xyz, rpy)


def mesh(name: str) -> Shape:
    """Return the mesh of that name in the folder ``meshes``."""
    return Shape("mesh", {"filename": f"meshes/{name}.obj"})


@dataclass(frozen=True, kw_only=True)
class Link:
    """A link: mass [kg], centre of mass [m], moments Ixx Iyy Izz and products Ixy Ixz Iyz about it [kg m²].

    Without mass it is a frame only.
    """

    name: str
    mass: float = 0.0
    com: Numbers = ZERO
    moments: Numbers = ZERO
    products: Numbers = ZERO
    visuals: Sequence[tuple[Shape, str]] = ()
    collisions: Sequence[Shape] = ()
    comment: str = ""


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint about an axis of its own frame, with a motor; fixed without an axis."""

    name: str
    parent: str
    child: str
    xyz: Numbers = ZERO
    rpy: Numbers = ZERO
    axis: Numbers | None = None
    range: tuple[float, float] = (0.0, 0.0)  # rad
    effort: float = 0.0  # N·m
    velocity: float = 0.0  # rad/s
    damping: float = 0.0  # N·m·s/rad
    reflected_inertia: float = 0.0  # kg m², of the motor's rotor behind its gear
    comment: str = ""


def write_urdf(
    file: Path,
    *,
    comment: str,
    colours: Mapping[str, Numbers],
    links: Sequence[Link],
    joints: Sequence[Joint],
) -> None:
    """Write a robot, named as its file.

    Args:
        file: where to, ``<robot>.urdf``.
        comment: what stands above all: sources, and what is estimated.
        colours: by name, red green blue opacity each.
        links: the root first.
        joints: in the order of the motors.
    """
    robot = ET.Element("robot", name=file.stem)
    robot.append(ET.Comment(f"\n  {comment.strip()}\n"))
    for name, rgba in colours.items():
        ET.SubElement(ET.SubElement(robot, "material", name=name), "color", rgba=text(rgba))
    for link in links:
        _add_link(robot, link)
    for joint in joints:
        _add_joint(robot, joint)
    for joint in joints:
        if joint.axis is not None:
            _add_motor(robot, joint)
    ET.indent(robot)
    file.write_text(
        f'<?xml version="1.0"?>\n{ET.tostring(robot, encoding="unicode")}\n', encoding="utf-8"
    )


def _add_link(robot: ET.Element, link: Link) -> None:
    element = ET.SubElement(robot, "link", name=link.name)
    if link.comment:
        element.append(ET.Comment(f" {link.comment} "))
    if link.mass > 0:
        inertial = ET.SubElement(element, "inertial")
        add_origin(inertial, link.com, ZERO)
        ET.SubElement(inertial, "mass", value=text([link.mass]))
        values = zip(MOMENTS, (*link.moments, *link.products), strict=True)
        ET.SubElement(inertial, "inertia", {key: text([value]) for key, value in values})
    for shape, colour in link.visuals:
        ET.SubElement(shape_element(element, "visual", shape), "material", name=colour)
    for shape in link.collisions:
        shape_element(element, "collision", shape)


def _add_joint(robot: ET.Element, joint: Joint) -> None:
    kind = "fixed" if joint.axis is None else "revolute"
    element = ET.SubElement(robot, "joint", name=joint.name, type=kind)
    if joint.comment:
        element.append(ET.Comment(f" {joint.comment} "))
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    add_origin(element, joint.xyz, joint.rpy)
    if joint.axis is None:
        return
    ET.SubElement(element, "axis", xyz=text(joint.axis))
    lower, upper = joint.range
    limits = {"lower": lower, "upper": upper, "effort": joint.effort, "velocity": joint.velocity}
    ET.SubElement(element, "limit", {key: text([value]) for key, value in limits.items()})
    if joint.damping:
        ET.SubElement(element, "dynamics", damping=text([joint.damping]))


def _add_motor(robot: ET.Element, joint: Joint) -> None:
    motor = add_motor(robot, joint.name, drive=f"{joint.name}_drive")
    if joint.reflected_inertia:
        ET.SubElement(motor, f"{DRAKE}rotor_inertia", value=text([joint.reflected_inertia]))
        ET.SubElement(motor, f"{DRAKE}gear_ratio", value="1")
