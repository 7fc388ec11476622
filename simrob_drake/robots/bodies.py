"""Links that are rigidly joined are one body: which those are, how they become one link; and which links are fingers.

A solver visits every body at every evaluation, welded or not. The flange, gripper and load of an arm are a third of
its bodies, and published robots have dozens of fixed links that only name a frame. Merging changes no motion: masses,
centres of mass and inertias add up by the parallel axis theorem, shapes keep their places, and each merged link stays
on as a frame of its name. What is joined to the last body of a chain tells where that carries its tool.

Fingers are joints that follow one other (``mimic``), or at least two that slide at the end of one link, or the only
moving jaw of a hand, by its name. They are closed at that end of their way at which their links' centres of mass are
nearer to each other, or to that of the link with the fixed jaw.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations, product
from math import isclose
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field, model_validator
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import Vector
from simrob_drake.robots.urdf import (
    MOVABLE_JOINTS,
    add_frame,
    joint_limits,
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
from simrob_drake.sections import Number, Positive, Strict

_USUAL = re.compile(r"tool|tcp|flange|attachment|end_?effector|(^|_)ee(_|f?$)|tip|grasp", re.IGNORECASE)
"""Names that published robots give to the place of the tool."""
_GRASPS = re.compile(r"tcp|tip|grasp", re.IGNORECASE)  # those of them that say where fingers grasp
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

    def seen_from(self, parent: RigidTransform) -> "_Inertia":
        """Return the same inertia in the parent's frame, in which the link has the pose ``parent``."""
        turn = parent.rotation().matrix()
        return _Inertia(self.mass, parent @ self.com, turn @ self.moments @ turn.T)

    def __add__(self, other: "_Inertia") -> "_Inertia":
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

    A ``palm``, which holds fingers, comes before all others, and before it what is rigidly attached to it by such a
    name, first where it is that of a grasp.

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
    hand += [name_of(frame) for frame in root.iterfind("frame") if frame.get("link") in hand]
    named = [name for usual in (_GRASPS, _USUAL) for name in hand if usual.search(name)]
    return list(dict.fromkeys([*named, *hand[:1], *(tool for _, _, tool in sorted(ends, key=lambda end: end[:2]))]))


_MOST = 5  # fingers of a hand
FOLLOWS = "follows"
"""Element in which an import writes a ``mimic``, since Drake's parser would heed that under discrete solvers only."""


JAW = "jaw"
"""Element in which an import marks the joint that its user calls the moving jaw of a hand."""
_JAWS = re.compile(r"jaw|finger|claw|grip", re.IGNORECASE)
_TURNS = re.compile(r"roll|pitch|yaw|rot|twist|wrist", re.IGNORECASE)  # joints that turn a whole hand


class Gripper(Strict):
    """Fingers, which move together."""

    axes: Annotated[dict[str, tuple[Number, Number]], Field(min_length=1)]
    """Its axes, each with where it is closed and where open [deg, or m of a prismatic axis]."""
    force: Positive | None = None
    """Largest force of each finger [N]; what its motor has unless given."""

    @model_validator(mode="after")
    def _opens(self) -> "Gripper":
        if still := [axis for axis, (closed, opened) in self.axes.items() if closed == opened]:
            raise ValueError(f"{', '.join(still)} must be open elsewhere than closed")
        return self


class _Fingers(NamedTuple):
    """Joints that move together: their positions at both ends of the way, and the link that holds them."""

    ends: dict[str, tuple[float, float]]
    palm: str


def fingers_of(root: ET.Element) -> tuple[dict[str, tuple[float, float]], str] | None:
    """Return a URDF's finger joints, closed and open [rad or m], and the link that holds them; None if undecided."""
    joints = {name_of(joint): joint for joint in root.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS}
    jaw = _jaw(root, joints)
    if jaw is not None:
        return jaw.ends, jaw.palm
    found = _following(joints) or _sliding(root, joints)
    if found is None or not _is_hand(root, joints, found):
        return None
    apart = [_apart(root, {name: ends[end] for name, ends in found.ends.items()}, found.palm) for end in (0, 1)]
    if isclose(*apart, rel_tol=1e-6):
        return None
    closed = int(apart[1] < apart[0])
    return {name: (ends[closed], ends[1 - closed]) for name, ends in found.ends.items()}, found.palm


def _jaw(root: ET.Element, joints: Mapping[str, ET.Element]) -> _Fingers | None:
    """Find the only moving jaw of a hand whose other jaw is fixed, as most hobby arms have it.

    An import marks the joint that its user names. Unless one is marked, it is the only joint at the end of the tree
    whose own name or link's name is that of a finger. The link that holds it has to move, and to have a shape, which is
    the fixed jaw.
    """
    marked = [name for name, joint in joints.items() if joint.find(JAW) is not None]
    found = marked or _joints_named_as_jaws(root, joints)
    if len(found) != 1:
        return None
    name = found[0]
    joint = joints[name]
    low, high = joint_limits(joint)
    if not np.isfinite([low, high]).all():
        return None
    palm = link_of(joint, "parent")
    # The jaws are closed at the end of the range at which they are nearest to each other.
    is_closed_low = _from_palm(root, joint, low) <= _from_palm(root, joint, high)
    ends = (low, high) if is_closed_low else (high, low)
    return _Fingers({name: ends}, palm)


