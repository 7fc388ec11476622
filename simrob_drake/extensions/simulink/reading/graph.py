"""A Simulink model as it is written: blocks, parameters, masks and lines; no values yet.

They stand in the XML of a part, or in the text of an old `.mdl` file, read without types or depth that could harm.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement
from xml.parsers import expat

from simrob_drake.base.messages import message
from simrob_drake.robots.imports import EntryKind

MAX_DEPTH = 200  # of elements in elements


class Unreadable(ValueError):
    """A part that is no XML, or XML that no model file has, such as one that refers to itself without end."""


def parse_part(content: bytes) -> ET.Element:
    """Return the outermost element of a part.

    Raises Unreadable: it is no XML, declares a document type, or is nested too deeply.
    """
    builder = ET.TreeBuilder()
    depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise Unreadable(
                message(
                    "simulink.nested_too_deep",
                    "nests elements more than {depth} deep",
                    depth=MAX_DEPTH,
                )
            )
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise Unreadable(
            message(
                "simulink.declares_entities",
                "declares a document type or entities, which no model file does",
            )
        )

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = builder.data, refuse
    try:
        parser.Parse(content, True)
        return builder.close()
    except expat.ExpatError as problem:
        raise Unreadable(
            message(
                "simulink.not_xml_at",
                "is not XML: {problem} at line {line}",
                problem=expat.ErrorString(problem.code),
                line=problem.lineno,
            )
        ) from problem
    except (ValueError, LookupError) as problem:  # characters or encodings that XML cannot hold
        raise (
            problem
            if isinstance(problem, Unreadable)
            else Unreadable(message("simulink.not_xml", "is not XML: {problem}", problem=problem))
        ) from problem


_TOKEN = re.compile(
    r'\s+|#[^\n]*\n|(?P<text>"(?:\\.|[^"\\])*")|(?P<list>\[[^\]]*\])|(?P<brace>[{}])|(?P<word>[^\s{}"\[]+)|(?P<wrong>.)'
)
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)
_CONNECTION = re.compile(r"([LR])Conn(\d+)")


def parse_mdl(content: bytes) -> Element:
    """Return the elements of an old model text (raises Unreadable: it is no such text)."""
    text = content.decode("utf-8", "replace")
    tokens = _tokens(text)
    root = Element("ModelInformation")
    try:
        for kind, word in tokens:
            brace = next(tokens)
            if kind != "word" or brace != ("brace", "{"):
                raise Unreadable(
                    message(
                        "simulink.no_section",
                        "is no Simulink model: '{word}' stands where a section should begin",
                        word=word[:20],
                    )
                )
            _fill(SubElement(root, word), tokens, 0)
    except StopIteration:
        raise Unreadable(
            message(
                "simulink.cut_off_in_section", "ends in the middle of a section; it was cut off"
            )
        ) from None
    for line in root.iter("Line"):
        _rewrite_line(line)
    return root


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    for match in _TOKEN.finditer(text):
        if match.lastgroup == "wrong":
            line = text.count("\n", 0, match.start()) + 1
            raise Unreadable(
                message(
                    "simulink.unreadable_line",
                    "is no Simulink model text: line {line} cannot be read",
                    line=line,
                )
            )
        if match.lastgroup == "text":
            yield (
                "text",
                _ESCAPE.sub(
                    lambda found: "\n" if found[1] == "n" else found[1], match["text"][1:-1]
                ),
            )
        elif match.lastgroup:
            yield match.lastgroup, match[0]


def _fill(element: Element, tokens: Iterator[tuple[str, str]], depth: int) -> None:
    """Read ``key value`` and ``Section { ... }`` until the section ends."""
    if depth > MAX_DEPTH:
        raise Unreadable(
            message(
                "simulink.sections_too_deep",
                "nests sections more than {depth} deep",
                depth=MAX_DEPTH,
            )
        )
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
    if element.tag == "Block" and key in ("BlockType", "Name"):
        element.set(key, value)
        element.attrib |= {"SID": value} if key == "Name" else {}  # lines name the blocks
    parameter = SubElement(element, "P", Name=key)
    parameter.text = value
    return parameter


def _rewrite_line(line: Element) -> None:
    """Write a line's ends as `.slx` does, ``block#out:1``; blocks go by their names there."""
    physical = False
    for part in (line, *line.iter("Branch")):
        texts = {
            parameter.get("Name", ""): parameter.text or "" for parameter in part.iterfind("P")
        }
        for end, side in (("Src", "out"), ("Dst", "in")):
            if f"{end}Block" in texts:
                place = texts.get(f"{end}Port", "1")
                match = _CONNECTION.fullmatch(place)
                physical |= match is not None
                port = f"{match[1].lower()}conn:{match[2]}" if match else f"{side}:{place}"
                SubElement(part, "P", Name=end).text = f"{texts[f'{end}Block']}#{port}"
    if physical or any(
        parameter.text == "Connection" for parameter in line.iterfind("P[@Name='LineType']")
    ):
        line.set("LineType", "Connection")


