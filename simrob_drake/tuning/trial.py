"""One of many trials: what is run, the record that it leaves, whatever becomes of it, and its rows as tables."""

import csv
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from threading import RLock
from typing import Any

from pydantic import Field

from simrob_drake.errors import SimrobError
from simrob_drake.folders import replaced_at_once
from simrob_drake.sections import Strict

Row = dict[str, Any]  # of a table, by column
COMPLETED, REFUSED, KILLED = "completed", "refused", "killed"
"""How trials end: at their end; or never begun, their station cannot be; or with their process."""
_LARGEST = 2**63
_ALONE = RLock()  # what a process has built, the next trial uses: a Dask worker has many threads unless told


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
        rows = [plain({**columns, **more}) for columns, more in zip(self.columns, measured, strict=False)]
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
    return trial.lost(KILLED, "its process was killed, twice")


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
