"""The file of a program that is taught: written whole at every change, beside it what undo and redo need.

The program's file is what `simrob run` takes, and what its owner may edit: what was changed there is taken as taught.
A file that is damaged or of another robot is kept as it is, and what is taught goes to another one.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from simrob_drake.errors import SimrobError
from simrob_drake.files import NotRead, text_of
from simrob_drake.folders import written_at_once
from simrob_drake.programs.program import Program
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import station_yaml
from simrob_drake.teach.history import MOST_LETTERS, History
from simrob_drake.teach.notices import Notice
from simrob_drake.teach.taught import Taught

Fits = Callable[[Program], None]
"""Raises an error that says why a program cannot be this robot's."""

_LARGEST = 8 * MOST_LETTERS  # bytes; letters may have four, and the newest step is kept however long it is


class Store:
    """Where a program lies.

    Attributes:
        file: of the program.
        steps_file: beside it, of undo and redo.
        station_file: beside it, of the station if it has settings.
    """

    def __init__(self, file: Path, station: str, robot: str | None = None) -> None:
        """Name the file, the station that it runs on (a name or a file), and the robot where there are several."""
        self.file, self._station, self._robot = file, station, robot
        self.steps_file = file.with_name(f".{file.stem}.steps")
        self.station_file = file.with_name(f"{file.stem}-station.yaml")
        self._written = ""  # what the file holds
        self._saved: tuple[Program, bool] | None = None
        self._saved_station: StationConfig | None = None

    def save(self, history: History, config: StationConfig) -> None:
        """Write what is taught. Whatever stops this between two files, the next :meth:`load` gives all of it.

        Raises:
            OutputError: the disk does not take it.
        """
        written_at_once(self.steps_file, f"{_digest(self._written)}\n{history.text()}")
        program, settings = history.present.program, history.present.settings
        if settings and config is not self._saved_station:
            written_at_once(self.station_file, station_yaml(config))
            self._saved_station = config
        if self._saved is not None and self._saved[0] is program and self._saved[1] == bool(settings):
            return
        text = self._present(history).text()
        written_at_once(self.file, text)
        self._written, self._saved = text, (program, bool(settings))

    def placed(self, program: Program, settings: Mapping[str, Any]) -> Program:
        """Return a program as its file has it: with the station, which lies beside it if it has settings."""
        station = self._station
        if settings:
            station = self.station_file.name
        elif os.path.isabs(station):
            station = os.path.relpath(station, self.file.parent.resolve())
        return program.model_copy(update={"station": station, "robot": self._robot})

    def load(self) -> History:
        """Return what was saved, and as one more step what was changed by hand since.

        Raises:
            InvalidConfig: a damaged program.
        """
        before, steps = self._steps()
        if not self.file.exists():
            return steps or History()
        program, self._written = Program.load(self.file), text_of(self.file)
        if steps is None:
            steps = History(Taught.of(program))
        elif program != self._present(steps):
            if _digest(self._written) == before:  # the last save was stopped before it came to this file
                return steps
            steps.record(steps.present.but(program=Taught.of(program).program))
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

    def sibling(self, folder: Path) -> Store:
        """Return the newest numbered file in a folder that was begun in place of this one; the first if none was."""
        return self._numbered(folder, max(2, _newest(self.file, folder)))

    def next(self, folder: Path) -> Store:
        """Return a numbered file that is not there yet."""
        return self._numbered(folder, max(2, _newest(self.file, folder) + 1))

    def _present(self, history: History) -> Program:
        return self.placed(history.present.program, history.present.settings)

    def _numbered(self, folder: Path, number: int) -> Store:
        return Store(folder / f"{_stem(self.file)}-{number}.yaml", self._station, self._robot)

    def _steps(self) -> tuple[str, History | None]:
        """Return the digest of the file that the last save was to replace, and the steps; None if there are none."""
        try:
            before, _, text = text_of(self.steps_file, _LARGEST).partition("\n")
        except NotRead:
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
        key, why, taken = (
            "taken_over",
            str(history.present.program.station),
            History(Taught.of(history.present.program)),
        )
    except SimrobError as problem:
        key, why, taken = "damaged", str(problem), first.last()
        if _loads(first):
            key, taken = "foreign", History()
    store = first.sibling(folder)
    try:
        history = store.load() if store.file.exists() else taken
        fits(history.present.program)
    except SimrobError:
        store, history = first.next(folder), taken
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
