"""Make one link of links that are rigidly joined: the same robot with fewer bodies to step.

A solver visits every body at every evaluation, welded or not. The flange, gripper and load of an arm are a third of
its bodies, and published robots have dozens of fixed links that only name a frame. Merging changes no motion: masses,
centres of mass and inertias add up by the parallel axis theorem, shapes keep their places, and each merged link stays
on as a frame of its name.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake.frames import Vector

_PLACED = ("visual", "collision")


@dataclass(frozen=True)
class _Inertia:
    """Mass [kg], centre of mass (3,) [m] in a link's frame, and moments about it (3, 3) [kg m²] in its axes."""

    mass: float
    com: Vector
    moments: Vector

    def seen_from(self, parent: RigidTransform) -> _Inertia:
        """Return the same inertia in the parent's frame, in which the link has the pose ``parent``."""
        turn = parent.rotation().matrix()
        return _Inertia(self.mass, parent @ self.com, turn @ self.moments @ turn.T)

    def __add__(self, other: _Inertia) -> _Inertia:
        mass = self.mass + other.mass
        com = (self.mass * self.com + other.mass * other.com) / mass
        return _Inertia(mass, com, self._about(com) + other._about(com))

    def _about(self, point: Vector) -> Vector:
        offset = point - self.com
        return self.moments + self.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))


def merge_fixed_links(robot: ET.Element) -> None:
    """Merge every link on a fixed joint into its parent, in place.

    Args:
        robot: the ``robot`` element of a checked URDF.
    """
    for joint in [joint for joint in robot.iterfind("joint") if joint.get("type") == "fixed"]:
        parent, child = (_link(robot, _end(joint, end).get("link", "")) for end in ("parent", "child"))
        pose = pose_of(joint)
        for element in [element for tag in _PLACED for element in child.iterfind(tag)]:
            place(element, pose @ pose_of(element))
            parent.append(element)
        inertia = _inertia(child)
        if inertia is not None:
            own = _inertia(parent)
            moved = inertia.seen_from(pose)
            _set_inertia(parent, moved if own is None else own + moved)
        _hand_over(robot, child, parent, pose)
        robot.remove(child)
        robot.remove(joint)
        add_frame(robot, child.get("name", ""), parent.get("name", ""), pose)


def pose_of(element: ET.Element) -> RigidTransform:
    """Return the pose that an element's ``<origin>``, or its own attributes, give; none is the identity."""
    origin = element.find("origin")
    source = element if origin is None else origin
    xyz, rpy = (np.array(source.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy"))
    return RigidTransform(RollPitchYaw(rpy), xyz)


def place(element: ET.Element, pose: RigidTransform) -> None:
    """Write a pose into an element's ``<origin>``."""
    origin = element.find("origin")
    _write_pose(ET.SubElement(element, "origin") if origin is None else origin, pose)


def add_frame(robot: ET.Element, name: str, link: str, pose: RigidTransform) -> None:
    """Add a named frame to a link, by Drake's element for it."""
    _write_pose(ET.SubElement(robot, "frame", name=name, link=link), pose)


def _write_pose(element: ET.Element, pose: RigidTransform) -> None:
    element.set("xyz", _text(pose.translation()))
    element.set("rpy", _text(RollPitchYaw(pose.rotation()).vector()))


def _hand_over(robot: ET.Element, child: ET.Element, parent: ET.Element, pose: RigidTransform) -> None:
    """Let the joints and frames of a link start at its parent."""
    name, new = child.get("name"), parent.get("name", "")
    for joint in robot.iterfind("joint"):
        if _end(joint, "parent").get("link") == name and _end(joint, "child").get("link") != name:
            _end(joint, "parent").set("link", new)
            place(joint, pose @ pose_of(joint))
    for frame in robot.iterfind("frame"):
        if frame.get("link") == name:
            frame.set("link", new)
            _write_pose(frame, pose @ pose_of(frame))


def _inertia(link: ET.Element) -> _Inertia | None:
    """Return the inertia of a link; None if it has no mass."""
    inertial = link.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    moments = None if inertial is None else inertial.find("inertia")
    if inertial is None or mass is None or moments is None or float(mass.get("value", 0)) == 0:
        return None
    xx, yy, zz, xy, xz, yz = (float(moments.get(key, 0)) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return _Inertia(float(mass.get("value", 0)), np.zeros(3), about_com).seen_from(pose_of(inertial))


def _set_inertia(link: ET.Element, inertia: _Inertia) -> None:
    old = link.find("inertial")
    if old is not None:
        link.remove(old)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=_text(inertia.com))
    ET.SubElement(inertial, "mass", value=repr(inertia.mass))
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia.moments.tolist()
    moments = {"ixx": xx, "iyy": yy, "izz": zz, "ixy": xy, "ixz": xz, "iyz": yz}
    ET.SubElement(inertial, "inertia", {key: repr(value) for key, value in moments.items()})


def _link(robot: ET.Element, name: str) -> ET.Element:
    return next(link for link in robot.iterfind("link") if link.get("name") == name)


def _end(joint: ET.Element, end: str) -> ET.Element:
    element = joint.find(end)
    assert element is not None  # checked before
    return element


def _text(values: Vector) -> str:
    return " ".join(repr(value) for value in np.asarray(values).tolist())
