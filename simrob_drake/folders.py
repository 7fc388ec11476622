"""Output folders: checked before the work, and filled at once or not at all; and the entries of our caches."""

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from simrob_drake.errors import OutputError

CACHE_VARIABLE = "XDG_CACHE_HOME"
"""The environment variable that says where caches lie; without it that is ``~/.cache``."""
_KEPT = 90 * 24 * 3600.0  # s


def cache_root() -> Path:
    """Return the folder of our caches: imported robots, and the meshes of pieces."""
    return Path(os.environ.get(CACHE_VARIABLE) or Path.home() / ".cache") / "simrob_drake"


def cache_entry(kind: str, *, made_of: Iterable[bytes], made_by: Iterable[Path]) -> Path:
    """Return the folder of a cache's entry; whether it is there yet is for the caller to see.

    Its name follows from all that the entry depends on, so that a correction of our code makes it anew. Entries that
    nobody asked for in ninety days are deleted.

    Args:
        kind: which cache.
        made_of: what the entry is made of.
        made_by: files and folders with the code that makes it.
    """
    modules = [file for place in made_by for file in sorted(place.rglob("*.py") if place.is_dir() else [place])]
    digest = hashlib.sha256()
    for content in (*made_of, *(module.read_bytes() for module in modules)):
        digest.update(hashlib.sha256(content).digest())
    entry = cache_root() / kind / digest.hexdigest()[:32]
    with suppress(OSError):  # it is not there yet, or on a disk that is only read
        os.utime(entry)
    _delete_forgotten(entry.parent)
    return entry


def _delete_forgotten(cache: Path) -> None:
    for entry in cache.glob("*"):
        with suppress(OSError):  # another process was quicker
            if time.time() - entry.stat().st_mtime > _KEPT:
                shutil.rmtree(entry, ignore_errors=True)


def check_folder(folder: Path, *, marker: str, force: bool) -> None:
    """Check, before any work, that results can be written to a folder.

    Args:
        folder: where to.
        marker: name of a file that every folder of this kind holds; only such a folder is ever replaced.
        force: replace one that is there.

    Raises:
        OutputError: it exists and is not to be replaced, is none of ours, or cannot be made.
    """
    if folder.exists():
        ours = folder.is_dir() and ((folder / marker).is_file() or not any(folder.iterdir()))
        if force and not ours:
            raise OutputError(f"{folder} holds something else than a result; it is not replaced, choose another folder")
        if not force:
            raise OutputError(f"{folder} exists already; choose another folder or replace it with --force")
    with writing(folder), tempfile.TemporaryDirectory(dir=_nearest_parent(folder)):
        pass  # trying tells more than asking for permissions


@contextmanager
def writing(target: Path) -> Iterator[None]:
    """Turn what the system says against writing a file or folder into an OutputError that names it."""
    try:
        yield
    except OSError as problem:
        why = problem.strerror or str(problem).partition("\n")[0]
        raise OutputError(f"{target} cannot be written: {why}") from problem


@contextmanager
def filled_at_once(folder: Path, *, marker: str, force: bool = False) -> Iterator[Path]:
    """Give a temporary folder that takes the name of ``folder``, and its place, once it is filled.

    What stands there by then is looked at again: it may have come, or changed, while the folder was filled.

    Args:
        folder: where to; checked as :func:`check_folder` does.
        marker: name of a file that every folder of this kind holds.
        force: replace one that is there.

    Raises:
        OutputError: the folder is not to be replaced, or the disk does not take it; nothing is left behind.
    """
    check_folder(folder, marker=marker, force=force)
    prefix, beside = f".{folder.name}-", _nearest_parent(folder)
    with writing(folder), tempfile.TemporaryDirectory(prefix=prefix, dir=beside, ignore_cleanup_errors=True) as place:
        work = Path(place) / folder.name
        work.mkdir()  # with the permissions that the user wants, which the folder around it has not
        yield work
        check_folder(folder, marker=marker, force=force)
        folder.parent.mkdir(parents=True, exist_ok=True)
        if folder.exists():
            _exchange(folder, work, aside=Path(place) / "before")
        else:
            work.rename(folder)  # fails where a folder with something in it came this moment


def _exchange(folder: Path, work: Path, *, aside: Path) -> None:
    """Put a folder in another's place, and that aside; at any time one of them is whole."""
    folder.rename(aside)
    try:
        work.rename(folder)
    except BaseException:
        aside.rename(folder)
        raise


def written_at_once(file: Path, text: str) -> None:
    """Write a text file, all of it or nothing.

    Raises:
        OutputError: the disk does not take it.
    """
    with writing(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{file.name}-", dir=file.parent) as folder:
            work = Path(folder) / file.name
            work.write_text(text, encoding="utf-8")
            work.replace(file)


def _nearest_parent(folder: Path) -> Path:
    return next(parent for parent in folder.absolute().parents if parent.exists())
