"""Joints that Drake can move: their types, axes, friction and ranges, and whether they are on their own."""

import difflib
import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.errors import nearest, shortened
from simrob_drake.importer.options import ImportOptions, ImportReport
from simrob_drake.importer.repairs.base import FLOATING_MARK
from simrob_drake.importer.repairs.structure import drop_lost_frames, number
from simrob_drake.robots.fingers import FOLLOWS, mimic_line
from simrob_drake.robots.urdf import (
    DRAKE,
    MOVABLE_JOINTS,
    child_of,
    joint_limits,
    joints_at,
    link_of,
    movable_joints,
    name_of,
    place,
    pose_of,
    written,
)
from simrob_drake.robots.urdf_check import numbers_in

_TYPES = (*MOVABLE_JOINTS, "fixed", "floating", "planar")
_OF_OTHER_FORMATS = ("revolute2", "screw", "ball", "universal", "gearbox", "spherical", "cylindrical")
_WAYS_OUT = {
    "floating": "only the root of a robot can float; give its links joints that motors can move, or make it fixed",
    "planar": "write it as two prismatic joints and a revolute or continuous one, or make it fixed",
}
_DEFAULT_AXIS = "1 0 0"  # of the URDF format

DEFAULT_STROKE = 1.0  # of a prismatic joint without limits, to each side [m]
_ENDLESS = 1e4  # rad: larger limits are a way to write that there are none
_ROUNDED = 1e-4  # rad or m: limits that differ by less were rounded
_ACCELERATION = f"{DRAKE}acceleration"
_FIXED_AT = "simrob_fixed_at"
"""Attribute of a joint that was fixed where its equal limits hold it [rad or m], until its followers are repaired."""


