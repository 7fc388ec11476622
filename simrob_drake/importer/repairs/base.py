"""Decide whether the base of a robot is fixed to the world or floats.

The file decides if it says so. Otherwise the names of joints and links decide, and if these are not clear, the shape:
robots on legs or wheels float, arms and hands are fixed.
"""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from simrob_drake.base.messages import message
from simrob_drake.robots.bodies import carriers
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import (
    MOVABLE_JOINTS,
    joints_at,
    link_of,
    name_of,
    outward,
    pose_of,
    root_link,
)

FLOATING_MARK = "simrob_base"
"""Attribute of a robot whose root was held by a floating joint, which the import has removed.

The repair of the joints sets it, and the choice of the base removes it.
"""

_WORLD = re.compile(r"(robot_)?world(_link)?(_\d+)?", re.IGNORECASE)
"""Names of a root link that is the world, also after the import has renamed it."""

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
"""Words in a name: ``left`` and ``leg`` in ``left_leg2`` and in ``LeftLeg``, ``L`` and ``Leg`` in ``LLeg``."""

_SIDE = r"(?:[lrfhbm]{0,2}|left|right|front|rear|hind|back|mid|middle)"
"""Side of the robot in front of a word, such as ``lf`` in ``lfhip``."""

_LEG = re.compile(
    _SIDE
    + r"(?:legs?|hip|thigh|knee|calf|shank|shin|ankle|foot|feet|toe|coxa|femur|tibia|haa|hfe|kfe)"
)
"""Words for parts and joints of legs, those of insects included.

HAA is hip abduction and adduction, HFE hip flexion and extension, KFE knee flexion and extension.
"""

_ARM = re.compile(
    _SIDE
    + r"(?:(?:fore|upper|lower)?arms?|shoulder|elbow|wrist|palm|hand|gripper|fingers?|thumb|index)"
)
"""Words for parts and joints of arms and hands."""

_WHEEL = re.compile(_SIDE + r"(?:wheels?)")

_LEAST_LEG_JOINTS = 3
"""Least count of movable joints in a leg that is recognized by its shape."""

_LEAST_NAMED_LEG_JOINTS = 2
"""Least count of movable joints in a leg that is recognized by its names: hip and knee."""

_LEAST_LEGS = 2
"""Least count of legs that carry a robot."""

_MOST_FINGERS = 5
"""Largest count of fingers of a hand. More branches are legs: those of insects, which do not hang down at first."""

_LEAST_WHEELS = 3
"""Least count of wheels that are recognized by their joints alone: many arms have one or two continuous joints."""

_LEAST_NAMED_WHEELS = 2
"""Least count of wheels that are recognized by their names, as a differential drive has two."""

_HANGING_SHARE = 0.5
"""A branch hangs down if at least this share of the distance to its farthest link points downward."""

Base = Literal["fixed", "floating"]


class BaseChoice(NamedTuple):
    """Decision whether a robot's base is fixed or floats, and its reason in words."""

    base: Base
    reason: str


def choose_base(robot: ET.Element, options: ImportOptions, report: ImportReport) -> Base:
    """Decide whether the robot's base is fixed or floats, and report the reason.

    The mark FLOATING_MARK is removed from the robot, so that it is not written into the new URDF.

    Args:
        robot: the ``robot`` element, with repaired joints.
        options: options of the import, which may give the base.
        report: report of the import.
    """
    choice = find_base(robot, options)
    robot.attrib.pop(FLOATING_MARK, None)
    names = {
        "fixed": message("importer.fixed", "fixed"),
        "floating": message("importer.floating", "floating"),
    }
    advice = ""
    if options.base == "auto":
        # A guess may be wrong, so the report has the option for the other base. Its value is the same in all languages.
        other = "floating" if choice.base == "fixed" else "fixed"
        advice = message(
            "importer.base_option", "; if this is wrong, choose --base {base}", base=other
        )
    report.add(
        "read",
        message("robots.link_called", "link '{link}'", link=root_link(robot)),
        message(
            "importer.base_because",
            "{base} base: {why}{how}",
            base=names[choice.base],
            why=choice.reason,
            how=advice,
        ),
    )
    return choice.base


