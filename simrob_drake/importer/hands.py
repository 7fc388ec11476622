"""Join an arm and a hand from another file to one robot, while the arm is imported.

A robot is an XML tree of links and joints here (a URDF). The hand's elements are added to those of the arm, and a fixed
joint holds the hand's root link.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from simrob_drake.base.errors import one_of
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.base.messages import compound, message
from simrob_drake.importer.repairs.names import FreeNames
from simrob_drake.robots.bodies import tool_links
from simrob_drake.robots.fingers import JAW
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import add_joint, joint_limits, movable_joints, name_of, root_link

HAND = "hand"
"""Name of the folder of the hand's meshes, and prefix for names of the hand that the arm has as well."""

_NAMED_TAGS = ("link", "joint", "frame", "material", "transmission")
"""Elements whose names must differ within a robot."""

_NAME_ATTRIBUTES = ("link", "joint", "name")
"""Attributes that contain a name of such an element."""

ReadRobot = Callable[[Path, Path, ImportOptions, ImportReport], ET.Element]
"""Reads and repairs a robot's file. Its arguments: the file, the folder for the meshes that it writes, the options, and
the report, to which it adds what it has done."""


def of_hand(options: ImportOptions) -> ImportOptions:
    """Options for the import of the hand: those of the arm, without the choices that concern the arm alone."""
    return options.model_copy(
        update={
            "hand": None,
            "hand_link": "",
            "xacro_arg": (),
            "model": "",
            "srdf": None,
            "gripper": "",
        }
    )


def add_hand(
    robot: ET.Element, read: ReadRobot, work: Path, options: ImportOptions, report: ImportReport
) -> None:
    """Import the hand of the options and add it to an arm, in place.

    Names of the hand that the arm has already are replaced.

    Args:
        robot: the arm, which is repaired already.
        read: reads and repairs the file of the hand.
        work: folder in which the robot is written.
        options: options of the import; `hand` is the file of the hand.
        report: report of the import, to which the hand's entries are added.

    Raises:
        InvalidModel: the hand has a defect that cannot be repaired.
        UnknownName: the arm has no link or frame with the name `hand_link`.
    """
    assert options.hand is not None
    folder = work / HAND
    # A folder of its own: files of arm and hand may have the same names.
    folder.mkdir()
    # Errors must name the file of the hand. The entries are then added to the one report that the user sees.
    hand_report = ImportReport(options.hand)
    hand = read(options.hand, folder, of_hand(options), hand_report)
    report.entries += [
        replace(entry, element=compound("{hand}: {element}", hand=HAND, element=entry.element))
        for entry in hand_report.entries
    ]
    if options.hand_link:
        links = [name_of(element) for tag in ("link", "frame") for element in robot.iterfind(tag)]
        # The file of the arm may have no link at the flange, but a frame.
        mount = one_of(
            message("importer.link_for_hand", "link for hand_link"), options.hand_link, links
        )
    else:
        mount = tool_links(robot)[0]  # the usual link for a tool
    # Before the hand is a part of the arm: afterwards its names cannot be distinguished.
    _rename_duplicates(hand, robot)
    for mesh in hand.iter("mesh"):
        mesh.set("filename", f"{HAND}/{mesh.get('filename', '')}")
    # The hand's own root, which may have been renamed just before.
    root = root_link(hand)
    robot.extend(hand)
    pose = transform_from_pose(options.hand_pose)
    add_joint(robot, f"{root}_mount", parent=mount, child=root, pose=pose)
    report.add(
        "read",
        message("robots.link_called", "link '{link}'", link=root),
        message(
            "importer.hand_put_on",
            "root of the hand {hand}, attached to '{mount}'",
            hand=options.hand.name,
            mount=mount,
        ),
    )


def _rename_duplicates(hand: ET.Element, arm: ET.Element) -> None:
    """Give other names to the elements of a hand whose names the arm has already, in place.

    References to these elements, such as the links of a joint, are changed, too.
    """
    hand_names = _element_names(hand)
    arm_names = _element_names(arm)
    free_names = FreeNames(hand_names | arm_names)
    # Sorted, so that the same files always get the same names.
    new_names = {name: free_names.take(f"{HAND}_{name}") for name in sorted(hand_names & arm_names)}
    # All elements, since names are used by joints, mimics, transmissions and frames alike.
    for element in hand.iter():
        for attribute in _NAME_ATTRIBUTES:
            name = element.get(attribute)
            if name in new_names:
                element.set(attribute, new_names[name])


def _element_names(robot: ET.Element) -> set[str]:
    """Names of the links, joints and other named elements of a robot."""
    return {name_of(element) for tag in _NAMED_TAGS for element in robot.iterfind(tag)}


def mark_jaw(robot: ET.Element, joint: str, report: ImportReport) -> None:
    """Mark the joint that the user calls the moving jaw of the hand by an element, in place, and remove other marks.

    When the robot is read, the marked joint becomes its gripper.

    Args:
        robot: the robot.
        joint: name of the joint.
        report: report of the import, which makes the error.

    Raises:
        UnknownName: no joint of this name moves.
        InvalidModel: the joint has no limits, so its closed position is not known.
    """
    one_of(message("importer.joint_for_gripper", "joint for gripper"), joint, movable_joints(robot))
    # one_of() has checked that there is such a joint.
    jaw = next(element for element in robot.iterfind("joint") if name_of(element) == joint)
    # A gripper is closed at one end of its range and open at the other.
    if not np.isfinite(joint_limits(jaw)).all():
        raise report.refusal(
            message("robots.joint_called", "joint '{joint}'", joint=joint),
            message(
                "importer.gripper_without_limits",
                "has no limits; the jaw of a gripper needs a closed and an open position",
            ),
        )
    for element in robot.iterfind("joint"):
        # A mark from the file itself, or from an earlier import, would make a second gripper.
        for mark in element.findall(JAW):
            element.remove(mark)
    ET.SubElement(jaw, JAW)
