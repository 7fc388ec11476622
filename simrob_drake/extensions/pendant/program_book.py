"""What is taught, kept: in steps for undo and redo, and in its file at every change."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from simrob_drake.base.arguments import whole
from simrob_drake.base.errors import InvalidParameter, SimrobError, Unsuitable, one_of
from simrob_drake.base.messages import message
from simrob_drake.base.sections import validated
from simrob_drake.extensions.pendant.pages.words import Notice
from simrob_drake.extensions.pendant.run_client import RunClient
from simrob_drake.extensions.pendant.store import (
    History,
    Store,
    Taught,
    entries_of,
    opened,
    with_change,
)
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.programs.moves.joints import JointMove, targets_on
from simrob_drake.programs.moves.kinds import check_move
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.moves.wait import PlayMove
from simrob_drake.programs.program import Program
from simrob_drake.programs.timeline import Change
from simrob_drake.programs.whole_program import carried_program
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.feedback_loops import loops_known, loops_on
from simrob_drake.stations.load import load_station
from simrob_drake.stations.resolve import resolve


class ProgramBook:
    """The program and what else is taught of a robot on a station, in a file.

    Nothing raises because of what a user does: what is wrong is told, and False returned.

    Attributes:
        station: its name or file, and ``config``: it with its settings.
        robot: the robot that is taught; empty in a station without any.
        file: of the program.
        store: where that lies, and what is made beside it.
        history: all that is taught, in steps.
        program: what is stored.
        pending: moves that were tested and not added yet, as a program's file has them.
        targets: taught targets of an arm by name.
        settings: what is changed of the station, by dotted key.
        conflict: whether another editor has changed the file since.
        known_loops: outer loops of the station without settings, by name.
        allow_code: whether the station may name Python code that is run with it.
    """

    store: Store

    def __init__(self, client: RunClient) -> None:
        """Begin with nothing taught; the client tells what changes, and what is wrong."""
        self._client = client
        self.station, self.robot = "", ""
        self.allow_code = self.conflict = False
        self.config = StationConfig(name="none", robots={})
        self.known_loops: dict[str, dict[str, Any]] = {}
        self.file = Path()
        self.history = History()
        self._unsaved: Notice | None = None
        self._show()

    def _show(self) -> None:
        """Let attributes tell what is taught now."""
        now = self.history.present
        self.program, self.settings = now.program, dict(now.settings)
        self.changes = (*now.program.changes, *now.changes)
        self.pending = tuple(entries_of(now.pending))
        self.targets = {name: target.model_dump() for name, target in now.targets.items()}

    # The station

    def use(self, station: str, robot: str | None, *, allow_code: bool) -> None:
        """Take a station, by name or file, and a robot, its first unless named; raises SimrobError: no such one."""
        self.station, self.allow_code = station, allow_code
        self.config = self.loaded({})
        self.known_loops = loops_known(self.config)
        robots = list(self.config.robots)
        self.robot = (
            one_of(message("pendant.robot", "robot"), robot, robots)
            if robot is not None
            else next(iter(robots), "")
        )

    @property
    def config(self) -> StationConfig:
        """The station with its settings."""
        return self._config

    @config.setter
    def config(self, config: StationConfig) -> None:
        self._config, self._robots = config, resolve(config).robots

    def loaded(self, settings: Mapping[str, Any]) -> StationConfig:
        """Return the station with other settings; raises SimrobError: they are none of it."""
        return load_station(self.station, settings, allow_code=self.allow_code)

    @property
    def loops(self) -> list[dict[str, Any]]:
        """Outer loops of the station, ``{name, on}``."""
        on = loops_on(self.known_loops, self.settings)
        return [{"name": name, "on": name in on} for name in self.known_loops]

    @property
    def model(self) -> RobotModel:
        """The robot that is taught; raises InvalidParameter: the station has none."""
        if not self.robot:
            raise InvalidParameter(
                "station",
                self.config.name,
                message("pendant.station_with_robot", "one with a robot, to teach it a move"),
            )
        return self._robots[self.robot].model

    @property
    def one_of_several(self) -> str | None:
        """The robot, if the program is of it alone, beside others; arms share one, whose lines say which is meant."""
        return self.robot if len(self.config.robots) > 1 and self.model.feet is not None else None

    # Change the program

    def insert(self, index: int, move: Mapping[str, Any]) -> bool:
        """Put a move, as a program's file has it, before the stored one of a number; their count: at the end."""
        return self.change(
            lambda program: program.with_inserted_move(index, self.within_limits(check_move(move)))
        )

    def edit(self, index: int, move: Mapping[str, Any]) -> bool:
        """Put another move in the place of a stored one."""
        return self.change(
            lambda program: program.with_replaced_move(index, self.within_limits(check_move(move)))
        )

    def remove(self, index: int) -> bool:
        """Take a stored move out."""
        return self.change(lambda program: program.without_move(index))

    def move_entry(self, index: int, to: int) -> bool:
        """Give a stored move another place."""
        return self.change(
            lambda program: program.without_move(index).with_inserted_move(to, program.moves[index])
        )

    def remove_change(self, index: int) -> bool:
        """Take one of ``program.changes`` out."""
        return self.change(lambda program: _with(program, changes=_without(program.changes, index)))

    def edit_change(self, index: int, change: Mapping[str, Any]) -> bool:
        """Put another change in the place of one of ``program.changes``."""

        def edited(program: Program) -> Program:
            other = validated(Change, dict(change), message("pendant.the_change", "the change"))
            return _with(program, changes=with_change(_without(program.changes, index), other))

        return self.change(edited)

    def describe(self, text: str) -> bool:
        """Give the program its line of description."""
        return self.change(lambda program: _with(program, description=str(text)))

    def change(self, edited: Callable[[Program], Program]) -> bool:
        """Store another program in the place of this."""
        program = self._client.or_wrong(lambda: edited(self.program))
        if program is not None:
            self.record(self.history.present.replaced(program=program))
        return program is not None

    def whole_program(self) -> Program:
        """Return the program; an empty one leaves the station to the references of its file."""
        if self.program.moves or self.program.references:
            return self.program
        return self.program.with_added_moves(PlayMove(duration=self.config.duration))

    def checked(self, move: Mapping[str, Any]) -> Move:
        """Return a move as a program's file has it, with its robot where that counts; raises InvalidConfig: no move."""
        made = check_move(move)
        if len(self.config.robots) > 1 and getattr(made, "robot", "") is None:
            return made.model_copy(update={"robot": self.robot})
        return made

    def within_limits(self, move: Move) -> Move:
        """Check a move before it is tried, and return it.

        Raises:
            SimrobError: a joint does not exist, its target is beyond its limits, or a controller overrules the move.
        """
        if isinstance(move, JointMove):
            loop = self.overruling_loop()
            if loop:
                raise Unsuitable(
                    ", ".join(move.target_deg),
                    message(
                        "pendant.loop_overrules",
                        "controllers.{loop} sets all joints of the robot, so that a move of joints has no effect",
                        loop=loop,
                    ),
                    message(
                        "pendant.turn_loop_off",
                        "drive it by its commands, or turn it off under Outer loops",
                    ),
                )
            targets_on(
                self.model, move.target_deg, message("pendant.the_move", "the move"), move.duration
            )
        return move

    def overruling_loop(self) -> str:
        """Name of the outer loop that overrules moves of the robot's joints, such as a walk. Empty if none does."""
        for name, section in self.config.controllers.items():
            overrules = isinstance(section, LoopSection) and section.overrules_reference
            if overrules and section.robot in (None, self.robot):
                return name
        return ""

    # The file

    def load(self, file: Path, folder: Path) -> None:
        """Take what is taught in a file, or in another one of the folder where that cannot be."""
        first = Store(file, self.station, self.one_of_several, carried_program(self.config))
        self.store, self.history, notice = opened(first, folder, self._fits)
        self.file = self.store.file
        try:
            if settings := self.history.present.settings:
                self.config = self.loaded(settings)
        except SimrobError as problem:  # of a station whose file has changed
            self._client.wrong(problem)
            self.history.record(self.history.present.replaced(settings={}))
        self.save()
        if notice is not None:
            self._client.say(notice)

    def keep_both(self, folder: Path) -> bool:
        """Leave a file that another editor has changed as it is; what is taught goes to another one of the folder."""
        if not self.conflict:
            return False
        theirs, self.store = self.file.name, self.store.sibling(folder, new=True)
        self.file = self.store.file
        self.save()
        self._client.say(Notice("both_kept", {"file": theirs, "new": self.file.name}))
        return True

    def record(self, taught: Taught, label: str = "") -> None:
        """Take a step of what is taught, as :meth:`History.record`, and save it."""
        self.history.record(taught, label)
        self.save()

    def save(self) -> None:
        """Write what is taught; what hinders that is told."""
        client = self._client
        try:
            saved, before = self.store.save(self.history, self.config), self.conflict
            self.conflict = not saved
            if self.conflict and not before:
                client.refuse("conflict", file=self.file.name)
                self._unsaved = client.message
        except SimrobError as problem:
            client.wrong(problem)
            saved, self._unsaved = False, client.message
        if saved and client.message is self._unsaved:
            client.say(Notice())
        if self.store.aside is not None:
            (file, kept), self.store.aside = self.store.aside, None
            client.say(Notice("put_aside", {"file": file.name, "kept": kept.name}))
        self._show()
        client.tell("program")

    def _fits(self, program: Program) -> None:
        """Check that a program can be this robot's; raises SimrobError: it has axes or moves that the robot has not."""
        for move in program.moves:
            self.within_limits(move)
            if not (move.of_arms if self.model.feet is None else move.of_legs):
                raise InvalidParameter(
                    "move",
                    move.key,
                    message("pendant.one_of_model", "one of {model}", model=self.model.name),
                )


def _with(program: Program, **changes: Any) -> Program:
    return program.model_copy(update=changes)


def _without(changes: tuple[Change, ...], index: int) -> tuple[Change, ...]:
    place = range(len(changes))[whole(index, "index", 0, len(changes) - 1)]
    return changes[:place] + changes[place + 1 :]
