"""Drives: every joint that moves has one motor that Drake reads, strong and fast enough for what hangs on it."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.importer.options import ImportOptions, ImportReport
from simrob_drake.importer.repairs.base import find_base
from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.importer.repairs.structure import number
from simrob_drake.robots.urdf import (
    DRAKE,
    MOVABLE_JOINTS,
    add_motor,
    child_of,
    doubtful_efforts,
    joints_at,
    link_of,
    mass_of,
    moments_of,
    movable_joints,
    name_of,
    outward,
    pose_of,
    root_link,
    written,
)
from simrob_drake.robots.urdf_check import numbers_in

SIMPLE = "SimpleTransmission"

SAFETY = 3.0  # how many times a motor can hold, stretched out, what hangs on it
REVOLUTE_ACCELERATION = 10.0
"""Acceleration [rad/s²] that estimated motors give to what they move, their own rotors included, while they hold it.
From rest to half a turn a second, the speed of joints without one, in a third of a second."""
PRISMATIC_ACCELERATION = 5.0
"""Likewise [m/s²]; half of gravity."""
UNKNOWN_EFFORT = 10.0  # where nothing is known of the masses [N·m or N]
LEAST_TORQUE, LEAST_FORCE = 1.0, 10.0  # least default efforts [N·m, N]
REVOLUTE_SPEED, PRISMATIC_SPEED = math.pi, 1.0  # default velocities [rad/s, m/s]
_SHARE = 0.1  # of the strongest motor: less would be a toy on the same robot
_ENDLESS = 1e9  # N·m or N; what absurd masses would ask for
_STRONGEST = 1e5  # N·m or N; efforts above stand for "no limit" and are no measure


def repair_drives(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Give every movable joint of a robot one simple transmission, an effort and a velocity, in place."""
    movable, driven = dict.fromkeys(movable_joints(robot)), set[str]()
    for drive in list(robot.iterfind("transmission")):
        _settle(robot, drive, movable, driven, report)
    idle = [joint for joint in movable if joint not in driven]
    for joint in idle:
        add_motor(robot, joint, drive=f"{joint}_drive")
    if idle:
        listed = "', '".join(idle)
        report.add("defaulted", f"joints '{listed}'", "no transmission drives them; a motor made for each")
    free = FreeNames()
    for drive in robot.iterfind("transmission"):
        for actuator in drive.iterfind("actuator"):
            name = name_of(actuator)
            new = free.take(name)
            if new != name:
                actuator.set("name", new)
                report.add("repaired", f"transmission '{name_of(drive)}'", f"a second motor called '{name}'; '{new}'")
    _repair_efforts(robot, options, report)


def _settle(
    robot: ET.Element, drive: ET.Element, movable: Collection[str], driven: set[str], report: ImportReport
) -> None:
    """Keep a transmission that Drake reads; of any other, make a motor of their own for its joints."""
    where, actuators = f"transmission '{name_of(drive)}'", drive.findall("actuator")
    joints = list(dict.fromkeys(name_of(joint).strip() for joint in drive.iterfind("joint")))
    undriven = [joint for joint in joints if joint in movable and joint not in driven]
    driven.update(undriven)
    written_types = (drive.findtext("type"), drive.get("type"), drive.findtext("plugin"))  # of ROS 1 and ROS 2
    kind = next((text.strip() for text in written_types if text and text.strip()), "")
    read_by_drake = (drive.findtext("type") or "").strip().endswith(SIMPLE) and len(drive.findall("joint")) == 1
    if len(joints) == len(undriven) == len(actuators) == 1 and read_by_drake and name_of(actuators[0]).strip():
        _repair_gears(actuators[0], where, report)
        return
    robot.remove(drive)
    for index, joint in enumerate(undriven):
        old = actuators[index] if len(actuators) == len(undriven) else None
        new = add_motor(robot, joint, drive=f"{joint}_drive", motor="" if old is None else name_of(old).strip())
        new.extend([] if old is None else list(old))  # its own gears go with it
        _repair_gears(new, where, report)
    report.add("repaired" if undriven else "dropped", where, _why(joints, undriven, kind, movable))


