"""A Simulink model as it is written, read from XML elements: blocks, parameters, masks and lines; no values yet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from simrob_drake.importer.options import EntryKind


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
    signals: dict[Port, str] = field(default_factory=dict)  # names of lines, by the ports they come from
    nets: list[list[Port]] = field(default_factory=list)  # physical lines: ports that are one node


@dataclass
class Model:
    """A model file."""

    path: Path  # the file
    kind: str  # ``Model``, ``Library`` or ``Subsystem``
    system: System  # its outermost level
    mask: Mask | None = None  # of a subsystem file as a whole
    code: str = ""  # of the model workspace, MATLAB assignments
    callbacks: dict[str, str] = field(default_factory=dict)  # names of callbacks that MATLAB would run, with their code
    stop_time: str = "10"  # when a run ends, an expression [s]
    notes: list[tuple[EntryKind, str, str]] = field(default_factory=list)
    """What the report is to say of its making: level, element and text."""

    @property
    def name(self) -> str:
        """What links call it."""
        return self.path.stem

    def count(self) -> int:
        """Return how many blocks are in it, on all levels."""
        return _count(self.system)


def _count(system: System) -> int:
    return sum(1 + (_count(block.system) if block.system else 0) for block in system.blocks.values())


MOST_BLOCKS = 200_000
DEEPEST = 100  # subsystems in subsystems


class TooManyElements(ValueError):
    """A model that refers to its own parts so often that it grows without end."""


class SystemReader:
    """Reads systems, following references to those that lie in parts of their own."""

    def __init__(self, part: Callable[[str], Element], defaults: Mapping[str, dict[str, str]]) -> None:
        """Take how the part of a referred system is found by its name, and what blocks of a type leave unsaid."""
        self._part, self._defaults = part, defaults
        self._blocks = 0

    def system(self, element: Element, depth: int = 0) -> System:
        """Return a system.

        Raises:
            TooManyElements: it has no end.
        """
        if depth > DEEPEST:
            raise TooManyElements(f"nests subsystems more than {DEEPEST} deep")
        reference = element.get("Ref")
        if reference:
            return self.system(self._part(reference), depth + 1)
        system = System()
        for child in element:
            if child.tag == "Block":
                block = self._block(child, depth)
                system.blocks[block.sid] = block
            elif child.tag == "Line":
                _add_line(system, child)
        return system

    def _block(self, element: Element, depth: int) -> SimulinkBlock:
        self._blocks += 1
        if self._blocks > MOST_BLOCKS:
            raise TooManyElements(f"has more than {MOST_BLOCKS} blocks")
        parameters = _parameters(element)
        instance = element.find("InstanceData")
        if instance is not None:
            parameters |= _parameters(instance)
        kind, source = element.get("BlockType", ""), parameters.get("SourceBlock", "")
        linked = kind == "Reference"
        inner = element.find("System")
        mask = element.find("Mask")
        return SimulinkBlock(
            sid=element.get("SID") or parameters.get("SID") or element.get("Name") or "",
            name=one_line(element.get("Name", "")),
            kind=one_line(source) if linked else kind,
            linked=linked,
            parameters={**self._defaults.get(kind, {}), **parameters},
            mask=None if mask is None else read_mask(mask),
            system=None if inner is None else self.system(inner, depth + 1),
        )


def read_defaults(element: Element | None) -> dict[str, dict[str, str]]:
    """Return the parameters that blocks of a type have where they do not say them, by type."""
    found = element.iter("Block") if element is not None else ()
    return {block.get("BlockType", ""): _parameters(block) for block in found if block.get("BlockType") != "SubSystem"}


def read_mask(element: Element) -> Mask:
    """Return a mask."""
    code = element.find("Initialization")
    return Mask(
        tuple(_mask_parameter(parameter) for parameter in element.iterfind("MaskParameter")),
        code.text or "" if code is not None else "",
    )


def _mask_parameter(element: Element) -> MaskParameter:
    options = element.find("TypeOptions")
    return MaskParameter(
        name=element.get("Name", ""),
        value=element.findtext("Value") or "",
        evaluated=element.get("Evaluate", "on") == "on",
        kind=element.get("Type", "edit"),
        choices=() if options is None else tuple(option.text or "" for option in options.iter("Option")),
    )


def one_line(text: str) -> str:
    """Return a block's name or place as people write it: on one line."""
    return " ".join(text.split())


def _parameters(element: Element) -> dict[str, str]:
    return {parameter.get("Name", ""): (parameter.text or "").strip() for parameter in element.iterfind("P")}


def _add_line(system: System, element: Element) -> None:
    ends = [
        (parameter.get("Name"), _port(parameter.text or ""))
        for parameter in element.iter("P")
        if parameter.get("Name") in ("Src", "Dst")
    ]
    physical = element.get("LineType") == "Connection" or any(port.side in ("lconn", "rconn") for _, port in ends)
    if physical:
        system.nets.append([port for _, port in ends])
        return
    sources = [port for role, port in ends if role == "Src"]
    if sources:
        system.wires.append((sources[0], [port for role, port in ends if role == "Dst"]))
        name = _parameters(element).get("Name", "")
        if name:
            system.signals[sources[0]] = one_line(name)


def _port(text: str) -> Port:
    """Read ``50#out:1``."""
    block, _, place = text.rpartition("#")
    side, _, number = place.partition(":")
    return Port(block, side, int(number) if number.isdecimal() and len(number) < 7 else 1)
