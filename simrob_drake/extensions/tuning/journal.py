"""One of many trials, whatever becomes of it; and the journal of a folder, so what was killed goes on where it was.

Each trial is a line of ``rows.jsonl``, a :class:`Record`, which goes to the disk at once.
"""

import csv
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import count
from math import isfinite
from pathlib import Path
from threading import RLock
from typing import Any, Generic, TypeVar

import yaml
from pydantic import ConfigDict, Field

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidConfig, OutputError, SimrobError
from simrob_drake.base.files import NotRead, open_regular
from simrob_drake.base.folders import (
    alone_in,
    check_folder,
    replaced_at_once,
    writing,
    written_at_once,
)
from simrob_drake.base.messages import message
from simrob_drake.base.progress import progress_bar
from simrob_drake.base.sections import Model, Number, Strict, validate_section
from simrob_drake.base.yaml_files import parse_json, read_yaml
from simrob_drake.extensions.tuning.processes import engine

Row = dict[str, Any]  # of a table, by column
COMPLETED, REFUSED, KILLED = "completed", "refused", "killed"
"""How trials end: at their end; or never begun, their station cannot be; or with their process."""
_LARGEST = 2**63
_ALONE = (
    RLock()
)  # what a process has built, the next trial uses: a Dask worker has many threads unless told


class Record(Strict):
    """What a trial came to."""

    of_any_size = True
    number: int = Field(strict=True, ge=1)
    """Of the trial."""
    rows: list[Row] = Field(min_length=1)
    """Its rows in the table."""


@dataclass(frozen=True)
class Trial(ABC):
    """One of many trials."""

    number: int  # from 1

    @property
    @abstractmethod
    def columns(self) -> list[Row]:
        """What identifies each of its rows among those of all trials."""

    @abstractmethod
    def measured(self) -> list[Row]:
        """Run it, and return the other columns of its rows: ``ended``, ``message``, and what was measured.

        Raises SimrobError: a station that cannot be run.
        """

    def record(self, measured: Sequence[Row]) -> Record:
        """Return its record, of plain values, as JSON keeps them; one that was left early has the first rows alone."""
        rows = [
            plain({**columns, **more})
            for columns, more in zip(self.columns, measured, strict=False)
        ]
        return Record(number=self.number, rows=rows)

    def lost(self, ended: str, message: str) -> Record:
        """Return its record if it never came to an end."""
        return self.record([{"ended": ended, "message": message}] * len(self.columns))


def made(trial: Trial) -> Record:
    """Make a trial, whatever becomes of it; a process makes one at a time."""
    try:
        with _ALONE:
            return trial.record(trial.measured())
    except SimrobError as problem:
        return trial.lost(REFUSED, str(problem))


def killed(trial: Trial) -> Record:
    """Return the record of a trial whose process was killed, and once more when it was alone."""
    return trial.lost(KILLED, message("tuning.process_killed", "its process was killed, twice"))


def table(records: Sequence[Record]) -> list[Row]:
    """Return the rows of all records, each with the number of its trial."""
    return [{"number": record.number, **row} for record in records for row in record.rows]


def plain(value: Any) -> Any:
    """Return a value as JSON keeps it: None for what is no finite number, a text for what it does not know."""
    match value:
        case Mapping():
            return {str(key): plain(inner) for key, inner in value.items()}
        case list() | tuple():
            return [plain(inner) for inner in value]
        case float():
            return float(value) if isfinite(value) else None
        case int() if abs(value) >= _LARGEST:
            return str(value)
        case None | str() | int():
            return value
    return str(value)


def write_rows(file: Path, rows: list[Row]) -> None:
    """Write rows as ``.csv`` and, with pyarrow, ``.parquet``, a column for all that one has; raises OutputError."""
    columns = list(dict.fromkeys(name for row in rows for name in row if name != "message"))
    columns += ["message"] if any("message" in row for row in rows) else []
    with replaced_at_once(file) as work, work.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.DictWriter(lines, columns)
        writer.writeheader()
        writer.writerows(rows)
    if find_spec("pyarrow") is not None:
        from pyarrow import parquet, table

        values = {name: _of_one_kind([row.get(name) for row in rows]) for name in columns}
        with replaced_at_once(file.with_suffix(".parquet")) as work:
            parquet.write_table(table(values), work)


