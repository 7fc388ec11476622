"""Groups of bodies as elements of URDF files, in the words that Drake reads."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Mesh, Shape, Sphere
from pydrake.math import RigidTransform

from simrob_drake.extensions.drake_scenes.mesh_copies import MeshCopies
from simrob_drake.extensions.drake_scenes.plant_parts import (
    BodyShape,
    Connection,
    GroupLink,
    PlantGroup,
)
from simrob_drake.robots.urdf import (
    DRAKE,
    add_colour,
    add_contact,
    add_joint,
    add_motor,
    format_number,
    format_numbers,
    place,
    set_inertia,
)

WORLD = "world"
"""GroupLink of a URDF file that Drake takes for the world."""


def group_element(
    group: PlantGroup, meshes: MeshCopies, on_lost: Callable[[str, str], None]
) -> ET.Element:
    """Make the element ``robot`` of a group.

    Args:
        group: a robot or a piece.
        meshes: copies of the meshes. The names in the element are relative to their folder.
        on_lost: function that is called with a link and a shape that a URDF does not have.
    """
    robot = ET.Element("robot", name=group.name)
    add_group(robot, group, meshes, on_lost, prefix="")
    return robot


def stations_element(
    name: str, groups: list[PlantGroup], meshes: MeshCopies, on_lost: Callable[[str, str], None]
) -> ET.Element:
    """Make one element ``robot`` of several groups, with those that are held joined to the world.

    Args:
        name: name of the element.
        groups: robots and pieces. If two of them have a name in common, the names of all links and joints begin with
            the name of their group.
        meshes: copies of the meshes. The names in the element are relative to their folder.
        on_lost: function that is called with a link and a shape that a URDF does not have.
    """
    robot = ET.Element("robot", name=name)
    ET.SubElement(robot, "link", name=WORLD)
    links = [link.name for group in groups for link in group.links]
    joints = [joint.name for group in groups for joint in group.joints]
    has_common_names = len(set(links)) < len(links) or len(set(joints)) < len(joints)
    for group in groups:
        prefix = f"{group.name}_" if has_common_names else ""
        add_group(robot, group, meshes, on_lost, prefix=prefix)
        # A link that no joint holds is free for Drake. A URDF does not say where such a link starts.
        if not group.is_free:
            root = f"{prefix}{group.root.name}"
            add_joint(robot, f"{root}_in_world", parent=WORLD, child=root, pose=group.pose)
    return robot


def add_group(
    robot: ET.Element,
    group: PlantGroup,
    meshes: MeshCopies,
    on_lost: Callable[[str, str], None],
    *,
    prefix: str,
) -> None:
    """Add the links, joints and motors of a group to an element ``robot``.

    Args:
        robot: the element, which is changed.
        group: a robot or a piece.
        meshes: copies of the meshes. The names in the element are relative to their folder.
        on_lost: function that is called with a link and a shape that a URDF does not have.
        prefix: text in front of the names of links, joints and motors.
    """
    shape_names = set[str]()
    for link in group.links:
        _add_link(robot, link, meshes, on_lost, prefix, shape_names)
    for joint in group.joints:
        _add_connection(robot, joint, prefix)


def _add_link(
    robot: ET.Element,
    link: GroupLink,
    meshes: MeshCopies,
    on_lost: Callable[[str, str], None],
    prefix: str,
    shape_names: set[str],
) -> None:
    """Add a link with its mass and its shapes. Arguments are those of `add_group`.

    Shapes keep their names, but a name that another link has already gets the name of the link in front, since links
    without a moving joint between them become one body in a station.
    """
    element = ET.SubElement(robot, "link", name=f"{prefix}{link.name}")
    if link.mass > 0:
        set_inertia(element, mass=link.mass, moments=link.moments, pose=RigidTransform(link.com))
    for number, shape in enumerate(link.shapes):
        geometry = shape_element(shape.shape, meshes)
        if geometry is None:
            on_lost(link.name, type(shape.shape).__name__)
            continue
        name = shape.name if shape.name not in shape_names else f"{link.name}_{number}_{shape.name}"
        shape_names.add(name)
        _add_shape(element, shape, geometry, name, f"{prefix}{link.name}_{number}")


def _add_shape(
    link: ET.Element, shape: BodyShape, geometry: ET.Element, name: str, number: str
) -> None:
    """Add a shape to a link, as a visual or a collision.

    Args:
        link: element of the link.
        shape: the shape.
        geometry: element of the shape itself.
        name: name of the shape in the file.
        number: a name that is unique in the robot, for the colour.
    """
    element = ET.SubElement(link, "visual" if shape.contact is None else "collision", name=name)
    place(element, shape.pose)
    ET.SubElement(element, "geometry").append(geometry)
    # A glTF file has materials of its own, and Drake warns of others.
    has_materials = Path(geometry.get("filename", "")).suffix.lower() == ".gltf"
    if shape.colour is not None and not has_materials:
        add_colour(element, f"{number}_colour", shape.colour)
    if shape.contact is not None:
        finite = {
            key: value
            for key, value in shape.contact.items()
            if value is None or np.isfinite(value)
        }
        add_contact(element, finite)


def shape_element(shape: Shape, meshes: MeshCopies) -> ET.Element | None:
    """Make the element of a shape, and copy its mesh. Returns None for a shape that a URDF does not have."""
    element: ET.Element | None = None
    match shape:
        case Box():
            element = ET.Element("box", size=format_numbers(shape.size()))
        case Cylinder():
            element = ET.Element(
                "cylinder",
                radius=format_number(shape.radius()),
                length=format_number(shape.length()),
            )
        case Sphere():
            element = ET.Element("sphere", radius=format_number(shape.radius()))
        case Capsule():
            element = ET.Element(
                f"{DRAKE}capsule",
                radius=format_number(shape.radius()),
                length=format_number(shape.length()),
            )
        case Ellipsoid():
            element = ET.Element(
                f"{DRAKE}ellipsoid",
                a=format_number(shape.a()),
                b=format_number(shape.b()),
                c=format_number(shape.c()),
            )
        case Mesh() | Convex():
            element = ET.Element(
                "mesh", filename=str(meshes.copy(shape)), scale=format_numbers(shape.scale3())
            )
            if isinstance(shape, Convex):
                ET.SubElement(element, f"{DRAKE}declare_convex")
    return element


def _add_connection(robot: ET.Element, joint: Connection, prefix: str) -> None:
    """Add a joint with its limits and its motor."""
    kind = joint.kind
    if kind == "revolute" and not np.isfinite(joint.limits).any():
        kind = "continuous"
    element = add_joint(
        robot,
        f"{prefix}{joint.name}",
        parent=f"{prefix}{joint.parent}",
        child=f"{prefix}{joint.child}",
        pose=joint.origin,
        kind=kind,
    )
    if not joint.moves:
        return
    ET.SubElement(element, "axis", xyz=format_numbers(joint.axis))
    limit = ET.SubElement(element, "limit")
    effort = 0.0 if joint.motor is None else joint.motor.effort
    values = {
        "lower": joint.limits[0],
        "upper": joint.limits[1],
        "velocity": joint.speed,
        f"{DRAKE}acceleration": joint.acceleration,
        "effort": effort,
    }
    # A limit that is left out is infinite for Drake.
    for key, value in values.items():
        if np.isfinite(value):
            limit.set(key, format_number(value))
    if joint.damping > 0:
        ET.SubElement(element, "dynamics", damping=format_number(joint.damping))
    if joint.motor is not None:
        name = f"{prefix}{joint.name}"
        actuator = add_motor(
            robot, name, drive=f"{name}_drive", motor=f"{prefix}{joint.motor.name}"
        )
        if joint.motor.rotor_inertia > 0:
            ET.SubElement(
                actuator, f"{DRAKE}rotor_inertia", value=format_number(joint.motor.rotor_inertia)
            )
        if joint.motor.gear_ratio != 1:
            ET.SubElement(
                actuator, f"{DRAKE}gear_ratio", value=format_number(joint.motor.gear_ratio)
            )
