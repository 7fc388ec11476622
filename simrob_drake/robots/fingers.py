"""Fingers of a robot: which joints of its file move fingers, and where these are closed and open.

Fingers are one of these:

* joints that follow one other joint (``mimic`` in a URDF), with the joint that leads them,
* at least two joints that slide at the end of the same link,
* the only moving jaw of a hand, found by its name.

The palm is the link that holds the fingers. Fingers are closed at that end of their range at which the centres of mass
of their links are nearer to each other; a single jaw is closed where its centre of mass is nearer to that of the palm.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from itertools import combinations, product
from math import isclose
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field, model_validator
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Number, Positive, Strict
from simrob_drake.robots.bodies import SHAPE_TAGS, carriers
from simrob_drake.robots.urdf import (
    MOVABLE_JOINTS,
    joint_limits,
    joints_at,
    link_of,
    name_of,
    outward,
    pose_of,
)

FOLLOWS = "follows"
"""Element in which an import writes a ``mimic``, since Drake's parser would apply that under discrete solvers only."""
JAW = "jaw"
"""Element in which an import marks the joint that its user names as the moving jaw of a hand."""

_MOST_FINGERS = 5
"""Largest count n of sliding fingers of a hand. All combinations of their two ends are tried, 2ⁿ in all."""
_SAME_DISTANCE = 1e-6
"""Relative difference below which two distances of fingers count as equal."""
_JAW_NAME = re.compile(r"jaw|finger|claw|grip", re.IGNORECASE)
"""Names that published robots give to jaws and fingers."""
_WRIST_NAME = re.compile(r"roll|pitch|yaw|rot|twist|wrist", re.IGNORECASE)
"""Names of joints that turn a whole hand."""


class Gripper(Strict):
    """Fingers, which move together."""

    axes: Annotated[dict[str, tuple[Number, Number]], Field(min_length=1)]
    """Axes of the fingers, each with its closed and its open position [deg, or m of a prismatic axis]."""
    force: Positive | None = None
    """Largest force of each finger [N]; that of its motor unless given."""

    @model_validator(mode="after")
    def _check_travel(self) -> "Gripper":
        """Check that each finger is closed and open at different positions.

        Raises:
            ValueError: a finger is not; pydantic reports the error with the key.
        """
        still = [axis for axis, (closed, opened) in self.axes.items() if closed == opened]
        if still:
            raise ValueError(
                message(
                    "robots.open_unlike_closed",
                    "{axes} must have different closed and open positions",
                    axes=", ".join(still),
                )
            )
        return self


class FingerRange(NamedTuple):
    """Positions of a finger's joint [rad or m].

    Attributes:
        closed: position in which the finger is closed.
        opened: position in which the finger is open.
    """

    closed: float
    opened: float


class FingerHand(NamedTuple):
    """Fingers that move together.

    Attributes:
        fingers: ranges of the fingers' joints, by the joint's name.
        palm: name of the link that holds the fingers.
    """

    fingers: dict[str, FingerRange]
    palm: str


class _Travel(NamedTuple):
    """Positions of a joint at both ends of its travel [rad or m], before it is decided which of the two is closed.

    The fingers of a hand reach their first positions together, and their second positions together.
    """

    first: float
    second: float


class _HandCandidate(NamedTuple):
    """Joints that move together and may be the fingers of a hand.

    Attributes:
        travels: travels of the joints, by the joint's name.
        palm: name of the link that holds them.
    """

    travels: dict[str, _Travel]
    palm: str


def fingers_of(root: ET.Element) -> FingerHand | None:
    """Find the fingers in the ``robot`` element of a URDF.

    Returns None if no joints are recognized as fingers, or if several fingers are at the same distances at both ends,
    so that it is not clear where they are closed. A single jaw of this sort counts as closed at its lower end.
    """
    joints = {
        name_of(joint): joint
        for joint in root.iterfind("joint")
        if joint.get("type") in MOVABLE_JOINTS
    }
    # The most certain signs first: a name or a mark of the user, then a coupling in the file, then the geometry alone.
    jaw = _jaw(root, joints)
    if jaw is not None:
        return jaw
    hand = _joints_that_follow(joints) or _joints_that_slide(root, joints)
    if hand is None or not _is_hand(root, joints, hand):
        return None
    first_positions = {name: travel.first for name, travel in hand.travels.items()}
    second_positions = {name: travel.second for name, travel in hand.travels.items()}
    at_first = _mean_distance(root, first_positions, hand.palm)
    at_second = _mean_distance(root, second_positions, hand.palm)
    # Fingers that move side by side in one direction keep their distance: they do not grasp.
    if isclose(at_first, at_second, rel_tol=_SAME_DISTANCE):
        return None
    is_closed_second = at_second < at_first
    fingers = {}
    for name, travel in hand.travels.items():
        if is_closed_second:
            fingers[name] = FingerRange(closed=travel.second, opened=travel.first)
        else:
            fingers[name] = FingerRange(closed=travel.first, opened=travel.second)
    return FingerHand(fingers, hand.palm)