def _of_one_kind(values: list[Any]) -> list[Any]:
    """Return the values of a column, whose kind Parquet keeps: numbers, truths or texts; mixed ones become texts."""
    kinds = {float if type(value) is int else type(value) for value in values if value is not None}
    if len(kinds) == 1 and kinds <= {float, bool, str}:
        return values
    return [None if value is None else str(value) for value in values]


ROWS = "rows.jsonl"
_LONGEST = 10_000_000  # bytes of a line: a map of pushes in 72 directions has some 30 thousand


class _Kept(Strict):
    """What stands in the file of what was asked for."""

    asked: dict[str, Any]
    digest: str
    """Of the station as it was then."""


class _Outcome(Strict):
    """The columns of a row that do not identify it: how its run ended, and what was measured."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Number | None]
    of_any_size = True

    ended: str
    message: str
    beyond: str = ""


def read_spec(folder: Path, file: str, model: type[Model]) -> Model:
    """Return what a folder was asked for; raises InvalidConfig: there is none, or it is damaged."""
    return validate_section(
        model, validate_section(_Kept, read_yaml(folder / file), folder / file).asked, folder / file
    )


class Journal:
    """The trials of a folder."""

    def __init__(
        self,
        folder: Path,
        file: str,
        spec: Strict,
        digest: str,
        *,
        columns: Callable[[Record], Sequence[Row]],
        force: bool = False,
        other: Collection[str] = (),
    ) -> None:
        """Begin in a new folder, or go on in one whose ``file`` asks for the same, ``other`` keys apart.

        ``columns`` gives what identifies each row of a record; none if no trial has its number. ``force`` replaces what
        is there. Raises OutputError: the folder holds something else, or cannot be written; InvalidConfig: the station
        has another digest by now, or a line of what is kept is damaged.
        """
        self.folder, self._columns = folder, columns
        content, what = spec.model_dump(mode="json"), Path(file).stem
        if force or not (folder / file).is_file():
            check_folder(folder, marker=file, force=force)
            with writing(folder):
                (folder / ROWS).unlink(missing_ok=True)
        else:
            found = validate_section(_Kept, read_yaml(folder / file), folder / file)
            asked = validate_section(type(spec), found.asked, folder / file).model_dump(mode="json")
            if any(content[key] != asked[key] for key in content.keys() - {*other}):
                raise OutputError(
                    message(
                        "tuning.holds_another",
                        "{folder} holds another {what}; choose another folder or replace it with --force",
                        folder=folder,
                        what=what,
                    )
                )
            if found.digest != digest:
                changed = message(
                    "tuning.has_changed",
                    "has changed since this {what} began; begin another, or put it back",
                    what=what,
                )
                raise InvalidConfig(folder / file, str(content["station"]), changed)
        kept = {"asked": content, "digest": digest}
        written_at_once(folder / file, yaml.safe_dump(kept, sort_keys=False, width=120))
        self.records = self.read()  # in the order of their numbers

    @contextmanager
    def adding(self) -> Iterator[Callable[[Record], None]]:
        """Give what adds a record, and let no other process do so; the half of a line that one left is cut off.

        Raises OutputError: another process is at work on them, or the disk does not take them; InvalidConfig: a line is
        damaged.
        """
        with alone_in(self.folder):
            self.records, end = self._read()
            with writing(self.folder / ROWS), (self.folder / ROWS).open("ab") as file:
                file.truncate(end)

                def add(record: Record) -> None:
                    file.write(json.dumps(record.model_dump(), ensure_ascii=False).encode() + b"\n")
                    file.flush()
                    os.fsync(file.fileno())
                    self.records.append(record)

                yield add
                self.records.sort(key=lambda record: record.number)

    def read(self) -> list[Record]:
        """Return the records that stand in it now, whoever makes them; raises InvalidConfig: a line is damaged."""
        return self._read()[0]

    def _read(self) -> tuple[list[Record], int]:
        """Return the records of all whole lines, and where the last of these ends [bytes]."""
        records, end, file = dict[int, Record](), 0, self.folder / ROWS
        if not file.exists():
            return [], end
        try:
            with open_regular(file) as lines:
                for number in count(1):
                    line = lines.readline(_LONGEST)
                    if not line.endswith(b"\n") and len(line) < _LONGEST:  # the end, or torn
                        break
                    end += len(line)
                    record = self._record(
                        line,
                        message("tuning.at_line", "{file}: line {line}", file=file, line=number),
                    )
                    if record.number in records:
                        raise InvalidConfig(
                            message(
                                "tuning.at_line", "{file}: line {line}", file=file, line=number
                            ),
                            "",
                            message(
                                "tuning.run_stands_before",
                                "run {number} stands there before",
                                number=record.number,
                            ),
                        )
                    records[record.number] = record
        except NotRead as problem:
            raise InvalidConfig(
                file,
                "",
                message("tuning.cannot_be_read", "cannot be read ({problem})", problem=problem),
            ) from problem
        except InvalidConfig as problem:
            raise InvalidConfig(
                "",
                "",
                message(
                    "tuning.delete_the_line",
                    "{problem}; delete the line, and its run is made again",
                    problem=problem,
                ),
            ) from problem
        return [records[number] for number in sorted(records)], end

    def _record(self, line: bytes, where: str) -> Record:
        try:
            text = line.decode()
        except UnicodeDecodeError as problem:
            raise InvalidConfig(
                where, "", message("tuning.no_utf8", "is no text in UTF-8")
            ) from problem
        if len(line) >= _LONGEST:
            raise InvalidConfig(
                where,
                "",
                message(
                    "tuning.longer_than", "is longer than {longest:g} MB", longest=_LONGEST / 1e6
                ),
            )
        record = validate_section(Record, parse_json(text, where), where)
        columns = self._columns(record)
        if not columns:
            raise InvalidConfig(
                where,
                message("tuning.run_number", "run {number}", number=record.number),
                message("tuning.not_asked_for", "is none of those that were asked for"),
            )
        if len(columns) != len(record.rows):
            raise InvalidConfig(
                where,
                message("tuning.run_number", "run {number}", number=record.number),
                message(
                    "tuning.rows_in_place_of",
                    "has {rows} rows in place of {columns}",
                    rows=len(record.rows),
                    columns=len(columns),
                ),
            )
        for row, own in zip(record.rows, columns, strict=True):
            others = {key: value for key, value in row.items() if key not in own}
            if {key: row[key] for key in row if key in own} != plain(own):
                raise InvalidConfig(
                    where,
                    message("tuning.run_number", "run {number}", number=record.number),
                    message(
                        "tuning.of_something_else", "is of something else than what was asked for"
                    ),
                )
            validate_section(_Outcome, others, where)
        return record


Task = TypeVar("Task", bound=Trial)


class TrialFolder(Generic[Task]):
    """Trials that are known before any is made, in a folder.

    Attributes:
        folder: where they stand.
        cases: all of them, their numbers from 1.
        journal: those that are made.
    """

    def __init__(
        self,
        folder: Path | str,
        file: str,
        spec: Strict,
        cases: Sequence[Task],
        digest: str,
        *,
        force: bool,
    ) -> None:
        """Begin in a new folder, or go on with the same trials, as :class:`Journal` does."""
        self.folder, self.cases = as_path(folder, "folder"), cases
        self.journal = Journal(self.folder, file, spec, digest, columns=self._columns, force=force)

    def _columns(self, record: Record) -> Sequence[Row]:
        return self.cases[record.number - 1].columns if record.number <= len(self.cases) else []

    def made(
        self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True
    ) -> list[Row]:
        """Make the trials that are not made yet, and return the rows of all; for the arguments see :func:`engine`.

        Raises OutputError: another process is at work on them, or the disk does not take them; SimrobError: no such
        scheduler, or one that goes away.
        """
        with self.journal.adding() as add, engine(workers=workers, scheduler=scheduler) as engine_:
            done = {record.number for record in self.journal.records}
            left, many = (
                [trial for trial in self.cases if trial.number not in done],
                len(self.cases),
            )
            with progress_bar(f"{many} runs", many, shown=progress) as move:
                for number, record in enumerate(
                    engine_.outcomes(made, left, killed), start=len(done) + 1
                ):
                    add(record)
                    if move:
                        move(number)
        return table(self.journal.records)
