"""Groups of bodies as models of SDF files, in the words that Drake reads."""

import xml.etree.ElementTree as ET

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Mesh,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake.extensions.drake_scenes.mesh_copies import MeshCopies
from simrob_drake.extensions.drake_scenes.plant_parts import (
    BodyShape,
    Connection,
    GroupLink,
    PlantGroup,
)
from simrob_drake.robots.urdf import MOMENTS, format_number, format_numbers, six_moments

VERSION = "1.9"
"""Version of the format SDF."""
_DRAKE = "drake:"
"""Prefix of Drake's own elements. SDF files declare no XML namespace for it."""


def sdf_element(
    name: str, groups: list[PlantGroup], meshes: MeshCopies, *, is_world: bool
) -> ET.Element:
    """Make the element ``sdf`` of groups.

    Args:
        name: name of the world.
        groups: robots and pieces, each of which becomes a model.
        meshes: copies of the meshes. The names in the element are relative to their folder.
        is_world: whether the models stand in a world, at their poses and welded to it if they are held. Without it
            there is one model alone, which the caller poses.
    """
    sdf = ET.Element("sdf", version=VERSION)
    if not is_world:
        sdf.append(_model(groups[0], meshes))
        return sdf
    world = ET.SubElement(sdf, "world", name=name)
    for group in groups:
        model = _model(group, meshes)
        model.insert(0, _pose(group.pose))
        world.append(model)
        if not group.is_free:
            weld = ET.SubElement(world, "joint", name=f"{group.name}_in_world", type="fixed")
            ET.SubElement(weld, "parent").text = "world"
            ET.SubElement(weld, "child").text = f"{group.name}::{group.root.name}"
    return sdf


def _model(group: PlantGroup, meshes: MeshCopies) -> ET.Element:
    """Make the element ``model`` of a group.

    Each link is posed in the frame of the joint that carries it, and each joint in its parent link: the poses are then
    those that the group has, without sums of rounding errors.
    """
    # SDF files take the first link of a model as the one that its pose belongs to.
    model = ET.Element("model", name=group.name, canonical_link=group.root.name)
    # In a model of SDF, unlike in a URDF, a link and a joint cannot have the same name.
    links = {link.name for link in group.links}
    names = {
        joint.name: f"{joint.name}_joint" if joint.name in links else joint.name
        for joint in group.joints
    }
    carriers = {joint.child: names[joint.name] for joint in group.joints}
    for link in group.links:
        model.append(_link(link, carriers.get(link.name, ""), meshes))
    for joint in group.joints:
        model.append(_joint(joint, names[joint.name]))
    return model


def _link(link: GroupLink, carrier: str, meshes: MeshCopies) -> ET.Element:
    """Make the element of a link.

    Args:
        link: the link.
        carrier: name of the joint that carries the link. Empty for the root.
        meshes: copies of the meshes.
    """
    element = ET.Element("link", name=link.name)
    if carrier:
        element.append(_pose(RigidTransform(), relative_to=carrier))
    if link.mass > 0:
        inertial = ET.SubElement(element, "inertial")
        inertial.append(_pose(RigidTransform(link.com)))
        _add(inertial, "mass", link.mass)
        inertia = ET.SubElement(inertial, "inertia")
        for key, value in zip(MOMENTS, six_moments(link.moments), strict=True):
            _add(inertia, key, value)
    else:
        # Without this element SDF gives a link 1 kg.
        inertial = ET.SubElement(element, "inertial")
        _add(inertial, "mass", 0.0)
        inertia = ET.SubElement(inertial, "inertia")
        for key in MOMENTS:
            _add(inertia, key, 0.0)
    for number, shape in enumerate(link.shapes):
        element.append(_shape(shape, number, meshes))
    return element


