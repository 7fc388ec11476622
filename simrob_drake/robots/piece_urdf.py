"""Pieces as parts of a URDF: fixed to a robot, or standing alone."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

from pydrake.math import RigidTransform

from simrob_drake.frames import transform_from_pose
from simrob_drake.robots.merge import add_frame, place, pose_of
from simrob_drake.robots.pieces import PieceModel, PieceShape
from simrob_drake.robots.urdf import DRAKE

FRICTION = {"mu_static": 1.0, "mu_dynamic": 0.9}
"""Of all pieces and floors: the contacts of the Simulink library."""
_INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def add_piece(robot: ET.Element, *, name: str, piece: PieceModel, parent: str, pose: RigidTransform) -> None:
    """Add a piece to a robot's URDF, fixed to a link or frame.

    Args:
        robot: the ``robot`` element, changed in place.
        name: of the new link; its tool centre point is the frame ``<name>_tcp``, its others ``<name>_<frame>``.
        piece: what to add.
        parent: the link or frame that it is fixed to.
        pose: of the piece in the parent's frame.
    """
    frame = next((frame for frame in robot.iterfind("frame") if frame.get("name") == parent), None)
    if frame is not None:
        parent, pose = frame.get("link", ""), pose_of(frame) @ pose
    robot.append(_link_element(name, piece))
    joint = ET.SubElement(robot, "joint", name=f"{name}_mount", type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=name)
    place(joint, pose)
    _add_frames(robot, name, piece)


def piece_robot(name: str, piece: PieceModel) -> ET.Element:
    """Return the URDF of a piece that stands alone, with the frames ``<name>_tcp`` and ``<name>_<frame>``."""
    robot = ET.Element("robot", name=name)
    robot.append(_link_element(name, piece))
    _add_frames(robot, name, piece)
    return robot


def _add_frames(robot: ET.Element, name: str, piece: PieceModel) -> None:
    for frame, pose in piece.frame_poses.items():
        add_frame(robot, f"{name}_{frame}", name, transform_from_pose(pose))


def _link_element(name: str, piece: PieceModel) -> ET.Element:
    link = ET.Element("link", name=name)
    if piece.mass > 0:
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=_text(piece.com))
        ET.SubElement(inertial, "mass", value=repr(piece.mass))
        moments = zip(_INERTIA, (*piece.inertia, 0.0, 0.0, 0.0), strict=False)  # products are zero unless given
        ET.SubElement(inertial, "inertia", {key: repr(moment) for key, moment in moments})
    for index, (shape, shape_name) in enumerate(zip(piece.shapes, piece.shape_names, strict=True)):
        if shape.visible:
            visual = _shape_element(link, "visual", f"{name}_{index}", shape, piece.folder)
            material = ET.SubElement(visual, "material", name=f"{name}_{index}_colour")
            ET.SubElement(material, "color", rgba=_text(shape.colour or piece.colour))
        if shape.collides:
            collision = _shape_element(link, "collision", f"{name}.{shape_name}", shape, piece.folder)
            friction = ET.SubElement(collision, f"{DRAKE}proximity_properties")
            for key, value in FRICTION.items():
                ET.SubElement(friction, f"{DRAKE}{key}", value=repr(value))
    return link


def _shape_element(link: ET.Element, tag: str, name: str, shape: PieceShape, folder: Path) -> ET.Element:
    element = ET.SubElement(link, tag, name=name)
    place(element, transform_from_pose(shape.pose))
    geometry = ET.SubElement(element, "geometry")
    if shape.box is not None:
        ET.SubElement(geometry, "box", size=_text(shape.box))
    elif shape.cylinder is not None:
        radius, length = shape.cylinder
        ET.SubElement(geometry, "cylinder", radius=repr(radius), length=repr(length))
    elif shape.sphere is not None:
        ET.SubElement(geometry, "sphere", radius=repr(shape.sphere))
    else:
        scale = _text([shape.scale] * 3)
        ET.SubElement(geometry, "mesh", filename=f"file://{folder / str(shape.mesh)}", scale=scale)
    return element


def _text(values: Sequence[float]) -> str:
    return " ".join(repr(value) for value in values)