def _jaw(root: ET.Element, joints: Mapping[str, ET.Element]) -> FingerHand | None:
    """Find the only moving jaw of a hand whose other jaw is fixed, as most hobby arms have it.

    An import marks the joint that its user names, which needs nothing else but limits. Without a mark, the jaw is the
    only joint at the end of the tree whose own name or link's name is that of a finger; the link that holds it then has
    to move, and to have a shape, which is the fixed jaw.

    Args:
        root: the ``robot`` element.
        joints: the moving joints, by name.

    Returns:
        a hand with one finger, or None if there is not exactly one such joint, or if this joint has no limits.
    """
    marked = [name for name, joint in joints.items() if joint.find(JAW) is not None]
    found = marked or _joints_named_as_jaws(root, joints)
    if len(found) != 1:
        return None
    name = found[0]
    joint = joints[name]
    low, high = joint_limits(joint)
    # Without limits there is no closed and no open end.
    if not np.isfinite([low, high]).all():
        return None
    palm = link_of(joint, "parent")
    # The jaws are closed at the end of the range at which they are nearest to each other; at the lower end if the
    # distances are equal.
    is_closed_low = _distance_from_palm(root, joint, low) <= _distance_from_palm(root, joint, high)
    finger = (
        FingerRange(closed=low, opened=high)
        if is_closed_low
        else FingerRange(closed=high, opened=low)
    )
    return FingerHand({name: finger}, palm)


def _joints_named_as_jaws(root: ET.Element, joints: Mapping[str, ET.Element]) -> list[str]:
    """Find the joints that may move the only moving jaw of a hand, by name.

    Such a joint, or its link, is named as a jaw. No other joint moves beyond this joint, which follows no other joint
    and leads none. The link that holds it moves and has a shape, and holds no other such joint.

    Args:
        root: the ``robot`` element.
        joints: the moving joints, by name.
    """
    starts = joints_at(root)
    carrier_of = carriers(root)
    moving_bodies = {carrier_of[link_of(joint, "child")] for joint in joints.values()}
    leaders = {
        follows.get("joint", "") for joint in joints.values() for follows in joint.iterfind(FOLLOWS)
    }
    links_with_shapes = set()
    for link in root.iterfind("link"):
        if any(link.find(tag) is not None for tag in SHAPE_TAGS):
            links_with_shapes.add(name_of(link))

    palm_of = dict[str, str]()
    for name, joint in joints.items():
        palm = link_of(joint, "parent")
        is_last = not any(name_of(other) in joints for other in _joints_beyond(starts, joint))
        is_alone = joint.find(FOLLOWS) is None and name not in leaders
        is_named = _is_jaw_name(name) or _is_jaw_name(link_of(joint, "child"))
        # A palm without a shape has no fixed jaw, and a palm that never moves is the frame of a machine.
        has_moving_palm = carrier_of[palm] in moving_bodies and palm in links_with_shapes
        if is_named and is_last and is_alone and has_moving_palm:
            palm_of[name] = palm
    # Two jaws that move on the same palm are a hand of two fingers.
    palms = list(palm_of.values())
    return [name for name, palm in palm_of.items() if palms.count(palm) == 1]


def _is_jaw_name(text: str) -> bool:
    """Whether a name is that of a jaw, and not of a joint that turns the whole hand, such as ``gripper_roll``."""
    return bool(_JAW_NAME.search(text)) and not _WRIST_NAME.search(text)


