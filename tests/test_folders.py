"""Output folders: whole or not there, and nobody's work is lost when two write to the same place."""

import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from threading import Event, Thread

import pytest

from simrob_drake.base import folders
from simrob_drake.base.errors import OutputError
from simrob_drake.base.folders import (
    CACHE_VARIABLE,
    cache_entry,
    filled_at_once,
    free_path,
    replaced_at_once,
    writing,
)
from simrob_drake.base.messages import in_language

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


@pytest.mark.parametrize("manager", [replaced_at_once, partial(filled_at_once, marker=MARKER)])
def test_an_error_names_the_target_in_other_languages_too(tmp_path, manager):
    target = tmp_path / "out"

    with pytest.raises(OutputError) as raised, manager(target) as work, writing(work):
        raise OSError(28, "No space left on device")
    assert raised.value.message == f"{target} cannot be written: No space left on device"
    assert in_language(raised.value.message, "es").startswith(f"no se puede escribir {target}: ")


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

    with pytest.raises(OutputError, match="contains files that are not a result"):
        fill(folder, "newer", force=True, meanwhile=write_a_thesis)
    assert (folder / "thesis.tex").read_text() == "new"
    assert list(tmp_path.iterdir()) == [folder]


def test_what_was_there_comes_back_where_the_new_cannot_take_its_place(tmp_path, monkeypatch):
    folder, rename = tmp_path / "out", Path.rename
    fill(folder, "old")
    monkeypatch.setattr(folders, "_swap_at_once", lambda *_: False)  # a disk that cannot

    def faulty(path, target):
        if path.parent != tmp_path and path.name == "out":
            raise OSError(5, "Input/output error")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", faulty)
    with pytest.raises(OutputError, match="Input/output error"):
        fill(folder, "new", force=True)
    assert (folder / MARKER).read_text() == "old"
    assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.long
def test_a_result_that_is_replaced_is_there_all_the_time(tmp_path):
    folder, seen, done = tmp_path / "out", [], Event()
    fill(folder, "0")

    def watch():
        while not done.is_set():
            seen.append((folder / MARKER).exists())

    watching = Thread(target=watch)
    watching.start()
    for number in range(100):
        fill(folder, str(number), force=True)
    done.set()
    watching.join()
    assert (folder / MARKER).read_text() == "99"
    assert list(tmp_path.iterdir()) == [folder]
    assert all(seen)


KILLED = """
import os, signal
from pathlib import Path
from simrob_drake.base.folders import filled_at_once
with filled_at_once(Path("out"), marker="summary.json", force=True) as work:
    (work / "half").write_text("done")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_process_left_goes_with_the_next_save(tmp_path, monkeypatch):
    subprocess.run([sys.executable, "-c", KILLED], cwd=tmp_path, check=False)
    (left,) = tmp_path.iterdir()
    users = [tmp_path / ".git", tmp_path / ".out-12345678", tmp_path / ".mine.simrob-part"]
    for folder in users[:2]:
        folder.mkdir()
    users[2].write_text("a file")

    fill(tmp_path / "young", "1")

    assert left.exists()  # it may be at work

    monkeypatch.setattr(folders, "_LOCKING_TIME", -1.0)
    fill(tmp_path / "second", "2")

    assert {path.name for path in tmp_path.iterdir()} == {
        "young",
        "second",
        *(user.name for user in users),
    }


def test_what_another_still_fills_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "_LOCKING_TIME", -1.0)
    fill(tmp_path / "out", "first", meanwhile=lambda: fill(tmp_path / "other", "second"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other", "out"]


def test_an_old_result_that_was_put_aside_is_not_deleted(tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "_LOCKING_TIME", -1.0)
    aside = tmp_path / ".out-abc.simrob-part" / "before"
    aside.mkdir(parents=True)

    fill(tmp_path / "out", "new")

    assert aside.is_dir()


def test_an_error_names_what_the_user_gave(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = Path("runs", "r")

    with (
        pytest.raises(OutputError) as raised,
        filled_at_once(folder, marker=MARKER) as work,
        folders.writing(work / "plots"),
    ):
        raise OSError(28, "No space left on device")
    assert str(raised.value) == "runs/r/plots cannot be written: No space left on device"
    with (
        pytest.raises(OutputError) as raised,
        replaced_at_once(Path("a.png")) as work,
        folders.writing(work),
    ):
        raise OSError(28, "No space left on device")
    assert str(raised.value) == "a.png cannot be written: No space left on device"


def test_a_file_is_replaced_when_it_is_whole(tmp_path):
    file, link = tmp_path / "a.svg", tmp_path / "link.svg"
    file.write_text("good")
    link.symlink_to(file)

    def fail():
        with replaced_at_once(file) as work:
            work.write_text("ba")
            raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match=r"a\.svg cannot be written: No space"):
        fail()
    assert file.read_text() == "good"
    with replaced_at_once(link) as work:
        work.write_text("better")
    assert link.is_symlink()
    assert file.read_text() == "better"
    assert sorted(tmp_path.iterdir()) == [file, link]


def test_entries_of_a_cache_go_when_nobody_asked_for_them_in_ninety_days(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    names = [b"used", b"forgotten", b"young"]

    entries = {name: cache_entry("robots", made_of=[name], made_by=[]) for name in names}

    assert len(set(entries.values())) == 3

    for name, days in zip(names, (100, 100, 80), strict=True):
        fill(entries[name], "a robot")
        os.utime(entries[name], times=(time.time() - days * 86400,) * 2)
    assert cache_entry("robots", made_of=[b"used"], made_by=[]) == entries[b"used"]
    assert {path.name for path in entries[b"used"].parent.iterdir()} == {
        entries[n].name for n in (b"used", b"young")
    }


def test_the_number_of_a_folder_is_at_its_end_and_that_of_a_file_before_the_ending(tmp_path):
    (tmp_path / "plot.png").touch()
    (tmp_path / "arm.v2-2026").mkdir()

    assert free_path(tmp_path / "plot.png").name == "plot-2.png"
    assert free_path(tmp_path / "arm.v2-2026", is_folder=True).name == "arm.v2-2026-2"
    assert free_path(tmp_path / "other.v2", is_folder=True).name == "other.v2"
