"""Output folders and files: checked before the work, and whole or not there; and the entries of our caches."""

import ctypes
import fcntl
import hashlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from simrob_drake.base.errors import InvalidParameter, OutputError
from simrob_drake.base.messages import join_texts, message

CACHE_VARIABLE = "XDG_CACHE_HOME"
"""The environment variable that says where caches lie; without it that is ``~/.cache``."""
_KEPT = 90 * 24 * 3600.0  # s
_WORKSHOP = ".simrob-part"  # how the hidden folders end in which work grows until it is whole
_YOUNG = 60.0  # s in which such a folder may not be locked yet
_BEFORE = "before"  # what stands there is a user's


def cache_root() -> Path:
    """Return the folder of our caches: imported robots, and the meshes of pieces."""
    return Path(os.environ.get(CACHE_VARIABLE) or Path.home() / ".cache") / "simrob_drake"


def cache_entry(kind: str, *, made_of: Iterable[bytes], made_by: Iterable[Path]) -> Path:
    """Return the folder of an entry of a ``kind`` of cache; whether it is there yet is for the caller to see.

    Its name follows from what it is made of, and from the code, files and folders, that makes it, so that a correction
    of our code makes it anew. Entries that nobody asked for in ninety days are deleted.
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


def is_cached(file: Path) -> bool:
    """Whether a file is in the cache, whose files users do not edit."""
    return file.resolve().is_relative_to(cache_root().resolve())


def _delete_forgotten(cache: Path) -> None:
    for entry in cache.glob("*"):
        with suppress(OSError):  # another process was quicker
            if time.time() - entry.stat().st_mtime > _KEPT:
                shutil.rmtree(entry, ignore_errors=True)


def check_ending(file: Path, endings: Sequence[str], name: str) -> str:
    """Check the ending of the name of a file that will be written. The ending decides the form of the file.

    Args:
        file: the file.
        endings: the endings that are possible, such as ``.xml``, in lower case.
        name: what users call the parameter or the option that the file was given as.

    Returns:
        the ending in lower case: ``WALK.PNG`` is as good as ``walk.png``.

    Raises:
        InvalidParameter: the name has another ending.
    """
    ending = file.suffix.lower()
    if ending not in endings:
        raise InvalidParameter(
            name,
            str(file),
            message(
                "base.file_ending_in",
                "a file that ends in {endings}",
                endings=join_texts(endings, message("base.or", " or ")),
            ),
        )
    return ending


def check_new_file(file: Path, *, force: bool) -> None:
    """Check, before any work, that a file may be written.

    Args:
        file: the file.
        force: whether it may replace a file that is there.

    Raises:
        OutputError: the file exists, and may not be replaced.
    """
    # os.path is used because methods of paths raise OSError for names that no file can have; such a name is refused
    # with its reason when the file is written.
    if os.path.exists(file) and not force:
        raise OutputError(
            message(
                "base.file_exists", "{file} exists already; choose another file or replace it with --force", file=file
            )
        )


def check_folder(folder: Path, *, marker: str, force: bool) -> None:
    """Check, before any work, that results can be written to a folder.

    Only a folder that holds a file called ``marker``, as each of its kind does, is ever replaced, and with ``force``.
    Raises OutputError: it exists and is not to be replaced, is none of ours, or cannot be made.
    """
    if os.path.exists(folder):  # which is false for names that no folder can have: writing tells the reason
        ours = folder.is_dir() and ((folder / marker).is_file() or not any(folder.iterdir()))
        if force and not ours:
            raise OutputError(
                message(
                    "base.no_result_folder",
                    "{folder} holds something else than a result; it is not replaced, choose another folder",
                    folder=folder,
                )
            )
        if not force:
            raise OutputError(
                message(
                    "base.folder_exists",
                    "{folder} exists already; choose another folder or replace it with --force",
                    folder=folder,
                )
            )
    with writing(folder), _workshop(_nearest_parent(folder), folder.name):
        pass  # trying tells more than asking for permissions


@contextmanager
def writing(target: Path) -> Iterator[None]:
    """Raise an OutputError with the name of a file or folder if the system cannot write it."""
    try:
        yield
    except OSError as problem:
        why = problem.strerror or str(problem).partition("\n")[0]
        raise OutputError(
            message("base.cannot_be_written", "{target} cannot be written: {why}", target=target, why=why)
        ) from None


@contextmanager
def filled_at_once(folder: Path, *, marker: str, force: bool = False) -> Iterator[Path]:
    """Give a temporary folder that takes the name of ``folder``, and its place, once it is filled.

    What stands there is checked by :func:`check_folder` before and after, as it may have come meanwhile. Raises
    OutputError: it is not to be replaced, or the disk does not take it; nothing is left behind.
    """
    check_folder(folder, marker=marker, force=force)
    with writing(folder), _workshop(_nearest_parent(folder), folder.name) as place:
        work = place / folder.name
        work.mkdir()  # with the permissions that the user wants, which the folder around it has not
        with _errors_with_target(work, folder):
            yield work
        check_folder(folder, marker=marker, force=force)
        folder.parent.mkdir(parents=True, exist_ok=True)
        if not folder.exists():
            work.rename(folder)  # fails where a folder with something in it came this moment
        elif not _swap_at_once(folder, work):
            _exchange(folder, work, aside=place / _BEFORE)


@contextmanager
def replaced_at_once(file: Path) -> Iterator[Path]:
    """Give a temporary file that takes the place of ``file`` once it is whole; a link goes on pointing at it.

    Raises OutputError: the disk does not take it; what was there stays as it was.
    """
    target = Path(os.path.realpath(file))
    with writing(file), _workshop(target.parent, target.name) as place:
        work = place / target.name
        with _errors_with_target(work, file):
            yield work
        work.replace(target)


def written_at_once(file: Path, text: str) -> None:
    """Write a text file, all of it or nothing, and the folders to it; raises OutputError: the disk does not take it."""
    with writing(file):
        file.parent.mkdir(parents=True, exist_ok=True)
    with replaced_at_once(file) as work:
        work.write_text(text, encoding="utf-8")


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Work in a folder that is there, and let no other process; raises OutputError: another one does."""
    with writing(folder):
        lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError as problem:
        raise OutputError(
            message("base.folder_in_use", "{folder}: another process is at work in it", folder=folder)
        ) from problem
    finally:
        os.close(lock)


