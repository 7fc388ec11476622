"""Parse XML files of robots, also those with small errors that other readers accept.

Text is decoded by its byte order mark, its declaration, or else by trial. Entities and deep nesting are refused,
because a short file could fill the memory with them.

A prefix that is declared nowhere is no error. Names keep their prefix, as in ``gazebo:plugin``, with two exceptions:
names of Drake get the namespace of Drake in braces, and names of xacro get the prefix ``xacro:``, whichever prefix the
file declares for these namespaces.
"""

import codecs
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping

# Unlike Path's methods, these functions are false for names that no file can have.
from os.path import exists, isdir
from pathlib import Path
from typing import TypeVar
from xml.parsers import expat

from simrob_drake.base.files import NotRead, content_of
from simrob_drake.base.messages import message
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import DRAKE, LARGEST_URDF, MOST_TAGS

# Writing a tree calls a function within itself for each level, and Python limits the depth of calls.
MAX_DEPTH = 60
"""Largest depth of nested elements. A URDF has six levels."""

_BEFORE_DECLARATION = r"(?>\s+|<!--.*?-->)"
"""White space or a comment, such as a licence. XML forbids both before the declaration, but they are common there."""

_LATE_DECLARATION = re.compile(_BEFORE_DECLARATION + r"++(<\?xml\b.*?\?>)", re.DOTALL)
"""A declaration that does not stand at the beginning of the file."""

_DECLARED_ENCODING = re.compile(
    _BEFORE_DECLARATION.encode() + rb"""*+<\?xml[^>]*\sencoding\s*=\s*["']([\w.:-]+)["']""",
    re.DOTALL,
)
_COMMENT = re.compile(r"<!--(.*?)-->", re.DOTALL)

_DRAKE_PREFIX = "drake"
_XACRO_PREFIX = "xacro"

# The longer marks come first, because the mark of UTF-32-LE begins with that of UTF-16-LE.
_ENCODING_OF_MARK = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)

_Content = TypeVar("_Content")


def xml_element(path: Path, report: ImportReport) -> ET.Element:
    """Parse an XML file, and return its outermost element.

    Args:
        path: the file.
        report: gets an entry for each repair.

    Raises:
        InvalidModel: the file cannot be read, is too large, is empty, is no XML, has a document type or too many tags,
            or nests elements too deep.
    """
    return parse_tree(xml_text(path, report), report)[0]


def xml_text(path: Path, report: ImportReport) -> str:
    """Read the text of an XML file, and repair small errors in it.

    Args:
        path: the file.
        report: gets an entry for each repair.

    Raises:
        InvalidModel: the file cannot be read, is too large, is no text, is empty, or has too many tags.
    """
    # Bytes become text before anything else: a null in UTF-16 is no sign of a binary file.
    text = _decode(_file_content(path, report), report)
    if "\0" in text:
        raise report.refusal(
            "", message("importer.is_binary", "is a binary file, not the text of a URDF")
        )
    if not text.strip():
        raise report.refusal("", message("importer.is_empty", "is empty"))
    # Counted in the text, before a tree is made of it, which takes much more memory.
    if text.count("<") > MOST_TAGS:
        raise report.refusal(
            "", message("robots.too_many_tags", "has more than {most} tags", most=MOST_TAGS)
        )
    return _repair_comments(_remove_late_declaration(text, report), report)


def read_included(
    read: Callable[[Path, ImportReport], _Content], path: Path, report: ImportReport
) -> _Content:
    """Read a file that another file includes.

    Args:
        read: function that reads a file and reports its repairs.
        path: the included file.
        report: report of the including file. Entries about the included file get its name.
    """
    # Errors name the included file, as they use the report that its reader gets.
    own_report = ImportReport(path)
    content = read(path, own_report)
    for entry in own_report.entries:
        report.add(entry.kind, path.name, entry.text)
    return content