def _why(joints: list[str], undriven: list[str], kind: str, movable: Collection[str]) -> str:
    listed = "', '".join(undriven)
    made = f"{SIMPLE} of '{listed}'"
    if not joints:
        return "drives no joint"
    if not undriven:
        what = "has a motor already" if all(joint in movable for joint in joints) else "is no joint that moves"
        return f"'{', '.join(joints)}' {what}"
    if len(undriven) > 1:
        return f"drives {len(undriven)} joints; each gets a motor of its own: {made}"
    if not kind.endswith(SIMPLE):
        return f"its type is '{kind}', which Drake does not simulate; {made}" if kind else f"has no type; {made}"
    return f"written as Drake reads it; {made}"


def _repair_gears(actuator: ET.Element, where: str, report: ImportReport) -> None:
    """Leave out gear figures that no motor has."""
    for gear in list(actuator):
        tag = gear.tag.removeprefix(DRAKE)
        if tag not in ("mechanicalReduction", "gear_ratio", "rotor_inertia"):
            continue
        values = numbers_in((gear.text if tag == "mechanicalReduction" else gear.get("value")) or "") or []
        least = {"mechanicalReduction": -math.inf, "gear_ratio": 0.0, "rotor_inertia": 0.0}[tag]
        if len(values) != 1 or values[0] < least or (values[0] == 0 and tag != "rotor_inertia"):
            actuator.remove(gear)
            report.add("dropped", where, f"its {tag} is no number that a motor can have")


