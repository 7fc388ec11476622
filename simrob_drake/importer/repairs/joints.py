"""Joints that Drake can move: their types, axes, friction, and whether they are on their own."""

from __future__ import annotations

import difflib
import xml.etree.ElementTree as ET

import numpy as np

from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.repairs.base import FLOATING_MARK
from simrob_drake.importer.repairs.limits import repair_limits
from simrob_drake.importer.repairs.numbers import number
from simrob_drake.importer.repairs.tree import children_of, drop_lost_frames
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import MOVABLE_JOINTS, link_of, movable_joints, name_of
from simrob_drake.robots.urdf_elements import written

_TYPES = (*MOVABLE_JOINTS, "fixed", "floating", "planar")
_OF_OTHER_FORMATS = ("revolute2", "screw", "ball", "universal", "gearbox", "spherical", "cylindrical")
_WAYS_OUT = {
    "floating": "only the root of a robot can float; give its links joints that motors can move, or make it fixed",
    "planar": "write it as two prismatic joints and a revolute or continuous one, or make it fixed",
}
_DEFAULT_AXIS = "1 0 0"  # of the URDF format


def repair_joints(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Repair the types, axes, limits and dynamics of a robot's joints, in place.

    Raises:
        InvalidModel: a joint is of a kind that no station can drive, or its axis is zero.
    """
    for joint in robot.iterfind("joint"):
        _repair_type(joint, report)
    _free_root(robot, report)
    for joint in robot.iterfind("joint"):
        where, kind = f"joint '{name_of(joint)}'", joint.get("type", "")
        if kind in _WAYS_OUT:
            raise report.refusal(where, f"is {kind}, which no motor can drive; {_WAYS_OUT[kind]}")
        _drop_mimic(joint, where, report)
        if kind != "fixed":
            _repair_axis(joint, where, report)
            repair_limits(joint, where, report)
        if joint.get("type") != "fixed":
            _repair_dynamics(joint, where, options, report)
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
        said = f"its type is '{kind}'" if kind else "it has no type"
        raise report.refusal(where, f"{said}; a station's robot has joints of the types {known}")
    joint.set("type", close[0])
    report.add("repaired", where, f"its type is '{kind}'; {close[0]}")


def _free_root(robot: ET.Element, report: ImportReport) -> None:
    """Turn a floating joint at an empty root into what it means: the link behind it is a root that floats."""
    held = {link_of(joint, "child") for joint in robot.iterfind("joint")}
    roots = [link for link in robot.iterfind("link") if name_of(link) not in held]
    joints = children_of(robot)[name_of(roots[0])] if roots else []
    if len(joints) != 1 or joints[0].get("type") != "floating" or len(roots[0]):
        return
    robot.remove(joints[0])
    robot.remove(roots[0])
    robot.set(FLOATING_MARK, "floating")
    report.add(
        "repaired",
        f"joint '{name_of(joints[0])}'",
        f"floats below '{name_of(roots[0])}', which is left out; '{link_of(joints[0], 'child')}' is a root that floats",
    )


def _drop_mimic(joint: ET.Element, where: str, report: ImportReport) -> None:
    mimic = joint.find("mimic")
    if mimic is None:
        return
    joint.remove(mimic)
    fixed = joint.get("type") == "fixed"
    why = "fixed joints move with nothing" if fixed else "no continuous solver can do that; it is a joint of its own"
    report.add("dropped", where, f"mimics '{mimic.get('joint', '')}': {why}")


def _repair_axis(joint: ET.Element, where: str, report: ImportReport) -> None:
    axis = joint.find("axis")
    if axis is None or "xyz" not in axis.attrib:
        axis = ET.SubElement(joint, "axis") if axis is None else axis
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
        report.add(
            "dropped", where, f"friction {friction:g}, which Drake does not simulate; --friction-as-damping adds it"
        )
