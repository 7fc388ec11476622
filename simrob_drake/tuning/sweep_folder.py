"""The folder of a sweep: what was asked for, each run as it ends, and in the end all of them as table and plots.

A line is added for each run and goes to the disk at once; so a sweep that was killed goes on where it was.
"""

import csv
import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import yaml

from simrob_drake.errors import InvalidConfig, OutputError
from simrob_drake.folders import alone_in, check_folder, replaced_at_once, writing, written_at_once
from simrob_drake.progress import progress_bar
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import station_yaml
from simrob_drake.tuning.engines import engine
from simrob_drake.tuning.rollout import Row, killed, rollout
from simrob_drake.tuning.sweep import Sweep
from simrob_drake.tuning.sweep_plots import save_sweep_plots
from simrob_drake.yaml_files import Strict, read_yaml, validated

SWEEP, TABLE = "sweep.yaml", "sweep.csv"
_ROWS = "rows.jsonl"


class _Asked(Strict):
    """What stands in ``sweep.yaml``."""

    sweep: Sweep
    digest: str
    """Of the station as it was when the sweep began."""


class SweepFolder:
    """A sweep and its runs, in a folder.

    Attributes:
        folder: where they stand.
        sweep: what is run.
        cases: all of its runs.
    """

    def __init__(self, folder: Path, sweep: Sweep, *, force: bool = False, allow_code: bool = False) -> None:
        """Begin a sweep in a new folder, or go on with the same one.

        Args:
            folder: where to.
            sweep: what to run.
            force: replace another sweep that is there, or the same one.
            allow_code: whether the station may name Python code.

        Raises:
            SimrobError: a sweep that cannot be.
            OutputError: the folder holds something else, or cannot be written.
            InvalidConfig: its station has changed since it began.
        """
        self.folder, self.sweep = folder, sweep
        self.cases = sweep.cases(allow_code=allow_code)
        asked = _Asked(sweep=sweep, digest=station_digest(self.cases[0].config()))
        if not force and (folder / SWEEP).is_file():
            found = _asked(folder)
            if found.sweep != sweep:
                raise OutputError(f"{folder} holds another sweep; choose another folder or replace it with --force")
            if found.digest != asked.digest:
                changed = "has changed since this sweep began; begin another, or put it back"
                raise InvalidConfig(folder / SWEEP, sweep.station, changed)
            return
        check_folder(folder, marker=SWEEP, force=force)
        with writing(folder):
            (folder / _ROWS).unlink(missing_ok=True)
        written_at_once(folder / SWEEP, yaml.safe_dump(asked.model_dump(mode="json"), sort_keys=False, width=120))

    @classmethod
    def there(cls, folder: Path, *, allow_code: bool = False) -> "SweepFolder":
        """Return the sweep that stands in a folder.

        Raises:
            InvalidConfig: there is none, it is damaged, or its station has changed since.
        """
        return cls(folder, _asked(folder).sweep, allow_code=allow_code)

    def rows(self) -> list[Row]:
        """Return the runs that are done, in the order of their numbers."""
        try:
            lines = (self.folder / _ROWS).read_text(encoding="utf-8").splitlines(keepends=True)
        except FileNotFoundError:
            return []
        found = [json.loads(line) for line in lines if line.endswith("\n")]  # the last one may be torn
        return sorted(found, key=lambda row: row["number"])

    def run(self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True) -> list[Row]:
        """Make the runs that are not done yet, write the table and the plots of all, and return the rows.

        Args:
            workers: how many processes of this machine; as many as it has processors unless given.
            scheduler: the address of a Dask scheduler whose workers do it instead.
            progress: show a bar.

        Raises:
            OutputError: another process is at work on them, or the disk does not take them.
            InvalidParameter: no such scheduler.
        """
        with (
            alone_in(self.folder),
            self._journal() as journal,
            engine(workers=workers, scheduler=scheduler) as workers_,
        ):
            done = {row["number"] for row in self.rows()}
            left = [case for case in self.cases if case.number not in done]
            with progress_bar(f"{len(self.cases)} runs", len(self.cases), shown=progress) as move:
                for count, row in enumerate(workers_.outcomes(rollout, left, killed), start=len(done) + 1):
                    journal.write(json.dumps(row, ensure_ascii=False) + "\n")
                    journal.flush()
                    os.fsync(journal.fileno())
                    if move:
                        move(count)
        rows = self.rows()
        write_rows(self.folder / TABLE, rows)
        save_sweep_plots(self.sweep, rows, self.folder / "plots")
        return rows

    @contextmanager
    def _journal(self) -> Iterator[IO[str]]:
        """Open the file of the runs to add to it, without the half of a line that a killed process left."""
        with writing(self.folder / _ROWS), (self.folder / _ROWS).open("a+", encoding="utf-8", newline="\n") as journal:
            whole = (self.folder / _ROWS).read_bytes().rpartition(b"\n")
            journal.truncate(len(whole[0]) + len(whole[1]))
            yield journal


def write_rows(file: Path, rows: list[Row]) -> None:
    """Write rows as a table with a column for whatever one of them has; what a run has not stays empty.

    Raises:
        OutputError: the disk does not take it.
    """
    columns = list(dict.fromkeys(name for row in rows for name in row if name != "message"))
    columns += ["message"] if any("message" in row for row in rows) else []
    with replaced_at_once(file) as work, work.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.DictWriter(lines, columns)
        writer.writeheader()
        writer.writerows(rows)


def _asked(folder: Path) -> _Asked:
    return validated(_Asked, read_yaml(folder / SWEEP), folder / SWEEP)


def station_digest(config: StationConfig) -> str:
    """Return a short text that is another one for another station."""
    return hashlib.sha256(station_yaml(config).encode()).hexdigest()[:16]
