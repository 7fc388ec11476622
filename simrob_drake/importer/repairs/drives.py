"""Drives: every joint that moves has one motor that Drake reads."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.repairs.efforts import repair_efforts
from simrob_drake.importer.repairs.names import free_name
from simrob_drake.importer.repairs.numbers import number
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import DRAKE, movable_joints, name_of

SIMPLE = "SimpleTransmission"


def repair_drives(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Give every movable joint of a robot one simple transmission, an effort and a velocity, in place."""
    driven: set[str] = set()
    for drive in list(robot.iterfind("transmission")):
        _settle(robot, drive, driven, report)
    idle = [joint for joint in movable_joints(robot) if joint not in driven]
    for joint in idle:
        _add(robot, joint, None)
    if idle:
        listed = "', '".join(idle)
        report.add("defaulted", f"joints '{listed}'", "no transmission drives them; a motor made for each")
    _part_motors(robot, report)
    repair_efforts(robot, options, report)


def _settle(robot: ET.Element, drive: ET.Element, driven: set[str], report: ImportReport) -> None:
    """Keep a transmission that Drake reads; of any other, make a motor of their own for its joints."""
    where, joints = f"transmission '{name_of(drive)}'", _joints(drive)
    movable = set(movable_joints(robot))
    wanted = [joint for joint in joints if joint in movable and joint not in driven]
    kind = _kind(drive)
    if len(joints) == len(wanted) == 1 and kind.endswith(SIMPLE) and _is_plain(drive):
        driven.update(wanted)
        _repair_gears(drive, where, report)
        return
    actuators = drive.findall("actuator")
    robot.remove(drive)
    for index, joint in enumerate(wanted):
        _add(robot, joint, actuators[index] if len(actuators) == len(wanted) else None)
        driven.add(joint)
    if wanted:
        for new in robot.findall("transmission")[-len(wanted) :]:
            _repair_gears(new, where, report)
    report.add("repaired" if wanted else "dropped", where, _why(joints, wanted, kind, movable))


def _why(joints: list[str], wanted: list[str], kind: str, movable: set[str]) -> str:
    if not wanted:
        if not joints:
            return "drives no joint"
        what = "has a motor already" if set(joints) <= movable else "is no joint that moves"
        return f"'{', '.join(joints)}' {what}"
    listed = "', '".join(wanted)
    made = f"{SIMPLE} of '{listed}'"
    if len(wanted) > 1:
        return f"drives {len(wanted)} joints; each gets a motor of its own: {made}"
    if not kind.endswith(SIMPLE):
        return f"its type is '{kind}', which Drake does not simulate; {made}" if kind else f"has no type; {made}"
    return f"written as Drake reads it; {made}"


def _joints(drive: ET.Element) -> list[str]:
    return list(dict.fromkeys(name_of(joint).strip() for joint in drive.iterfind("joint")))


def _kind(drive: ET.Element) -> str:
    """Return a transmission's type, wherever ROS 1 and ROS 2 put it."""
    for text in (drive.findtext("type"), drive.get("type"), drive.findtext("plugin")):
        if text and text.strip():
            return text.strip()
    return ""


def _is_plain(drive: ET.Element) -> bool:
    """Whether Drake reads a transmission as it is."""
    actuators, joints = drive.findall("actuator"), drive.findall("joint")
    named = len(actuators) == len(joints) == 1 and bool(name_of(actuators[0]).strip())
    return named and (drive.findtext("type") or "").strip().endswith(SIMPLE)


def _add(robot: ET.Element, joint: str, actuator: ET.Element | None) -> None:
    """Add a transmission for one joint; an actuator's own gears go with it."""
    drive = ET.SubElement(robot, "transmission", name=f"{joint}_drive")
    ET.SubElement(drive, "type").text = f"transmission_interface/{SIMPLE}"
    ET.SubElement(drive, "joint", name=joint)
    name = name_of(actuator).strip() if actuator is not None else ""
    motor = ET.SubElement(drive, "actuator", name=name or f"{joint}_motor")
    motor.extend([] if actuator is None else list(actuator))


def _repair_gears(drive: ET.Element, where: str, report: ImportReport) -> None:
    """Leave out gear figures that no motor has."""
    for actuator, gear in list(_gears(drive)):
        tag = gear.tag.removeprefix(DRAKE)
        if tag == "mechanicalReduction":
            right = _positive(gear.text)
        else:
            value = number(gear, "value")
            right = value is not None and (value > 0 or (value == 0 and tag == "rotor_inertia"))
        if not right:
            actuator.remove(gear)
            report.add("dropped", where, f"its {tag} is no number that a motor can have")


def _gears(drive: ET.Element) -> Iterator[tuple[ET.Element, ET.Element]]:
    for actuator in drive.iterfind("actuator"):
        for tag in ("mechanicalReduction", f"{DRAKE}gear_ratio", f"{DRAKE}rotor_inertia"):
            for gear in actuator.findall(tag):
                yield actuator, gear


def _positive(text: str | None) -> bool:
    try:
        return float(text or "") != 0
    except ValueError:
        return False


def _part_motors(robot: ET.Element, report: ImportReport) -> None:
    """Give every motor a name of its own."""
    taken: set[str] = set()
    for drive in robot.iterfind("transmission"):
        for actuator in drive.iterfind("actuator"):
            name = name_of(actuator)
            new = free_name(name, taken)
            taken.add(new)
            if new != name:
                actuator.set("name", new)
                report.add("repaired", f"transmission '{name_of(drive)}'", f"a second motor called '{name}'; '{new}'")
