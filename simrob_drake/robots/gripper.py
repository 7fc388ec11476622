"""Fingers of a robot that move together: told by its ``robot.yaml``, or found in its URDF.

Fingers are joints that follow one other (``mimic``), or at least two that slide at the end of one link. They are closed
at that end of their way at which their links' centres of mass are nearer to each other.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from itertools import combinations
from math import isclose
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import Vector
from simrob_drake.robots.urdf import MOVABLE_JOINTS, joint_limits, joints_at, link_of, name_of, outward, pose_of
from simrob_drake.sections import Number, Positive, Strict

FOLLOWS = "follows"
"""What an import calls a ``mimic``, which no solver of ours does: the joint has a motor of its own."""


class Gripper(Strict):
    """Fingers, which move together."""

    axes: Annotated[dict[str, tuple[Number, Number]], Field(min_length=1)]
    """Its axes, each with where it is closed and where open [deg, or m of a prismatic axis]."""
    force: Positive | None = None
    """Largest force of each finger [N, or N·m of one that turns]; what its motor has unless given."""


class _Fingers(NamedTuple):
    """Joints that move together: their positions at both ends of the way, and the link that holds them."""

    ends: dict[str, tuple[float, float]]
    palm: str


def fingers_of(root: ET.Element) -> tuple[dict[str, tuple[float, float]], str] | None:
    """Return the joints of the fingers of a URDF, each closed and open [rad or m], and the link that holds them.

    None where there are none, or where no end of their way is the closed one.
    """
    joints = {name_of(joint): joint for joint in root.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS}
    found = _following(joints) or _sliding(root, joints)
    if found is None or not _is_hand(root, joints, found):
        return None
    apart = [_apart(root, {name: ends[end] for name, ends in found.ends.items()}, found.palm) for end in (0, 1)]
    if isclose(*apart, rel_tol=1e-6):
        return None
    closed = int(apart[1] < apart[0])
    return {name: (ends[closed], ends[1 - closed]) for name, ends in found.ends.items()}, found.palm


def _following(joints: Mapping[str, ET.Element]) -> _Fingers | None:
    """Return the joints that follow one other, with that: those of most followers."""
    groups: dict[str, dict[str, tuple[float, float]]] = {}
    for name, joint in joints.items():
        follows = joint.find(FOLLOWS)
        leader = "" if follows is None else follows.get("joint", "")
        if follows is None or leader not in joints:
            continue
        factor, offset = (float(follows.get(key, usual)) for key, usual in (("multiplier", "1"), ("offset", "0")))
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
    return _Fingers(ends, palm) if len(ends) > 1 else None


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