@contextmanager
def _errors_with_target(work: Path, target: Path) -> Iterator[None]:
    """Replace the working folder in the text of errors by the folder that the user has named."""
    try:
        yield
    except OutputError as problem:
        raise OutputError(str(problem).replace(str(work), str(target))) from None


@contextmanager
def _workshop(folder: Path, name: str) -> Iterator[Path]:
    """Give a hidden folder until the work is done; what killed processes left of theirs is deleted.

    A lock, which goes with its process, tells which are still used.
    """
    _tidy(folder)
    prefix = f".{name[:100]}-"
    with tempfile.TemporaryDirectory(_WORKSHOP, prefix, folder, ignore_cleanup_errors=True) as place:
        lock = os.open(place, os.O_RDONLY)
        try:
            with suppress(OSError):  # a disk without locks: then nothing there is deleted, either
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield Path(place)
        finally:
            os.close(lock)


def _tidy(folder: Path) -> None:
    for left in folder.glob(f".*{_WORKSHOP}"):
        with suppress(OSError):  # it is used, or another process was quicker
            if time.time() - left.stat().st_mtime < _YOUNG or (left / _BEFORE).exists():
                continue
            lock = os.open(left, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(left, ignore_errors=True)
            finally:
                os.close(lock)


def _swap_at_once(folder: Path, work: Path) -> bool:
    """Exchange two folders in one step. Returns False if the system or the disk cannot do that."""
    system, first, second = ctypes.CDLL(None), os.fsencode(folder), os.fsencode(work)
    try:
        if sys.platform == "darwin":
            return int(system.renamex_np(first, second, 2)) == 0  # RENAME_SWAP
        return int(system.renameat2(-100, first, -100, second, 2)) == 0  # AT_FDCWD, RENAME_EXCHANGE
    except AttributeError:  # a C library without it
        return False


def _exchange(folder: Path, work: Path, *, aside: Path) -> None:
    """Put a folder in another's place, and that aside; at any time one of them is whole."""
    folder.rename(aside)
    try:
        work.rename(folder)
    except BaseException:
        aside.rename(folder)
        raise


def _nearest_parent(folder: Path) -> Path:
    return next(parent for parent in folder.absolute().parents if parent.exists())