def _distance_from_palm(root: ET.Element, joint: ET.Element, position: float) -> float:
    """Compute the distance between the centres of mass of a joint's two links [m].

    Args:
        root: the ``robot`` element.
        joint: the joint of a jaw.
        position: position of the joint [rad or m].
    """
    links = {name_of(link): link for link in root.iterfind("link")}
    palm_centre = _centre_of_mass(links[link_of(joint, "parent")])
    jaw_centre = _centre_of_mass(links[link_of(joint, "child")])
    # Pose of the jaw in the frame of the palm.
    pose = pose_of(joint) @ _joint_motion(joint, position)
    return float(np.linalg.norm(pose @ jaw_centre - palm_centre))


def _centre_of_mass(link: ET.Element) -> Vector:
    """Read the centre of mass of a link in the link's frame, shape (3,) [m]. Without inertia, it is the origin."""
    inertial = link.find("inertial")
    return np.zeros(3) if inertial is None else np.asarray(pose_of(inertial).translation())


class MimicLine(NamedTuple):
    """Position of a joint that follows another: ``factor * position of the leader + offset``.

    Attributes:
        factor: ratio of the positions [rad/rad, m/rad, rad/m or m/m].
        offset: position if the leader is at 0 [rad or m].
    """

    factor: float
    offset: float


def mimic_line(follows: ET.Element) -> MimicLine:
    """Read the factor and the offset by which a joint follows another, from its element FOLLOWS.

    As in a URDF's ``mimic``, they are 1 and 0 unless given.
    """
    return MimicLine(float(follows.get("multiplier", "1")), float(follows.get("offset", "0")))


def _joints_that_follow(joints: Mapping[str, ET.Element]) -> _HandCandidate | None:
    """Find the joint that most others follow, with its followers.

    Args:
        joints: the joints that can move, by name.

    Returns:
        the candidate, or None if no joint follows another one of `joints` with a factor other than 0, or if the joint
        that most others follow lacks a limit.
    """
    # For each leader: the travels of the leader and of its followers, by the joint's name.
    groups: dict[str, dict[str, _Travel]] = {}
    for name, joint in joints.items():
        # Leave out joints that follow no other joint, or one that cannot move and is therefore not among `joints`.
        follows = joint.find(FOLLOWS)
        leader = "" if follows is None else follows.get("joint", "")
        if follows is None or leader not in joints:
            continue
        # With a factor of 0 the joint does not move, and is no finger.
        factor, offset = mimic_line(follows)
        if factor == 0:
            continue
        # The ends of a follower are those to which its leader moves it. Its own limits may be wider.
        low, high = joint_limits(joints[leader])
        group = groups.setdefault(leader, {leader: _Travel(low, high)})
        group[name] = _Travel(factor * low + offset, factor * high + offset)
    if not groups:
        return None
    # Other joints of a robot may follow each other, too, such as the two sides of a linkage.
    leader = max(groups, key=lambda name: len(groups[name]))
    travels = groups[leader]
    if not np.isfinite(list(travels.values())).all():
        return None
    return _HandCandidate(travels, link_of(joints[leader], "parent"))


def _joints_that_slide(root: ET.Element, joints: Mapping[str, ET.Element]) -> _HandCandidate | None:
    """Find the link on which most joints slide side by side at the ends of the tree.

    Joints that lack a limit do not count. Returns None if there are fewer than two such joints, or more than
    _MOST_FINGERS. The first position of each joint is the end of its travel at which the fingers are nearest to each
    other.

    Args:
        root: the ``robot`` element.
        joints: the moving joints, by name.
    """
    starts = joints_at(root)
    # For each palm: the limits of the joints that slide on it, by the joint's name.
    limits_by_palm: dict[str, dict[str, _Travel]] = {}
    for name, joint in joints.items():
        is_last = not any(
            other.get("type") in MOVABLE_JOINTS for other in _joints_beyond(starts, joint)
        )
        limits = _Travel(*joint_limits(joint))
        if is_last and joint.get("type") == "prismatic" and np.isfinite(limits).all():
            limits_by_palm.setdefault(link_of(joint, "parent"), {})[name] = limits
    if not limits_by_palm:
        return None
    palm = max(limits_by_palm, key=lambda name: len(limits_by_palm[name]))
    limits_of = limits_by_palm[palm]
    if not 1 < len(limits_of) <= _MOST_FINGERS:
        return None

    def distance(travels: Mapping[str, _Travel]) -> float:
        """Mean distance of the fingers in their first positions [m]."""
        return _mean_distance(root, {name: travel.first for name, travel in travels.items()}, palm)

    # Each finger may be closed at either end of its own travel: two fingers that close on each other may both move in
    # the positive direction of their own axes, or one of them in the negative one.
    both_directions = [
        (limits, _Travel(limits.second, limits.first)) for limits in limits_of.values()
    ]
    combined = [dict(zip(limits_of, travels, strict=True)) for travels in product(*both_directions)]
    return _HandCandidate(min(combined, key=distance), palm)


