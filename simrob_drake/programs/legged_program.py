"""The stored program of a legged robot: what it holds, how it is changed, and how a change is taken back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simrob_drake.errors import InvalidParameter
from simrob_drake.programs.given_moves import any_move, cell_of
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.programs.legged_parts import parts_of
from simrob_drake.programs.moves import MOVE_TIME, AnyMove, Move
from simrob_drake.programs.postures import targets_on
from simrob_drake.programs.program import Program, counted
from simrob_drake.programs.workcell import Workcell
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.station import StationLike


@dataclass(frozen=True)
class Snapshot:
    """What :meth:`Programmed.undo` goes back to."""

    program: Program
    state: State | None
    config: StationConfig


class Programmed(LeggedGeometry):
    """A robot with a program. Changes of the program move nothing.

    Attributes of :class:`LeggedGeometry`, and:
        program: the moves and cells that are stored.
        runs: what the last move or program was made of, in order.
    """

    def __init__(self, station: Workcell | StationLike, robot: str | None = None) -> None:
        """Take a robot of a station; see :class:`LeggedGeometry`."""
        super().__init__(station, robot)
        self.program = Program()
        self._start = self.cell.config
        self.runs: list[SimulationResult] = []
        self._past: list[Snapshot] = []

    def _described(self) -> list[str]:
        feet = [] if self.worn_feet is None else [f"feet {self.worn_feet}"]
        return [*super()._described(), *feet, f"program of {counted(len(self.program.moves), 'move')}"]

    def add_reference(self, target_deg: Mapping[str, float]) -> None:
        """Store targets without a time as a cell for a sequencer, which decides when to go on (AddRef).

        Arguments and errors are those of :meth:`test_move`; nothing moves.
        """
        cell = cell_of(target_deg)
        targets_on(self.model, cell.target_deg, "the reference")
        self._remember()
        self.program = self.program.with_reference(cell)

    @property
    def cells(self) -> list[dict[int, float]]:
        """The stored references as a sequencer takes them: the place of each axis, and its target [rad]."""
        return [targets_on(self.model, cell.target_deg, "the reference") for cell in self.program.references]

    def remove(self, index: int = -1) -> None:
        """Take a stored move out of the program, the last unless given; the robot stays where it is.

        Raises:
            InvalidParameter: no such move.
        """
        program = self.program.removed(index)
        self._remember()
        self.program = program

    def edit(self, index: int, move: AnyMove | Mapping[str, Any] | None = None, duration: float | None = None) -> None:
        """Change a stored move; the robot stays where it is.

        Args:
            index: of the move, counted from 0; negative numbers count from the end.
            move: in place of its targets [deg], or of the whole move: as :meth:`insert` takes it.
            duration: in place of the duration [s] of a move of joints.

        Raises:
            SimrobError: as :meth:`insert`, or no such move.
        """
        self.program.removed(index)  # there is one
        old = self.program.moves[index]
        before = (old.target_deg, old.duration) if isinstance(old, Move) else (old, MOVE_TIME)
        new = any_move(before[0] if move is None else move, duration, otherwise=before[1])
        self._replace(self.program.edited(index, new))

    def insert(self, index: int, move: AnyMove | Mapping[str, Any], duration: float | None = None) -> None:
        """Put a move before the stored one of number ``index``; the robot stays where it is.

        Args:
            index: counted from 0; negative numbers count from the end.
            move: targets [deg] by axis, or what stands in a program's file, such as ``{"walk": {"steps": 4}}``,
                ``{"act": "bow"}`` or ``{"attach": "parcel"}``.
            duration: of a move of joints [s]; 1 unless given.

        Raises:
            SimrobError: no such place, a move that is wrong, or a program that the robot cannot do from its start.
        """
        self._replace(self.program.inserted(index, any_move(move, duration)))

    def undo(self) -> None:
        """Take back the last thing that was done, a test, a run or a change of the program: robot and program.

        Raises:
            InvalidParameter: nothing was done.
        """
        if not self._past:
            raise InvalidParameter("undo", "asked for before anything was done", "called after a move or a change")
        self._restore(self._past.pop())

    def save(self, file: Path | str) -> Path:
        """Write the program as YAML; see :meth:`Program.save`."""
        return self.program.save(file)

    def load(self, file: Path | str) -> None:
        """Take the program of a YAML file in place of the stored one; the robot stays where it is.

        Raises:
            InvalidConfig: a damaged file.
            SimrobError: a program that this robot cannot do; names the file and the move.
        """
        program = Program.load(file)
        for number, cell in enumerate(program.references):
            targets_on(self.model, cell.target_deg, f"{file}: references[{number}]")
        self._replace(program, str(file))

    def _replace(self, program: Program, file: str = "") -> None:
        parts_of(self, program.moves, self._start, file)  # the robot can do them
        self._remember()
        self.program = program

    def _remember(self, snapshot: Snapshot | None = None) -> None:
        self._past.append(snapshot or self._snapshot())

    def _snapshot(self) -> Snapshot:
        return Snapshot(self.program, self.cell.state, self.cell.config)

    def _restore(self, snapshot: Snapshot) -> None:
        self.program, self.cell.state = snapshot.program, snapshot.state
        self.cell.change(snapshot.config)
