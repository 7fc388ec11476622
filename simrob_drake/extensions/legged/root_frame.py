"""The frame of a robot's root link: moved up to the hips if the URDF has it near the ground.

The height of that frame stands for the robot's size in many places: the walk's pendulum, the bound of a fall monitor,
the sizes of soles. Published URDFs often draw all links from a point on the ground, or have a root link for the robot's
shadow on the floor. The root's frame is then near the ground or under it, and its height says nothing about the robot.
"""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.extensions.legged.anatomy import Anatomy
from simrob_drake.robots.urdf import joints_at, place, pose_of, root_link
from simrob_drake.stations.legs import chain_lengths, put_upright, straight

_LOW = 0.5
"""A root's frame is low if it is below the hips by more than this part of the legs' length."""


def height_of_hips(anatomy: Anatomy) -> float:
    """Compute the mean height of the hips over the root's frame [m], while the root is upright."""
    clearance = anatomy.clearance
    put_upright(clearance, anatomy.robot, straight(anatomy.robot))
    return float(np.mean([anatomy.origin(limb.leg.axes[0])[2] for limb in anatomy.legs]))


def is_root_low(anatomy: Anatomy) -> bool:
    """Whether the root's frame is so far below the hips that its height does not stand for the robot's size."""
    leg = anatomy.legs[0].leg
    length, _ = chain_lengths(anatomy.clearance, anatomy.robot, leg.axes, leg)
    return height_of_hips(anatomy) > _LOW * float(length)


def raise_root_frame(urdf: Path, height: float) -> None:
    """Move the frame of the root link of a URDF up by a height [m]. The robot itself stays as it is.

    All that the file expresses in that frame is expressed in the new one: the link's mass, shapes and named frames, and
    the joints that start at it.
    """
    tree = ET.parse(urdf)  # written by the importer
    robot = tree.getroot()
    root = root_link(robot)
    link = next(link for link in robot.iterfind("link") if link.get("name") == root)
    parts = [part for tag in ("inertial", "visual", "collision") for part in link.findall(tag)]
    frames = [frame for frame in robot.iter("frame") if frame.get("link") == root]
    down = RigidTransform(np.array([0.0, 0.0, -height]))
    for element in [*parts, *frames, *joints_at(robot)[root]]:
        place(element, down @ pose_of(element))
    tree.write(urdf, encoding="utf-8", xml_declaration=True)