def repair_joints(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Repair a robot's joints in place: types, axes, limits, dynamics; raises InvalidModel: what none can drive."""
    for joint in robot.iterfind("joint"):
        _repair_type(joint, report)
    _free_root(robot, report)
    for joint in robot.iterfind("joint"):
        where, kind = f"joint '{name_of(joint)}'", joint.get("type", "")
        if kind in _WAYS_OUT:
            raise report.refusal(where, f"is {kind}, which no motor can drive; {_WAYS_OUT[kind]}")
        if kind != "fixed":
            _repair_axis(joint, where, report)
            _repair_limits(joint, where, report)
            _repair_dynamics(joint, where, options, report)
    _check_followers(robot, report)
    _fix_still_followers(robot, report)
    _widen_followers(robot, report)
    if not movable_joints(robot):
        raise report.refusal("", "has no joint that moves, so no motor could; a rigid thing is a piece, not a robot")
    drop_lost_frames(robot, report)


def _repair_type(joint: ET.Element, report: ImportReport) -> None:
    where, kind = f"joint '{name_of(joint)}'", joint.get("type", "")
    if kind in _TYPES:
        return
    plain = kind.strip().lower()
    close = difflib.get_close_matches(plain, _TYPES, n=1, cutoff=0.75)
    if plain in _OF_OTHER_FORMATS or not close:
        known = ", ".join((*MOVABLE_JOINTS, "fixed"))
        message = f"its type is '{kind}'" if kind else "it has no type"
        raise report.refusal(where, f"{message}; a station's robot has joints of the types {known}")
    joint.set("type", close[0])
    report.add("repaired", where, f"its type is '{kind}'; {close[0]}")


def _free_root(robot: ET.Element, report: ImportReport) -> None:
    """Turn a floating joint at an empty root into what it means: the link behind it is a root that floats."""
    held = {link_of(joint, "child") for joint in robot.iterfind("joint")}
    roots = [link for link in robot.iterfind("link") if name_of(link) not in held]
    joints = joints_at(robot)[name_of(roots[0])] if roots else []
    if len(joints) != 1 or joints[0].get("type") != "floating" or len(roots[0]):
        return
    robot.remove(joints[0])
    robot.remove(roots[0])
    robot.set(FLOATING_MARK, "floating")
    top = link_of(joints[0], "child")
    why = f"floats below '{name_of(roots[0])}', which is left out; '{top}' is a root that floats"
    report.add("repaired", f"joint '{name_of(joints[0])}'", why)


def _check_followers(robot: ET.Element, report: ImportReport) -> None:
    """Check every ``mimic`` and rename it to ``FOLLOWS``, the tag from which stations make a coupling, in place.

    A ``mimic`` without a meaning is removed: at a fixed joint, or with a leader that is missing or follows the joint
    itself. Joints that follow a fixed joint, or follow with a multiplier of 0, keep theirs here:
    :func:`_fix_still_followers` makes them fixed joints afterwards.
    """
    joints = {name_of(joint): joint for joint in robot.iterfind("joint")}
    followers = {name: joint for name, joint in joints.items() if joint.find("mimic") is not None}
    for name, joint in followers.items():
        mimic, where = child_of(joint, "mimic"), f"joint '{name}'"
        leader = mimic.get("joint", "")
        said = f"mimics '{leader}'"
        _repair_mimic(mimic, where, report)
        if joint.get("type") == "fixed":
            joint.remove(mimic)
            report.add("dropped", where, f"{said}: fixed joints move with nothing")
        elif mimic_line(mimic)[0] == 0:
            continue  # it stands, whatever leads it
        elif leader not in joints or _leads_back(joints, name):
            joint.remove(mimic)
            problem = (
                "which leads back to itself" if leader in joints else f"which is no joint{nearest(leader, joints)}"
            )
            report.add("lost", where, f"{said}, {problem}; it moves on its own")
    for name, joint in followers.items():
        follows = joint.find("mimic")
        if follows is None:
            continue
        follows.tag = FOLLOWS
        factor, offset = mimic_line(follows)
        said = f"mimics '{follows.get('joint', '')}' by {factor:g} with an offset of {offset:g}"
        report.add("read", f"joint '{name}'", f"{said}: stations couple them")


def _repair_mimic(mimic: ET.Element, where: str, report: ImportReport) -> None:
    """Put the format's defaults in the place of a multiplier and an offset that are no numbers, in place."""
    for key, default in (("multiplier", "1"), ("offset", "0")):
        text = mimic.get(key)
        if text is not None and len(numbers_in(text) or []) != 1:
            mimic.set(key, default)
            problem = f"{key}='{shortened(text)}' of its mimic is no number; {default}, as the format has it"
            report.add("lost", where, problem)


def _leads_back(joints: Mapping[str, ET.Element], name: str) -> bool:
    """Whether the joint that a joint mimics follows that joint itself, directly or through others."""
    passed, here = set[str](), name
    while here in joints and here not in passed:
        passed.add(here)
        mimic = joints[here].find("mimic")
        if mimic is None:
            return False
        here = mimic.get("joint", "")
    return here == name


def _fix_still_followers(robot: ET.Element, report: ImportReport) -> None:
    """Fix the joints that follow what does not move, in place, where that holds them.

    In a chain each one is fixed after its leader.
    """
    while True:
        joints = {name_of(joint): joint for joint in robot.iterfind("joint")}
        for name, joint in joints.items():
            follows = joint.find(FOLLOWS)
            if follows is None:
                continue
            factor, offset = mimic_line(follows)
            leader = joints.get(follows.get("joint", ""), joint)
            if factor and leader.get("type") in MOVABLE_JOINTS:
                continue
            # The position of a fixed joint counts as 0, but one that was fixed here stands where it was fixed.
            position = factor * float(leader.get(_FIXED_AT, "0")) + offset
            joint.remove(follows)
            _fix_at(joint, position)
            joint.set(_FIXED_AT, written(position))
            why = f"follows '{name_of(leader)}', which does not move" if factor else "follows with a multiplier of 0"
            report.add("repaired", f"joint '{name}'", f"{why}; fixed at {position:g}")
            break
        else:
            for joint in joints.values():
                joint.attrib.pop(_FIXED_AT, None)
            return


def _widen_followers(robot: ET.Element, report: ImportReport) -> None:
    """Let every joint that follows another go as far as that takes it, in place; in a chain the leaders come first."""
    joints = {name_of(joint): joint for joint in robot.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS}
    done: set[str] = set()

    def widen(name: str) -> None:
        """Widen the limits of a joint after those of the joint that it follows."""
        joint = joints[name]
        follows = joint.find(FOLLOWS)
        if name in done or follows is None:
            return
        done.add(name)
        leader = joints[follows.get("joint", "")]
        widen(name_of(leader))
        factor, offset = mimic_line(follows)
        ends = [factor * end + offset for end in joint_limits(leader)]
        own = joint_limits(joint)
        wide = min(*ends, *own), max(*ends, *own)
        if np.allclose(wide, own, rtol=0, atol=_ROUNDED):
            return
        said = f"[{own[0]:.4g}, {own[1]:.4g}] leave out where '{name_of(leader)}' takes it, which it follows"
        if np.isfinite(wide).all():
            limit = child_of(joint, "limit")
            limit.set("lower", f"{wide[0]:.12g}")
            limit.set("upper", f"{wide[1]:.12g}")
            report.add("repaired", f"joint '{name}'", f"its limits {said}; [{wide[0]:.4g}, {wide[1]:.4g}]")
        elif joint.get("type") == "revolute":
            _set_range(joint, None, None)
            joint.set("type", "continuous")
            report.add("repaired", f"joint '{name}'", f"its limits {said}; continuous instead of revolute")

    for name in joints:
        widen(name)


def _repair_axis(joint: ET.Element, where: str, report: ImportReport) -> None:
    axis = child_of(joint, "axis")
    if "xyz" not in axis.attrib:
        axis.set("xyz", _DEFAULT_AXIS)
        report.add("defaulted", where, f"has no axis; {_DEFAULT_AXIS}, as the format has it")
        return
    text = axis.attrib["xyz"]
    direction = np.array(text.split(), dtype=float)
    length = float(np.linalg.norm(direction))
    if length < 1e-6:
        raise report.refusal(f"{where} <axis>", f'xyz="{text}" is no direction; write one, or make the joint fixed')
    if abs(length - 1) > 1e-3:  # Drake makes it one anyway; a length that differs by more than rounding may be a slip
        axis.set("xyz", " ".join(written(value) for value in (direction / length).tolist()))
        report.add("repaired", f"{where} <axis>", f'xyz="{text}" is {length:.4g} long; "{axis.get("xyz")}"')


def _repair_dynamics(joint: ET.Element, where: str, options: ImportOptions, report: ImportReport) -> None:
    dynamics = joint.find("dynamics")
    if dynamics is None:
        return
    where = f"{where} <dynamics>"
    for key in ("damping", "friction"):
        value = number(dynamics, key)
        if value is not None and value < 0:
            dynamics.set(key, "0")
            report.add("repaired", where, f"{key} {value:g} is negative; 0")
    friction = number(dynamics, "friction")
    if not friction:
        return
    del dynamics.attrib["friction"]
    if options.friction_as_damping:
        damping = number(dynamics, "damping") or 0.0
        dynamics.set("damping", written(damping + friction))
        report.add("repaired", where, f"damping {damping:g} plus friction {friction:g}: damping {damping + friction:g}")
    else:
        back = "drives.friction of a robot brings it back, --friction-as-damping adds it"
        report.add("lost", where, f"friction {friction:g}, seldom measured; {back}")


def _repair_limits(joint: ET.Element, where: str, report: ImportReport) -> None:
    """Repair the lower and upper limit of a joint that moves, in place; effort and velocity come later.

    A continuous joint has limits all the same if they are whole, for Drake heeds them. Both zero is how they are left
    out, and a joint without limits moves.
    """
    where, limit, kind = f"{where} <limit>", joint.find("limit"), joint.get("type")
    acceleration = number(limit, _ACCELERATION)
    if limit is not None and acceleration is not None and acceleration <= 0:
        del limit.attrib[_ACCELERATION]
        report.add("dropped", where, f"acceleration {acceleration:g} is not positive")
    lower, upper = number(limit, "lower"), number(limit, "upper")
    said = _range_text(lower, upper)
    if kind == "continuous" and lower is not None and upper is not None and lower < upper:
        report.add("read", where, f"limits {lower:g} and {upper:g} of a continuous joint are heeded")
    elif kind == "continuous" and (lower is not None or upper is not None):
        _set_range(joint, None, None)
        report.add("dropped", where, f"{said}, which are no range; a continuous joint needs none")
    elif kind != "continuous" and (lower or upper):
        _repair_range(joint, lower, upper, where, report)
    elif kind == "prismatic":
        _set_range(joint, -DEFAULT_STROKE, DEFAULT_STROKE)
        report.add("defaulted", where, f"{said}; a prismatic joint needs a range, ±{DEFAULT_STROKE:g} m")
    elif kind == "revolute":
        _set_range(joint, None, None)
        joint.set("type", "continuous")
        report.add("defaulted", where, f"{said}, so nothing stops it; continuous instead of revolute")


def _repair_range(
    joint: ET.Element, lower: float | None, upper: float | None, where: str, report: ImportReport
) -> None:
    for key, value in (("lower", lower), ("upper", upper)):
        if value is None:
            report.add("defaulted", where, f"has no {key}; 0, as the format has it")
    low, high = lower or 0.0, upper or 0.0
    if low > high:
        report.add("repaired", where, f"lower {low:g} is above upper {high:g}; exchanged")
        low, high = high, low
    if low == high:
        _fix_at(joint, low)
        joint.set(_FIXED_AT, written(low))
        report.add("repaired", where, f"lower and upper are both {low:g}, so it can't move; fixed there")
        return
    _set_range(joint, low, high)
    largest, said = max(-low, high), _range_text(low, high)
    if joint.get("type") == "revolute" and largest > _ENDLESS:
        _set_range(joint, None, None)
        joint.set("type", "continuous")
        report.add("repaired", where, f"{said} rad stop nothing; continuous instead of revolute")


def _fix_at(joint: ET.Element, position: float) -> None:
    """Make a joint fixed at a position [rad or m], in place."""
    x, y, z = (float(word) for word in child_of(joint, "axis").get("xyz", "").split())
    length = math.hypot(x, y, z)
    direction = [x / length, y / length, z / length]
    if joint.get("type") == "prismatic":
        motion = RigidTransform([position * part for part in direction])
    else:
        motion = RigidTransform(RotationMatrix(AngleAxis(angle=position, axis=direction)), [0, 0, 0])
    place(joint, pose_of(joint) @ motion)
    joint.set("type", "fixed")
    for element in [child for child in joint if child.tag in ("axis", "limit", "dynamics")]:
        joint.remove(element)


def _set_range(joint: ET.Element, lower: float | None, upper: float | None) -> None:
    """Write limits of a joint that are others than it has; None takes them out."""
    for key, value in (("lower", lower), ("upper", upper)):
        limit = joint.find("limit")
        if value is not None and number(limit, key) != value:
            child_of(joint, "limit").set(key, written(value))
        elif value is None and limit is not None:
            limit.attrib.pop(key, None)


def _range_text(lower: float | None, upper: float | None) -> str:
    if lower is None and upper is None:
        return "no limits"
    return f"lower {'missing' if lower is None else f'{lower:g}'}, upper {'missing' if upper is None else f'{upper:g}'}"