def _shape(shape: BodyShape, number: int, meshes: MeshCopies) -> ET.Element:
    """Make the element ``visual`` or ``collision`` of a shape. The number makes its name unique in its link."""
    element = ET.Element(
        "visual" if shape.contact is None else "collision", name=f"{shape.name}_{number}"
    )
    element.append(_pose(shape.pose))
    ET.SubElement(element, "geometry").append(_geometry(shape.shape, meshes))
    if shape.colour is not None:
        material = ET.SubElement(element, "material")
        ET.SubElement(material, "diffuse").text = format_numbers(shape.colour)
    if shape.contact is not None:
        properties = ET.SubElement(element, f"{_DRAKE}proximity_properties")
        for key, value in shape.contact.items():
            if value is None:
                ET.SubElement(properties, f"{_DRAKE}{key}")
            elif np.isfinite(value):
                _add(properties, f"{_DRAKE}{key}", value)
    return element


def _geometry(shape: Shape, meshes: MeshCopies) -> ET.Element:
    """Make the element of a shape itself, and copy its mesh."""
    match shape:
        case Box():
            element = ET.Element("box")
            ET.SubElement(element, "size").text = format_numbers(shape.size())
        case Cylinder() | Capsule():
            element = ET.Element("cylinder" if isinstance(shape, Cylinder) else "capsule")
            _add(element, "radius", shape.radius())
            _add(element, "length", shape.length())
        case Sphere():
            element = ET.Element("sphere")
            _add(element, "radius", shape.radius())
        case Ellipsoid():
            element = ET.Element("ellipsoid")
            ET.SubElement(element, "radii").text = format_numbers((shape.a(), shape.b(), shape.c()))
        case Mesh() | Convex():
            element = ET.Element("mesh")
            ET.SubElement(element, "uri").text = str(meshes.copy(shape))
            ET.SubElement(element, "scale").text = format_numbers(shape.scale3())
            if isinstance(shape, Convex):
                ET.SubElement(element, f"{_DRAKE}declare_convex")
        case HalfSpace():
            element = ET.Element("plane")
            ET.SubElement(element, "normal").text = "0 0 1"
            ET.SubElement(element, "size").text = "1 1"
        case _:
            raise TypeError(f"{type(shape).__name__} is no shape of an SDF file")
    return element


def _joint(joint: Connection, name: str) -> ET.Element:
    """Make the element of a joint with its limits, under a name that is free in its model."""
    kind = joint.kind
    if kind == "revolute" and not np.isfinite(joint.limits).any():
        kind = "continuous"
    element = ET.Element("joint", name=name, type=kind)
    element.append(_pose(joint.origin, relative_to=joint.parent))
    ET.SubElement(element, "parent").text = joint.parent
    ET.SubElement(element, "child").text = joint.child
    if not joint.moves:
        return element
    axis = ET.SubElement(element, "axis")
    ET.SubElement(axis, "xyz").text = format_numbers(joint.axis)
    if joint.damping > 0:
        _add(ET.SubElement(axis, "dynamics"), "damping", joint.damping)
    limit = ET.SubElement(axis, "limit")
    values = {
        "lower": joint.limits[0],
        "upper": joint.limits[1],
        "velocity": joint.speed,
        f"{_DRAKE}acceleration": joint.acceleration,
        # An effort of 0 means that nothing drives the joint; without an effort its motor has no limit.
        "effort": 0.0 if joint.motor is None else joint.motor.effort,
    }
    for key, value in values.items():
        if np.isfinite(value):
            _add(limit, key, value)
    if joint.motor is not None:
        _add(element, f"{_DRAKE}rotor_inertia", joint.motor.rotor_inertia)
        _add(element, f"{_DRAKE}gear_ratio", joint.motor.gear_ratio)
    return element


def _pose(pose: RigidTransform, relative_to: str = "") -> ET.Element:
    """Make the element ``pose``: x y z roll pitch yaw."""
    element = ET.Element("pose", {"relative_to": relative_to} if relative_to else {})
    element.text = format_numbers((*pose.translation(), *RollPitchYaw(pose.rotation()).vector()))
    return element


def _add(parent: ET.Element, tag: str, value: float) -> None:
    """Add an element with one number."""
    ET.SubElement(parent, tag).text = format_number(value)
