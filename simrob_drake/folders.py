"""Output folders: checked before the work, and filled at once or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from simrob_drake.errors import OutputError

CACHE_VARIABLE = "XDG_CACHE_HOME"
"""The environment variable that says where caches lie; without it that is ``~/.cache``."""


def cache_root() -> Path:
    """Return the folder of our caches: imported robots, and the meshes of pieces."""
    return Path(os.environ.get(CACHE_VARIABLE) or Path.home() / ".cache") / "simrob_drake"


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
    try:
        with tempfile.TemporaryDirectory(dir=_nearest_parent(folder)):  # trying tells more than asking for permissions
            pass
    except OSError as problem:
        raise OutputError(f"{folder} cannot be written: {problem.strerror or problem}") from problem


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
    prefix = f".{folder.name}-"
    try:
        with tempfile.TemporaryDirectory(
            prefix=prefix, dir=_nearest_parent(folder), ignore_cleanup_errors=True
        ) as place:
            work = Path(place) / folder.name
            work.mkdir()  # with the permissions that the user wants, which the folder around it has not
            yield work
            check_folder(folder, marker=marker, force=force)
            folder.parent.mkdir(parents=True, exist_ok=True)
            if folder.exists():
                _exchange(folder, work, aside=Path(place) / "before")
            else:
                work.rename(folder)  # fails where a folder with something in it came this moment
    except OSError as problem:
        raise OutputError(f"{folder} cannot be written: {problem.strerror or problem}") from problem


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
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{file.name}-", dir=file.parent) as folder:
            work = Path(folder) / file.name
            work.write_text(text, encoding="utf-8")
            work.replace(file)
    except OSError as problem:
        raise OutputError(f"{file} cannot be written: {problem.strerror or problem}") from problem


def _nearest_parent(folder: Path) -> Path:
    return next(parent for parent in folder.absolute().parents if parent.exists())