def _is_hand(root: ET.Element, joints: Mapping[str, ET.Element], hand: _HandCandidate) -> bool:
    """Whether the fingers are the only moving joints beyond the palm, in two branches or more.

    The robot needs other moving joints as well, as a hand on an arm has them. In the file of a gripper alone there are
    none, and a joint or a link has to be named as a finger: the axes of a machine that slide from its frame are no
    fingers.

    Args:
        root: the ``robot`` element.
        joints: the moving joints, by name.
        hand: the fingers and their palm.
    """
    starts = joints_at(root)
    beyond = {name_of(joint) for joint in outward(starts, hand.palm)} & joints.keys()
    # A branch is a joint on the palm with all joints that it carries; only branches that move count.
    moving_branches = 0
    for joint in starts[hand.palm]:
        names = {name_of(joint), *(name_of(other) for other in _joints_beyond(starts, joint))}
        if beyond & names:
            moving_branches += 1
    has_other_joints = len(beyond) < len(joints)
    finger_names = [
        name for finger in hand.travels for name in (finger, link_of(joints[finger], "child"))
    ]
    is_named = any(_JAW_NAME.search(name) for name in finger_names)
    return beyond == hand.travels.keys() and moving_branches > 1 and (has_other_joints or is_named)


def _joints_beyond(starts: Mapping[str, list[ET.Element]], joint: ET.Element) -> list[ET.Element]:
    """Find the joints that a joint carries; ``starts`` are the joints that start at each link."""
    return outward(starts, link_of(joint, "child"))


def _mean_distance(root: ET.Element, positions: Mapping[str, float], palm: str) -> float:
    """Compute the mean distance between the centres of mass of fingers' links, over all pairs [m].

    One finger has no pair, and the distance 0.

    Args:
        root: the ``robot`` element.
        positions: positions of the fingers' joints [rad or m], by name; other joints beyond the palm are at 0.
        palm: name of the link that holds the fingers.
    """
    links = {name_of(link): link for link in root.iterfind("link")}
    # Poses of the links beyond the palm, in the frame of the palm.
    poses = {palm: RigidTransform()}
    centres = list[Vector]()
    for joint in outward(joints_at(root), palm):
        # Outward, so that the pose of a joint's parent is known before that of its child.
        name = name_of(joint)
        child = link_of(joint, "child")
        motion = _joint_motion(joint, positions.get(name, 0.0))
        pose_of_parent = poses[link_of(joint, "parent")]
        poses[child] = pose_of_parent @ pose_of(joint) @ motion
        if name in positions:
            centres.append(poses[child] @ _centre_of_mass(links[child]))
    distances = [
        float(np.linalg.norm(first - second)) for first, second in combinations(centres, 2)
    ]
    return sum(distances) / max(len(distances), 1)


def _joint_motion(joint: ET.Element, position: float) -> RigidTransform:
    """Compute the motion of a joint from its zero to a position: a translation or a rotation along or about its axis.

    Args:
        joint: a joint that slides or turns, or a fixed joint, whose position is 0.
        position: the position [rad or m].
    """
    # The axis of a joint without an element <axis> is x, by the definition of URDF.
    element = joint.find("axis")
    direction = "1 0 0" if element is None else element.get("xyz", "1 0 0")
    axis = np.array(direction.split(), dtype=float)
    # In a file the vector may have any length: it is a direction.
    axis /= np.linalg.norm(axis)
    if joint.get("type") == "prismatic":
        return RigidTransform(position * axis)
    rotation = RotationMatrix(AngleAxis(position, axis))
    return RigidTransform(rotation, np.zeros(3))
