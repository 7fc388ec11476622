"""Links that are rigidly joined are one body: which links those are, who carries them, how they become one link.

A solver visits every body at every evaluation, welded or not. The flange, gripper and load of an arm are a third of
its bodies, and published robots have dozens of fixed links that only name a frame. Merging changes no motion: masses,
centres of mass and inertias add up by the parallel axis theorem, shapes keep their places, and each merged link stays
on as a frame of its name. What is joined to the last body of a chain tells where that carries its tool.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.frames import Vector
from simrob_drake.robots.urdf import (
    MOVABLE_JOINTS,
    add_frame,
    joints_at,
    link_of,
    mass_of,
    moments_of,
    name_of,
    outward,
    place,
    pose_of,
    root_link,
    set_inertia,
)

_USUAL = re.compile(r"tool|tcp|flange|attachment|end_?effector|(^|_)ee(_|f?$)|tip|grasp", re.IGNORECASE)
"""Names that published robots give to the place of the tool."""
_SHAPES = ("visual", "collision")


def carriers(robot: ET.Element) -> dict[str, str]:
    """Return, by link, the link that carries its body: the first one on the way to the root that a joint moves."""
    found = {root_link(robot): root_link(robot)}
    for joint in outward(joints_at(robot), root_link(robot)):
        child = link_of(joint, "child")
        found[child] = found[link_of(joint, "parent")] if joint.get("type") == "fixed" else child
    return found


def bodies(robot: ET.Element) -> dict[str, list[ET.Element]]:
    """Return, by the link that carries it, the links of each body."""
    carrier, found = carriers(robot), dict[str, list[ET.Element]]()
    for link in robot.iterfind("link"):
        found.setdefault(carrier[name_of(link)], []).append(link)
    return found


def links_without_inertia(robot: ET.Element, *, floating: bool = False) -> list[str]:
    """Return the links that move but carry no mass, nor anything with mass rigidly attached: no dynamics for them.

    The root link moves, too, if the robot is ``floating``.
    """
    weightless = {link for link, parts in bodies(robot).items() if not any(mass_of(part) > 0 for part in parts)}
    moved = {link_of(j, "child") for j in robot.iterfind("joint") if j.get("type") in MOVABLE_JOINTS}
    if floating:
        moved.add(root_link(robot))
    return [name for name in map(name_of, robot.iterfind("link")) if name in moved & weightless]


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
    """Merge every link of a checked URDF that is on a fixed joint into its parent, in place."""
    links = {name_of(link): link for link in robot.iterfind("link")}
    placed: dict[str, list[ET.Element]] = {name: [] for name in links}  # the joints and frames that start at each link
    for joint in robot.iterfind("joint"):
        placed[link_of(joint, "parent")].append(joint)
    for frame in robot.iterfind("frame"):
        placed.setdefault(frame.get("link", ""), []).append(frame)
    for joint in [joint for joint in robot.iterfind("joint") if joint.get("type") == "fixed"]:
        name, carrier, pose = link_of(joint, "child"), link_of(joint, "parent"), pose_of(joint)
        child, parent = links.pop(name), links[carrier]
        shapes = [element for tag in _SHAPES for element in child.iterfind(tag)]
        for element in (*shapes, *placed[name]):
            place(element, pose @ pose_of(element))
        parent.extend(shapes)
        inertia = _inertia(child)
        if inertia is not None:
            own = _inertia(parent)
            moved = inertia.seen_from(pose)
            whole = moved if own is None else own + moved
            set_inertia(parent, mass=whole.mass, moments=whole.moments, pose=RigidTransform(whole.com))
        for element in placed[name]:
            start = element.find("parent") if element.tag == "joint" else element
            assert start is not None  # checked before
            start.set("link", carrier)
        robot.remove(child)
        robot.remove(joint)
        placed[carrier].remove(joint)
        placed[carrier] += [*placed.pop(name), add_frame(robot, name, carrier, pose)]


def _inertia(link: ET.Element) -> _Inertia | None:
    """Return the inertia of a link; None if it has no mass."""
    inertial = link.find("inertial")
    if inertial is None or mass_of(link) == 0:
        return None
    return _Inertia(mass_of(link), np.zeros(3), moments_of(inertial)).seen_from(pose_of(inertial))


def tool_links(root: ET.Element, palm: str = "") -> list[str]:
    """Return the links of a robot, at least one joint of which moves, that can carry a tool, the likeliest first.

    A ``palm``, which holds fingers, comes before all others, or what is rigidly attached to it by such a name.

    These are the ends of the kinematic chains: of every chain the link or frame with a usual name (``tool0``, ``tcp``
    ...) that is rigidly attached to its last moving link, else the outermost such link. Chains whose end has a usual
    name come first, then those with more joints, then file order.
    """
    carrier, starts = carriers(root), joints_at(root)
    moving = [joint for joint in root.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS]
    inner = {carrier[link_of(joint, "parent")] for joint in moving}
    counts = {root_link(root): 0}  # of the joints that move each link
    for joint in outward(starts, root_link(root)):
        counts[link_of(joint, "child")] = counts[link_of(joint, "parent")] + (joint.get("type") in MOVABLE_JOINTS)
    ends = []
    for end in [link_of(joint, "child") for joint in moving]:
        if end not in inner:
            attached = [end, *(link_of(joint, "child") for joint in outward(starts, end, rigid=True))]
            frames = [name_of(frame) for frame in root.iterfind("frame") if frame.get("link") in attached]
            usual = [name for name in (*frames, *attached) if _USUAL.search(name)]
            ends.append((not usual, -counts[end], (usual or attached)[-1]))
    hand = [palm, *(link_of(joint, "child") for joint in outward(starts, palm, rigid=True))] if palm else []
    hand = [name for name in hand if _USUAL.search(name)][-1:] or hand[:1]
    return list(dict.fromkeys([*hand, *(tool for _, _, tool in sorted(ends, key=lambda end: end[:2]))]))
