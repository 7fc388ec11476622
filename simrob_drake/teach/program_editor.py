"""What is taught, kept: in steps for undo and redo, and in its file at every change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from simrob_drake.arguments import whole
from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.programs.moves.joints import JointMove, targets_on
from simrob_drake.programs.moves.kinds import check_move
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.program import Program
from simrob_drake.programs.timeline import Change
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.sections import validated
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station
from simrob_drake.stations.resolve import resolve
from simrob_drake.teach.pages.words import Notice
from simrob_drake.teach.run_client import HandOver, MakeLive, RunClient
from simrob_drake.teach.store import Store
from simrob_drake.teach.taught import History, Taught, entries_of, with_change


class ProgramEditor(RunClient):
    """The program and what else is taught. Attributes: those of the session that tell of the program."""

    conflict = False
    _allow_code = False
    _store: Store
    _unsaved: Notice | None = None

    def __init__(self, live: MakeLive | None = None, hand_over: HandOver | None = None) -> None:
        """Begin with nothing taught."""
        super().__init__(live, hand_over)
        self.station, self.robot = "", ""
        self.config = StationConfig(name="none", robots={})
        self.file = Path()
        self._history = History()
        self._show()

    def _show(self) -> None:
        """Let attributes tell what is taught now."""
        now = self._history.present
        self.program, self.settings = now.program, dict(now.settings)
        self.pending = tuple(entries_of(now.pending))
        self.targets = {name: target.model_dump() for name, target in now.targets.items()}

    @property
    def config(self) -> StationConfig:
        """The station with its settings."""
        return self._config

    @config.setter
    def config(self, config: StationConfig) -> None:
        self._config, self._robots = config, resolve(config).robots

    def _loaded(self, settings: Mapping[str, Any]) -> StationConfig:
        """Return the station with other settings."""
        return load_station(self.station, settings, allow_code=self._allow_code)

    @property
    def model(self) -> RobotModel:
        """The robot that is taught.

        Raises:
            InvalidParameter: the station has none.
        """
        if not self.robot:
            raise InvalidParameter("station", self.config.name, "one with a robot, to teach it a move")
        return self._robots[self.robot].model

    @property
    def can_undo(self) -> bool:
        """Whether :meth:`undo` has something to take back."""
        return self._history.can_undo

    @property
    def can_redo(self) -> bool:
        """Whether :meth:`redo` has something to bring back."""
        return self._history.can_redo

    # Change the program

    def insert(self, index: int, move: Mapping[str, Any]) -> bool:
        """Put a move, as a program's file has it, before the stored one of a number; their count: at the end."""
        return self._edit(lambda program: program.inserted(index, self._within_limits(check_move(move))))

    def edit(self, index: int, move: Mapping[str, Any]) -> bool:
        """Put another move in the place of a stored one."""
        return self._edit(lambda program: program.edited(index, self._within_limits(check_move(move))))

    def remove(self, index: int) -> bool:
        """Take a stored move out."""
        return self._edit(lambda program: program.removed(index))

    def move_entry(self, index: int, to: int) -> bool:
        """Give a stored move another place."""
        return self._edit(lambda program: program.removed(index).inserted(to, program.moves[index]))

    def remove_change(self, index: int) -> bool:
        """Take one of ``program.changes`` out."""
        return self._edit(lambda program: _with(program, changes=_without(program.changes, index)))

    def edit_change(self, index: int, change: Mapping[str, Any]) -> bool:
        """Put another change in the place of one of ``program.changes``."""

        def edited(program: Program) -> Program:
            other = validated(Change, dict(change), "the change")
            return _with(program, changes=with_change(_without(program.changes, index), other))

        return self._edit(edited)

    def describe(self, text: str) -> bool:
        """Give the program its line of description."""
        return self._edit(lambda program: _with(program, description=str(text)))

    # How

    def _checked(self, move: Mapping[str, Any]) -> Move:
        """Return a move as a program's file has it; it names its robot where it can and there are several.

        Raises:
            InvalidConfig: what is no move.
        """
        made = check_move(move)
        if len(self.config.robots) > 1 and getattr(made, "robot", "") is None:
            return made.model_copy(update={"robot": self.robot})
        return made

    def _within_limits(self, move: Move) -> Move:
        """Return a move, if its axes may go where it leads them.

        Raises:
            SimrobError: no such axis, or a target beyond its limits; tells by how much.
        """
        if isinstance(move, JointMove):
            targets_on(self.model, move.target_deg, "the move", move.duration)
        return move

    def _edit(self, edited: Callable[[Program], Program]) -> bool:
        program = self._or_wrong(lambda: edited(self.program))
        if program is not None:
            self._record(self._history.present.replaced(program=program))
        return program is not None

    def _record(self, taught: Taught, label: str = "") -> None:
        self._history.record(taught, label)
        self._save()

    def _save(self) -> None:
        try:
            saved, before = self._store.save(self._history, self.config), self.conflict
            self.conflict = not saved
            if self.conflict and not before:
                self._refused("conflict", file=self.file.name)
                self._unsaved = self.message
        except SimrobError as problem:
            self._wrong(problem)
            saved, self._unsaved = False, self.message
        if saved and self.message is self._unsaved:
            self._say(Notice())
        if self._store.aside is not None:
            (file, kept), self._store.aside = self._store.aside, None
            self._say(Notice("put_aside", {"file": file.name, "kept": kept.name}))
        self._show()
        self._tell("program")

    def _refused(self, key: str, **fills: Any) -> bool:
        self._say(Notice(key, fills, wrong=True))
        return False


def _with(program: Program, **changes: Any) -> Program:
    return program.model_copy(update=changes)


def _without(changes: tuple[Change, ...], index: int) -> tuple[Change, ...]:
    place = range(len(changes))[whole(index, "index", 0, len(changes) - 1)]
    return changes[:place] + changes[place + 1 :]
