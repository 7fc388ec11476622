"""The file of a program that is taught: written whole at every change, beside it what undo and redo need.

The program's file is what `simrob run` takes, and what its owner may edit: what was changed there is taken as taught
when it is opened, and not overwritten while it is. A file that is damaged or of another robot is kept as it is, and
what is taught goes to another one.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping
from hashlib import sha256
from itertools import count
from pathlib import Path
from typing import Any

from simrob_drake.errors import InvalidConfig, SimrobError
from simrob_drake.files import NotRead, text_of
from simrob_drake.folders import writing, written_at_once
from simrob_drake.programs.program import Program
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import station_yaml
from simrob_drake.teach.pages.words import Notice
from simrob_drake.teach.taught import MOST_LETTERS, History, Taught
from simrob_drake.yaml_files import parse_json

Fits = Callable[[Program], None]
"""Raises an error that says why a program cannot be this robot's."""

_LARGEST = 8 * MOST_LETTERS  # bytes; letters may have four, and the newest step is kept however long it is


class Store:
    """Where a program lies.

    Attributes:
        file: of the program.
        steps_file: beside it, of undo and redo.
        station_file: beside it, of the station if it has settings.
        aside: a file that was made anew, and where the old one is, which somebody has changed.
    """

    def __init__(self, file: Path, station: str, robot: str | None = None, first: Program | None = None) -> None:
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
        written_at_once(self.steps_file, f"{_digest(self._written)} {json.dumps(self._made)}\n{history.text()}")
        if self._saved is not None and self._saved[0] is program and self._saved[1] == bool(settings):
            return not self._is_changed
        if not self.write(self._present(history)):
            return False
        self._saved = program, bool(settings)
        return True

    def write(self, program: Program) -> bool:
        """Write a program into the file; tell whether that was done, and not another editor's change lost by it.

        Raises:
            OutputError: the disk does not take it.
        """
        if self._is_changed:
            return False
        text = program.text()
        written_at_once(self.file, text)
        self._written = text
        return True

    def make(self, file: Path, text: str) -> None:
        """Write a file that is made of what is taught; one that is not as it was made is put aside.

        Raises:
            OutputError: the disk does not take it.
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
        """Return what was saved, and as one more step what was changed by hand since.

        Raises:
            InvalidConfig: a damaged program.
        """
        before, steps = self._steps()
        if not self.file.exists():
            return steps or History(self._first)
        program, self._written = Program.load(self.file), text_of(self.file)
        if steps is None:
            steps = History(Taught.of(program))
        elif program != self._present(steps):
            if _digest(self._written) == before:  # the last save was stopped before it came to this file
                return steps
            steps.record(steps.present.replaced(program=Taught.of(program).program))
        self._saved = steps.present.program, bool(steps.present.settings)  # it is left alone until something changes
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

    Args:
        first: the file asked for.
        folder: where another one is begun in its place, or was the last time.
        fits: tells whether a program can be this robot's.
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
        if _loads(first):
            key, taken = "foreign", History()
    store = first.sibling(folder, new=False)
    try:
        history = store.load() if store.file.exists() else taken
        fits(history.present.program)
    except SimrobError:
        store, history = first.sibling(folder, new=True), taken
    fills = {"file": first.file.name, "new": store.file.name, "why": why}
    return store, history, Notice(key, fills, wrong=key != "taken_over")


def _loads(store: Store) -> bool:
    try:
        store.load()
    except SimrobError:
        return False
    return True


def _newest(file: Path, folder: Path) -> int:
    """Return the highest number of the files in a folder that were begun in place of one; 0 if none was."""
    pattern = re.compile(rf"{re.escape(_stem(file))}-(\d+)")
    return max((int(found[1]) for one in folder.glob("*.yaml") if (found := pattern.fullmatch(one.stem))), default=0)


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
