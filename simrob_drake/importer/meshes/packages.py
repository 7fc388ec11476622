"""Find the folder of a ROS or Gazebo package by its name, around a URDF and below the folders of ``--mesh-path``."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

MANIFEST = "package.xml"
_LEVELS = 4
"""How far up from a package others are looked for."""
_DEPTH = 3
"""How far down below a folder of ``--mesh-path``."""
_FOLDERS = 5000
"""How many folders are looked into at most, so that ``--mesh-path /`` ends."""


def find_package(name: str, *, root: Path, mesh_path: Iterable[Path]) -> Path | None:
    """Return the folder of a package; None if there is none that may be read.

    Args:
        name: as in ``package://name/...``.
        root: the folder of the package that asks.
        mesh_path: folders that the user allows; they come last.
    """
    if not re.fullmatch(r"\w[\w.-]*", name):  # no way up, no hidden folder
        return None
    around = [root, *root.parents][:_LEVELS]
    for folder in (*around, *_children(around[1:3])):
        if _may_be(folder, name, beside=root.parent):
            return folder
    return next((folder for top in mesh_path for folder in _below(top) if _is(folder, name)), None)


def is_file(path: Path) -> bool:
    """Return whether a path is a file's; False for names that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError, RuntimeError):
        return False


def _is(folder: Path, name: str) -> bool:
    return folder.name == name or _manifest_name(folder) == name


def _may_be(folder: Path, name: str, *, beside: Path) -> bool:
    """Return whether a folder is that package by its manifest, or by its name at a place where packages lie."""
    if _manifest_name(folder) == name:
        return True
    private = folder == Path.home() or folder.parent == Path(folder.anchor)  # neither /etc nor a home is a package
    return (
        folder.name == name
        and not private
        and (is_file(folder / MANIFEST) or folder.parent == beside or beside.is_relative_to(folder))
    )


def _manifest_name(folder: Path) -> str:
    """Return the name in a folder's ``package.xml``; empty without one. Read as text: no parser, no entities."""
    try:
        with (folder / MANIFEST).open(encoding="utf-8", errors="replace") as file:
            found = re.search(r"<name>\s*([^<]*?)\s*</name>", file.read(100_000))
    except (OSError, ValueError):
        return ""
    return found.group(1) if found else ""


def _children(folders: Iterable[Path]) -> Iterator[Path]:
    for folder in folders:
        yield from _folders_in(folder)


def _below(top: Path) -> Iterator[Path]:
    """Yield a folder and those below it, the near ones first."""
    level, seen = [top], 0
    for _ in range(_DEPTH + 1):
        yield from level
        seen += len(level)
        if seen > _FOLDERS:
            return
        level = [child for folder in level for child in _folders_in(folder)]


def _folders_in(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            names = sorted(entry.name for entry in entries if entry.is_dir() and not entry.name.startswith("."))
    except OSError:
        return []
    return [folder / name for name in names[:_FOLDERS]]
