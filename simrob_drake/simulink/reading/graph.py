"""A Simulink model as it is written: systems of blocks, their parameters, masks and lines. No value is computed yet."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

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
