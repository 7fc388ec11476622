"""From the text of an XML file to its elements, without entities and without depth that could harm.

Namespaces are read as people write them: a prefix that is declared nowhere is no error. Names with a prefix stay as
they are written, ``gazebo:plugin``; but Drake's get its namespace, however they are declared, and xacro's get
``xacro:``.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from xml.parsers import expat

from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.urdf import DRAKE

MAX_DEPTH = 60
"""Of elements in elements; a URDF has six levels."""

_DRAKE_PREFIX, _XACRO_PREFIX = "drake", "xacro"


def parse_tree(text: str, report: ImportReport) -> tuple[ET.Element, list[str]]:
    """Return the outermost element of a text, and its comments.

    Raises:
        InvalidModel: it is no XML, declares a document type or entities, or is nested too deeply.
    """
    return _Reader(report).read(text)


class _Reader:
    """One reading of one text."""

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
                "", f"is not XML: {what} at line {problem.lineno}, column {problem.offset + 1}"
            ) from problem
        except ValueError as problem:  # characters that no XML can hold, such as lone surrogates
            raise self._report.refusal("", f"is not XML: {problem}") from problem

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        declared = {
            name.removeprefix("xmlns:"): _kind(uri) for name, uri in attributes.items() if name.startswith("xmlns:")
        }
        self._prefixes.append({**self._prefixes[-1], **declared} if declared else self._prefixes[-1])
        if len(self._prefixes) > MAX_DEPTH:
            raise self._report.refusal("", f"nests elements more than {MAX_DEPTH} deep; a URDF has six levels")
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
        raise self._report.refusal("", "declares a document type or entities, which a URDF never needs; remove them")


def _kind(uri: str) -> str:
    """Return which of the prefixes that matter a namespace stands for; empty for the others."""
    if uri == DRAKE.strip("{}"):
        return _DRAKE_PREFIX
    return _XACRO_PREFIX if "xacro" in uri else ""