class Port(NamedTuple):
    """A port of a block within its system."""

    block: str  # the block's identifier in its system (SID)
    side: str  # ``in``, ``out``, ``lconn`` or ``rconn`` (physical, left and right), or ``enable``, ``trigger`` ...
    number: int  # from 1


@dataclass(frozen=True)
class MaskParameter:
    """A parameter of a mask."""

    name: str  # its variable
    value: str  # the expression that gives its value
    evaluated: bool = True  # whether the value is an expression, or text as it stands
    kind: str = "edit"  # of its field: ``edit``, ``popup``, ``checkbox`` ...
    choices: tuple[str, ...] = ()
    counts: tuple[str, ...] = ()  # what each of these is as a number; without, or empty, its place


@dataclass(frozen=True)
class Mask:
    """The parameters of a masked block, and the code that MATLAB would run before it."""

    parameters: tuple[MaskParameter, ...] = ()
    code: str = ""


@dataclass
class SimulinkBlock:
    """A block."""

    sid: str  # identifier in its system
    name: str  # on one line
    kind: str  # its ``BlockType``, or for a link into a library its source, such as ``sm_lib/Joints/Revolute Joint``
    linked: bool = False  # whether ``kind`` is a place in a library
    parameters: dict[str, str] = field(default_factory=dict)  # as they are written
    mask: Mask | None = None  # of its own
    system: System | None = None  # what is in a subsystem

    @property
    def commented(self) -> str:
        """``on``: out of the model; ``through``: replaced by a wire; ``off``."""
        return self.parameters.get("Commented", "off")


@dataclass
class System:
    """The blocks of one level, and the lines between them."""

    blocks: dict[str, SimulinkBlock] = field(default_factory=dict)  # by identifier
    wires: list[tuple[Port, list[Port]]] = field(default_factory=list)
    """Signal lines, from an ``out`` port to the ports it feeds."""
    # names of lines, by the ports they come from
    signals: dict[Port, str] = field(default_factory=dict)
    nets: list[list[Port]] = field(default_factory=list)  # physical lines: ports that are one node

    def find(self, path: str) -> SimulinkBlock | None:
        """Return the block at ``system/block``, in whose names a ``/`` stands twice; None where there is none."""
        system: System | None = self
        found: SimulinkBlock | None = None
        for step in (
            one_line(part.replace("\0", "/")) for part in path.replace("//", "\0").split("/")
        ):
            found = (
                next((one for one in system.blocks.values() if one.name == step), None)
                if system
                else None
            )
            system = found.system if found else None
        return found


@dataclass
class Model:
    """A model file."""

    path: Path  # the file
    kind: str  # ``Model``, ``Library``, ``Subsystem``, or ``Assembly`` of a CAD tool
    system: System  # its outermost level
    mask: Mask | None = None  # of a subsystem file as a whole
    code: str = ""  # of the model workspace, MATLAB assignments, or which file it is from
    stored: bytes = b""  # of the model workspace, variables as MATLAB keeps them
    # names of callbacks that MATLAB would run, with their code
    callbacks: dict[str, str] = field(default_factory=dict)
    stop_time: str = "10"  # when a run ends, an expression [s]
    notes: list[tuple[EntryKind, str, str]] = field(default_factory=list)
    """What the report is to say of its making: level, element and text."""

    @property
    def name(self) -> str:
        """What links call it."""
        return self.path.stem


MOST_BLOCKS = 200_000
DEEPEST = 100  # subsystems in subsystems


_COUNTED = {
    **dict.fromkeys(("Mux", "BusCreator", "Merge"), ("Inputs", "in")),
    "Demux": ("Outputs", "out"),
}
"""The parameter in which blocks have how many ports they have, where that is left unsaid."""


ELEMENT = "Element"
"""The parameter of a port block that is one signal of a bus: the name of that, ``outer.inner`` of a bus in a bus."""


