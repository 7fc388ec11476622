"""Pieces as parts of a URDF: fixed to a robot, or standing alone."""

import xml.etree.ElementTree as ET

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.frames import transform_from_pose
from simrob_drake.robots.pieces import PieceModel
from simrob_drake.robots.urdf_elements import (
    add_colour,
    add_contact,
    add_frame,
    add_joint,
    add_solid,
    pose_of,
    set_inertia,
)

FRICTION = {"mu_static": 1.0, "mu_dynamic": 0.9}
"""Of all pieces and floors: the contacts of the Simulink library."""


def add_piece(robot: ET.Element, *, name: str, piece: PieceModel, parent: str, pose: RigidTransform) -> None:
    """Add a piece to a robot's URDF, in place, fixed to the link or frame ``parent`` at a pose in it.

    ``name`` is the new link's; its tool centre point is the frame ``<name>_tcp``, its others are ``<name>_<frame>``.
    """
    frame = next((frame for frame in robot.iterfind("frame") if frame.get("name") == parent), None)
    if frame is not None:
        parent, pose = frame.get("link", ""), pose_of(frame) @ pose
    _add_link(robot, name, piece)
    add_joint(robot, f"{name}_mount", parent=parent, child=name, pose=pose)


def piece_robot(name: str, piece: PieceModel) -> ET.Element:
    """Return the URDF of a piece that stands alone, with the frames ``<name>_tcp`` and ``<name>_<frame>``."""
    robot = ET.Element("robot", name=name)
    _add_link(robot, name, piece)
    return robot


def _add_link(robot: ET.Element, name: str, piece: PieceModel) -> None:
    """Add the link that a piece is, with its frames."""
    link = ET.SubElement(robot, "link", name=name)
    if piece.mass > 0:
        set_inertia(link, mass=piece.mass, moments=piece.inertia, pose=RigidTransform(np.array(piece.com)))
    for index, (shape, shape_name) in enumerate(zip(piece.shapes, piece.shape_names, strict=True)):
        solid = shape.solid(piece.folder)
        if shape.visible:
            visual = add_solid(link, "visual", f"{name}_{index}", solid)
            add_colour(visual, f"{name}_{index}_colour", shape.colour or piece.colour)
        if shape.collides:
            add_contact(add_solid(link, "collision", f"{name}.{shape_name}", solid), FRICTION)
    for frame, pose in piece.frame_poses.items():
        add_frame(robot, f"{name}_{frame}", name, transform_from_pose(pose))
