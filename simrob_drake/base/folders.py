"""Output files and folders that appear complete or not at all, and the folders of this package's caches.

Work is done in a hidden *workshop*, a folder next to the target. The result is moved to its place when it is complete.
A folder of results contains a *marker*, a file that each result of its kind has, such as ``summary.json``. Only folders
with their marker are ever replaced, so that a wrong path on a command line deletes nothing of the user's.
"""

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
from simrob_drake.base.messages import join_texts, message, replace_text

CACHE_VARIABLE = "XDG_CACHE_HOME"
"""Environment variable with the folder of all programs' caches. If it is not set, that is ``~/.cache``."""

_LIFE_OF_ENTRIES = 90 * 24 * 3600.0
"""Time after which an unused entry of a cache is deleted [s]."""

_WORKSHOP = ".simrob-part"
"""End of the names of workshops."""

_LOCKING_TIME = 60.0
"""Age below which a workshop without a lock is not deleted [s]: its process may not have locked it yet."""

_BEFORE = "before"
"""Name of the former result in a workshop, while a new one takes its place. It belongs to the user: a workshop with it
is never deleted."""


def cache_root() -> Path:
    """Folder of this package's caches: of imported robots, and of the meshes of pieces."""
    caches = os.environ.get(CACHE_VARIABLE) or Path.home() / ".cache"
    return Path(caches) / "simrob_drake"


def cache_entry(kind: str, *, made_of: Iterable[bytes], made_by: Iterable[Path]) -> Path:
    """Path of an entry of a cache, which may not exist yet. Entries that were not used for ninety days are deleted.

    The name of an entry is a digest of its sources and of the code that makes it, so that a correction of the code
    makes a new entry.

    Args:
        kind: name of the cache.
        made_of: contents of the sources.
        made_by: modules that make the entry, or folders with these modules.
    """
    modules: list[Path] = []
    for place in made_by:
        modules += sorted(place.rglob("*.py")) if place.is_dir() else [place]
    contents = [*made_of, *(module.read_bytes() for module in modules)]
    digest = hashlib.sha256()
    for content in contents:
        # Digests of equal length, so that the borders between the contents count.
        digest.update(hashlib.sha256(content).digest())
    entry = cache_root() / kind / digest.hexdigest()[:32]
    # The time of the last change serves as the time of the last use. The entry may not exist yet, or the disk may be
    # read-only.
    with suppress(OSError):
        os.utime(entry)
    _delete_unused(entry.parent)
    return entry


def is_cached(file: Path) -> bool:
    """Whether a file is in a cache of this package, so that the user does not edit it."""
    return file.resolve().is_relative_to(cache_root().resolve())


def _delete_unused(cache: Path) -> None:
    """Delete the entries of a cache that were not used for a long time."""
    for entry in cache.glob("*"):
        # Another process may delete the entry at the same time.
        with suppress(OSError):
            unused_time = time.time() - entry.stat().st_mtime
            if unused_time > _LIFE_OF_ENTRIES:
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
                "base.file_exists",
                "{file} exists already; choose another file or replace it with --force, in Python force=True",
                file=file,
            )
        )


def free_path(path: Path, *, is_folder: bool = False) -> Path:
    """Find a path that does not exist: the given one, or one with a number, such as ``plot-2.png``.

    The number of a file stands before its ending. What follows a point in the name of a folder is no ending.

    Raises:
        OutputError: all numbers up to 999 are taken.
    """
    ending = "" if is_folder else path.suffix
    stem = path.name.removesuffix(ending)
    numbered = (path.with_name(f"{stem}-{number}{ending}") for number in range(2, 1000))
    free = next((one for one in (path, *numbered) if not os.path.exists(one)), None)
    if free is None:
        raise OutputError(
            message(
                "base.numbers_taken",
                "{path} exists already, and so do those with numbers up to 999",
                path=path,
            )
        )
    return free


