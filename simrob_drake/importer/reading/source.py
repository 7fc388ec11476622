"""From a file to its ``robot`` element: tolerant of what people write, but never of what could harm."""

import codecs
import re
import xml.etree.ElementTree as ET
from collections import Counter
from os.path import exists, isdir  # which are false for names that no file can have
from pathlib import Path

from simrob_drake.files import NotRead, content_of
from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.reading.xacro import XACRO, expanded
from simrob_drake.importer.reading.xml_tree import parse_tree
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import DRAKE, LARGEST_URDF, MOST_TAGS

_OTHER_FORMATS = {
    "sdf": "an SDF file, which describes models and worlds for Gazebo",
    "gazebo": "an SDF file of an old kind",
    "world": "an SDF world",
    "model": "an SDF model",
    "mujoco": "an MJCF file, of MuJoCo",
    "mujocoinclude": "an MJCF file, of MuJoCo",
    "COLLADA": "a COLLADA mesh",
    "launch": "a ROS launch file",
    "package": "a ROS package manifest",
    "html": "a web page; was the raw file meant?",
}
_MARKS = (  # the longer ones first: that of UTF-32 begins with that of UTF-16
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_DECLARED = re.compile(rb"""^\s*<\?xml[^>]*\sencoding\s*=\s*["']([\w.:-]+)["']""")
_LATE_DECLARATION = re.compile(r"\s+(<\?xml\b.*?\?>)")
_COMMENT = re.compile(r"<!--(.*?)-->", re.DOTALL)
_HIDDEN = re.compile(r"<(link|joint|visual|collision|inertial|transmission|geometry|mesh|origin|limit|mimic)\b[^<]*>")


def read_source(path: Path, report: ImportReport, options: ImportOptions | None = None) -> ET.Element:
    """Return the ``robot`` element of a URDF or xacro file, with every change noted in the report.

    Elements and attributes of foreign namespaces, which no simulation uses, are left out; those of Drake stay.

    Raises:
        InvalidModel: it cannot be read, is too large, is no XML, declares entities, or holds no robot.
    """
    text = decoded(_content(path, report), report)
    robot, comments = parse_tree(text, report)
    if _is_xacro(robot, path):
        text = expanded(path, options or ImportOptions(), report)
        robot, comments = parse_tree(text, report)
        if _is_xacro(robot, path):
            raise report.refusal("", "still holds xacro elements after its expansion")
        report.add("read", "", "xacro, expanded")
    if robot.tag != "robot":
        kind = _OTHER_FORMATS.get(robot.tag)
        said = f"this is {kind}; a URDF is needed" if kind else "the outermost element of a URDF is <robot>"
        raise report.refusal(f"<{robot.tag}>", said)
    _tell_comments(comments, report)
    _drop_foreign(robot, report)
    return robot


def decoded(content: bytes, report: ImportReport) -> str:
    """Return a file's text, whichever encoding it has or claims to have."""
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            report.add("repaired", "", f"begins with a byte order mark ({encoding.upper()}); written without, in UTF-8")
            text = _decoded(content.removeprefix(mark), (encoding,), report)
            break
    else:
        declared = _DECLARED.search(content)
        name = declared.group(1).decode("ascii") if declared else "utf-8"
        text = _decoded(content, (name, "utf-8", "cp1252", "latin-1"), report)
    if "\0" in text:
        raise report.refusal("", "is a binary file, not the text of a URDF")
    if not text.strip():
        raise report.refusal("", "is empty")
    if text.count("<") > MOST_TAGS:
        raise report.refusal("", f"has more than {MOST_TAGS} tags")
    return _well_formed(text, report)


def _well_formed(text: str, report: ImportReport) -> str:
    """Mend what XML forbids and most readers of URDFs do not mind; no line changes its number."""
    declaration = _LATE_DECLARATION.match(text)
    if declaration:
        text = text.replace(declaration.group(1), "", 1)
        report.add("repaired", "", "blanks before <?xml ...?>, which must be the first; left out")
    end = text.rfind("-->") + 3  # beyond, each comment would be searched for an end that is not there
    bad = [comment for comment in _COMMENT.findall(text, 0, end) if "--" in comment or comment.endswith("-")]
    if bad:
        text = _COMMENT.sub(lambda found: f"<!--{found.group(1).replace('-', ' ')}-->", text[:end]) + text[end:]
        report.add("repaired", "", f"{len(bad)} comment(s) hold --, which XML forbids; mended")
    return text


def _decoded(content: bytes, encodings: tuple[str, ...], report: ImportReport) -> str:
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except (LookupError, ValueError):  # an encoding that Python does not know, or that the file does not keep to
            continue
        if encoding != encodings[0]:
            report.add("repaired", "", f"is not {encodings[0]}, as it says or should be; read as {encoding}")
        return text
    raise report.refusal("", f"cannot be read as {encodings[0].upper()} text")


def _content(path: Path, report: ImportReport) -> bytes:
    if isdir(path):
        raise report.refusal("", "is a folder; name the URDF file in it")
    if not exists(path):
        raise report.refusal("", "there is no such file")
    try:
        return content_of(path, LARGEST_URDF)
    except NotRead as problem:
        raise report.refusal("", f"cannot be read: {problem}") from problem


def _is_xacro(robot: ET.Element, path: Path) -> bool:
    """Whether there is something to expand: a declared but unused prefix ``xacro:`` is not."""
    named = [robot.tag, *(name for element in robot.iter() for name in (element.tag, *element.attrib))]
    if any(name.startswith(XACRO) for name in named):
        return True
    values = (value for element in robot.iter() for value in element.attrib.values())
    return path.suffix.lower() == ".xacro" and any("${" in value or "$(" in value for value in values)


def _tell_comments(comments: list[str], report: ImportReport) -> None:
    hiding = [tags for comment in comments if (tags := _HIDDEN.findall(comment))]
    if hiding:
        counts = Counter(tag for tags in hiding for tag in tags)
        listed = ", ".join(f"{count} <{tag}>" for tag, count in counts.most_common())
        report.add("read", "", f"{len(hiding)} comment(s) hide elements ({listed}); they are ignored")


def _drop_foreign(robot: ET.Element, report: ImportReport) -> None:
    """Leave out what has a prefix other than Drake's, told once a name."""
    counts: Counter[str] = Counter()
    for element in robot.iter():
        for name in [name for name in element.attrib if _is_foreign(name)]:
            del element.attrib[name]
            counts[f"attribute {name}"] += 1
        for child in [child for child in element if _is_foreign(child.tag)]:
            element.remove(child)
            counts[f"<{child.tag}>"] += 1
    for name, count in counts.items():
        report.add("dropped", name, f"{count} ×: of a namespace that no simulation uses")


def _is_foreign(name: str) -> bool:
    return (":" in name or name.startswith("{")) and not name.startswith(DRAKE)
