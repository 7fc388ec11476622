"""Output folders: checked before the work, and filled at once or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from simrob_drake.errors import OutputError


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
    ancestor = next(parent for parent in folder.absolute().parents if parent.exists())
    try:
        with tempfile.TemporaryDirectory(dir=ancestor):  # trying tells more than asking for permissions
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
        folder.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        try:
            yield work
            work.chmod(0o755)
            if folder.exists():
                shutil.rmtree(folder)
            work.rename(folder)
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise
    except OSError as problem:
        raise OutputError(f"{folder} cannot be written: {problem.strerror or problem}") from problem