def check_folder(folder: Path, *, marker: str, force: bool) -> None:
    """Check, before any work, that results can be written to a folder.

    Args:
        folder: the folder.
        marker: name of the file that each result of this kind has.
        force: whether a former result in the folder may be replaced.

    Raises:
        OutputError: the folder exists without `force`; or with it, and is neither empty nor has the marker; or it
            cannot be made.
    """
    # os.path.exists is false for names that no folder can have. These are refused with their reason below.
    if os.path.exists(folder):
        # An empty folder holds nothing of the user's, so it may be replaced like a former result.
        is_replaceable = folder.is_dir() and (
            (folder / marker).is_file() or not any(folder.iterdir())
        )
        if force and not is_replaceable:
            raise OutputError(
                message(
                    "base.no_result_folder",
                    "{folder} contains files that are not a result, and is not replaced; choose another folder",
                    folder=folder,
                )
            )
        if not force:
            raise OutputError(
                message(
                    "base.folder_exists",
                    "{folder} exists already; choose another folder or replace it with --force, in Python force=True",
                    folder=folder,
                )
            )
    # Permissions do not tell whether a disk is full or read-only, so that a workshop is made on trial.
    with writing(folder), _workshop(_nearest_parent(folder), folder.name):
        pass


@contextmanager
def writing(target: Path) -> Iterator[None]:
    """Raise an OutputError with the name of a file or folder if the system cannot write it."""
    try:
        yield
    except OSError as problem:
        # Errors of libraries have no strerror, and may have several lines.
        why = problem.strerror or str(problem).partition("\n")[0]
        raise OutputError(
            message(
                "base.cannot_be_written",
                "{target} cannot be written: {why}",
                target=target,
                why=why,
            )
        ) from None


@contextmanager
def filled_at_once(folder: Path, *, marker: str, force: bool = False) -> Iterator[Path]:
    """Context manager with a temporary folder, which gets the name of the target when its body is done.

    If the body fails, nothing is left behind, and a former result stays.

    Args:
        folder: the target.
        marker: name of the file that each result of this kind has.
        force: whether a former result in the target is replaced.

    Raises:
        OutputError: the target may not be replaced, see :func:`check_folder`, or cannot be written.
    """
    check_folder(folder, marker=marker, force=force)
    with writing(folder), _workshop(_nearest_parent(folder), folder.name) as workshop:
        work = workshop / folder.name
        # A folder inside of the workshop: it has the user's usual permissions, and the workshop has stricter ones.
        work.mkdir()
        with _errors_with_target(work, folder):
            yield work
        # The check is repeated: while the body was at work, the user may have made something at this path.
        check_folder(folder, marker=marker, force=force)
        folder.parent.mkdir(parents=True, exist_ok=True)
        if not folder.exists():
            # This fails if another process has made the folder and filled it at this moment.
            work.rename(folder)
        elif not _swap_at_once(folder, work):
            _exchange(folder, work, aside=workshop / _BEFORE)


@contextmanager
def replaced_at_once(file: Path) -> Iterator[Path]:
    """Context manager with a temporary file, which replaces the target when its body is done.

    If the target is a symbolic link, the file that it points to is replaced. If the body fails, the former file stays.

    Raises:
        OutputError: the target cannot be written.
    """
    # Renaming onto a symbolic link would replace the link itself.
    target = Path(os.path.realpath(file))
    with writing(file), _workshop(target.parent, target.name) as workshop:
        work = workshop / target.name
        with _errors_with_target(work, file):
            yield work
        # Within one folder, the system replaces a file in one step: a reader sees the former content or the new one.
        work.replace(target)


