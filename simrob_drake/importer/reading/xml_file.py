"""From an XML file to its elements: whatever encoding it has, without entities and without depth that could harm.

Namespaces are read as people write them: a prefix that is declared nowhere is no error. Names with a prefix stay as
they are written, ``gazebo:plugin``; but Drake's get its namespace, however they are declared, and xacro's get
``xacro:``.
"""

import codecs
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from os.path import exists, isdir  # which are false for names that no file can have
from pathlib import Path
from typing import TypeVar
from xml.parsers import expat

from simrob_drake.base.files import NotRead, content_of
from simrob_drake.base.messages import message
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import DRAKE, LARGEST_URDF, MOST_TAGS

MAX_DEPTH = 60  # of elements in elements; a URDF has six levels

_BEFORE_DECLARATION = r"(?>\s+|<!--.*?-->)"  # what may not, but often does, stand there: a licence, blanks
_LATE_DECLARATION = re.compile(_BEFORE_DECLARATION + r"++(<\?xml\b.*?\?>)", re.DOTALL)

_DRAKE_PREFIX, _XACRO_PREFIX = "drake", "xacro"
_MARKS = (  # the longer ones first: that of UTF-32 begins with that of UTF-16
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_DECLARED = re.compile(
    _BEFORE_DECLARATION.encode() + rb"""*+<\?xml[^>]*\sencoding\s*=\s*["']([\w.:-]+)["']""", re.DOTALL
)
_COMMENT = re.compile(r"<!--(.*?)-->", re.DOTALL)
_Content = TypeVar("_Content")


def xml_element(path: Path, report: ImportReport) -> ET.Element:
    """Return a file's outermost element; raises InvalidModel: unreadable, too large, no XML, or declares entities."""
    return parse_tree(xml_text(path, report), report)[0]


def xml_text(path: Path, report: ImportReport) -> str:
    """Return a file's text; the report tells what was mended; raises InvalidModel: unreadable, too large, no text."""
    content = _content(path, report)
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            report.add(
                "repaired",
                "",
                message(
                    "importer.byte_order_mark",
                    "begins with a byte order mark ({encoding}); written without, in UTF-8",
                    encoding=encoding.upper(),
                ),
            )
            text = _decoded(content.removeprefix(mark), (encoding,), report)
            break
    else:
        declared = _DECLARED.match(content)
        name = declared.group(1).decode("ascii") if declared else "utf-8"
        text = _decoded(content, (name, "utf-8", "cp1252", "latin-1"), report)
    if "\0" in text:
        raise report.refusal("", message("importer.is_binary", "is a binary file, not the text of a URDF"))
    if not text.strip():
        raise report.refusal("", message("importer.is_empty", "is empty"))
    if text.count("<") > MOST_TAGS:
        raise report.refusal("", message("robots.too_many_tags", "has more than {most} tags", most=MOST_TAGS))
    return _well_formed(text, report)


def included(read: Callable[[Path, ImportReport], _Content], path: Path, report: ImportReport) -> _Content:
    """Return what is read from a file that another one names; what was mended is told under its name."""
    own = ImportReport(path)
    content = read(path, own)
    for entry in own.entries:
        report.add(entry.kind, path.name, entry.text)
    return content


def _well_formed(text: str, report: ImportReport) -> str:
    """Mend what XML forbids and most readers of URDFs do not mind; no line changes its number."""
    late = _LATE_DECLARATION.match(text)
    if late:
        text = text[: late.start(1)] + text[late.end(1) :]
        report.add(
            "repaired",
            "",
            message("importer.xml_line_misplaced", "<?xml ...?> is not at the beginning, as it must be; left out"),
        )
    end = text.rfind("-->") + 3  # beyond, each comment would be searched for an end that is not there
    bad = [comment for comment in _COMMENT.findall(text, 0, end) if "--" in comment or comment.endswith("-")]
    if bad:
        text = _COMMENT.sub(lambda found: f"<!--{found.group(1).replace('-', ' ')}-->", text[:end]) + text[end:]
        report.add(
            "repaired",
            "",
            message(
                "importer.comments_with_dashes", "{count} comment(s) hold --, which XML forbids; mended", count=len(bad)
            ),
        )
    return text


def _decoded(content: bytes, encodings: tuple[str, ...], report: ImportReport) -> str:
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except (LookupError, ValueError):  # an encoding that Python does not know, or that the file does not keep to
            continue
        if encoding != encodings[0]:
            report.add(
                "repaired",
                "",
                message(
                    "importer.other_encoding",
                    "is not {declared}, as it says or should be; read as {encoding}",
                    declared=encodings[0],
                    encoding=encoding,
                ),
            )
        return text
    raise report.refusal(
        "", message("importer.no_text_of_encoding", "cannot be read as {encoding} text", encoding=encodings[0].upper())
    )


def _content(path: Path, report: ImportReport) -> bytes:
    if isdir(path):
        raise report.refusal("", message("importer.is_a_folder", "is a folder; name the URDF file in it"))
    if not exists(path):
        raise report.refusal("", message("importer.there_is_no_file", "there is no such file"))
    try:
        return content_of(path, LARGEST_URDF)
    except NotRead as problem:
        raise report.refusal(
            "", message("importer.cannot_be_read", "cannot be read: {problem}", problem=problem)
        ) from problem


def parse_tree(text: str, report: ImportReport) -> tuple[ET.Element, list[str]]:
    """Return a text's outermost element and comments; raises InvalidModel: no XML, a doctype, or nested too deep."""
    return _Reader(report).read(text)


class _Reader:
    def __init__(self, report: ImportReport) -> None:
        self._report = report
        self._comments: list[str] = []
        self._builder = ET.TreeBuilder()
        self._prefixes: list[Mapping[str, str]] = [{_DRAKE_PREFIX: _DRAKE_PREFIX, _XACRO_PREFIX: _XACRO_PREFIX}]

    def read(self, text: str) -> tuple[ET.Element, list[str]]:
        parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._builder.data
        parser.CommentHandler = self._comments.append
        parser.StartDoctypeDeclHandler = self._refuse_doctype
        try:
            parser.Parse(text, True)
            return self._builder.close(), self._comments
        except expat.ExpatError as problem:
            what = expat.ErrorString(problem.code)
            raise self._report.refusal(
                "",
                message(
                    "importer.not_xml_at",
                    "is not XML: {what} at line {line}, column {column}",
                    what=what,
                    line=problem.lineno,
                    column=problem.offset + 1,
                ),
            ) from problem
        except ValueError as problem:  # characters that no XML can hold, such as lone surrogates
            raise self._report.refusal(
                "", message("robots.not_xml", "is not XML: {problem}", problem=problem)
            ) from problem

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        declared = {
            name.removeprefix("xmlns:"): _kind(uri) for name, uri in attributes.items() if name.startswith("xmlns:")
        }
        self._prefixes.append({**self._prefixes[-1], **declared} if declared else self._prefixes[-1])
        if len(self._prefixes) > MAX_DEPTH:
            raise self._report.refusal(
                "",
                message(
                    "importer.nested_too_deep",
                    "nests elements more than {depth} deep; a URDF has six levels",
                    depth=MAX_DEPTH,
                ),
            )
        kept = {self._full(name): value for name, value in attributes.items() if not name.startswith("xmlns")}
        self._builder.start(self._full(tag), kept)

    def _end(self, tag: str) -> None:
        self._builder.end(self._full(tag))
        self._prefixes.pop()

    def _full(self, name: str) -> str:
        prefix, colon, rest = name.partition(":")
        if not colon:
            return name
        kind = self._prefixes[-1].get(prefix, "")
        if _DRAKE_PREFIX in (prefix, kind):
            return DRAKE + rest
        return f"{_XACRO_PREFIX}:{rest}" if kind == _XACRO_PREFIX else name

    def _refuse_doctype(self, *_: object) -> None:
        raise self._report.refusal(
            "",
            message(
                "importer.remove_entities",
                "declares a document type or entities, which a URDF never needs; remove them",
            ),
        )


def _kind(uri: str) -> str:
    """Return which of the prefixes that matter a namespace stands for; empty for the others."""
    if uri == DRAKE.strip("{}"):
        return _DRAKE_PREFIX
    return _XACRO_PREFIX if "xacro" in uri else ""