def find_base(robot: ET.Element, options: ImportOptions) -> BaseChoice:
    """Decide whether the robot's base is fixed or floats, without a change of the robot.

    The first of these that applies decides: the option of the user, a floating joint that held the root, a root link
    that is the world, the names of joints and links, and the shape of the tree of joints.

    Args:
        robot: the ``robot`` element.
        options: options of the import, which may give the base.
    """
    if options.base != "auto":
        return BaseChoice(options.base, message("importer.as_chosen", "chosen by the user"))
    root = root_link(robot)
    # What the file says is more reliable than names and shapes.
    if robot.get(FLOATING_MARK) is not None:
        return BaseChoice(
            "floating",
            message("importer.floating_joint_held", "the file has a floating joint at the root"),
        )
    # Joints at the world hold the robot where its author placed it.
    if _WORLD.fullmatch(root):
        return BaseChoice("fixed", message("importer.root_is_world", "the root link is the world"))
    joints_of_link = joints_at(robot)
    # Names come before the shape: an arm may hang down like a leg, and a leg may be drawn stretched out.
    support = _support_by_names(robot, joints_of_link, root)
    if not support:
        support = _support_by_shape(joints_of_link, root)
    if support:
        return BaseChoice("floating", support)

    movable = [joint for joint in robot.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS]
    # The count is only for the report. A robot without legs and wheels is fixed, with arms or without.
    arm_joint_count = sum(_has_word(_ARM, joint) for joint in movable)
    called = ""
    if arm_joint_count:
        called = message(
            "importer.called_as_arms",
            "; {arms} joints have names of arms or hands",
            arms=arm_joint_count,
        )
    return BaseChoice(
        "fixed",
        message(
            "importer.no_legs_no_wheels",
            "the robot has no pair of legs and no wheels{called}",
            called=called,
        ),
    )


def _support_by_names(
    robot: ET.Element, joints_of_link: Mapping[str, list[ET.Element]], root: str
) -> str:
    """Find legs or wheels by the names of joints and links, wherever in the tree of links they begin.

    Args:
        robot: the ``robot`` element.
        joints_of_link: joints that start at a link, by the link's name.
        root: name of the root link.

    Returns:
        the reason, in words, why the robot is on legs or wheels; empty if the names do not show any.
    """
    joints = outward(joints_of_link, root)
    # Links that fixed joints connect count as one: a leg may begin at a plate that is fixed to the trunk.
    carrier_of_link = carriers(robot)
    movable_counts = Counter[str]()  # movable joints in the tree that starts at a link
    links_with_leg = set[str]()  # links from which a joint of a leg is reached
    leg_counts = Counter[str]()  # legs that start at a body, by the link that carries it
    # From the tips to the root, so that the counts of a link are complete when its parent needs them.
    for joint in reversed(joints):
        parent = link_of(joint, "parent")
        child = link_of(joint, "child")
        moves = joint.get("type") != "fixed"
        movable_counts[parent] += movable_counts[child] + moves
        if child in links_with_leg or _has_word(_LEG, joint):
            links_with_leg.add(parent)
            # The joint itself is the first of the leg. A fixed joint to a leg is no second leg.
            is_leg = moves and movable_counts[child] + 1 >= _LEAST_NAMED_LEG_JOINTS
            leg_counts[carrier_of_link[parent]] += is_leg
    for link, count in leg_counts.items():
        if count >= _LEAST_LEGS:
            return message(
                "importer.branches_called_as_legs",
                "{count} branches of '{link}' have names of legs",
                count=count,
                link=link,
            )
    # A wheel turns without end. Joints with limits that are called wheels are something else.
    continuous = [joint for joint in joints if joint.get("type") == "continuous"]
    wheel_count = sum(_has_word(_WHEEL, joint) for joint in continuous)
    if wheel_count < _LEAST_NAMED_WHEELS:
        return ""
    return message(
        "importer.joints_called_as_wheels",
        "{wheels} continuous joints have names of wheels",
        wheels=wheel_count,
    )


