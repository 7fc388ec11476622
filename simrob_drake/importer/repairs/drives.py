"""Repair the drives of a robot (a URDF): every joint that has a motor has one motor that Drake reads.

The format describes a motor by an ``<actuator>`` in a ``<transmission>``, and its largest torque or force (effort) and
speed by the ``<limit>`` of the joint. Efforts that are missing are estimated from what hangs on the joint. Every change
adds an entry to the report of the import.

A joint without a motor is *passive*: it moves freely. Many files do not describe motors at all, such as those that CAD
programs export. In these files every joint gets a motor. Where a file describes the motors of some joints, by
transmissions or by efforts, the others are passive.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.messages import message
from simrob_drake.importer.repairs.base import find_base
from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.importer.repairs.structure import number
from simrob_drake.robots.fingers import FOLLOWS
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import (
    DRAKE,
    MOVABLE_JOINTS,
    add_motor,
    child_of,
    doubtful_efforts,
    format_number,
    joints_at,
    link_of,
    mass_of,
    moments_of,
    movable_joints,
    name_of,
    outward,
    pose_of,
    remove_motors,
    root_link,
)
from simrob_drake.robots.urdf_check import numbers_in

SIMPLE = "SimpleTransmission"
"""End of the name of the only type of transmission that Drake reads."""

SAFETY = 3.0
"""Ratio of an estimated effort to the effort that holds the load against gravity."""

REVOLUTE_ACCELERATION = 10.0
"""Acceleration [rad/s²] that estimated motors give to what they move, their own rotors included, while they hold it.
A joint reaches half a turn a second, the speed of joints without a given speed, in a third of a second."""

PRISMATIC_ACCELERATION = 5.0
"""Acceleration that estimated motors of prismatic joints give [m/s²]; half of gravity."""

UNKNOWN_EFFORT = 10.0
"""Estimated effort if no mass is known [N·m or N]."""

LEAST_TORQUE = 1.0
"""Least estimated effort of a revolute joint [N·m]."""

LEAST_FORCE = 10.0
"""Least estimated effort of a prismatic joint [N]."""

REVOLUTE_SPEED = math.pi
"""Speed of a revolute joint whose file gives none [rad/s]."""

PRISMATIC_SPEED = 1.0
"""Speed of a prismatic joint whose file gives none [m/s]."""

_SHARE_OF_STRONGEST = 0.1
"""Least estimated effort, as a fraction of the strongest motor of the same robot."""

_LARGEST_EFFORT = 1e9
"""Bound of estimated efforts, which absurd masses would exceed [N·m or N]."""

_LARGEST_REAL_EFFORT = 1e5
"""Larger efforts of a file mean "no limit". They do not count when other motors are estimated [N·m or N]."""

_LEAST_GEAR_VALUES = {"mechanicalReduction": -math.inf, "gear_ratio": 0.0, "rotor_inertia": 0.0}
"""Smallest value of the elements of an actuator that hold a number, by tag. A reduction may turn the joint's sense."""


