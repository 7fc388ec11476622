"""Importers of programs in the languages of robots, such as RAPID: what an extension provides for such files.

An extension announces a subclass of :class:`ProgramImporter` at the extension point ``importers`` by the suffix of the
files. ``simrob run FILE`` then runs the program, and ``simrob import FILE`` writes it as YAML.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from simrob_drake.importer.importer import Importer

# The options of commands need this module. Importing programs here would load scipy for every command.
if TYPE_CHECKING:
    from simrob_drake.programs.plan import Check
    from simrob_drake.programs.program import Program
    from simrob_drake.stations.config import StationConfig


@dataclass(frozen=True)
class ProgramRequest:
    """Request of a user for the import of a program.

    Attributes:
        config: the station on which the program is done.
        robot: robot of the station that does the program; None for the only one.
        signals: file with a table of what inputs and outputs mean; None if there is none.
        cycles: count of repetitions of an endless loop.
        check: what is checked before each move in addition to the robot's reach.
    """

    config: StationConfig
    robot: str | None
    signals: Path | None
    cycles: int
    check: Check


@dataclass(frozen=True)
class ProgramRemark:
    """A remark about a line of the file.

    Attributes:
        text: the remark, with file and line.
        is_lost: whether the line was not understood, so that the program is done without it.
    """

    text: str
    is_lost: bool


@dataclass(frozen=True)
class ImportedProgram:
    """A program that was imported.

    Attributes:
        program: the moves.
        duration: time that they take [s].
        remarks: remarks about lines of the file, in their order.
        lines: file and line of moves by their number, for messages about a run.
    """

    program: Program
    duration: float
    remarks: tuple[ProgramRemark, ...] = ()
    lines: Mapping[int, str] = field(default_factory=dict)

    @property
    def losses(self) -> list[str]:
        """Texts of the remarks about lines that were not understood."""
        # Other remarks are about lines that were understood, but mean something else here.
        return [remark.text for remark in self.remarks if remark.is_lost]


class ProgramImporter(Importer, ABC):
    """Reads a program in the language of a robot. The core then runs it, or writes it as YAML."""

    @abstractmethod
    def read_program(self, file: Path, request: ProgramRequest) -> ImportedProgram:
        """Read the program of a file. Nothing moves.

        Args:
            file: the file.
            request: station, robot and options that the user wants.

        Raises:
            SimrobError: the program cannot be understood or done; the message names the file and the line.
        """