def _joints_named_as_jaws(root: ET.Element, joints: Mapping[str, ET.Element]) -> list[str]:
    """Joints at the end of the tree, of a moving link with a shape, that are named as jaws and follow no other."""
    starts = joints_at(root)
    carrier = carriers(root)
    moved = {carrier[link_of(joint, "child")] for joint in joints.values()}
    shaped = {name_of(link) for link in root.iterfind("link") if any(link.find(tag) is not None for tag in _SHAPES)}
    leaders = {follows.get("joint", "") for joint in joints.values() for follows in joint.iterfind(FOLLOWS)}
    found = []
    for name, joint in joints.items():
        is_last = not any(name_of(other) in joints for other in _after(starts, joint))
        is_alone = joint.find(FOLLOWS) is None and name not in leaders
        palm = link_of(joint, "parent")
        is_named = any(_JAWS.search(text) and not _TURNS.search(text) for text in (name, link_of(joint, "child")))
        if is_named and is_last and is_alone and carrier[palm] in moved and palm in shaped:
            found.append(name)
    palms = [link_of(joints[name], "parent") for name in found]
    # Two jaws that move are a hand of two fingers.
    return [name for name, palm in zip(found, palms, strict=True) if palms.count(palm) == 1]


def _from_palm(root: ET.Element, joint: ET.Element, position: float) -> float:
    """Distance between the centres of mass of a joint's link and the link that holds it, in a position [m]."""
    links = {name_of(link): link for link in root.iterfind("link")}
    centres = []
    for end in ("parent", "child"):
        inertial = links[link_of(joint, end)].find("inertial")
        centres.append(np.zeros(3) if inertial is None else pose_of(inertial).translation())
    pose = pose_of(joint) @ _motion(joint, position)
    return float(np.linalg.norm(pose @ centres[1] - centres[0]))


def followed(follows: ET.Element) -> tuple[float, float]:
    """Return the factor and the offset by which a joint follows another."""
    return float(follows.get("multiplier", "1")), float(follows.get("offset", "0"))


def _following(joints: Mapping[str, ET.Element]) -> _Fingers | None:
    """Return the joints that follow one other, with that: those of most followers."""
    groups: dict[str, dict[str, tuple[float, float]]] = {}
    for name, joint in joints.items():
        follows = joint.find(FOLLOWS)
        leader = "" if follows is None else follows.get("joint", "")
        if follows is None or leader not in joints:
            continue
        factor, offset = followed(follows)
        if factor == 0:  # it stands, and is no finger
            continue
        group = groups.setdefault(leader, {leader: joint_limits(joints[leader])})
        group[name] = (factor * group[leader][0] + offset, factor * group[leader][1] + offset)
    ends = max(groups.values(), key=len, default={})
    if not ends or not np.isfinite(list(ends.values())).all():
        return None
    return _Fingers(ends, link_of(joints[next(iter(ends))], "parent"))


def _sliding(root: ET.Element, joints: Mapping[str, ET.Element]) -> _Fingers | None:
    """Return at least two joints that slide side by side at the ends of the tree."""
    starts = joints_at(root)
    sides: dict[str, dict[str, tuple[float, float]]] = {}
    for name, joint in joints.items():
        beyond = _after(starts, joint)
        last = not any(other.get("type") in MOVABLE_JOINTS for other in beyond)
        if last and joint.get("type") == "prismatic" and np.isfinite(joint_limits(joint)).all():
            sides.setdefault(link_of(joint, "parent"), {})[name] = joint_limits(joint)
    palm, ends = max(sides.items(), key=lambda side: len(side[1]), default=("", {}))
    if not 1 < len(ends) <= _MOST:
        return None
    ways = product(*((way, way[::-1]) for way in ends.values()))  # each may be closed at either end of its own

    def apart(way: Iterable[tuple[float, float]]) -> float:
        return _apart(root, {name: end for name, (end, _) in zip(ends, way, strict=True)}, palm)

    return _Fingers(dict(zip(ends, min(ways, key=apart), strict=True)), palm)


def _is_hand(root: ET.Element, joints: Mapping[str, ET.Element], fingers: _Fingers) -> bool:
    """Tell whether something moves the link that holds fingers, and nothing but these moves beyond it, in two rows."""
    starts = joints_at(root)
    beyond = {name_of(joint) for joint in outward(starts, fingers.palm)} & joints.keys()
    rows = [row for row in starts[fingers.palm] if beyond & {name_of(row), *map(name_of, _after(starts, row))}]
    return beyond == fingers.ends.keys() and len(rows) > 1 and len(beyond) < len(joints)


def _after(starts: Mapping[str, list[ET.Element]], joint: ET.Element) -> list[ET.Element]:
    return outward(starts, link_of(joint, "child"))


def _apart(root: ET.Element, positions: Mapping[str, float], palm: str) -> float:
    """Return the mean distance between the links that joints end at, beyond a link, in positions [rad or m]."""
    centres, poses = list[Vector](), {palm: RigidTransform()}
    links = {name_of(link): link for link in root.iterfind("link")}
    for joint in outward(joints_at(root), palm):
        child = link_of(joint, "child")
        turn = _motion(joint, positions.get(name_of(joint), 0.0))
        poses[child] = poses[link_of(joint, "parent")] @ pose_of(joint) @ turn
        if name_of(joint) in positions:
            inertial = links[child].find("inertial")
            centre = np.zeros(3) if inertial is None else pose_of(inertial).translation()
            centres.append(poses[child] @ centre)
    gaps = [float(np.linalg.norm(one - other)) for one, other in combinations(centres, 2)]
    return sum(gaps) / max(len(gaps), 1)


def _motion(joint: ET.Element, value: float) -> RigidTransform:
    element = joint.find("axis")
    axis = np.array(("1 0 0" if element is None else element.get("xyz", "1 0 0")).split(), dtype=float)
    if joint.get("type") == "prismatic":
        return RigidTransform(value * axis)
    return RigidTransform(RotationMatrix(AngleAxis(value, axis / np.linalg.norm(axis))), np.zeros(3))
