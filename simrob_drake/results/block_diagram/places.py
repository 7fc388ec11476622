"""Where each system of a station's Diagram stands in its picture.

Whoever added a system to the station said in which block it stands (:meth:`simrob_drake.parts.site.Site.draw`). Of the
others some are wiring, bars or sums; what is left is a user's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from pydrake.systems.framework import LeafSystem, System
from pydrake.systems.primitives import Adder, Demultiplexer, MatrixGain, Multiplexer, PassThrough, Selector

from simrob_drake.blocks.events import EventTimes, SteadySteps
from simrob_drake.parts.captions import BlockRole, Drawn, wrapped
from simrob_drake.stations.ports import StationPorts

ROLES: tuple[BlockRole, ...] = get_args(BlockRole)
"""In the order of the signal flow."""

Shape = Literal["block", "mux", "bus", "port", "sum"]
"""Of them two are thin bars: a mux brings signals together, a bus hands them out."""

BARS: tuple[Shape, ...] = ("mux", "bus")

_SILENT = (PassThrough, Demultiplexer, EventTimes, SteadySteps)


@dataclass(frozen=True)
class Place:
    """Where a system is drawn: systems of one key share a block."""

    key: str
    role: BlockRole
    label: str = ""
    robot: str = ""  # empty for what the robots share
    shape: Shape = "block"


def place_of(name: str, system: System, ports: StationPorts) -> Place | None:
    """Return where a system is drawn, or None for wiring that is part of the arrows."""
    robot = next((r for r in ports.plant.robots.values() if name.startswith(r.prefix)), None)
    local = name if robot is None else name.removeprefix(robot.prefix)
    owner = robot.name if robot is not None and robot.prefix else ""
    said = _said(name, ports)
    if isinstance(system, _SILENT) or said is None:
        return None
    if isinstance(said, Drawn):
        return Place(said.key, said.role, said.label, said.robot)
    if _is_wire(local, system):
        return None
    bars: list[tuple[type, Shape, str]] = [(Multiplexer, "mux", ""), (Selector, "bus", ""), (Adder, "sum", "+")]
    for kind, shape, label in bars:
        if isinstance(system, kind):
            return Place(name, "servo", label, owner, shape)
    told = type(system).__name__ if type(system) is not LeafSystem else system.GetSystemType().split("::")[-1]
    return Place(name, "own", f"{wrapped(name)}\n{told}")


def _is_wire(local: str, system: System) -> bool:
    """Tell whether a system only hands values on: in a joint's row, or from one order of axes to another."""
    if isinstance(system, Multiplexer):
        return "." in local
    return isinstance(system, MatrixGain) and bool(np.isin(np.asarray(system.D()), (-1.0, 0.0, 1.0)).all())


def _said(name: str, ports: StationPorts) -> Drawn | str | None:
    """Return the block that was said to hold a system, None for wiring, and its name where nothing was said."""
    known = name
    while known not in ports.drawn:
        known, dot, _ = known.rpartition(".")
        if not dot:
            return name
    return ports.drawn[known]
