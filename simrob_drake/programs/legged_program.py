"""The stored program of a legged robot: what it holds, how it is changed, and how a change is taken back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from simrob_drake.errors import InvalidParameter
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.programs.postures import postures_of, targets_on
from simrob_drake.programs.program import Move, Program, cell_of, move_of
from simrob_drake.programs.workcell import Workcell
from simrob_drake.results.state import State
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.station import Station

MOVE_TIME = 1.0
"""Time of a move unless told otherwise [s]; ``tinc`` of the thesis."""


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
    """

    def __init__(self, station: Workcell | str | Path | StationConfig | Station, robot: str | None = None) -> None:
        """Take a robot of a station; see :class:`LeggedGeometry`."""
        super().__init__(station, robot)
        self.program = Program()
        self._start = self.cell.config
        self._past: list[Snapshot] = []

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
        self._replace(self.program.removed(index))

    def edit(self, index: int, target_deg: Mapping[str, float] | None = None, duration: float | None = None) -> None:
        """Change targets or duration of a stored move; the robot stays where it is.

        Args:
            index: of the move, counted from 0; negative numbers count from the end.
            target_deg: in place of its targets [deg].
            duration: in place of its duration [s].

        Raises:
            SimrobError: as :meth:`test_move`, or no such move.
        """
        self.program.removed(index)  # there is one
        old = self.program.moves[index]
        move = move_of(
            old.target_deg if target_deg is None else target_deg, old.duration if duration is None else duration
        )
        self._replace(self.program.edited(index, move), move)

    def insert(self, index: int, target_deg: Mapping[str, float], duration: float = MOVE_TIME) -> None:
        """Put a move before the stored one of number ``index``; the robot stays where it is.

        Raises:
            SimrobError: as :meth:`test_move`, or no such place.
        """
        move = move_of(target_deg, duration)
        self._replace(self.program.inserted(index, move), move)

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
            SimrobError: a program that this robot cannot do.
        """
        program = Program.load(file)
        for cell in program.references:
            targets_on(self.model, cell.target_deg, "the reference")
        postures_of(self.model, program.moves, self.reference)
        self._replace(program)

    def _replace(self, program: Program, *moves: Move) -> None:
        postures_of(self.model, moves, self.reference)  # the robot can do them
        self._remember()
        self.program = program

    def _remember(self, snapshot: Snapshot | None = None) -> None:
        self._past.append(snapshot or self._snapshot())

    def _snapshot(self) -> Snapshot:
        return Snapshot(self.program, self.cell.state, self.cell.config)

    def _restore(self, snapshot: Snapshot) -> None:
        self.program, self.cell.state = snapshot.program, snapshot.state
        self.cell.change(snapshot.config)
