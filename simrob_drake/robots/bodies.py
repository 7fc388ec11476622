"""Bodies of a robot: groups of rigidly joined links, how each group becomes one link, and which links carry tools.

The robot is the ``robot`` element of a URDF. Links that fixed joints connect are one body; its carrier is the link of
the body that is nearest to the root.

A solver visits every body at every evaluation, welded or not. The flange, gripper and load of an arm are a third of
its bodies, and published robots have dozens of fixed links that only name a frame. Merging changes no motion: masses,
centres of mass and inertias add up by the parallel axis theorem, shapes keep their places, and each merged link stays
on as a frame of its name.
"""

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.frames import Vector
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

# "ee" alone is in many words, such as "wheel" and "knee", so that it has to be a word of its own.
_TOOL_NAME = re.compile(
    r"tool|tcp|flange|attachment|end_?effector|(^|_)ee(_|f?$)|tip|grasp", re.IGNORECASE
)
"""Names that published robots give to the frame of the tool."""
_GRASP_NAME = re.compile(r"tcp|tip|grasp", re.IGNORECASE)
"""Those of these names that mean the point at which fingers grasp."""
SHAPE_TAGS = ("visual", "collision")
"""Tags of the elements of a link that have a shape."""


def carriers(robot: ET.Element) -> dict[str, str]:
    """Find the carrier of each link's body: the first link on the way to the root that a joint moves, or the root.

    A link that a joint moves is its own carrier. Returns the names of the carriers, by the names of all links.
    """
    root = root_link(robot)
    found = {root: root}
    # Each joint comes after those that carry it, so that the carrier of its parent is known.
    for joint in outward(joints_at(robot), root):
        child = link_of(joint, "child")
        is_fixed = joint.get("type") == "fixed"
        found[child] = found[link_of(joint, "parent")] if is_fixed else child
    return found


def bodies(robot: ET.Element) -> dict[str, list[ET.Element]]:
    """Find the links of each body, by the name of the body's carrier."""
    carrier_of = carriers(robot)
    found = dict[str, list[ET.Element]]()
    for link in robot.iterfind("link"):
        found.setdefault(carrier_of[name_of(link)], []).append(link)
    return found


def links_without_inertia(robot: ET.Element, *, floating: bool = False) -> list[str]:
    """Find the moving links whose body has no mass, by name: a dynamic simulation cannot move them.

    A moving link is one that a joint moves. The links that are fixed to it are not listed, but their mass counts.

    Args:
        robot: a ``robot`` element.
        floating: whether the root link moves, too.
    """
    # A link without mass is no problem if another link of its body has mass.
    weightless = {
        carrier
        for carrier, links in bodies(robot).items()
        if not any(mass_of(link) > 0 for link in links)
    }
    # A link that a joint moves is the carrier of its own body, so that the two sets have names of carriers.
    moving = {
        link_of(joint, "child")
        for joint in robot.iterfind("joint")
        if joint.get("type") in MOVABLE_JOINTS
    }
    if floating:
        moving.add(root_link(robot))
    return [
        name_of(link) for link in robot.iterfind("link") if name_of(link) in moving & weightless
    ]


@dataclass(frozen=True)
class _Inertia:
    """Mass and its distribution, in the frame of a link.

    Attributes:
        mass: mass [kg].
        com: centre of mass, shape (3,) [m].
        moments: matrix of moments of inertia about the centre of mass, shape (3, 3) [kg m²].
    """

    mass: float
    com: Vector
    moments: Vector

    def in_parent(self, pose: RigidTransform) -> "_Inertia":
        """Express the inertia in a parent frame, in which the present frame has the given pose."""
        # Moments about the centre of mass only turn: J' = R J Rᵀ. They do not depend on the origin of the frame.
        rotation = pose.rotation().matrix()
        return _Inertia(self.mass, pose @ self.com, rotation @ self.moments @ rotation.T)

    def __add__(self, other: "_Inertia") -> "_Inertia":
        """Combine two inertias in the same frame, as if they were rigidly joined."""
        # Both moments are moved to the common centre of mass before they are added.
        mass = self.mass + other.mass
        com = (self.mass * self.com + other.mass * other.com) / mass
        return _Inertia(mass, com, self._moments_about(com) + other._moments_about(com))

    def _moments_about(self, point: Vector) -> Vector:
        """Compute the moments about a point (3,) [m], shape (3, 3) [kg m²].

        With the offset d of the point, the parallel axis theorem says: moments + mass (d · d 1 - d dᵀ).
        """
        offset = point - self.com
        return self.moments + self.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))


def merge_fixed_links(robot: ET.Element) -> None:
    """Merge every link of a checked URDF that is on a fixed joint into its parent, in place.

    A frame with the name of the link replaces the link. The link's shapes, inertia, joints and frames go over to the
    parent.

    Args:
        robot: the ``robot`` element. It is changed.
    """
    links = {name_of(link): link for link in robot.iterfind("link")}
    # The joints and frames that start at each link, by the link's name. They move to the parent with the link.
    starting: dict[str, list[ET.Element]] = {name: [] for name in links}
    for joint in robot.iterfind("joint"):
        starting[link_of(joint, "parent")].append(joint)
    for frame in robot.iterfind("frame"):
        starting.setdefault(frame.get("link", ""), []).append(frame)

    fixed_joints = [joint for joint in robot.iterfind("joint") if joint.get("type") == "fixed"]
    for joint in fixed_joints:
        child_name = link_of(joint, "child")
        parent_name = link_of(joint, "parent")
        pose = pose_of(joint)
        # The child may have been extended by other merged links before, and the parent may be merged later.
        child = links.pop(child_name)
        moved = starting.pop(child_name)
        _merge_link(child, links[parent_name], pose)
        # What started at the child now starts at the parent, with the pose of the fixed joint in front.
        for element in moved:
            place(element, pose @ pose_of(element))
            start = element.find("parent") if element.tag == "joint" else element
            assert start is not None  # checked before
            start.set("link", parent_name)
        # Stations, tools and pieces name links. A frame of the same name keeps such a name valid.
        robot.remove(child)
        robot.remove(joint)
        starting[parent_name].remove(joint)
        starting[parent_name] += [*moved, add_frame(robot, child_name, parent_name, pose)]


