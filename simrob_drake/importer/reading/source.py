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
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.importer.importer import RobotImporter, load_importer
from simrob_drake.importer.reading.xacro import XACRO, expand_xacro
from simrob_drake.importer.reading.xml_file import parse_tree, xml_text
from simrob_drake.importer.sdf.reading import read_sdf
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import DRAKE

_HIDDEN_TAG = re.compile(
    r"<(link|joint|visual|collision|inertial|transmission|geometry|mesh|origin|limit|mimic)\b[^<]*>"
)
"""An element of a URDF in the text of a comment."""


def read_source(
    path: Path, report: ImportReport, options: ImportOptions | None = None
) -> ET.Element:
    """Read the ``robot`` element of a robot's file.

    Elements and attributes of namespaces other than Drake's are left out, because no simulation uses them.

    Args:
        path: the file.
        report: gets an entry for each change.
        options: options of the import, such as the arguments of a xacro file; None for the defaults.

    Raises:
        InvalidModel: the file cannot be read, is too large, is no XML, declares entities, or contains no robot.
    """
    options = options or ImportOptions()
    text = xml_text(path, report)
    robot, comments = parse_tree(text, report)
    if _is_xacro(robot, path):
        text = expand_xacro(path, text, options, report)
        robot, comments = parse_tree(text, report)
        if _is_xacro(robot, path):
            raise report.refusal(
                "",
                message("importer.still_xacro", "still holds xacro elements after its expansion"),
            )
        report.add("read", "", message("importer.xacro_expanded", "xacro, expanded"))
    if robot.tag == "sdf":
        return read_sdf(robot, path.absolute(), options, report)
    if robot.tag != "robot":
        importer = _importer_of(robot.tag, report)
        if importer is None:
            raise report.refusal(f"<{robot.tag}>", _wrong_element(robot.tag))
        return importer.robot_element(robot, path.absolute(), options, report)
    _report_hidden_elements(comments, report)
    _remove_foreign_names(robot, report)
    return robot


def _wrong_element(tag: str) -> str:
    """Sentence about a file whose outermost element is not ``robot``, with its format if that is known."""
    formats = read_yaml(Path(__file__).with_name("other_formats.yaml"))
    kind = formats.get(tag)
    if kind:
        return message("importer.urdf_needed", "this is {kind}; a URDF is needed", kind=kind)
    return message("robots.outermost_robot", "the outermost element of a URDF must be <robot>")


def _report_hidden_elements(comments: list[str], report: ImportReport) -> None:
    """Report elements in comments, because a user may not expect that they are ignored."""
    hiding_count = 0
    tag_counts: Counter[str] = Counter()
    for comment in comments:
        tags = _HIDDEN_TAG.findall(comment)
        tag_counts.update(tags)
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
            "{count} comment(s) hide elements ({elements}); they are ignored",
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
                "{count} ×: of a namespace that no simulation uses",
                count=count,
            ),
        )


def _is_foreign(name: str) -> bool:
    """Whether the name of an element or attribute belongs to a namespace other than Drake's."""
    has_namespace = ":" in name or name.startswith("{")
    return has_namespace and not name.startswith(DRAKE)
