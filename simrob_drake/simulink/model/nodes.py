"""A block where it stands in an expanded model: with its path, its workspace, and what is in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidModel
from simrob_drake.frames import Vector
from simrob_drake.importer.options import ImportReport
from simrob_drake.simulink.reading.graph import SimulinkBlock, System
from simrob_drake.simulink.values.evaluate import UndefinedVariable
from simrob_drake.simulink.values.functions import matrix
from simrob_drake.simulink.values.syntax import NotUnderstood
from simrob_drake.simulink.values.units import UnknownUnit, factor
from simrob_drake.simulink.values.workspace import Variables


@dataclass
class Findings:
    """What is found while a model is read.

    Attributes:
        report: everything, in words.
        undefined: variables that no workspace has: name, then the places that ask for it.
        assume: take the default of a block's parameter whose variable is unknown.
    """

    report: ImportReport
    undefined: dict[str, list[str]] = field(default_factory=dict)
    assume: bool = False

    def missing(self, problem: UndefinedVariable, where: str) -> None:
        """Note a variable that is not known."""
        name = problem.name if not problem.why else f"{problem.name} ({problem.why})"
        places = self.undefined.setdefault(name, [])
        if where not in places:
            places.append(where)


@dataclass(eq=False)
class Node:
    """A block of an expanded model.

    Attributes:
        path: from the model's top, ``Arm/joint_1``.
        block: as it is written.
        workspace: where its parameters' variables are found.
        findings: where problems are noted.
        parent: the subsystem it is in.
        children: what is in it, by identifier.
        system: whose lines connect these.
        home: name of the file it is written in.
    """

    path: str
    block: SimulinkBlock
    workspace: Variables
    findings: Findings
    parent: Node | None = None
    children: dict[str, Node] = field(default_factory=dict)
    system: System | None = None
    home: str = ""

    @property
    def kind(self) -> str:
        """What it is: its ``BlockType``, or the last part of its place in a library that is not at hand."""
        return self.block.kind.rpartition("/")[2] if self.block.linked else self.block.kind

    def text(self, name: str, default: str = "") -> str:
        """Return a parameter as it is written."""
        return self.block.parameters.get(name, default)

    def is_on(self, name: str) -> bool:
        """Tell whether a switch is on."""
        return self.text(name, "off") == "on"

    def value(self, name: str, default: str, unknown: str | None = None) -> Any:
        """Return a parameter's value: a matrix, text or structure.

        Where a variable is not known it is ``unknown``, or else the default.

        Raises:
            InvalidModel: it cannot be computed.
        """
        text = self.text(name, default) or default
        try:
            return self.workspace.value(text)
        except UndefinedVariable as problem:
            self.findings.missing(problem, f"{self.path}: {name}")
            if self.findings.assume:
                taken = unknown or default
                self.findings.report.add("defaulted", self.path, f"{name} = {text} is unknown: {taken} is taken")
            return self.workspace.value(unknown or default)
        except NotUnderstood as problem:
            raise self.refusal(f"{name} = {text[:60]} {problem}") from problem

    def numbers(
        self, name: str, default: str, *, unit: str = "1", size: int | None = None, unknown: str | None = None
    ) -> Vector:
        """Return a parameter as a flat vector in SI.

        Args:
            name: the parameter; its unit stands under ``<name>Units``.
            default: what counts where it is missing.
            unit: a unit of the dimension it must have.
            size: how many numbers there must be.
            unknown: what counts where a variable is not known; the default unless given.

        Raises:
            InvalidModel: another number of numbers, or a unit that does not fit.
        """
        array = self.matrix(name, default, unknown).reshape(-1)
        if size is not None and array.size != size:
            raise self.refusal(f"{name} has {array.size} numbers, not {size}")
        if not np.all(np.isfinite(array)):
            raise self.refusal(f"{name} is not finite")
        return np.asarray(array * self.unit(name, unit))

    def matrix(self, name: str, default: str, unknown: str | None = None) -> Vector:
        """Return a parameter as a matrix, as it is written.

        Raises:
            InvalidModel: it is none.
        """
        try:
            return matrix(self.value(name, default, unknown))
        except (NotUnderstood, TypeError, ValueError) as problem:
            raise self.refusal(f"{name} {problem}") from problem

    def number(self, name: str, default: str = "0", *, unit: str = "1", unknown: str | None = None) -> float:
        """Return a parameter as one number in SI."""
        return float(self.numbers(name, default, unit=unit, size=1, unknown=unknown)[0])

    def unit(self, name: str, like: str) -> float:
        """Return what a parameter's unit is in SI; SI where none is written."""
        written = self.text(f"{name}Units") or self.text(f"{name.removesuffix('s')}Units")
        try:
            return factor(written, like) if written else 1.0
        except UnknownUnit as problem:
            raise self.refusal(f"{name}: {problem}") from problem

    def lose(self, problem: InvalidModel, instead: str = "") -> None:
        """Note that what the block does to the motion is lost, and why."""
        message = str(problem).rpartition(f"{self.path}: ")[2]
        self.findings.report.add("lost", self.path, message + instead)

    def refusal(self, problem: str) -> InvalidModel:
        """Return the error for what this block cannot be."""
        return self.findings.report.refusal(self.path, problem)
