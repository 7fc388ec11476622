"""All that is taught, its history, and its file: written whole at every change, beside it what undo and redo need.

The program's file is what `simrob run` takes, and what its owner may edit: what was changed there is taken as taught
when it is opened, and not overwritten while it is. A file that is damaged or of another robot is kept as it is, and
what is taught goes to another one.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from itertools import count
from pathlib import Path
from typing import Annotated, Any, cast

from pydantic import Field, ValidationError

from simrob_drake.base.errors import InvalidConfig, SimrobError
from simrob_drake.base.files import NotRead, text_of
from simrob_drake.base.folders import writing, written_at_once
from simrob_drake.base.sections import Number, Strict
from simrob_drake.base.yaml_files import parse_json
from simrob_drake.extensions.pendant.pages.words import Notice
from simrob_drake.parts.resolved import WORLD
from simrob_drake.programs.moves.joints import JointMove
from simrob_drake.programs.moves.kinds import AnyMove
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.program import Program
from simrob_drake.programs.timeline import GRID, Change
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import station_yaml


class Target(Strict):
    """Where an arm was when it was taught."""

    axes: dict[str, Number]
    """Its posture [deg, or m of a prismatic axis]."""
    pose: Annotated[tuple[Number, ...], Field(min_length=6, max_length=6)]
    """[x y z Rz Ry Rx] of its tool centre point in a frame [m, deg]."""
    frame: str = WORLD
    """The world, or a work object."""
    tool: str = ""
    """Whose that point is."""
    robot: str = ""
    """Which arm of the station."""


class Taught(Strict):
    """All that is taught; every change gives another one."""

    program: Program = Program(grid=GRID)
    """What is stored."""
    pending: tuple[AnyMove, ...] = ()
    """What was tried since, and is neither stored nor discarded."""
    joins: bool = False
    """Whether the next tested move of axes joins the last of these."""
    changes: tuple[Change, ...] = ()
    """What was changed while it was tried."""
    targets: dict[str, Target] = Field(default_factory=dict)
    """Of an arm, by name."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """Of the station, by dotted key."""

    @classmethod
    def of(cls, program: Program) -> Taught:
        """Return what is taught by a program alone; it gets a grid if it has none."""
        return cls().replaced(program=program.model_copy(update={"grid": program.grid or GRID}))

    def replaced(self, **changes: Any) -> Taught:
        """Return it with something changed, all of it checked already."""
        return self.model_copy(update=changes)

    def with_program(self, **changes: Any) -> Taught:
        """Return it with something of the program changed, likewise."""
        return self.replaced(program=self.program.model_copy(update=changes))

    def with_tested(self, move: JointMove) -> Taught:
        """Return it with a move of axes tried: it joins the one that was tested last, if nothing came between."""
        if not self.joins:
            return self.replaced(pending=(*self.pending, move), joins=True)
        *others, last = self.pending
        targets = {**cast(JointMove, last).target_deg, **move.target_deg}
        both = move.model_copy(update={"target_deg": targets})
        return self.replaced(pending=(*others, both))

    def with_tried(self, *moves: Move) -> Taught:
        """Return it with moves tried that stand for themselves."""
        return self.replaced(pending=(*self.pending, *moves), joins=False)

    def added(self) -> Taught:
        """Return it with what was tried stored."""
        moves, changes = (
            (*self.program.moves, *self.pending),
            (*self.program.changes, *self.changes),
        )
        return self.with_program(moves=moves, changes=changes).discarded()

    def discarded(self) -> Taught:
        """Return it without what was tried."""
        return self.replaced(pending=(), joins=False, changes=())


def with_change(changes: Sequence[Change], change: Change) -> tuple[Change, ...]:
    """Return changes with another one, in order of time, in place of one of the same moment, kind and thing."""
    kept = [one for one in changes if _of(one) != _of(change)]
    return tuple(sorted([*kept, change], key=lambda one: one.time))


def _of(change: Change) -> tuple[Any, ...]:
    """Return what a change is of: a later one of the same replaces it, as a drag that has gone on."""
    things = change.push, change.drag, change.drive
    return (
        change.time,
        tuple(change.set or ()),
        *(None if one is None else (type(one), one.at) for one in things),
    )


def entries_of(moves: Sequence[Move]) -> list[dict[str, Any]]:
    """Return moves as a program's file has them."""
    return [move.entry() for move in moves]


MOST_STEPS, MOST_LETTERS = (
    200,
    2_000_000,
)  # what is kept to go back to; the oldest is forgotten first


