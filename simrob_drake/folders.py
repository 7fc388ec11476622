"""Output folders: checked before the work, and filled at once or not at all."""

from __future__ import annotations

import os
import shutil
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
def filled_at_once(folder: Path) -> Iterator[Path]:
    """Give a temporary folder that takes the name of ``folder``, and its place, once it is filled.

    Raises:
        OutputError: the disk does not take it; nothing is left behind.
    """
    try:
        work = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=_nearest_parent(folder)))
        try:
            yield work
            work.chmod(0o755)
            folder.parent.mkdir(parents=True, exist_ok=True)
            if folder.exists():
                shutil.rmtree(folder)
            work.rename(folder)
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise
    except OSError as problem:
        raise OutputError(f"{folder} cannot be written: {problem.strerror or problem}") from problem


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
