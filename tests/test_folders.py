"""Output folders: whole or not there, and nobody's work is lost when two write to the same place."""

import os
import time
from pathlib import Path

import pytest

from simrob_drake.errors import OutputError
from simrob_drake.folders import CACHE_VARIABLE, cache_entry, filled_at_once

MARKER = "summary.json"


def fill(folder: Path, text: str, *, force: bool = False, meanwhile=lambda: None) -> None:
    with filled_at_once(folder, marker=MARKER, force=force) as work:
        (work / MARKER).write_text(text)
        meanwhile()


def test_a_folder_appears_whole_with_the_permissions_that_the_user_wants(tmp_path):
    before = os.umask(0o027)
    try:
        fill(tmp_path / "runs" / "new", "1")
    finally:
        os.umask(before)
    assert (tmp_path / "runs" / "new").stat().st_mode & 0o777 == 0o750
    assert [path.name for path in tmp_path.rglob("*")] == ["runs", "new", MARKER]


def test_the_second_of_two_with_one_name_does_not_erase_the_first(tmp_path):
    folder = tmp_path / "out"
    with pytest.raises(OutputError, match=r"out exists already; .*--force"):
        fill(folder, "second", meanwhile=lambda: fill(folder, "first"))
    assert (folder / MARKER).read_text() == "first"
    assert list(tmp_path.iterdir()) == [folder]


def test_a_folder_that_comes_at_the_last_moment_is_not_erased(tmp_path, monkeypatch):
    folder, rename = tmp_path / "out", Path.rename

    def late(path, target):
        monkeypatch.setattr(Path, "rename", rename)
        fill(folder, "first")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", late)
    with pytest.raises(OutputError, match="out cannot be written: Directory not empty"):
        fill(folder, "second")
    assert (folder / MARKER).read_text() == "first"
    assert list(tmp_path.iterdir()) == [folder]


def test_force_replaces_a_result_but_nothing_that_took_its_place(tmp_path):
    folder = tmp_path / "out"
    fill(folder, "old")
    fill(folder, "new", force=True)
    assert (folder / MARKER).read_text() == "new"

    def write_a_thesis() -> None:
        (folder / MARKER).rename(folder / "thesis.tex")

    with pytest.raises(OutputError, match="something else than a result"):
        fill(folder, "newer", force=True, meanwhile=write_a_thesis)
    assert (folder / "thesis.tex").read_text() == "new"
    assert list(tmp_path.iterdir()) == [folder]


def test_what_was_there_comes_back_where_the_new_cannot_take_its_place(tmp_path, monkeypatch):
    folder, rename = tmp_path / "out", Path.rename
    fill(folder, "old")

    def faulty(path, target):
        if path.parent != tmp_path and path.name == "out":
            raise OSError(5, "Input/output error")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", faulty)
    with pytest.raises(OutputError, match="Input/output error"):
        fill(folder, "new", force=True)
    assert (folder / MARKER).read_text() == "old"
    assert list(tmp_path.iterdir()) == [folder]


def test_entries_of_a_cache_go_when_nobody_asked_for_them_in_ninety_days(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    names = [b"used", b"forgotten", b"young"]
    entries = {name: cache_entry("robots", made_of=[name], made_by=[]) for name in names}
    assert len(set(entries.values())) == 3
    for name, days in zip(names, (100, 100, 80), strict=True):
        fill(entries[name], "a robot")
        os.utime(entries[name], times=(time.time() - days * 86400,) * 2)
    assert cache_entry("robots", made_of=[b"used"], made_by=[]) == entries[b"used"]
    assert {path.name for path in entries[b"used"].parent.iterdir()} == {entries[n].name for n in (b"used", b"young")}