class History:
    """What is taught now, with what undo goes back to and what redo brings back."""

    def __init__(self, taught: Taught | None = None) -> None:
        """Begin with what is taught already."""
        self._steps = [_as_step(Taught() if taught is None else taught)]
        self._at = 0
        self._label = ""

    @property
    def present(self) -> Taught:
        """What is taught now."""
        return self._steps[self._at][0]

    @property
    def can_undo(self) -> bool:
        """Whether there is something to go back to."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is something to bring back."""
        return self._at < len(self._steps) - 1

    def record(self, taught: Taught, label: str = "") -> None:
        """Take a step, if something is new; what was undone before is forgotten.

        A step with a ``label`` goes on with the last one if that had the same, as a slider that is still moved.
        """
        if taught == self.present:
            return
        keep = self._at + (0 if label and label == self._label and self._at > 0 else 1)
        self._steps[keep:] = [_as_step(taught)]
        self._at, self._label = len(self._steps) - 1, label
        letters = sum(len(text) for _, text in self._steps)
        while len(self._steps) > MOST_STEPS or (letters > MOST_LETTERS and len(self._steps) > 1):
            letters -= len(self._steps.pop(0)[1])
            self._at -= 1

    def withdraw(self) -> None:
        """Forget the last step, which came to nothing."""
        if self.can_undo:
            self.undo()
            del self._steps[self._at + 1 :]

    def undo(self) -> None:
        """Go back a step."""
        self._at, self._label = max(self._at - 1, 0), ""

    def redo(self) -> None:
        """Bring a step back."""
        self._at, self._label = min(self._at + 1, len(self._steps) - 1), ""

    def text(self) -> str:
        """Return all of it: the number of the present step, and one line for each."""
        return "\n".join([str(self._at), *(text for _, text in self._steps)]) + "\n"

    @classmethod
    def of_text(cls, text: str) -> History | None:
        """Return what :meth:`text` gave; None of anything else."""
        at, *lines = text.removesuffix("\n").split("\n")
        history = cls()
        try:
            history._steps = [(Taught.model_validate_json(line), line) for line in lines]
            history._at = range(len(lines))[int(at)]
        except (ValidationError, SimrobError, ValueError, IndexError):
            return None
        return history


def _as_step(taught: Taught) -> tuple[Taught, str]:
    return taught, taught.model_dump_json()


Fits = Callable[[Program], None]  # raises an error that says why a program cannot be this robot's

_LARGEST = (
    8 * MOST_LETTERS
)  # bytes; letters may have four, and the newest step is kept however long it is