def _repair_efforts(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Give every movable joint of a robot a positive effort and velocity, in place."""
    loads, floats = _loads(robot), find_base(robot, options)[0] == "floating"
    rotors = _rotor_inertias(robot)
    whole = loads[root_link(robot)].mass if floats else 0.0
    joints = [joint for joint in robot.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS]
    for name, (effort, mass) in doubtful_efforts(robot).items():
        text = f"effort {effort:g} N·m for a link of {mass:.3g} kg is doubtful: no motor of its size has it"
        report.add("open", f"joint '{name}' <limit>", text)
    for prismatic in (False, True):
        group = [joint for joint in joints if (joint.get("type") == "prismatic") == prismatic]
        efforts = [number(joint.find("limit"), "effort") or 0.0 for joint in group]
        missing = [joint for joint, effort in zip(group, efforts, strict=True) if effort <= 0]
        held = [_effort(loads[link_of(joint, "child")], whole, rotors[name_of(joint)], prismatic) for joint in missing]
        likely = [_SHARE * effort for effort in (*efforts, *held) if effort <= _STRONGEST]
        least = max([LEAST_FORCE if prismatic else LEAST_TORQUE, *likely])
        for joint, effort in zip(missing, held, strict=True):
            rotor = rotors[name_of(joint)]
            carried = f"by what it carries and its armature of {rotor:.3g}" if rotor else "by what it carries"
            why = carried if effort >= least else "the least beside the robot's other motors"
            known = loads[link_of(joint, "child")].mass > 0 or rotor > 0
            _set_effort(joint, max(effort, least), why if known else "a guess, for no mass is known", report)
        slow = [joint for joint in group if (number(joint.find("limit"), "velocity") or 0.0) <= 0]
        speed, unit = (PRISMATIC_SPEED, "m/s") if prismatic else (REVOLUTE_SPEED, "rad/s")
        for joint in slow:
            child_of(joint, "limit").set("velocity", written(speed))
        if slow:
            listed = "', '".join(name_of(joint) for joint in slow)
            report.add("defaulted", f"joints '{listed}' <limit>", f"no velocity above 0; {speed:.4g} {unit}")


class _Load(NamedTuple):
    mass: float  # the link's own included [kg]
    moment: float  # of all masses about the link's origin, when stretched out [kg m]
    reach: float  # to the farthest joint or centre of mass [m]
    inertia: float  # of all links about the link's origin, when stretched out [kg m²]


def _rotor_inertias(robot: ET.Element) -> Mapping[str, float]:
    """Inertias of the motors' rotors as their joints feel them, by joint [kg m² or kg]; 0 without one."""
    rotors = dict.fromkeys(movable_joints(robot), 0.0)
    for drive in robot.iterfind("transmission"):
        actuator, joint = drive.find("actuator"), drive.find("joint")
        if actuator is None or joint is None or name_of(joint) not in rotors:
            continue
        inertia = number(actuator.find(f"{DRAKE}rotor_inertia"), "value") or 0.0
        ratio = number(actuator.find(f"{DRAKE}gear_ratio"), "value") or 1.0
        rotors[name_of(joint)] = inertia * ratio**2
    return rotors


def _loads(robot: ET.Element) -> Mapping[str, _Load]:
    starts, links = joints_at(robot), {name_of(link): link for link in robot.iterfind("link")}
    order = [root_link(robot), *(link_of(joint, "child") for joint in outward(starts, root_link(robot)))]
    loads: dict[str, _Load] = {}
    for link in reversed(order):
        mass, reach = mass_of(links[link]), _offset(links[link].find("inertial"))
        moment = mass * reach
        inertia = moment * reach + _largest_moment(links[link])
        for joint in starts[link]:
            hung, offset = loads[link_of(joint, "child")], _offset(joint)
            mass += hung.mass
            moment += hung.moment + hung.mass * offset
            # Masses at distances r from the joint are at r + offset from this link's origin, stretched out.
            inertia += hung.inertia + 2 * offset * hung.moment + hung.mass * offset**2
            reach = max(reach, offset + hung.reach)
        loads[link] = _Load(mass=mass, moment=moment, reach=reach, inertia=inertia)
    return loads


def _largest_moment(link: ET.Element) -> float:
    """Bound on a link's moment of inertia about any axis through its centre of mass [kg m²]; 0 without an inertia."""
    inertial = link.find("inertial")
    return 0.0 if inertial is None or not mass_of(link) else float(np.linalg.norm(moments_of(inertial), 2))


def _offset(element: ET.Element | None) -> float:
    """Return how far an element's origin lies from where it is measured from [m]."""
    return 0.0 if element is None else float(np.linalg.norm(pose_of(element).translation()))


def _effort(load: _Load, whole: float, rotor: float, prismatic: bool) -> float:
    """Estimate an effort [N·m or N] that moves a joint in the posture in which it is hardest, all stretched out.

    The largest of: three times what holds the load against gravity; what holds it once and accelerates it with the
    rotor as stated above; and, where the robot floats, what carries the rest of the robot on this joint's end.

    Args:
        load: what hangs on the joint.
        whole: mass of the robot if it floats, else 0 [kg].
        rotor: inertia of the rotor as the joint feels it [kg m² or kg].
        prismatic: whether the joint slides.
    """
    if not load.mass and not rotor:
        return UNKNOWN_EFFORT
    weight = STANDARD_GRAVITY * (load.mass if prismatic else load.moment)
    moved = rotor + (load.mass if prismatic else load.inertia)
    acceleration = PRISMATIC_ACCELERATION if prismatic else REVOLUTE_ACCELERATION
    rest = STANDARD_GRAVITY * max(whole - load.mass, 0.0) * (1.0 if prismatic else load.reach)
    return max(SAFETY * weight, weight + moved * acceleration, rest)


def _set_effort(joint: ET.Element, effort: float, why: str, report: ImportReport) -> None:
    limit, effort = child_of(joint, "limit"), min(effort, _ENDLESS)
    digit = 10.0 ** (math.floor(math.log10(effort)) - 1)  # the second one that counts, to which it is rounded up
    effort = float(f"{math.ceil(round(effort / digit, 6)) * digit:.2g}")
    text, unit = limit.get("effort"), "N" if joint.get("type") == "prismatic" else "N·m"
    limit.set("effort", written(effort))
    message = "has no effort" if text is None else f"effort {text} would not move it"
    report.add("defaulted", f"joint '{name_of(joint)}' <limit>", f"{message}; {effort:g} {unit}, {why}")
