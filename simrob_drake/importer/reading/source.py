"""From a file to its ``robot`` element: tolerant of what people write, but never of what could harm."""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

from simrob_drake.base.extension import BrokenExtension, MissingExtension
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.importer.importer import RobotImporter, load_importer
from simrob_drake.importer.reading.xacro import XACRO, expanded
from simrob_drake.importer.reading.xml_file import parse_tree, xml_text
from simrob_drake.importer.sdf.reading import read_sdf
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.urdf import DRAKE

_HIDDEN = re.compile(r"<(link|joint|visual|collision|inertial|transmission|geometry|mesh|origin|limit|mimic)\b[^<]*>")


def read_source(path: Path, report: ImportReport, options: ImportOptions | None = None) -> ET.Element:
    """Return the ``robot`` element of a URDF or xacro file, with every change noted in the report.

    Elements and attributes of foreign namespaces, which no simulation uses, are left out; those of Drake stay. Raises
    InvalidModel: it cannot be read, is too large, is no XML, declares entities, or holds no robot.
    """
    text = xml_text(path, report)
    robot, comments = parse_tree(text, report)
    if _is_xacro(robot, path):
        text = expanded(path, text, options or ImportOptions(), report)
        robot, comments = parse_tree(text, report)
        if _is_xacro(robot, path):
            raise report.refusal("", message("importer.still_xacro", "still holds xacro elements after its expansion"))
        report.add("read", "", message("importer.xacro_expanded", "xacro, expanded"))
    if robot.tag == "sdf":
        return read_sdf(robot, path.absolute(), options or ImportOptions(), report)
    if robot.tag != "robot":
        importer = _importer_of(robot.tag, report)
        if importer is not None:
            return importer.robot_element(robot, path.absolute(), options or ImportOptions(), report)
        kind = read_yaml(Path(__file__).with_name("other_formats.yaml")).get(robot.tag)
        sentence = (
            message("importer.urdf_needed", "this is {kind}; a URDF is needed", kind=kind)
            if kind
            else message("robots.outermost_robot", "the outermost element of a URDF is <robot>")
        )
        raise report.refusal(f"<{robot.tag}>", sentence)
    hiding = [tags for comment in comments if (tags := _HIDDEN.findall(comment))]
    if hiding:
        counts = Counter(tag for tags in hiding for tag in tags)
        listed = join_texts(
            (compound("{count} <{tag}>", count=count, tag=tag) for tag, count in counts.most_common()), ", "
        )
        report.add(
            "read",
            "",
            message(
                "importer.comments_hide",
                "{count} comment(s) hide elements ({elements}); they are ignored",
                count=len(hiding),
                elements=listed,
            ),
        )
    _drop_foreign(robot, report)
    return robot


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
    """Whether there is something to expand: a declared but unused prefix ``xacro:`` is not."""
    named = [robot.tag, *(name for element in robot.iter() for name in (element.tag, *element.attrib))]
    if any(name.startswith(XACRO) for name in named):
        return True
    signs = ("$(", "${") if path.suffix.lower() == ".xacro" else ("$(",)  # packages are named in plain URDFs, too
    values = [value for element in robot.iter() for value in element.attrib.values()]
    return any(sign in value for sign in signs for value in values)


def _drop_foreign(robot: ET.Element, report: ImportReport) -> None:
    """Leave out what has a prefix other than Drake's, told once a name."""
    counts: Counter[str] = Counter()
    for element in robot.iter():
        for name in [name for name in element.attrib if _is_foreign(name)]:
            del element.attrib[name]
            counts[message("importer.attribute_called", "attribute {name}", name=name)] += 1
        for child in [child for child in element if _is_foreign(child.tag)]:
            element.remove(child)
            counts[f"<{child.tag}>"] += 1
    for name, count in counts.items():
        report.add(
            "dropped",
            name,
            message("importer.namespace_unused", "{count} ×: of a namespace that no simulation uses", count=count),
        )


def _is_foreign(name: str) -> bool:
    return (":" in name or name.startswith("{")) and not name.startswith(DRAKE)
