"""How strong and how fast a motor is, where the file does not say: enough to hold what hangs on it, three times."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.repairs.base import find_base
from simrob_drake.importer.repairs.numbers import number
from simrob_drake.importer.repairs.tree import children_of
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import MOVABLE_JOINTS, link_of, mass_of, name_of, root_link
from simrob_drake.robots.urdf_elements import pose_of, written

SAFETY = 3.0
"""How many times a motor can hold, stretched out, what hangs on it."""

UNKNOWN_EFFORT = 10.0
"""Where nothing is known of the masses [N·m or N]."""

LEAST_TORQUE, LEAST_FORCE = 1.0, 10.0
"""Least default efforts [N·m, N]."""

TURNING, SLIDING = math.pi, 1.0
"""Default velocities [rad/s, m/s]."""

_SHARE = 0.1  # of the strongest motor: less would be a toy on the same robot
_ENDLESS = 1e9  # N·m or N; what absurd masses would ask for
_STRONGEST = 1e5  # N·m or N; efforts above stand for "no limit" and are no measure


def repair_efforts(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Give every movable joint of a robot a positive effort and velocity, in place."""
    loads, floats = _loads(robot), find_base(robot, options)[0] == "floating"
    whole = loads[root_link(robot)].mass if floats else 0.0
    joints = [joint for joint in robot.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS]
    for slides in (False, True):
        group = [joint for joint in joints if (joint.get("type") == "prismatic") == slides]
        given = [number(joint.find("limit"), "effort") or 0.0 for joint in group]
        missing = [joint for joint, effort in zip(group, given, strict=True) if effort <= 0]
        held = [_effort(loads[link_of(joint, "child")], whole, slides) for joint in missing]
        measures = [_SHARE * effort for effort in (*given, *held) if effort <= _STRONGEST]
        least = max([LEAST_FORCE if slides else LEAST_TORQUE, *measures])
        for joint, effort in zip(missing, held, strict=True):
            known = loads[link_of(joint, "child")].mass > 0
            _set_effort(joint, effort, least, known, report)
        _set_velocities(group, slides, report)


@dataclass(frozen=True)
class _Load:
    """What hangs on a link.

    Attributes:
        mass: the link's own included [kg].
        moment: of all masses about the link's origin, when stretched out [kg m].
        reach: to the farthest joint or centre of mass [m].
    """

    mass: float
    moment: float
    reach: float


def _loads(robot: ET.Element) -> Mapping[str, _Load]:
    """Return what hangs on each link, itself included."""
    joints_at = children_of(robot)
    own = {name_of(link): (mass_of(link), _offset(link.find("inertial"))) for link in robot.iterfind("link")}
    order = [root_link(robot)]
    for link in order:
        order.extend(link_of(joint, "child") for joint in joints_at[link])
    loads: dict[str, _Load] = {}
    for link in reversed(order):
        mass, reach = own[link]
        moment = mass * reach
        for joint in joints_at[link]:
            hung, offset = loads[link_of(joint, "child")], _offset(joint)
            mass += hung.mass
            moment += hung.moment + hung.mass * offset
            reach = max(reach, offset + hung.reach)
        loads[link] = _Load(mass, moment, reach)
    return loads


def _offset(element: ET.Element | None) -> float:
    """Return how far an element's origin lies from where it is measured from [m]."""
    return 0.0 if element is None else float(np.linalg.norm(pose_of(element).translation()))


def _effort(load: _Load, whole: float, slides: bool) -> float:
    """Return a default effort [N·m or N].

    It holds three times what hangs on the joint and, where the robot floats, the rest of it once, which stands on
    this joint's end: ``whole`` [kg] is its mass.
    """
    if load.mass == 0:
        return UNKNOWN_EFFORT
    rest = max(whole - load.mass, 0.0)
    if slides:
        return STANDARD_GRAVITY * max(SAFETY * load.mass, rest)
    return STANDARD_GRAVITY * max(SAFETY * load.moment, rest * load.reach)


def _set_effort(joint: ET.Element, held: float, least: float, known: bool, report: ImportReport) -> None:
    limit, effort = _limit(joint), _rounded_up(min(max(held, least), _ENDLESS))
    text = limit.get("effort")
    limit.set("effort", written(effort))
    said = "has no effort" if text is None else f"effort {text} would not move it"
    unit = "N" if joint.get("type") == "prismatic" else "N·m"
    why = "by what it carries" if held >= least else "the least beside the robot's other motors"
    if not known:
        why = "a guess, for no mass is known"
    report.add("defaulted", f"joint '{name_of(joint)}' <limit>", f"{said}; {effort:g} {unit}, {why}")


def _set_velocities(joints: list[ET.Element], slides: bool, report: ImportReport) -> None:
    slow = [joint for joint in joints if (number(joint.find("limit"), "velocity") or 0.0) <= 0]
    speed, unit = (SLIDING, "m/s") if slides else (TURNING, "rad/s")
    for joint in slow:
        _limit(joint).set("velocity", written(speed))
    if slow:
        listed = "', '".join(name_of(joint) for joint in slow)
        report.add("defaulted", f"joints '{listed}' <limit>", f"no velocity above 0; {speed:.4g} {unit}")


def _limit(joint: ET.Element) -> ET.Element:
    limit = joint.find("limit")
    return ET.SubElement(joint, "limit") if limit is None else limit


def _rounded_up(value: float) -> float:
    """Return a value rounded up to two significant digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(round(value / unit, 6)) * unit:.2g}")