def _merge_link(child: ET.Element, parent: ET.Element, pose: RigidTransform) -> None:
    """Add the shapes and the inertia of a link to its parent, in place. A link without mass adds its shapes only.

    Args:
        child: the link. The poses of its shapes are changed, too, since the parent gets the same elements.
        parent: the link to which it is fixed.
        pose: pose of the child in the parent.
    """
    # Poses of shapes are given in their link, so that they change with the link to which they belong.
    shapes = [element for tag in SHAPE_TAGS for element in child.iterfind(tag)]
    for shape in shapes:
        place(shape, pose @ pose_of(shape))
    parent.extend(shapes)
    inertia_of_child = _inertia_of(child)
    if inertia_of_child is None:
        return
    total = inertia_of_child.in_parent(pose)
    inertia_of_parent = _inertia_of(parent)
    if inertia_of_parent is not None:
        total = inertia_of_parent + total
    # The moments have the axes of the parent, so that the pose is a translation to the centre of mass alone.
    set_inertia(parent, mass=total.mass, moments=total.moments, pose=RigidTransform(total.com))


def _inertia_of(link: ET.Element) -> _Inertia | None:
    """Read the inertia of a link. Returns None if the link has no mass."""
    inertial = link.find("inertial")
    if inertial is None or mass_of(link) == 0:
        return None
    # A URDF gives moments in a frame of their own, whose origin is the centre of mass.
    in_own_frame = _Inertia(mass_of(link), np.zeros(3), moments_of(inertial))
    return in_own_frame.in_parent(pose_of(inertial))


def tool_links(root: ET.Element, palm: str = "") -> list[str]:
    """Find the links and frames of a robot that can carry a tool, the likeliest first.

    They come in this order, each once:

    1. the frames and links of the hand with a usual name for a tool (``tool0``, ``tcp`` ...), first those for the point
       of a grasp,
    2. the palm, which is the link that holds the fingers,
    3. one link or frame at the end of each kinematic chain.

    Args:
        root: the ``robot`` element; at least one joint moves.
        palm: name of the link that holds fingers, or an empty text if the robot has none.
    """
    hand = _hand_names(root, palm) if palm else []
    grasps = [name for name in hand if _GRASP_NAME.search(name)]
    tools = [name for name in hand if _TOOL_NAME.search(name)]
    # The first name of the hand is that of the palm. A dict drops repeated names and keeps their order.
    return list(dict.fromkeys([*grasps, *tools, *hand[:1], *_chain_tools(root)]))


def _hand_names(root: ET.Element, palm: str) -> list[str]:
    """Names of a palm (the link that holds fingers), the links rigidly attached to it, and the frames of all these."""
    attached = outward(joints_at(root), palm, rigid=True)
    links = [palm, *(link_of(joint, "child") for joint in attached)]
    frames = [name_of(frame) for frame in root.iterfind("frame") if frame.get("link") in links]
    return [*links, *frames]


class _ChainTool(NamedTuple):
    """The link or frame for a tool at the end of a kinematic chain.

    Attributes:
        has_usual_name: whether its name is usual for a tool.
        joint_count: count of the joints between the root and the end of the chain that move.
        name: name of the link or frame.
    """

    has_usual_name: bool
    joint_count: int
    name: str


def _chain_tools(root: ET.Element) -> list[str]:
    """Find the link or frame for a tool at the end of each kinematic chain.

    The candidates are the chain's last moving link and the links that are rigidly attached to it, in order outward. The
    tool is the last one with a usual name; if no link has one, the last of their frames with a usual name; and the last
    link if there is no such frame either. Tools with usual names come first, then those of chains with more moving
    joints, then file order.
    """
    carrier_of = carriers(root)
    starts = joints_at(root)
    moving_joints = [
        joint for joint in root.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS
    ]
    # Bodies on which a moving joint starts are not at the end of a chain.
    inner = {carrier_of[link_of(joint, "parent")] for joint in moving_joints}
    counts = _joint_counts(root)
    found = []
    for joint in moving_joints:
        end = link_of(joint, "child")
        if end in inner:
            continue
        # Published arms end in several links without a joint between them, such as a flange and a `tool0`.
        attached = [end, *(link_of(fixed, "child") for fixed in outward(starts, end, rigid=True))]
        frames = [
            name_of(frame) for frame in root.iterfind("frame") if frame.get("link") in attached
        ]
        usual = [name for name in (*frames, *attached) if _TOOL_NAME.search(name)]
        name = usual[-1] if usual else attached[-1]
        found.append(_ChainTool(bool(usual), counts[end], name))
    # The chain with more joints is more likely that of an arm. The sort is stable: equal entries keep the file's order.
    found.sort(key=lambda tool: (not tool.has_usual_name, -tool.joint_count))
    return [tool.name for tool in found]


def _joint_counts(root: ET.Element) -> dict[str, int]:
    """Count the moving joints between the root link and each link, by the link's name."""
    # Outward, so that the count of a joint's parent is known before that of its child.
    counts = {root_link(root): 0}
    for joint in outward(joints_at(root), root_link(root)):
        is_moving = joint.get("type") in MOVABLE_JOINTS
        counts[link_of(joint, "child")] = counts[link_of(joint, "parent")] + int(is_moving)
    return counts
