"""From a part's XML to its elements, without document types, entities or depth that could harm."""

import xml.etree.ElementTree as ET
from xml.parsers import expat

MAX_DEPTH = 200
"""Of elements in elements."""


class Unreadable(ValueError):
    """A part that is no XML, or XML that no model file has."""


def parse_part(content: bytes) -> ET.Element:
    """Return the outermost element of a part.

    Raises:
        Unreadable: it is no XML, declares a document type, or is nested too deeply.
    """
    builder = ET.TreeBuilder()
    depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise Unreadable(f"nests elements more than {MAX_DEPTH} deep")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise Unreadable("declares a document type or entities, which no model file does")

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(content, True)
        return builder.close()
    except expat.ExpatError as problem:
        raise Unreadable(f"is not XML: {expat.ErrorString(problem.code)} at line {problem.lineno}") from problem
    except (ValueError, LookupError) as problem:  # characters or encodings that XML cannot hold
        raise problem if isinstance(problem, Unreadable) else Unreadable(f"is not XML: {problem}") from problem
