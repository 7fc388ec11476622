"""Whether a robot stands on its foot or floats."""

import re
import xml.etree.ElementTree as ET
from typing import Literal

import numpy as np

from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import MOVABLE_JOINTS, joints_at, link_of, outward, root_link
from simrob_drake.robots.urdf_elements import pose_of

FLOATING_MARK = "simrob_base"
"""Attribute of a robot from the repair of its joints to the choice of its base: a floating joint held its root."""

_WORLD = re.compile(r"(robot_)?world(_link)?(_\d+)?", re.IGNORECASE)
_LEG_JOINTS = 3
_FINGERS = 5  # a hand has no more; insects have six legs, which start sideways
_WHEELS = 3

Base = Literal["fixed", "floating"]


def choose_base(robot: ET.Element, options: ImportOptions, report: ImportReport) -> Base:
    """Return how the robot's root is held, and tell why; the mark that led to it is taken away."""
    base, why = find_base(robot, options)
    robot.attrib.pop(FLOATING_MARK, None)
    how = "" if options.base != "auto" else f"; --base {'floating' if base == 'fixed' else 'fixed'} changes that"
    report.add("read", f"link '{root_link(robot)}'", f"{base} base: {why}{how}")
    return base


def find_base(robot: ET.Element, options: ImportOptions) -> tuple[Base, str]:
    """Return how the robot's root is held, and why."""
    if options.base != "auto":
        return options.base, "as chosen"
    root = root_link(robot)
    if robot.get(FLOATING_MARK) is not None:
        return "floating", "a floating joint held it"
    if _WORLD.fullmatch(root):
        return "fixed", "its root link is the world"
    joints = joints_at(robot)
    rigid = [root, *(link_of(joint, "child") for joint in outward(joints, root, rigid=True))]
    starts = [joint for link in rigid for joint in joints[link] if joint.get("type") != "fixed"]
    branches = [[start, *outward(joints, link_of(start, "child"))] for start in starts]
    long = [branch for branch in branches if _movable(branch) >= _LEG_JOINTS]
    legs = len(long) if len(long) > _FINGERS else sum(map(_hangs_down, long))
    if legs >= 2:
        return "floating", f"{legs} branches of {_LEG_JOINTS} and more joints start at it, as legs do"
    wheels = sum(branch[0].get("type") == "continuous" and _movable(branch) <= 2 for branch in branches)
    if wheels >= _WHEELS:
        return "floating", f"{wheels} continuous joints start at it, as wheels do"
    return "fixed", "no pair of legs and no wheels start at it"


def _movable(joints: list[ET.Element]) -> int:
    return sum(joint.get("type") in MOVABLE_JOINTS for joint in joints)


def _hangs_down(branch: list[ET.Element]) -> bool:
    """Whether a branch leads downward at zero, by more than half of its way: arms and fingers do not."""
    start = link_of(branch[0], "child")
    poses = {start: pose_of(branch[0])}
    for joint in branch[1:]:
        poses[link_of(joint, "child")] = poses[link_of(joint, "parent")] @ pose_of(joint)
    ways = [pose.translation() - poses[start].translation() for pose in poses.values()]
    farthest = max(ways, key=np.linalg.norm)
    return bool(-farthest[2] >= 0.5 * np.linalg.norm(farthest))
