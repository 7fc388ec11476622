"""The range of a joint: two figures in order, or none where it turns for ever."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.importer.repairs.numbers import number
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import DRAKE
from simrob_drake.robots.urdf_elements import place, pose_of, written

DEFAULT_STROKE = 1.0
"""Of a prismatic joint without limits, to each side [m]."""

_MANY_TURNS = 4 * math.pi
_ENDLESS = 1e4  # rad: larger limits are a way to write that there are none
_ACCELERATION = f"{DRAKE}acceleration"


def repair_limits(joint: ET.Element, where: str, report: ImportReport) -> None:
    """Repair the lower and upper limit of a joint that moves, in place; effort and velocity come later."""
    where = f"{where} <limit>"
    limit = joint.find("limit")
    if limit is not None:
        acceleration = number(limit, _ACCELERATION)
        if acceleration is not None and acceleration <= 0:
            del limit.attrib[_ACCELERATION]
            report.add("dropped", where, f"acceleration {acceleration:g} is not positive")
    lower, upper = number(limit, "lower"), number(limit, "upper")
    if joint.get("type") == "continuous":
        _repair_continuous(joint, lower, upper, where, report)
    elif (lower or 0.0) == (upper or 0.0) == 0.0:
        _open(joint, lower, upper, where, report)
    else:
        _repair_range(joint, lower or 0.0, upper or 0.0, where, report)


def _repair_continuous(
    joint: ET.Element, lower: float | None, upper: float | None, where: str, report: ImportReport
) -> None:
    """Keep limits that a continuous joint has all the same, for Drake heeds them; but only whole ones."""
    if lower is None and upper is None:
        return
    if lower is not None and upper is not None and lower < upper:
        report.add("read", where, f"limits {lower:g} and {upper:g} of a continuous joint are heeded")
        return
    _unset(joint)
    report.add("dropped", where, f"{_told(lower, upper)}, which are no range; a continuous joint needs none")


def _open(joint: ET.Element, lower: float | None, upper: float | None, where: str, report: ImportReport) -> None:
    """Let a joint without limits move: both zero is how they are left out."""
    told = _told(lower, upper)
    if joint.get("type") == "prismatic":
        _set(joint, -DEFAULT_STROKE, DEFAULT_STROKE)
        report.add("defaulted", where, f"{told}; a prismatic joint needs a range, ±{DEFAULT_STROKE:g} m")
    else:
        _unset(joint)
        joint.set("type", "continuous")
        report.add("defaulted", where, f"{told}, so nothing stops it; continuous instead of revolute")


def _repair_range(joint: ET.Element, lower: float, upper: float, where: str, report: ImportReport) -> None:
    limit = joint.find("limit")
    for key in ("lower", "upper"):
        if number(limit, key) is None:
            report.add("defaulted", where, f"has no {key}; 0, as the format has it")
    if lower > upper:
        report.add("repaired", where, f"lower {lower:g} is above upper {upper:g}; exchanged")
        lower, upper = upper, lower
    if lower == upper:
        _hold(joint, lower)
        report.add("repaired", where, f"lower and upper are both {lower:g}, so it can't move; fixed there")
        return
    _set(joint, lower, upper)
    largest = max(-lower, upper)
    if joint.get("type") != "revolute":
        return
    if largest > _ENDLESS:
        _unset(joint)
        joint.set("type", "continuous")
        report.add("repaired", where, f"{_told(lower, upper)} rad stop nothing; continuous instead of revolute")
    elif largest > _MANY_TURNS:
        turns = largest / math.tau
        report.add("read", where, f"{_told(lower, upper)} rad are {turns:.1f} turns; were degrees meant?")


def _hold(joint: ET.Element, value: float) -> None:
    """Fix a joint at a position [rad or m]."""
    axis = joint.find("axis")
    assert axis is not None  # repaired before
    x, y, z = (float(word) for word in axis.get("xyz", "").split())
    length = math.hypot(x, y, z)
    direction = [x / length, y / length, z / length]
    if joint.get("type") == "prismatic":
        motion = RigidTransform([value * part for part in direction])
    else:
        motion = RigidTransform(RotationMatrix(AngleAxis(angle=value, axis=direction)), [0, 0, 0])
    place(joint, pose_of(joint) @ motion)
    joint.set("type", "fixed")
    for tag in ("axis", "limit", "dynamics"):
        for element in joint.findall(tag):
            joint.remove(element)


def _set(joint: ET.Element, lower: float, upper: float) -> None:
    limit = joint.find("limit")
    limit = ET.SubElement(joint, "limit") if limit is None else limit
    for key, value in (("lower", lower), ("upper", upper)):
        if number(limit, key) != value:
            limit.set(key, written(value))


def _unset(joint: ET.Element) -> None:
    limit = joint.find("limit")
    if limit is not None:
        for key in ("lower", "upper"):
            limit.attrib.pop(key, None)


def _told(lower: float | None, upper: float | None) -> str:
    if lower is None and upper is None:
        return "no limits"
    return f"lower {'missing' if lower is None else f'{lower:g}'}, upper {'missing' if upper is None else f'{upper:g}'}"