def _remove_late_declaration(text: str, report: ImportReport) -> str:
    """Remove an XML declaration that does not stand at the beginning. The numbers of lines stay the same."""
    # Parsers refuse such a file with an error that few users understand.
    late = _LATE_DECLARATION.match(text)
    if not late:
        return text
    report.add(
        "repaired",
        "",
        message(
            "importer.xml_line_misplaced",
            "the declaration <?xml ...?> is not at the beginning of the file; it is left out",
        ),
    )
    return text[: late.start(1)] + text[late.end(1) :]


def _repair_comments(text: str, report: ImportReport) -> str:
    """Replace the dashes in all comments by spaces if a comment contains ``--`` or ends with ``-``.

    The numbers of lines and columns stay the same.
    """
    # After the last end of a comment, the search from each beginning would run to the end of the text in vain. A file
    # with many beginnings would take very long.
    end = text.rfind("-->") + 3
    bad_count = 0
    for comment in _COMMENT.findall(text, 0, end):
        if "--" in comment or comment.endswith("-"):
            bad_count += 1
    if not bad_count:
        return text
    report.add(
        "repaired",
        "",
        message(
            "importer.comments_with_dashes",
            "{count} {count:comment contains|comments contain} --, which XML forbids; replaced by spaces",
            count=bad_count,
        ),
    )
    # Each character is replaced by one, so that errors name the line and column of the file.
    repaired = _COMMENT.sub(lambda found: f"<!--{found.group(1).replace('-', ' ')}-->", text[:end])
    return repaired + text[end:]


def _decode(content: bytes, report: ImportReport) -> str:
    """Decode the content of an XML file: by its byte order mark, or by its declared encoding, or by trial.

    Args:
        content: the bytes of the file.
        report: gets an entry if there is a mark, or if the text is not in the declared encoding.

    Raises:
        InvalidModel: the content is no text of the encoding that its mark stands for.
    """
    # A mark is certain. A declared encoding is often copied from another file.
    for mark, encoding in _ENCODING_OF_MARK:
        if content.startswith(mark):
            report.add(
                "repaired",
                "",
                message(
                    "importer.byte_order_mark",
                    "begins with a byte order mark ({encoding}); converted to UTF-8 without a mark",
                    encoding=encoding.upper(),
                ),
            )
            return _decode_by_trial(content.removeprefix(mark), (encoding,), report)
    # Without a declaration, XML is UTF-8.
    declaration = _DECLARED_ENCODING.match(content)
    declared = declaration.group(1).decode("ascii") if declaration else "utf-8"
    # Latin-1 comes last, because it accepts all bytes.
    return _decode_by_trial(content, (declared, "utf-8", "cp1252", "latin-1"), report)


def _decode_by_trial(content: bytes, encodings: tuple[str, ...], report: ImportReport) -> str:
    """Decode bytes in the first of some encodings that fits. It is reported if that is not the very first.

    Raises:
        InvalidModel: no encoding fits.
    """
    expected = encodings[0]
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except (LookupError, ValueError):  # the encoding is unknown to Python, or does not fit
            continue
        if encoding != expected:
            report.add(
                "repaired",
                "",
                message(
                    "importer.other_encoding",
                    "cannot be decoded as {declared}; read as {encoding}",
                    declared=expected,
                    encoding=encoding,
                ),
            )
        return text
    raise report.refusal(
        "",
        message(
            "importer.no_text_of_encoding",
            "cannot be decoded as {encoding}",
            encoding=expected.upper(),
        ),
    )


def _file_content(path: Path, report: ImportReport) -> bytes:
    """Read the bytes of a file.

    Raises:
        InvalidModel: the file does not exist, is a folder, is too large, or cannot be read.
    """
    # Users often name the folder of a robot. Python's own error does not say what to do.
    if isdir(path):
        raise report.refusal(
            "", message("importer.is_a_folder", "is a folder; name the URDF file in it")
        )
    if not exists(path):
        raise report.refusal("", message("importer.there_is_no_file", "there is no such file"))
    try:
        return content_of(path, LARGEST_URDF)
    except NotRead as problem:
        raise report.refusal(
            "", message("importer.cannot_be_read", "cannot be read: {problem}", problem=problem)
        ) from problem


