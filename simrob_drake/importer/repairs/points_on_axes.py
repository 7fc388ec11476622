"""Masses without extent on the axis of a chain's last joint: nothing would resist that joint."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.frames import Vector
from simrob_drake.importer.repairs.inertia_figures import Figures, read_figures
from simrob_drake.robots.bodies import bodies, carriers
from simrob_drake.robots.urdf import link_of, mass_of, name_of
from simrob_drake.robots.urdf_elements import pose_of

_ON_AXIS = 1e-6  # m


def take_out_points_on_axes(robot: ET.Element) -> dict[str, Figures]:
    """Take the inertias out, in place, that leave the mass matrix singular, and return what they said, by link.

    Only the last body of a chain is looked at: what is further in may be moved by what is further out.
    """
    carrier = carriers(robot)
    inner = {carrier[link_of(joint, "parent")] for joint in robot.iterfind("joint") if joint.get("type") != "fixed"}
    taken: dict[str, Figures] = {}
    for joint in robot.iterfind("joint"):
        last = link_of(joint, "child")
        if joint.get("type") in ("revolute", "continuous") and last not in inner:
            points = _masses(bodies(robot)[last])
            poses = _poses_in_body(robot, points)
            if all(_is_on_axis(figures, poses[name], _axis(joint)) for name, figures in points.items()):
                taken |= {name: Figures(figures.mass, None, figures.place) for name, figures in points.items()}
    for link in robot.iterfind("link"):
        inertial = link.find("inertial")
        if name_of(link) in taken and inertial is not None:
            link.remove(inertial)
    return taken


def _masses(links: list[ET.Element]) -> dict[str, Figures]:
    """Return what the links with mass say, by name."""
    inertials = {name_of(link): link.find("inertial") for link in links if mass_of(link) > 0}
    return {name: read_figures(inertial) for name, inertial in inertials.items() if inertial is not None}


def _poses_in_body(robot: ET.Element, links: dict[str, Figures]) -> dict[str, RigidTransform]:
    """Return each link's pose in the link that carries it."""
    fixed = {link_of(j, "child"): j for j in robot.iterfind("joint") if j.get("type") == "fixed"}
    poses = {}
    for name in links:
        pose, link = RigidTransform(), name
        while link in fixed:
            pose, link = pose_of(fixed[link]) @ pose, link_of(fixed[link], "parent")
        poses[name] = pose
    return poses


def _axis(joint: ET.Element) -> Vector:
    axis = joint.find("axis")
    return np.array(("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split(), dtype=float)


def _is_on_axis(figures: Figures, pose: RigidTransform, axis: Vector) -> bool:
    """Whether a link's mass is a point on an axis through the origin of its body, in which the link has the pose."""
    offset = np.cross(pose @ figures.place.translation(), axis / np.linalg.norm(axis))
    return figures.moments is not None and not figures.moments.any() and float(np.linalg.norm(offset)) < _ON_AXIS
