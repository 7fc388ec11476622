"""The structure of a robot: elements that are used, numbers that are numbers, names that differ, and one tree."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from simrob_drake.importer.repairs.elements import keep_known_elements
from simrob_drake.importer.repairs.names import repair_names
from simrob_drake.importer.repairs.numbers import mend_numbers
from simrob_drake.importer.repairs.tree import repair_tree
from simrob_drake.importer.report import ImportReport


def repair_structure(robot: ET.Element, report: ImportReport) -> None:
    """Repair a robot's elements, numbers, names and tree, in place.

    Raises:
        InvalidModel: a defect of which no repair is sure.
    """
    keep_known_elements(robot, report)
    repair_names(robot, report)
    mend_numbers(robot, report)
    repair_tree(robot, report)
