"""Put a hand of its own file on an arm: two trees become one, before the robot is written."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from simrob_drake.errors import one_of
from simrob_drake.frames import transform_from_pose
from simrob_drake.importer.options import ImportOptions, ImportReport
from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.robots.bodies import tool_links
from simrob_drake.robots.fingers import JAW
from simrob_drake.robots.urdf import add_joint, joint_limits, movable_joints, name_of, root_link

HAND = "hand"  # the folder of its meshes, and what stands before names that the arm has, too
_NAMED = ("link", "joint", "frame", "material", "transmission")
_NAMES = ("link", "joint", "name")  # attributes that name what else is in the tree

Read = Callable[[Path, Path, ImportOptions, ImportReport], ET.Element]
"""What reads and repairs a file, and writes its meshes into a folder."""


def of_hand(options: ImportOptions) -> ImportOptions:
    """Return the choices of an import that are those of the hand, too: not arguments of a xacro, nor which model."""
    return options.model_copy(
        update={"hand": None, "hand_link": "", "xacro_arg": (), "model": "", "srdf": None, "gripper": ""}
    )


def add_hand(robot: ET.Element, read: Read, work: Path, options: ImportOptions, report: ImportReport) -> None:
    """Put the hand of the options on a repaired robot, in place: its root on a link, by a fixed joint.

    Names that the robot has already get another one. ``work`` is the folder of the robot. Raises InvalidModel: a defect
    of the hand that can't be repaired; UnknownName: no such link.
    """
    assert options.hand is not None
    (work / HAND).mkdir()
    own = ImportReport(options.hand)
    hand = read(options.hand, work / HAND, of_hand(options), own)
    report.entries += [replace(entry, element=f"{HAND}: {entry.element}") for entry in own.entries]
    links = [name_of(element) for tag in ("link", "frame") for element in robot.iterfind(tag)]
    where = one_of("link for hand_link", options.hand_link, links) if options.hand_link else tool_links(robot)[0]
    held, taken = ({name_of(element) for tag in _NAMED for element in tree.iterfind(tag)} for tree in (hand, robot))
    free = FreeNames(held | taken)
    new = {name: free.take(f"{HAND}_{name}") for name in sorted(held & taken)}
    for element in hand.iter():
        for key in _NAMES:
            if element.get(key) in new:
                element.set(key, new[element.attrib[key]])
    for mesh in hand.iter("mesh"):
        mesh.set("filename", f"{HAND}/{mesh.get('filename', '')}")
    root = root_link(hand)
    robot.extend(hand)
    pose = transform_from_pose(options.hand_pose)
    add_joint(robot, f"{root}_mount", parent=where, child=root, pose=pose)
    report.add("read", f"link '{root}'", f"of {options.hand.name}, put on '{where}'")


def mark_jaw(robot: ET.Element, joint: str, report: ImportReport) -> None:
    """Mark the joint that the user calls the moving jaw of the hand.

    Raises:
        UnknownName: no such joint moves.
        InvalidModel: the joint has no range.
    """
    one_of("joint for gripper", joint, movable_joints(robot))
    element = next(one for one in robot.iterfind("joint") if name_of(one) == joint)
    if not np.isfinite(joint_limits(element)).all():
        raise report.refusal(f"joint '{joint}'", "has no limits, so that no end of its range is that of a closed jaw")
    for other in robot.iterfind("joint"):
        for mark in other.findall(JAW):
            other.remove(mark)
    ET.SubElement(element, JAW)
