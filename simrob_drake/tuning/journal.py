"""What a folder was asked for, and its runs as they end; so what was killed goes on where it was.

A line is added for each run and goes to the disk at once.
"""

import json
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Protocol, TypeVar

import yaml

from simrob_drake.errors import InvalidConfig, OutputError
from simrob_drake.folders import alone_in, check_folder, writing, written_at_once
from simrob_drake.progress import progress_bar
from simrob_drake.tuning.engines import engine
from simrob_drake.tuning.rollout import Row
from simrob_drake.yaml_files import Strict, read_yaml, validated

_ROWS = "rows.jsonl"


class Numbered(Protocol):
    """What is to be done, under a number of its own."""

    @property
    def number(self) -> int:
        """From 1."""


Task = TypeVar("Task", bound=Numbered)


class _Kept(Strict):
    """What stands in the file of what was asked for."""

    asked: dict[str, Any]
    digest: str
    """Of the station as it was then."""


def asked_of(folder: Path, file: str) -> dict[str, Any]:
    """Return what a folder was asked for.

    Raises:
        InvalidConfig: there is none, or it is damaged.
    """
    return validated(_Kept, read_yaml(folder / file), folder / file).asked


def take(folder: Path, file: str, asked: Strict, digest: str, *, force: bool, other: Collection[str] = ()) -> bool:
    """Begin in a new folder, or go on in one that was asked for the same; return whether it is new.

    Args:
        folder: which.
        file: where in it stands what is asked for.
        asked: that.
        digest: of the station.
        force: replace what is there.
        other: keys that may have changed since.

    Raises:
        OutputError: the folder holds something else, or cannot be written.
        InvalidConfig: the station has changed since.
    """
    content, what = asked.model_dump(mode="json"), Path(file).stem
    fresh = force or not (folder / file).is_file()
    if fresh:
        check_folder(folder, marker=file, force=force)
        with writing(folder):
            (folder / _ROWS).unlink(missing_ok=True)
    else:
        found = validated(_Kept, read_yaml(folder / file), folder / file)
        if any(content.get(key) != found.asked.get(key) for key in {*content, *found.asked} - {*other}):
            raise OutputError(f"{folder} holds another {what}; choose another folder or replace it with --force")
        if found.digest != digest:
            changed = f"has changed since this {what} began; begin another, or put it back"
            raise InvalidConfig(folder / file, str(content["station"]), changed)
    kept = {"asked": content, "digest": digest}
    written_at_once(folder / file, yaml.safe_dump(kept, sort_keys=False, width=120))
    return fresh


def rows(folder: Path) -> list[Row]:
    """Return the runs that are done, in the order of their numbers."""
    try:
        lines = (folder / _ROWS).read_text(encoding="utf-8").splitlines(keepends=True)
    except FileNotFoundError:
        return []
    found = [json.loads(line) for line in lines if line.endswith("\n")]  # the last one may be torn
    return sorted(found, key=lambda row: row["number"])


def run(
    folder: Path,
    cases: Sequence[Task],
    work: Callable[[Task], Row],
    died: Callable[[Task], Row],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: bool = True,
) -> list[Row]:
    """Make the runs that are not done yet, and return the rows of all.

    Args:
        folder: where they are kept.
        cases: all runs, with their numbers.
        work: makes one, and returns its row with its number.
        died: the row of one whose process died.
        workers: how many processes of this machine; as many as it has processors unless given.
        scheduler: the address of a Dask scheduler whose workers do it instead.
        progress: show a bar.

    Raises:
        OutputError: another process is at work on them, or the disk does not take them.
        SimrobError: no such scheduler, or one that goes away.
    """
    with alone_in(folder), _opened(folder / _ROWS) as journal, engine(workers=workers, scheduler=scheduler) as engine_:
        done = {row["number"] for row in rows(folder)}
        left = [case for case in cases if case.number not in done]
        with progress_bar(f"{len(cases)} runs", len(cases), shown=progress) as move:
            for count, row in enumerate(engine_.outcomes(work, left, died), start=len(done) + 1):
                journal.write(json.dumps(row, ensure_ascii=False) + "\n")
                journal.flush()
                os.fsync(journal.fileno())
                if move:
                    move(count)
    return rows(folder)


@contextmanager
def _opened(file: Path) -> Iterator[IO[str]]:
    """Open the file of the runs to add to it, without the half of a line that a killed process left."""
    with writing(file), file.open("a+", encoding="utf-8", newline="\n") as journal:
        whole = file.read_bytes().rpartition(b"\n")
        journal.truncate(len(whole[0]) + len(whole[1]))
        yield journal