def parse_tree(text: str, report: ImportReport) -> tuple[ET.Element, list[str]]:
    """Parse XML.

    Args:
        text: the XML.
        report: report of the import, which makes the errors.

    Returns:
        the outermost element, and the texts of all comments.

    Raises:
        InvalidModel: the text is no XML, has a document type, or nests elements too deep.
    """
    return _Parser(report).parse(text)


class _Parser:
    """Parses one XML text, with the rules for prefixes of this module.

    Python's own parser of elements cannot be used: it refuses prefixes that are not declared.
    """

    def __init__(self, report: ImportReport) -> None:
        self._report = report
        self._comments: list[str] = []
        self._builder = ET.TreeBuilder()
        # For each open element, the known prefix ("drake", "xacro" or "") that stands for each prefix of the file. The
        # first entry holds outside of all elements.
        self._prefixes: list[Mapping[str, str]] = [
            {_DRAKE_PREFIX: _DRAKE_PREFIX, _XACRO_PREFIX: _XACRO_PREFIX}
        ]

    def parse(self, text: str) -> tuple[ET.Element, list[str]]:
        """Parse the text. See :func:`parse_tree`."""
        parser = expat.ParserCreate()
        # One piece of text for each element, and not one for each line.
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
        except (
            ValueError
        ) as problem:  # characters that XML cannot contain, such as single surrogates
            raise self._report.refusal(
                "", message("robots.not_xml", "is not XML: {problem}", problem=problem)
            ) from problem

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        """Begin an element: read the prefixes that it declares, and keep its other attributes."""
        prefixes = dict(self._prefixes[-1])
        # xmlns attributes are no data. They would come out as attributes of the robot.
        kept_attributes = {}
        for name, value in attributes.items():
            if name.startswith("xmlns:"):
                prefixes[name.removeprefix("xmlns:")] = _known_prefix(value)
            elif not name.startswith("xmlns"):
                kept_attributes[name] = value
        self._prefixes.append(prefixes)

        # The list has an entry for each open element.
        if len(self._prefixes) > MAX_DEPTH:
            raise self._report.refusal(
                "",
                message(
                    "importer.nested_too_deep",
                    "has elements in more than {depth} levels; a URDF has six levels",
                    depth=MAX_DEPTH,
                ),
            )
        # The prefixes of this element apply to its own names, too, so they are replaced only now.
        full_attributes = {self._full_name(name): value for name, value in kept_attributes.items()}
        self._builder.start(self._full_name(tag), full_attributes)

    def _end(self, tag: str) -> None:
        """End an element."""
        # The prefixes of an element apply to its end tag, too: they are removed afterwards.
        self._builder.end(self._full_name(tag))
        self._prefixes.pop()

    def _full_name(self, name: str) -> str:
        """Replace the prefix of a name of Drake by the namespace, and that of a name of xacro by ``xacro:``."""
        prefix, colon, rest = name.partition(":")
        if not colon:
            return name
        # A prefix of the name drake counts as Drake's without a declaration, as in Drake's own parser.
        known = self._prefixes[-1].get(prefix, "")
        if _DRAKE_PREFIX in (prefix, known):
            return DRAKE + rest
        return f"{_XACRO_PREFIX}:{rest}" if known == _XACRO_PREFIX else name

    def _refuse_doctype(self, *_: object) -> None:
        """Refuse a document type, in which entities could be defined that expand to a huge text."""
        raise self._report.refusal(
            "",
            message(
                "importer.remove_entities",
                "declares a document type or entities, which a URDF never needs; remove them",
            ),
        )


def _known_prefix(uri: str) -> str:
    """Prefix of a namespace: ``drake`` or ``xacro``, or empty for other namespaces."""
    if uri == DRAKE.strip("{}"):
        return _DRAKE_PREFIX
    # Files declare xacro by several addresses, such as http://ros.org/wiki/xacro and http://www.ros.org/wiki/xacro.
    return _XACRO_PREFIX if "xacro" in uri else ""
