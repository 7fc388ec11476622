"""From a table of Denavit-Hartenberg parameters to the URDF of a robot."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from pydrake.geometry import Cylinder, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.robots.dh import BASE_LINK, TOOL_LINK, DhRow, DhTable
from simrob_drake.robots.dh_shapes import LinkShape, link_shapes
from simrob_drake.robots.merge import place
from simrob_drake.robots.solids import solid_inertia

_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def dh_robot(name: str, table: DhTable) -> ET.Element:
    """Return the ``robot`` element of an arm.

    Its links are ``base_link``, ``link_1`` ... and ``tool0``; each moves about the z axis of its own frame, or along
    it. The pose of ``tool0`` in ``base_link`` is the product of the table.
    """
    robot = ET.Element("robot", name=name)
    shapes, origins, frames = link_shapes(table), table.origins(), table.link_frames()
    names = [BASE_LINK, *(f"link_{number}" for number in range(1, len(table.rows) + 1)), TOOL_LINK]
    for link_name, link_shapes_ in zip(names, [*shapes, []], strict=True):
        _add_shapes(ET.SubElement(robot, "link", name=link_name), link_shapes_)
    links = robot.findall("link")
    for number, (row, joint_name) in enumerate(zip(table.rows, table.joints, strict=True)):
        _add_inertia(links[number + 1], row, frames[number], shapes[number + 1])
        joint = _add_joint(robot, joint_name, row.type, (names[number], names[number + 1]), origins[number])
        _add_motion(joint, row)
        _add_motor(robot, joint_name)
    _add_joint(robot, "flange", "fixed", (names[-2], names[-1]), origins[-1])
    return robot


def _add_shapes(link: ET.Element, shapes: Iterable[LinkShape]) -> None:
    name = link.get("name", "")
    for number, shape in enumerate(shapes):
        for tag in ("visual", "collision"):
            element = ET.SubElement(link, tag, name=f"{name}_{number}")
            place(element, shape.solid.pose)
            geometry = ET.SubElement(element, "geometry")
            body = shape.solid.shape
            if isinstance(body, Cylinder):
                ET.SubElement(geometry, "cylinder", radius=repr(body.radius()), length=repr(body.length()))
            elif isinstance(body, Sphere):
                ET.SubElement(geometry, "sphere", radius=repr(body.radius()))
            if tag == "visual":
                material = ET.SubElement(element, "material", name=f"{name}_{number}_colour")
                ET.SubElement(material, "color", rgba=" ".join(map(repr, shape.colour)))


def _add_inertia(link: ET.Element, row: DhRow, frame: RigidTransform, shapes: list[LinkShape]) -> None:
    """Add the link's inertia: what the row gives of it, the rest from its shapes."""
    if row.mass == 0:
        return
    whole = solid_inertia([shape.solid for shape in shapes], closed=True)
    centre = whole.centre if row.com is None else frame @ np.array(row.com)
    turn, moments = RotationMatrix(), (row.mass / whole.volume * whole.moments).tolist()
    if row.inertia is not None:
        turn, moments = frame.rotation(), [*row.inertia, 0.0, 0.0, 0.0]
    inertial = ET.SubElement(link, "inertial")
    place(inertial, RigidTransform(turn, centre))
    ET.SubElement(inertial, "mass", value=repr(row.mass))
    ET.SubElement(inertial, "inertia", {key: repr(value) for key, value in zip(_MOMENTS, moments, strict=False)})


def _add_joint(robot: ET.Element, name: str, kind: str, links: tuple[str, str], origin: RigidTransform) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    place(joint, origin)
    return joint


def _add_motion(joint: ET.Element, row: DhRow) -> None:
    ET.SubElement(joint, "axis", xyz="0 0 1")
    low, high = row.range
    limit = ET.SubElement(joint, "limit", lower=repr(low), upper=repr(high), effort=repr(row.effort))
    if row.speed is not None:
        limit.set("velocity", repr(row.speed))
    ET.SubElement(joint, "dynamics", damping=repr(row.damping))


def _add_motor(robot: ET.Element, joint: str) -> None:
    transmission = ET.SubElement(robot, "transmission", name=f"{joint}_transmission")
    ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
    ET.SubElement(transmission, "joint", name=joint)
    ET.SubElement(transmission, "actuator", name=f"{joint}_motor")
