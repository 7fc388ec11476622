"""A Simulink model as it is written, read from XML elements: blocks, parameters, masks and lines; no values yet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from simrob_drake.importer.options import EntryKind


class Port(NamedTuple):
    """A port of a block within its system.

    Attributes:
        block: the block's identifier in its system (SID).
        side: ``in``, ``out``, ``lconn`` or ``rconn`` (physical, left and right), or ``enable``, ``trigger`` ...
        number: from 1.
    """

    block: str
    side: str
    number: int


@dataclass(frozen=True)
class MaskParameter:
    """A parameter of a mask.

    Attributes:
        name, value: its variable, and the expression that gives its value.
        evaluated: whether the value is an expression, or text as it stands.
        kind: of its field: ``edit``, ``popup``, ``checkbox`` ...
    """

    name: str
    value: str
    evaluated: bool = True
    kind: str = "edit"
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Mask:
    """The parameters of a masked block, and the code that MATLAB would run before it."""

    parameters: tuple[MaskParameter, ...] = ()
    code: str = ""


@dataclass
class SimulinkBlock:
    """A block.

    Attributes:
        sid, name: identifier in its system, and name on one line.
        kind: its ``BlockType``, or for a link into a library its source, such as ``sm_lib/Joints/Revolute Joint``.
        linked: whether ``kind`` is a place in a library.
        parameters: as they are written.
        mask: of its own.
        system: what is in a subsystem.
    """

    sid: str
    name: str
    kind: str
    linked: bool = False
    parameters: dict[str, str] = field(default_factory=dict)
    mask: Mask | None = None
    system: System | None = None

    @property
    def commented(self) -> str:
        """``on``: out of the model; ``through``: replaced by a wire; ``off``."""
        return self.parameters.get("Commented", "off")


@dataclass
class System:
    """The blocks of one level, and the lines between them.

    Attributes:
        blocks: by identifier.
        wires: signal lines, from an ``out`` port to the ports it feeds.
        signals: names of lines, by the ports they come from.
        nets: physical lines: ports that are one node.
    """

    blocks: dict[str, SimulinkBlock] = field(default_factory=dict)
    wires: list[tuple[Port, list[Port]]] = field(default_factory=list)
    signals: dict[Port, str] = field(default_factory=dict)
    nets: list[list[Port]] = field(default_factory=list)


@dataclass
class Model:
    """A model file.

    Attributes:
        path: the file.
        kind: ``Model``, ``Library`` or ``Subsystem``.
        system: its outermost level.
        mask: of a subsystem file as a whole.
        code: of the model workspace, MATLAB assignments.
        callbacks: names of callbacks that MATLAB would run, with their code.
        stop_time: when a run ends, an expression [s].
        notes: what the report is to say of its making: level, element and text.
    """

    path: Path
    kind: str
    system: System
    mask: Mask | None = None
    code: str = ""
    callbacks: dict[str, str] = field(default_factory=dict)
    stop_time: str = "10"
    notes: list[tuple[EntryKind, str, str]] = field(default_factory=list)

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
