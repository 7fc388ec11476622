"""From a part's XML, or the text of an old `.mdl` file, to elements, without types or depth that could harm."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from xml.etree.ElementTree import Element, SubElement
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


_TOKEN = re.compile(
    r'\s+|#[^\n]*\n|(?P<text>"(?:\\.|[^"\\])*")|(?P<list>\[[^\]]*\])|(?P<brace>[{}])|(?P<word>[^\s{}"\[]+)'
)
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)
_CONNECTION = re.compile(r"([LR])Conn(\d+)")


def parse_mdl(content: bytes) -> Element:
    """Return the elements of an old model text.

    Raises:
        Unreadable: it is no such text.
    """
    text = content.decode("utf-8", "replace")
    tokens = _tokens(text)
    root = Element("ModelInformation")
    try:
        for kind, word in tokens:
            brace = next(tokens)
            if kind != "word" or brace != ("brace", "{"):
                raise Unreadable(f"is no Simulink model: '{word[:20]}' stands where a section should begin")
            _fill(SubElement(root, word), tokens, 0)
    except StopIteration:
        raise Unreadable("ends in the middle of a section; it was cut off") from None
    for line in root.iter("Line"):
        _rewrite_line(line)
    return root


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    place = 0
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None:
            line = text.count("\n", 0, place) + 1
            raise Unreadable(f"is no Simulink model text: line {line} cannot be read")
        place = match.end()
        if match.lastgroup == "text":
            yield "text", _ESCAPE.sub(lambda found: "\n" if found[1] == "n" else found[1], match["text"][1:-1])
        elif match.lastgroup:
            yield match.lastgroup, match[0]


def _fill(element: Element, tokens: Iterator[tuple[str, str]], depth: int) -> None:
    """Read ``key value`` and ``Section { ... }`` until the section ends."""
    if depth > MAX_DEPTH:
        raise Unreadable(f"nests sections more than {MAX_DEPTH} deep")
    key: str | None = None
    last: Element | None = None
    for kind, word in tokens:
        if (kind, word) == ("brace", "}"):
            return
        if (kind, word) == ("brace", "{"):
            _fill(SubElement(element, key or "Section"), tokens, depth + 1)
            key, last = None, None
        elif key is None and kind == "text" and last is not None:
            last.text = (last.text or "") + word  # a long text goes on in the next line
        elif key is None:
            key = word
        else:
            last = _give(element, key, word)
            key = None
    raise StopIteration


def _give(element: Element, key: str, value: str) -> Element:
    if element.tag == "Block" and key == "BlockType":
        element.set(key, value)
    elif element.tag == "Block" and key == "Name":
        element.set(key, value)
        element.set("SID", value)  # lines name the blocks
    parameter = SubElement(element, "P", Name=key)
    parameter.text = value
    return parameter


def _rewrite_line(line: Element) -> None:
    """Write a line's ends as `.slx` does, ``block#out:1``; blocks go by their names there."""
    physical = False
    for part in (line, *line.iter("Branch")):
        texts = {parameter.get("Name", ""): parameter.text or "" for parameter in part.iterfind("P")}
        for end, side in (("Src", "out"), ("Dst", "in")):
            if f"{end}Block" in texts:
                place = texts.get(f"{end}Port", "1")
                match = _CONNECTION.fullmatch(place)
                physical |= match is not None
                port = f"{match[1].lower()}conn:{match[2]}" if match else f"{side}:{place}"
                SubElement(part, "P", Name=end).text = f"{texts[f'{end}Block']}#{port}"
    if physical or any(parameter.text == "Connection" for parameter in line.iterfind("P[@Name='LineType']")):
        line.set("LineType", "Connection")
