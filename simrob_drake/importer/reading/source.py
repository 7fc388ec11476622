"""Read the ``robot`` element of a robot's file, in any of the supported formats.

A URDF contains this element. A xacro file is expanded to a URDF, an SDF file is converted, and files of other formats
are converted by extensions. Namespaces of other programs are left out.
"""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

from simrob_drake.base.extension import BrokenExtension, MissingExtension
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.importer.importer import RobotImporter, load_importer
from simrob_drake.importer.reading.xacro import XACRO, expand_xacro
from simrob_drake.importer.reading.xml_file import parse_tree, xml_text
from simrob_drake.importer.sdf.reading import read_sdf
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import DRAKE

# Authors of files switch off a joint or a shape by a comment. The user of the file may take it for a part of the robot.
_HIDDEN_TAG = re.compile(
    r"<(link|joint|visual|collision|inertial|transmission|geometry|mesh|origin|limit|mimic)\b[^<]*>"
)
"""An element of a URDF in the text of a comment."""

_OTHER_FORMATS = {
    "gazebo": message("importer.kind_gazebo", "an old SDF file"),
    "world": message("importer.kind_world", "an SDF world"),
    "model": message("importer.kind_model", "an SDF model"),
    "mujocoinclude": message(
        "importer.kind_mujocoinclude", "a part of an MJCF file of MuJoCo, which other files include"
    ),
    "COLLADA": message("importer.kind_collada", "a COLLADA mesh"),
    "launch": message("importer.kind_launch", "a ROS launch file"),
    "package": message("importer.kind_package", "a ROS package manifest"),
    "html": message("importer.kind_html", "a web page, perhaps in place of the raw file"),
}
"""Files that users take for a robot's file, by their outermost element: what they are, in words."""


def read_source(
    path: Path, report: ImportReport, options: ImportOptions | None = None
) -> ET.Element:
    """Read the ``robot`` element of a robot's file.

    Elements and attributes of namespaces other than Drake's are left out of a URDF, because no simulation uses them.

    Args:
        path: the file.
        report: gets an entry for each change.
        options: options of the import, such as the arguments of a xacro file; None for the defaults.

    Raises:
        InvalidModel: the file cannot be read, is too large, is empty, is no XML, has a document type, nests elements
            too deep, cannot be expanded or converted, or contains no robot.
        UnknownName: an SDF file has no model of the name that the options give.
    """
    options = options or ImportOptions()
    # The text is kept, as xacro needs it unparsed.
    text = xml_text(path, report)
    robot, comments = parse_tree(text, report)
    if _is_xacro(robot, path):
        text = expand_xacro(path, text, options, report)
        robot, comments = parse_tree(text, report)
        if _is_xacro(robot, path):
            raise report.refusal(
                "",
                message(
                    "importer.still_xacro", "still contains xacro elements after its expansion"
                ),
            )
        report.add(
            "read",
            "",
            message("importer.xacro_expanded", "the macros of the xacro file are expanded"),
        )
    if robot.tag == "sdf":
        return read_sdf(robot, path.absolute(), options, report)
    if robot.tag != "robot":
        # An element that the core does not read may belong to an extension, such as <mujoco>.
        importer = _importer_of(robot.tag, report)
        if importer is None:
            raise report.refusal(f"<{robot.tag}>", _wrong_element(robot.tag))
        return importer.robot_element(robot, path.absolute(), options, report)
    _report_hidden_elements(comments, report)
    # Only a URDF is cleaned: importers of other formats know all of their names.
    _remove_foreign_names(robot, report)
    return robot


def _wrong_element(tag: str) -> str:
    """Sentence about a file whose outermost element is not ``robot``, with its format if that is known."""
    kind = _OTHER_FORMATS.get(tag)
    if kind is not None:
        return message("importer.urdf_needed", "this is {kind}; a URDF is needed", kind=kind)
    return message("robots.outermost_robot", "the outermost element of a URDF must be <robot>")


def _report_hidden_elements(comments: list[str], report: ImportReport) -> None:
    """Report elements in comments, because a user may not expect that they are ignored."""
    hiding_count = 0
    tag_counts: Counter[str] = Counter()
    for comment in comments:
        tags = _HIDDEN_TAG.findall(comment)
        tag_counts.update(tags)
        # A comment counts once, however many elements it hides.
        hiding_count += bool(tags)
    if not hiding_count:
        return
    listed = (
        compound("{count} <{tag}>", count=count, tag=tag) for tag, count in tag_counts.most_common()
    )
    report.add(
        "read",
        "",
        message(
            "importer.comments_hide",
            "{count} {count:comment contains|comments contain} elements ({elements}), which are ignored",
            count=hiding_count,
            elements=join_texts(listed, ", "),
        ),
    )


def _importer_of(tag: str, report: ImportReport) -> RobotImporter | None:
    """Find the importer of an extension for the robots of XML files. Returns None if there is none for this file.

    Args:
        tag: outermost element of the file.
        report: report of the import, which makes the error.

    Raises:
        InvalidModel: an extension has such an importer, and it cannot be used.
    """
    try:
        importer = load_importer(f"<{tag}>")
    except (BrokenExtension, MissingExtension) as problem:
        raise report.refusal(
            "", message("importer.cannot_be_read", "cannot be read: {problem}", problem=problem)
        ) from problem
    # Importers of other things than robots are used by `simrob import` alone.
    return importer if isinstance(importer, RobotImporter) else None


def _is_xacro(robot: ET.Element, path: Path) -> bool:
    """Whether a file contains anything that xacro expands. A declared prefix that is not used does not count.

    Args:
        robot: outermost element of the file.
        path: the file.
    """
    # In plain URDFs, $(find PACKAGE) is common in names of meshes, and counts, too. ${...} counts in xacro files only.
    signs = ("$(", "${") if path.suffix.lower() == ".xacro" else ("$(",)
    for element in robot.iter():
        names = (element.tag, *element.attrib)
        if any(name.startswith(XACRO) for name in names):
            return True
        if any(sign in value for value in element.attrib.values() for sign in signs):
            return True
    return False


def _remove_foreign_names(robot: ET.Element, report: ImportReport) -> None:
    """Remove elements and attributes with a prefix other than Drake's, with one entry in the report for each name."""
    counts: Counter[str] = Counter()
    for element in robot.iter():
        # Lists, because the names and elements are removed while they are visited.
        for name in list(element.attrib):
            if _is_foreign(name):
                del element.attrib[name]
                counts[message("importer.attribute_called", "attribute {name}", name=name)] += 1
        for child in list(element):
            if _is_foreign(child.tag):
                element.remove(child)
                counts[f"<{child.tag}>"] += 1
    for name, count in counts.items():
        report.add(
            "dropped",
            name,
            message(
                "importer.namespace_unused",
                "{count} ×: belongs to a namespace of another program",
                count=count,
            ),
        )


def _is_foreign(name: str) -> bool:
    """Whether the name of an element or attribute belongs to a namespace other than Drake's."""
    has_namespace = ":" in name or name.startswith("{")
    return has_namespace and not name.startswith(DRAKE)