class SystemReader:
    """Reads systems, following references to those that lie in parts of their own."""

    def __init__(
        self, part: Callable[[str], Element], defaults: Mapping[str, dict[str, str]]
    ) -> None:
        """Take how the part of a referred system is found by its name, and what blocks of a type leave unsaid."""
        self._part, self._defaults = part, defaults
        self._blocks = 0

    def system(self, element: Element, depth: int = 0) -> System:
        """Return a system (raises Unreadable: it has no end)."""
        if depth > DEEPEST:
            raise Unreadable(
                message(
                    "simulink.subsystems_too_deep",
                    "nests subsystems more than {deepest} deep",
                    deepest=DEEPEST,
                )
            )
        reference = element.get("Ref")
        if reference:
            return self.system(self._part(reference), depth + 1)
        system = System()
        for child in element:
            if child.tag == "Block":
                block = self._block(child, depth)
                system.blocks[block.sid] = block
                system.signals |= {
                    Port(block.sid, "out", number): name for number, name in _named_outputs(child)
                }
            elif child.tag == "Line":
                _add_line(system, child)
        return system

    def _block(self, element: Element, depth: int) -> SimulinkBlock:
        self._blocks += 1
        if self._blocks > MOST_BLOCKS:
            raise Unreadable(
                message("simulink.too_many_blocks", "has more than {most} blocks", most=MOST_BLOCKS)
            )
        parameters = _parameters(element)
        instance = element.find("InstanceData")
        if instance is not None:
            parameters |= _parameters(instance)
        kind, source = element.get("BlockType", ""), parameters.get("SourceBlock", "")
        counts = element.find("PortCounts")
        interface = element.find("List[@ListType='InterfaceData']")
        if interface is not None:  # of a bus element port
            said = _parameters(interface)
            parameters |= {"Port": said.get("PortNumber", "1"), ELEMENT: said.get("Element", "")}
        name, side = _COUNTED.get(kind, ("", ""))
        counted = (
            {name: counts.attrib[side]} if counts is not None and side in counts.attrib else {}
        )
        block = SimulinkBlock(
            element.get("SID") or parameters.get("SID") or element.get("Name") or "", one_line(element.get("Name", "")),
            one_line(source) if kind == "Reference" else kind, linked=kind == "Reference",
            parameters={**counted, **self._defaults.get(kind, {}), **parameters},
        )  # fmt: skip
        if (inner := element.find("System")) is not None:
            block.system = self.system(inner, depth + 1)
        if (mask := element.find("Mask")) is not None:
            block.mask = read_mask(mask)
        elif (before := element.find("Object[@PropName='MaskObject']")) is not None:
            block.mask = _mask_of_object(before)
        return block


def read_defaults(element: Element | None) -> dict[str, dict[str, str]]:
    """Return the parameters that blocks of a type have where they do not say them, by type."""
    found = element.iter("Block") if element is not None else ()
    return {
        block.get("BlockType", ""): _parameters(block)
        for block in found
        if block.get("BlockType") != "SubSystem"
    }


def read_mask(element: Element) -> Mask:
    """Return a mask."""
    parameters = tuple(map(_mask_parameter, element.iterfind("MaskParameter")))
    return Mask(parameters, element.findtext("Initialization") or "")


def _mask_parameter(element: Element) -> MaskParameter:
    options, members = (
        element.find("TypeOptions"),
        element.findall("EnumerationTypeOptions/EnumerationMember"),
    )
    named = (
        options.iter("Option")
        if options is not None
        else (one.find("DescriptiveName") for one in members)
    )
    choices = tuple(one.text or "" if one is not None else "" for one in named)
    counts = tuple(member.findtext("Value") or "" for member in members)
    value, evaluated = element.findtext("Value") or "", element.get("Evaluate", "on") == "on"
    return MaskParameter(
        element.get("Name", ""), value, evaluated, element.get("Type", "edit"), choices, counts
    )


def _mask_of_object(element: Element) -> Mask:
    """Return a mask as files up to R2016 have it, as an object of objects."""
    rows = element.findall("Array[@PropName='Parameters']/Object") + element.findall(
        "Object[@PropName='Parameters']"
    )
    parameters = []
    for row in rows:
        said = _parameters(row)
        choices = tuple(cell.text or "" for cell in row.iterfind("*[@PropName='TypeOptions']/Cell"))
        evaluated, kind = said.get("Evaluate", "on") == "on", said.get("Type", "edit")
        parameters.append(
            MaskParameter(said.get("Name", ""), said.get("Value", ""), evaluated, kind, choices)
        )
    return Mask(tuple(parameters), _parameters(element).get("Initialization", ""))


def one_line(text: str) -> str:
    """Return a block's name or place as people write it: on one line."""
    return " ".join(text.split())


def _parameters(element: Element) -> dict[str, str]:
    return {
        parameter.get("Name", ""): (parameter.text or "").strip()
        for parameter in element.iterfind("P")
    }


def _named_outputs(element: Element) -> Iterator[tuple[int, str]]:
    """Give the names of signals that a block itself has for its outputs."""
    for port in (*element.iterfind("PortProperties/Port"), *element.iterfind("Port")):
        values = _parameters(port)
        number = port.get("Index") or values.get("PortNumber", "1")
        if port.get("Type", "out") == "out" and values.get("Name") and number.isdecimal():
            yield int(number), one_line(values["Name"])


def _add_line(system: System, element: Element) -> None:
    said = [(parameter.get("Name"), parameter.text or "") for parameter in element.iter("P")]
    ends = [(role, _port(text)) for role, text in said if role in ("Src", "Dst")]
    if element.get("LineType") == "Connection" or any(
        port.side in ("lconn", "rconn") for _, port in ends
    ):
        system.nets.append([port for _, port in ends])
    elif sources := [port for role, port in ends if role == "Src"]:
        system.wires.append((sources[0], [port for role, port in ends if role == "Dst"]))
        if name := _parameters(element).get("Name", ""):
            system.signals[sources[0]] = one_line(name)


def _port(text: str) -> Port:
    """Read ``50#out:1``."""
    block, _, place = text.rpartition("#")
    side, _, number = place.partition(":")
    return Port(block, side, int(number) if number.isdecimal() and len(number) < 7 else 1)