def repair_drives(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Give every joint that has a motor one simple transmission, an effort and a velocity, in place.

    Passive joints have no transmission, and the effort 0.

    Args:
        robot: the ``robot`` element, whose joints and inertias are repaired: efforts are estimated from masses.
        options: options of the import, which may give the base.
        report: gets an entry for each change.
    """
    # A dictionary keeps the names in file order and finds one of thousands at once, which a list would not.
    movable = dict.fromkeys(movable_joints(robot))
    driven = set[str]()  # names of the joints that have a motor
    for drive in list(robot.iterfind("transmission")):
        # The first transmission of a joint gives it its motor, so `driven` grows from one to the next.
        driven.update(_repair_transmission(robot, drive, movable, driven, report))
    # Transmissions that are left now are the file's own. The motors that are made below must not count.
    passive = _passive_joints(robot, driven)
    # A joint with an effort of 0 may have a transmission, which would give it a motor.
    remove_motors(robot, passive)
    if passive:
        _make_passive(robot, passive, report)
    idle = [joint for joint in movable if joint not in driven and joint not in passive]
    for joint in idle:
        add_motor(robot, joint, drive=f"{joint}_drive")
    if idle:
        names = "', '".join(idle)
        report.add(
            "defaulted",
            message("importer.joints_called", "joints '{names}'", names=names),
            message(
                "importer.motor_made_for_each",
                "no transmission drives these joints; each of them gets a motor",
            ),
        )
    # Names of motors are checked after new motors were made, since these may have the name of a given one.
    _rename_duplicate_motors(robot, report)
    _repair_efforts_and_speeds(robot, options, report, passive)


def _passive_joints(robot: ET.Element, driven: Collection[str]) -> list[str]:
    """Find the joints that have no motor in a file that describes the motors of other joints, in file order.

    These are joints without a transmission, if others have one. Joints with an effort of exactly 0 are passive, too, if
    a joint with a transmission has another effort or none, or, in a file without transmissions, if a joint has a
    positive effort. An axis that follows another one is never passive: stations couple the two, and where the solver
    does not hold the coupling, its own motor does.

    Args:
        robot: the robot, whose transmissions are repaired.
        driven: names of the joints that have a transmission.
    """
    joints = [joint for joint in robot.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS]
    efforts = {name_of(joint): number(joint.find("limit"), "effort") for joint in joints}
    without_effort = {name for name, effort in efforts.items() if effort == 0}
    # Zeros that would leave the robot without any motor stand for unknown efforts, as CAD programs write them.
    if driven:
        # At least one joint with a motor has an effort.
        are_zeros_meant = bool(set(driven) - without_effort)
    else:
        are_zeros_meant = any(effort is not None and effort > 0 for effort in efforts.values())

    passive = []
    for joint in joints:
        name = name_of(joint)
        # A file without any transmission does not describe motors by them.
        has_no_transmission = bool(driven) and name not in driven
        has_no_effort = are_zeros_meant and name in without_effort
        if (has_no_transmission or has_no_effort) and joint.find(FOLLOWS) is None:
            passive.append(name)
    return passive


def _make_passive(robot: ET.Element, passive: Collection[str], report: ImportReport) -> None:
    """Set the effort of passive joints to 0, remove speed limits that are not positive, and report the joints.

    A joint without ``<limit>`` stays as it is, as a missing effort counts as 0. A speed limit that is not positive
    stands for a missing one. Passive joints get no estimated one, as no motor limits their speed.
    """
    for joint in robot.iterfind("joint"):
        limit = joint.find("limit")
        if name_of(joint) not in passive or limit is None:
            continue
        limit.set("effort", "0")
        if (number(limit, "velocity") or 0.0) <= 0:
            limit.attrib.pop("velocity", None)
    report.add(
        "read",
        message("importer.joints_called", "joints '{names}'", names="', '".join(passive)),
        message(
            "importer.passive",
            "passive: the file gives motors to other joints only. To drive these joints, set "
            "servo.passive: [] and servo.torque_limit in a station",
        ),
    )


def _rename_duplicate_motors(robot: ET.Element, report: ImportReport) -> None:
    """Give another name to each motor whose name an earlier motor has, in place."""
    free_names = FreeNames()
    for drive in robot.iterfind("transmission"):
        for actuator in drive.iterfind("actuator"):
            name = name_of(actuator)
            new = free_names.take(name)
            if new != name:
                actuator.set("name", new)
                report.add(
                    "repaired",
                    message(
                        "importer.transmission_called", "transmission '{name}'", name=name_of(drive)
                    ),
                    message(
                        "importer.second_motor",
                        "a second motor has the name '{name}'; renamed to '{new}'",
                        name=name,
                        new=new,
                    ),
                )


def _repair_transmission(
    robot: ET.Element,
    drive: ET.Element,
    movable: Collection[str],
    driven: Collection[str],
    report: ImportReport,
) -> list[str]:
    """Keep a transmission that Drake reads, or replace it by a simple transmission for each of its joints, in place.

    Args:
        robot: the robot.
        drive: the transmission, an element of the robot.
        movable: names of the joints that move.
        driven: names of the joints that have a motor already. They do not get another one.
        report: report of the import.

    Returns:
        names of the joints that have got their motor from this transmission.
    """
    where = message("importer.transmission_called", "transmission '{name}'", name=name_of(drive))
    actuators = drive.findall("actuator")
    # Each name once: some files repeat a joint in its transmission.
    joints = list(dict.fromkeys(name_of(joint).strip() for joint in drive.iterfind("joint")))
    new_joints = [joint for joint in joints if joint in movable and joint not in driven]
    # Such a transmission stays as it is, with its own name and that of its motor.
    if _is_read_by_drake(drive) and new_joints == joints:
        _repair_gears(actuators[0], where, report)
        return new_joints
    # Any other transmission is replaced by simple ones, or by nothing if its joints have motors already.
    robot.remove(drive)
    for index, joint in enumerate(new_joints):
        # If there are as many motors as joints, each joint keeps its motor with its gears.
        if len(actuators) == len(new_joints):
            old_motor = actuators[index]
            motor = add_motor(
                robot, joint, drive=f"{joint}_drive", motor=name_of(old_motor).strip()
            )
            # The gears: reduction, gear ratio and rotor inertia.
            motor.extend(list(old_motor))
        else:
            motor = add_motor(robot, joint, drive=f"{joint}_drive")
        _repair_gears(motor, where, report)
    report.add(
        "repaired" if new_joints else "dropped", where, _reason(drive, joints, new_joints, movable)
    )
    return new_joints


def _is_read_by_drake(drive: ET.Element) -> bool:
    """Whether Drake reads a transmission: a simple one with one joint, and one motor with a name."""
    kind = (drive.findtext("type") or "").strip()
    actuators = drive.findall("actuator")
    # ROS writes the type with a name space: transmission_interface/SimpleTransmission.
    if not kind.endswith(SIMPLE) or len(actuators) != 1 or len(drive.findall("joint")) != 1:
        return False
    return bool(name_of(actuators[0]).strip())


def _reason(
    drive: ET.Element, joints: list[str], new_joints: list[str], movable: Collection[str]
) -> str:
    """Describe why a transmission was replaced or removed.

    Args:
        drive: the transmission.
        joints: names of its joints.
        new_joints: names of those of its joints that get a motor in its place.
        movable: names of the joints of the robot that move.
    """
    if not joints:
        return message("importer.drives_no_joint", "drives no joint")
    if not new_joints:
        have_motors = all(joint in movable for joint in joints)
        problem = (
            message("importer.has_motor_already", "another transmission drives this already")
            if have_motors
            else message("importer.is_no_moving_joint", "this is not a joint that moves")
        )
        return message(
            "importer.joints_with_problem",
            "'{joints}': {problem}",
            joints=", ".join(joints),
            problem=problem,
        )
    names = "', '".join(new_joints)
    replacement = message(
        "importer.simple_transmission_of", "{simple} of '{names}'", simple=SIMPLE, names=names
    )
    if len(new_joints) > 1:
        return message(
            "importer.drives_several",
            "drives {count} joints; each gets a motor of its own: {replacement}",
            count=len(new_joints),
            replacement=replacement,
        )
    kind = _transmission_type(drive)
    if not kind:
        return message(
            "importer.without_type",
            "has no type; replaced by {replacement}",
            replacement=replacement,
        )
    if not kind.endswith(SIMPLE):
        return message(
            "importer.type_not_simulated",
            "has the type '{kind}', which Drake does not simulate; replaced by {replacement}",
            kind=kind,
            replacement=replacement,
        )
    return message(
        "importer.written_as_drake_reads",
        "does not have the form that Drake reads; replaced by {replacement}",
        replacement=replacement,
    )


def _transmission_type(drive: ET.Element) -> str:
    """Type of a transmission, as ROS 1 or ROS 2 writes it; empty if it has none."""
    for text in (drive.findtext("type"), drive.get("type"), drive.findtext("plugin")):
        if text and text.strip():
            return text.strip()
    return ""


def _repair_gears(actuator: ET.Element, where: str, report: ImportReport) -> None:
    """Remove gear ratios and rotor inertias that no motor can have from an actuator, in place.

    Args:
        actuator: the ``<actuator>`` of a motor.
        where: name of its transmission, for the report.
        report: report of the import.
    """
    for gear in list(actuator):
        # Drake's own elements have its name space, and their number is an attribute.
        tag = gear.tag.removeprefix(DRAKE)
        if tag not in _LEAST_GEAR_VALUES:
            continue
        text = gear.text if tag == "mechanicalReduction" else gear.get("value")
        values = numbers_in(text or "") or []
        is_number = len(values) == 1
        # Only the rotor inertia can be 0: a ratio of 0 would let the motor move nothing.
        is_possible = (
            is_number
            and values[0] >= _LEAST_GEAR_VALUES[tag]
            and (values[0] != 0 or tag == "rotor_inertia")
        )
        if not is_possible:
            actuator.remove(gear)
            report.add(
                "dropped",
                where,
                message(
                    "importer.no_number_of_motor",
                    "its <{tag}> is not a number that a motor can have",
                    tag=tag,
                ),
            )


def _repair_efforts_and_speeds(
    robot: ET.Element, options: ImportOptions, report: ImportReport, passive: Collection[str]
) -> None:
    """Give every joint that has a motor a positive effort and velocity, in place, and report doubtful efforts.

    Args:
        robot: the robot.
        options: options of the import.
        report: report of the import.
        passive: names of the joints without a motor.
    """
    loads = _loads(robot)
    rotors = _rotor_inertias(robot)
    base = find_base(robot, options).base
    # The load on the root link is the whole robot.
    floating_mass = loads[root_link(robot)].mass if base == "floating" else 0.0
    for name, (effort, mass) in doubtful_efforts(robot).items():
        text = message(
            "importer.doubtful_effort",
            "an effort of {effort:g} N·m is doubtful for a link of {mass:.3g} kg; correct this limit "
            "if it is a placeholder",
            effort=effort,
            mass=mass,
        )
        report.add(
            "open", message("robots.limit_of_joint", "joint '{joint}' <limit>", joint=name), text
        )
    movable = [joint for joint in robot.iterfind("joint") if joint.get("type") in MOVABLE_JOINTS]
    # Passive joints keep their effort of 0, and no speed limit.
    with_motor = [joint for joint in movable if name_of(joint) not in passive]
    # Torques [N·m] and forces [N] cannot be compared, so the two types of joints are estimated apart.
    revolute = [joint for joint in with_motor if joint.get("type") != "prismatic"]
    prismatic = [joint for joint in with_motor if joint.get("type") == "prismatic"]
    _repair_efforts(revolute, LEAST_TORQUE, loads, rotors, floating_mass, report)
    _repair_speeds(revolute, REVOLUTE_SPEED, "rad/s", report)
    _repair_efforts(prismatic, LEAST_FORCE, loads, rotors, floating_mass, report)
    _repair_speeds(prismatic, PRISMATIC_SPEED, "m/s", report)


def _repair_speeds(
    joints: Sequence[ET.Element], speed: float, unit: str, report: ImportReport
) -> None:
    """Give joints without a positive velocity a default speed, in place.

    Args:
        joints: joints of one kind.
        speed: the default speed.
        unit: unit of the speed, for the report.
        report: report of the import.
    """
    # Exporters write a speed of 0 for an unknown one.
    slow = [joint for joint in joints if (number(joint.find("limit"), "velocity") or 0.0) <= 0]
    for joint in slow:
        child_of(joint, "limit").set("velocity", format_number(speed))
    if slow:
        names = "', '".join(name_of(joint) for joint in slow)
        report.add(
            "defaulted",
            message("importer.limit_of_joints", "joints '{names}' <limit>", names=names),
            message(
                "importer.no_velocity",
                "no velocity above 0; set to {speed:.4g} {unit}",
                speed=speed,
                unit=unit,
            ),
        )


class _Load(NamedTuple):
    """Load on a joint: the link behind it and all that hangs on this link, in one stretched line.

    Attributes:
        mass: mass [kg].
        moment: sum of the masses times their distances from the link's origin [kg m].
        reach: distance from the link's origin to the farthest joint or centre of mass [m].
        inertia: moment of inertia about the link's origin [kg m²].
    """

    mass: float
    moment: float
    reach: float
    inertia: float


def _repair_efforts(
    joints: Sequence[ET.Element],
    least_effort: float,
    loads: Mapping[str, _Load],
    rotors: Mapping[str, float],
    floating_mass: float,
    report: ImportReport,
) -> None:
    """Give joints without a positive effort an estimated effort, in place.

    Args:
        joints: joints of one kind: all revolute and continuous joints, or all prismatic joints.
        least_effort: least estimated effort [N·m or N].
        loads: load on each link, by the link's name.
        rotors: inertia of each motor's rotor as its joint feels it, by the joint's name [kg m² or kg].
        floating_mass: mass of the robot if it floats, else 0 [kg].
        report: report of the import.
    """
    efforts = [number(joint.find("limit"), "effort") or 0.0 for joint in joints]
    without_effort = [joint for joint, effort in zip(joints, efforts, strict=True) if effort <= 0]
    estimates = []
    for joint in without_effort:
        load = loads[link_of(joint, "child")]
        # All estimates come first: the least effort below depends on the strongest motor, which may be estimated.
        estimates.append(_estimate_effort(joint, load, rotors[name_of(joint)], floating_mass))
    # A motor is not weaker than a fraction of the robot's other motors of the same kind.
    shares = [
        _SHARE_OF_STRONGEST * effort
        for effort in (*efforts, *estimates)
        if effort <= _LARGEST_REAL_EFFORT
    ]
    least = max([least_effort, *shares])
    for joint, estimate in zip(without_effort, estimates, strict=True):
        rotor = rotors[name_of(joint)]
        is_mass_known = loads[link_of(joint, "child")].mass > 0 or rotor > 0
        if not is_mass_known:
            why = message("importer.guess_without_mass", "a guess, as no mass is given")
        elif estimate < least:
            why = message("importer.least_of_other_motors", "the minimum for a motor of this robot")
        elif rotor:
            why = message(
                "importer.by_carried_and_armature",
                "estimated from its load and its rotor inertia of {rotor:.3g}",
                rotor=rotor,
            )
        else:
            why = message("importer.by_carried", "estimated from its load")
        _set_effort(joint, max(estimate, least), why, report)


def _rotor_inertias(robot: ET.Element) -> Mapping[str, float]:
    """Inertia of each motor's rotor as its joint feels it, by the name of the joint [kg m² or kg].

    A joint feels J n², with the inertia J of the rotor and the gear ratio n. An inertia that is missing is 0, and a
    gear ratio that is missing is 1.
    """
    rotors = dict.fromkeys(movable_joints(robot), 0.0)
    for drive in robot.iterfind("transmission"):
        actuator = drive.find("actuator")
        joint = drive.find("joint")
        if actuator is None or joint is None or name_of(joint) not in rotors:
            continue
        inertia = number(actuator.find(f"{DRAKE}rotor_inertia"), "value") or 0.0
        ratio = number(actuator.find(f"{DRAKE}gear_ratio"), "value") or 1.0
        rotors[name_of(joint)] = inertia * ratio**2
    return rotors


def _loads(robot: ET.Element) -> Mapping[str, _Load]:
    """Compute the load on each link of a robot, by the link's name, from the tips of its tree to its root."""
    joints_of_link = joints_at(robot)  # joints whose parent the link is
    links = {name_of(link): link for link in robot.iterfind("link")}
    root = root_link(robot)
    order = [root, *(link_of(joint, "child") for joint in outward(joints_of_link, root))]
    loads: dict[str, _Load] = {}
    # From the tips to the root, so that the loads behind a link's joints are known.
    for link in reversed(order):
        mass = mass_of(links[link])
        reach = _offset(links[link].find("inertial"))
        moment = mass * reach
        # Parallel axis theorem for the link itself: m r² + I.
        inertia = moment * reach + _largest_moment(links[link])
        for joint in joints_of_link[link]:
            load = loads[link_of(joint, "child")]
            offset = _offset(joint)
            mass += load.mass
            moment += load.moment + load.mass * offset
            # A mass at a distance r from the joint is at r + offset from this link's origin, if all is stretched out:
            # sum of m (r + offset)² = sum of m r² + 2 offset (sum of m r) + offset² (sum of m).
            inertia += load.inertia + 2 * offset * load.moment + load.mass * offset**2
            reach = max(reach, offset + load.reach)
        loads[link] = _Load(mass=mass, moment=moment, reach=reach, inertia=inertia)
    return loads


def _largest_moment(link: ET.Element) -> float:
    """Largest moment of inertia of a link about an axis through its centre of mass [kg m²].

    It is 0 if the link has no inertia or no mass.
    """
    inertial = link.find("inertial")
    if inertial is None or not mass_of(link):
        return 0.0
    return float(np.linalg.norm(moments_of(inertial), 2))  # the largest eigenvalue


def _offset(element: ET.Element | None) -> float:
    """Distance of a joint from its parent link's origin, or of an ``<inertial>`` from its link's origin [m].

    It is 0 if there is no such element.
    """
    return 0.0 if element is None else float(np.linalg.norm(pose_of(element).translation()))


def _estimate_effort(joint: ET.Element, load: _Load, rotor: float, floating_mass: float) -> float:
    """Estimate an effort [N·m or N] that moves a joint in the hardest posture, with all stretched out.

    It is the largest of three efforts:

    - SAFETY times the effort that holds the load against gravity;
    - the effort that holds the load and accelerates load and rotor by REVOLUTE_ACCELERATION or PRISMATIC_ACCELERATION;
    - for a robot that floats, such as one on legs: the effort that carries the rest of the robot on the far end.

    It is UNKNOWN_EFFORT if neither the mass of the load nor the inertia of the rotor is known.

    Args:
        joint: the joint.
        load: load on the joint's child link.
        rotor: inertia of the rotor as the joint feels it [kg m² or kg].
        floating_mass: mass of the robot if it floats, else 0 [kg].
    """
    if not load.mass and not rotor:
        return UNKNOWN_EFFORT
    # A stance leg pushes the rest of the robot, which is at the far end of the joint's load.
    rest_mass = max(floating_mass - load.mass, 0.0)
    # Newton's law for a prismatic joint, F = m g and F = m a, and for a revolute one, T = m g r and T = I alpha.
    if joint.get("type") == "prismatic":
        holding = STANDARD_GRAVITY * load.mass
        accelerating = (rotor + load.mass) * PRISMATIC_ACCELERATION
        carrying = STANDARD_GRAVITY * rest_mass
    else:
        holding = STANDARD_GRAVITY * load.moment
        accelerating = (rotor + load.inertia) * REVOLUTE_ACCELERATION
        carrying = STANDARD_GRAVITY * rest_mass * load.reach
    return max(SAFETY * holding, holding + accelerating, carrying)


def _set_effort(joint: ET.Element, effort: float, why: str, report: ImportReport) -> None:
    """Set the effort of a joint, rounded up to two significant digits and at most 1e9, in place.

    Args:
        joint: the joint.
        effort: the effort [N·m or N].
        why: origin of the number, for the report.
        report: report of the import.
    """
    bounded = min(effort, _LARGEST_EFFORT)
    # Value of a 1 at the second significant digit, such as 10 for 345.
    second_digit = 10.0 ** (math.floor(math.log10(bounded)) - 1)
    # The inner rounding removes rounding errors: 0.28 / 0.01 is 28.000000000000004, not 28.
    digits = math.ceil(round(bounded / second_digit, 6))
    # The text has two digits again: the product may have rounding errors.
    rounded = float(f"{digits * second_digit:.2g}")
    limit = child_of(joint, "limit")
    old_text = limit.get("effort")
    limit.set("effort", format_number(rounded))
    unit = "N" if joint.get("type") == "prismatic" else "N·m"
    problem = (
        message("importer.has_no_effort", "has no effort")
        if old_text is None
        else message(
            "importer.effort_would_not_move", "effort {effort} is not positive", effort=old_text
        )
    )
    report.add(
        "defaulted",
        message("robots.limit_of_joint", "joint '{joint}' <limit>", joint=name_of(joint)),
        message(
            "importer.new_effort",
            "{problem}; set to {effort:g} {unit}, {why}",
            problem=problem,
            effort=rounded,
            unit=unit,
            why=why,
        ),
    )
