"""Whether a robot stands on its foot or floats: by what the file says, else by names, else by shape."""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping
from typing import Literal

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
"""Attribute of a robot from the repair of its joints to the choice of its base: a floating joint held its root."""

_WORLD = re.compile(r"(robot_)?world(_link)?(_\d+)?", re.IGNORECASE)
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")  # of left_leg2, LeftLeg, LLeg
_SIDE = r"(?:[lrfhbm]{0,2}|left|right|front|rear|hind|back|mid|middle)"
_LEG = re.compile(
    _SIDE
    + r"(?:legs?|hip|thigh|knee|calf|shank|shin|ankle|foot|feet|toe|coxa|femur|tibia|haa|hfe|kfe)"
)
_ARM = re.compile(
    _SIDE
    + r"(?:(?:fore|upper|lower)?arms?|shoulder|elbow|wrist|palm|hand|gripper|fingers?|thumb|index)"
)
_WHEEL = re.compile(_SIDE + r"(?:wheels?)")
_LEG_JOINTS, _NAMED_LEG_JOINTS = 3, 2  # called legs may have two: hip and knee
_FINGERS = 5  # a hand has no more; insects have six legs, which start sideways
_WHEELS, _NAMED_WHEELS = 3, 2

Base = Literal["fixed", "floating"]


def choose_base(robot: ET.Element, options: ImportOptions, report: ImportReport) -> Base:
    """Return how the robot's root is held, and tell why; the mark that led to it is taken away."""
    base, why = find_base(robot, options)
    robot.attrib.pop(FLOATING_MARK, None)
    how = (
        ""
        if options.base != "auto"
        else message(
            "importer.base_option",
            "; --base {base} changes that",
            base=message("importer.floating", "floating")
            if base == "fixed"
            else message("importer.fixed", "fixed"),
        )
    )
    report.add(
        "read",
        message("robots.link_called", "link '{link}'", link=root_link(robot)),
        message("importer.base_because", "{base} base: {why}{how}", base=base, why=why, how=how),
    )
    return base


def find_base(robot: ET.Element, options: ImportOptions) -> tuple[Base, str]:
    """Return how the robot's root is held, and why."""
    if options.base != "auto":
        return options.base, message("importer.as_chosen", "as chosen")
    root = root_link(robot)
    if robot.get(FLOATING_MARK) is not None:
        return "floating", message("importer.floating_joint_held", "a floating joint held it")
    if _WORLD.fullmatch(root):
        return "fixed", message("importer.root_is_world", "its root link is the world")
    starts = joints_at(robot)
    if stands := _named(robot, starts, root) or _shaped(starts, root):
        return "floating", stands
    arms = sum(
        _is_called(_ARM, joint)
        for joint in robot.iterfind("joint")
        if joint.get("type") in MOVABLE_JOINTS
    )
    called = (
        message(
            "importer.called_as_arms",
            "; {arms} joints are called as those of arms and hands are",
            arms=arms,
        )
        if arms
        else ""
    )
    return "fixed", message(
        "importer.no_legs_no_wheels",
        "no pair of legs and no wheels carry it{called}",
        called=called,
    )


def _named(robot: ET.Element, starts: Mapping[str, list[ET.Element]], root: str) -> str:
    """Return why names say that a robot stands on legs or wheels, wherever they start; empty if they do not."""
    movable, legged, legs = Counter[str](), set[str](), Counter[str]()
    joints = outward(starts, root)
    body = carriers(robot)  # the first link of all that is rigid with a link
    for joint in reversed(joints):
        parent, child = link_of(joint, "parent"), link_of(joint, "child")
        moves = joint.get("type") != "fixed"
        movable[parent] += movable[child] + moves
        if child in legged or _is_called(_LEG, joint):
            legged.add(parent)
            legs[body[parent]] += moves and movable[child] + 1 >= _NAMED_LEG_JOINTS
    for link, count in legs.items():
        if count >= 2:
            return message(
                "importer.branches_called_as_legs",
                "{count} branches of '{link}' are called as legs are",
                count=count,
                link=link,
            )
    wheels = sum(_is_called(_WHEEL, joint) for joint in joints if joint.get("type") == "continuous")
    return (
        message(
            "importer.joints_called_as_wheels",
            "{wheels} continuous joints are called as wheels are",
            wheels=wheels,
        )
        if wheels >= _NAMED_WHEELS
        else ""
    )


def _is_called(words: re.Pattern[str], joint: ET.Element) -> bool:
    """Whether a joint, or the link behind it, has one of the words in its name."""
    found = _WORD.findall(f"{name_of(joint)} {link_of(joint, 'child')}")
    return any(words.fullmatch(word.lower()) for word in found)


def _shaped(starts: Mapping[str, list[ET.Element]], root: str) -> str:
    """Return why what starts at the root looks like legs or wheels; empty if nothing does."""
    rigid = [root, *(link_of(joint, "child") for joint in outward(starts, root, rigid=True))]
    first = [joint for link in rigid for joint in starts[link] if joint.get("type") != "fixed"]
    branches = [[joint, *outward(starts, link_of(joint, "child"))] for joint in first]
    long = [
        branch
        for branch in branches
        if _movable(branch) >= _LEG_JOINTS and not any(_is_called(_ARM, one) for one in branch)
    ]
    legs = len(long) if len(long) > _FINGERS else sum(map(_hangs_down, long))
    if legs >= 2:
        return message(
            "importer.branches_start_as_legs",
            "{legs} branches of {joints} and more joints start at it, as legs do",
            legs=legs,
            joints=_LEG_JOINTS,
        )
    wheels = sum(
        branch[0].get("type") == "continuous" and _movable(branch) <= 2 for branch in branches
    )
    return (
        message(
            "importer.joints_start_as_wheels",
            "{wheels} continuous joints start at it, as wheels do",
            wheels=wheels,
        )
        if wheels >= _WHEELS
        else ""
    )


def _movable(joints: list[ET.Element]) -> int:
    return sum(joint.get("type") in MOVABLE_JOINTS for joint in joints)


def _hangs_down(branch: list[ET.Element]) -> bool:
    """Whether a branch leads downward at zero, by more than half of its way: most arms and fingers do not."""
    start = link_of(branch[0], "child")
    poses = {start: pose_of(branch[0])}
    for joint in branch[1:]:
        poses[link_of(joint, "child")] = poses[link_of(joint, "parent")] @ pose_of(joint)
    ways = [pose.translation() - poses[start].translation() for pose in poses.values()]
    farthest = max(ways, key=np.linalg.norm)
    return bool(-farthest[2] >= 0.5 * np.linalg.norm(farthest))