def written_at_once(file: Path, text: str) -> None:
    """Write a text file, all of it or nothing. Missing folders are made.

    Raises:
        OutputError: the file cannot be written.
    """
    with writing(file):
        file.parent.mkdir(parents=True, exist_ok=True)
    with replaced_at_once(file) as work:
        work.write_text(text, encoding="utf-8")


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Context manager that locks a folder against all others that lock it by this function, in any process.

    Raises:
        OutputError: the folder is locked already, or there is no such folder.
    """
    with writing(folder):
        # The lock belongs to the open descriptor. If the process is killed, the system closes it and the lock is gone.
        lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError as problem:
        raise OutputError(
            message(
                "base.folder_in_use",
                "{folder}: another process is using this folder",
                folder=folder,
            )
        ) from problem
    finally:
        os.close(lock)


@contextmanager
def _errors_with_target(work: Path, target: Path) -> Iterator[None]:
    """Context manager that names the user's target in the messages of an OutputError, instead of the temporary path.

    Args:
        work: the temporary file or folder.
        target: the file or folder that the user has named.
    """
    try:
        yield
    except OutputError as problem:
        raise OutputError(replace_text(problem.message, str(work), str(target))) from None


@contextmanager
def _workshop(folder: Path, name: str) -> Iterator[Path]:
    """Context manager with a new workshop, which is deleted at the end. Abandoned workshops are deleted before.

    The workshop is locked while its process lives, so that other processes see that it is in use.

    Args:
        folder: the folder in which the workshop is made.
        name: name of the target, with which the name of the workshop begins.
    """
    _delete_abandoned_workshops(folder)
    # File systems allow names of 255 bytes, to which the random part and the ending are added.
    prefix = f".{name[:100]}-"
    with tempfile.TemporaryDirectory(
        _WORKSHOP, prefix, folder, ignore_cleanup_errors=True
    ) as workshop:
        lock = os.open(workshop, os.O_RDONLY)
        try:
            # On a disk without locks, no other process can lock a workshop, and so none deletes it.
            with suppress(OSError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield Path(workshop)
        finally:
            os.close(lock)


def _delete_abandoned_workshops(folder: Path) -> None:
    """Delete the workshops in a folder whose processes were killed. A process that ends releases its locks.

    A workshop that changed in the last minute stays, and one with a former result, which belongs to the user.
    """
    for workshop in folder.glob(f".*{_WORKSHOP}"):
        # An error means that the workshop is locked, is no folder, or was deleted by another process.
        with suppress(OSError):
            age = time.time() - workshop.stat().st_mtime
            has_former_result = (workshop / _BEFORE).exists()
            if age < _LOCKING_TIME or has_former_result:
                continue
            # A symbolic link with such a name could lead to a folder of the user's: it is not followed.
            lock = os.open(workshop, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(workshop, ignore_errors=True)
            finally:
                os.close(lock)


def _swap_at_once(folder: Path, work: Path) -> bool:
    """Exchange two folders in one step. Returns False if the system or the disk cannot do that."""
    c_library = ctypes.CDLL(None)
    first = os.fsencode(folder)
    second = os.fsencode(work)
    # The constants of the C library: RENAME_SWAP is 2, AT_FDCWD is -100, and RENAME_EXCHANGE is 2.
    try:
        if sys.platform == "darwin":
            return int(c_library.renamex_np(first, second, 2)) == 0
        return int(c_library.renameat2(-100, first, -100, second, 2)) == 0
    # An old C library has no such function.
    except AttributeError:
        return False


def _exchange(folder: Path, work: Path, *, aside: Path) -> None:
    """Replace a folder by another one in two steps.

    Between the steps no folder has this name, and the former one is complete at another path. If the second step fails,
    the former folder gets its name back.

    Args:
        folder: the folder that is replaced.
        work: the folder that takes its name.
        aside: path to which the former folder is moved.
    """
    folder.rename(aside)
    try:
        work.rename(folder)
    # An interrupt by the user, too, must not leave the target without any result.
    except BaseException:
        aside.rename(folder)
        raise


def _nearest_parent(folder: Path) -> Path:
    """Nearest existing folder above a folder, which need not exist: the workshop must be on the same disk."""
    return next(parent for parent in folder.absolute().parents if parent.exists())
