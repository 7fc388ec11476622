"""The structure of a robot: elements that are used, numbers that are numbers, names that differ, and one tree."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter

from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.repairs.names import repair_names
from simrob_drake.importer.repairs.numbers import mend_numbers
from simrob_drake.importer.repairs.tree import repair_tree
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import DRAKE, name_of
from simrob_drake.robots.urdf_check import SHAPE_SIZES

_SHAPES = {"mesh", *SHAPE_SIZES}
_VISUAL = {f"{DRAKE}{name}" for name in ("illustration_properties", "perception_properties", "accepting_renderer")}
_KNOWN: dict[str, set[str]] = {
    "robot": {"link", "joint", "material", "transmission", "frame"},
    "link": {"inertial", "visual", "collision"},
    "joint": {"parent", "child", "origin", "axis", "limit", "dynamics", "mimic"},
    "inertial": {"origin", "mass", "inertia"},
    "visual": {"origin", "geometry", "material"} | _VISUAL,
    "collision": {"origin", "geometry", f"{DRAKE}proximity_properties"},
    "geometry": _SHAPES,
    "mesh": {f"{DRAKE}declare_convex"},
    "material": {"color", "texture"},
}
"""By tag, what may stand in it."""
_OPAQUE = ("transmission", "collision_filter_group", "linear_bushing_rpy", "proximity_properties")
"""What is read by a stage of its own, or by Drake alone."""
_REPEATED = {"link", "joint", "material", "transmission", "frame", "visual", "collision", *_VISUAL}
_KEPT_OF_DRAKE = {f"{DRAKE}collision_filter_group", f"{DRAKE}linear_bushing_rpy"}
_CLOSING = ("loop_joint", f"{DRAKE}joint", f"{DRAKE}ball_constraint", f"{DRAKE}tendon_constraint")


def repair_structure(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Repair a robot's elements, numbers, names and tree, in place.

    Raises:
        InvalidModel: a defect of which no repair is sure.
    """
    _keep_known_elements(robot, options, report)
    repair_names(robot, report)
    mend_numbers(robot, report)
    repair_tree(robot, report)


def _keep_known_elements(robot: ET.Element, options: ImportOptions, report: ImportReport) -> None:
    """Leave out, in place, what no simulation here uses, told once a tag; move misplaced links and joints up.

    Raises:
        InvalidModel: the robot closes a loop, or moves in a way that no station can drive.
    """
    for element in [element for element in robot if element.tag in _CLOSING]:
        where = f"<{element.tag.removeprefix(DRAKE)}> '{name_of(element)}'"
        problem = "is no part of a tree of motored joints, which a station's robot is"
        if not options.drop_loops:
            raise report.refusal(where, f"{problem}; remove it, or leave it out with --drop-loops")
        robot.remove(element)
        report.add("dropped", where, f"{problem}; left out")
    _lift(robot, robot, report)
    dropped: Counter[tuple[str, str]] = Counter()
    _prune(robot, dropped)
    for (tag, place), count in dropped.items():
        report.add("dropped", f"<{tag}> in <{place}>", f"{count} ×: no simulation here uses it")
    _drop_second_ones(robot, report)


def _lift(robot: ET.Element, element: ET.Element, report: ImportReport) -> None:
    """Move links and joints that stand within links, joints or groups of them to where they belong."""
    for child in list(element):
        if child.tag in ("link", "joint", "group"):
            _lift(robot, child, report)
            if element is not robot and child.tag != "group":
                element.remove(child)
                robot.append(child)
                report.add(
                    "repaired", f"{child.tag} '{name_of(child)}'", f"stood in a <{element.tag}>; moved into <robot>"
                )


def _prune(element: ET.Element, dropped: Counter[tuple[str, str]]) -> None:
    if element.tag.removeprefix(DRAKE) in _OPAQUE or element.tag in _VISUAL:
        return
    allowed = _KNOWN.get(element.tag, set())
    if element.tag == "robot":
        allowed = allowed | _KEPT_OF_DRAKE
    for child in list(element):
        if child.tag in allowed:
            _prune(child, dropped)
        else:
            element.remove(child)
            dropped[child.tag.replace(DRAKE, "drake:"), element.tag] += 1


def _drop_second_ones(robot: ET.Element, report: ImportReport) -> None:
    """Keep the first of what stands once; readers of URDFs, Drake's among them, see no other."""
    for top in robot:
        if top.tag not in ("link", "joint", "material"):
            continue
        for element in top.iter():
            for place in [child.tag for child in element if child.tag not in _REPEATED]:
                for second in element.findall(place)[1:]:
                    element.remove(second)
                    report.add("dropped", f"{top.tag} '{name_of(top)}'", f"a second <{place}> in its <{element.tag}>")
            shapes = [child for child in element if child.tag in _SHAPES] if element.tag == "geometry" else []
            for second in shapes[1:]:
                element.remove(second)
                report.add("dropped", f"{top.tag} '{name_of(top)}'", f"a second shape, <{second.tag}>, in its geometry")