def _has_word(words: re.Pattern[str], joint: ET.Element) -> bool:
    """Whether the name of a joint, or of its child link, contains one of some words.

    Only whole words count: ``ship`` contains no ``hip``.
    """
    found = _WORD.findall(f"{name_of(joint)} {link_of(joint, 'child')}")
    return any(words.fullmatch(word.lower()) for word in found)


def _support_by_shape(joints_of_link: Mapping[str, list[ET.Element]], root: str) -> str:
    """Find legs or wheels by the shape of the branches that start at the root.

    Args:
        joints_of_link: joints that start at a link, by the link's name.
        root: name of the root link.

    Returns:
        the reason, in words, why the robot is on legs or wheels; empty if the shape shows none.
    """
    # The body of the root: the root link and all links that fixed joints connect with it.
    rigid_joints = outward(joints_of_link, root, rigid=True)
    links = [root, *(link_of(joint, "child") for joint in rigid_joints)]
    first_joints = [
        joint for link in links for joint in joints_of_link[link] if joint.get("type") != "fixed"
    ]
    # A branch is a moving joint of this body, and all joints behind it.
    branches = [
        [joint, *outward(joints_of_link, link_of(joint, "child"))] for joint in first_joints
    ]
    long_branches = []
    for branch in branches:
        # A humanoid's arms hang down at zero, too.
        is_arm = any(_has_word(_ARM, joint) for joint in branch)
        if _movable_count(branch) >= _LEAST_LEG_JOINTS and not is_arm:
            long_branches.append(branch)
    # Up to five branches may be arms or the fingers of a hand. Only those that hang down count as legs.
    leg_count = len(long_branches)
    if leg_count <= _MOST_FINGERS:
        leg_count = sum(_hangs_down(branch) for branch in long_branches)
    if leg_count >= _LEAST_LEGS:
        return message(
            "importer.branches_start_as_legs",
            "{legs} branches of {joints} or more joints start at the root link, as legs do",
            legs=leg_count,
            joints=_LEAST_LEG_JOINTS,
        )
    # A wheel has one joint, and a caster has a second one.
    wheel_count = sum(
        branch[0].get("type") == "continuous" and _movable_count(branch) <= 2 for branch in branches
    )
    if wheel_count < _LEAST_WHEELS:
        return ""
    return message(
        "importer.joints_start_as_wheels",
        "{wheels} continuous joints start at the root link, as wheels do",
        wheels=wheel_count,
    )


def _movable_count(joints: list[ET.Element]) -> int:
    """Count the joints that a motor can move."""
    return sum(joint.get("type") in MOVABLE_JOINTS for joint in joints)


def _hangs_down(branch: list[ET.Element]) -> bool:
    """Whether a branch leads downward with all joints at zero, by at least half of the distance to its farthest link.

    Most arms and fingers do not: they are drawn upright or stretched out.

    Args:
        branch: joints of the branch, each after the joint that carries it.
    """
    start = link_of(branch[0], "child")
    poses = {start: pose_of(branch[0])}
    for joint in branch[1:]:
        poses[link_of(joint, "child")] = poses[link_of(joint, "parent")] @ pose_of(joint)
    # Measured from the first joint's link, as the mounting of the branch says nothing about its direction.
    offsets = [pose.translation() - poses[start].translation() for pose in poses.values()]
    farthest = max(offsets, key=np.linalg.norm)
    return bool(-farthest[2] >= _HANGING_SHARE * np.linalg.norm(farthest))