class Store:
    """Where a program lies.

    Attributes:
        file: of the program.
        steps_file: beside it, of undo and redo.
        station_file: beside it, of the station if it has settings.
        aside: a file that was made anew, and where the old one is, which somebody has changed.
    """

    def __init__(
        self, file: Path, station: str, robot: str | None = None, first: Program | None = None
    ) -> None:
        """Name the file, the station that it runs on (a name or a file), and the robot where there are several.

        ``first`` is what is taught where there is no file yet: the program that the station carries.
        """
        self.file, self._station, self._robot = file, station, robot
        self._first = Taught() if first is None else Taught.of(first)
        self.steps_file = file.with_name(f".{file.stem}.steps")
        self.station_file = file.with_name(f"{file.stem}-station.yaml")
        self._written = ""  # what the file holds, unless another editor has changed it
        self._made: dict[str, str] = {}  # digests of other files as they were written
        self.aside: tuple[Path, Path] | None = None
        self._saved: tuple[Program, bool] | None = None
        self._saved_station: StationConfig | None = None

    def save(self, history: History, config: StationConfig) -> bool:
        """Write what is taught. Whatever stops this between two files, the next :meth:`load` gives all of it.

        Returns:
            whether the program is in its file, which is left alone if another editor has changed it.

        Raises:
            OutputError: the disk does not take it.
        """
        program, settings = history.present.program, history.present.settings
        if settings and config is not self._saved_station:
            self.make(self.station_file, station_yaml(config))
            self._saved_station = config
        written_at_once(
            self.steps_file, f"{_digest(self._written)} {json.dumps(self._made)}\n{history.text()}"
        )
        if (
            self._saved is not None
            and self._saved[0] is program
            and self._saved[1] == bool(settings)
        ):
            return not self._is_changed
        if not self.write(self._present(history)):
            return False
        self._saved = program, bool(settings)
        return True

    def write(self, program: Program) -> bool:
        """Write a program into the file; tell whether no other editor's change was lost by it; raises OutputError."""
        if self._is_changed:
            return False
        text = program.text()
        written_at_once(self.file, text)
        self._written = text
        return True

    def make(self, file: Path, text: str) -> None:
        """Write a file that is made of what is taught; one that is not as it was made is put aside.

        Raises OutputError: the disk does not take it.
        """
        digest = _digest(text)
        if file.exists() and _digest_of(file) not in (digest, self._made.get(file.name)):
            places = (file.with_stem(f"{file.stem}-edited-{number}") for number in count(1))
            kept = next(place for place in places if not place.exists())
            with writing(kept):
                file.rename(kept)
            self.aside = file, kept
        written_at_once(file, text)
        self._made[file.name] = digest

    def placed(self, program: Program, settings: Mapping[str, Any]) -> Program:
        """Return a program as its file has it: with the station, which lies beside it if it has settings."""
        station = self._station
        if settings:
            station = self.station_file.name
        elif os.path.isabs(station):
            station = os.path.relpath(station, self.file.parent.resolve())
        return program.model_copy(update={"station": station, "robot": self._robot})

    @property
    def _is_changed(self) -> bool:
        """Whether the file is another one than was read or written last; if it is gone, nothing can be lost."""
        return self.file.exists() and _digest_of(self.file) != _digest(self._written)

    def load(self) -> History:
        """Return what was saved, and as one more step changes by hand; raises InvalidConfig: a damaged program."""
        before, steps = self._steps()
        if not self.file.exists():
            return steps or History(self._first)
        program, self._written = Program.load(self.file), text_of(self.file)
        if steps is None:
            steps = History(Taught.of(program))
        elif program != self._present(steps):
            if (
                _digest(self._written) == before
            ):  # the last save was stopped before it came to this file
                return steps
            steps.record(steps.present.replaced(program=Taught.of(program).program))
        # it is left alone until something changes
        self._saved = (
            steps.present.program,
            bool(steps.present.settings),
        )
        return steps

    def last(self) -> History:
        """Return the last that was saved, whatever became of the program's file."""
        return self._steps()[1] or History()

    def is_of(self, program: Program) -> bool:
        """Tell whether a program in this file is one of this station and robot."""
        if program.robot not in (None, self._robot) and self._robot is not None:
            return False
        if program.station in (None, self._station, self.station_file.name):
            return True
        place = self.file.parent / str(program.station)
        return place.is_file() and place.resolve() == Path(self._station).resolve()

    def sibling(self, folder: Path, *, new: bool) -> Store:
        """Return the newest numbered file in a folder that was begun in place of this one, or a new one."""
        number = max(2, _newest(self.file, folder) + new)
        return Store(folder / f"{_stem(self.file)}-{number}.yaml", self._station, self._robot)

    def _present(self, history: History) -> Program:
        return self.placed(history.present.program, history.present.settings)

    def _steps(self) -> tuple[str, History | None]:
        """Return the digest of the file that the last save was to replace, and the steps; None if there are none."""
        try:
            header, _, text = text_of(self.steps_file, _LARGEST).partition("\n")
            before, _, made = header.partition(" ")
            self._made = dict(parse_json(made or "{}", self.steps_file))
        except (NotRead, InvalidConfig, ValueError, TypeError):
            return "", None
        return before, History.of_text(text)


def opened(first: Store, folder: Path, fits: Fits) -> tuple[Store, History, Notice | None]:
    """Return where a program lies, what is taught in it, and what is to be told of that.

    ``first`` is the file asked for, ``folder`` where another one is begun in its place, or was the last time; ``fits``
    tells whether a program can be this robot's.
    """
    try:
        history = first.load()
        fits(history.present.program)
        if first.is_of(history.present.program):
            return first, history, None
        key, why = "taken_over", str(history.present.program.station)
        taken = History(Taught.of(history.present.program))
    except SimrobError as problem:
        key, why, taken = "damaged", str(problem), first.last()
        with suppress(SimrobError):
            first.load()  # then it is of another robot
            key, taken = "foreign", History()
    store = first.sibling(folder, new=False)
    try:
        history = store.load() if store.file.exists() else taken
        fits(history.present.program)
    except SimrobError:
        store, history = first.sibling(folder, new=True), taken
    fills = {"file": first.file.name, "new": store.file.name, "why": why}
    return store, history, Notice(key, fills, wrong=key != "taken_over")


def _newest(file: Path, folder: Path) -> int:
    """Return the highest number of the files in a folder that were begun in place of one; 0 if none was."""
    pattern = re.compile(rf"{re.escape(_stem(file))}-(\d+)")
    return max(
        (int(found[1]) for one in folder.glob("*.yaml") if (found := pattern.fullmatch(one.stem))),
        default=0,
    )


def _stem(file: Path) -> str:
    return re.sub(r"-\d+$", "", file.stem)


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()


def _digest_of(file: Path) -> str:
    """Return the digest of a file's text; nothing of a file that has none."""
    try:
        return _digest(text_of(file, _LARGEST))
    except NotRead:
        return ""
