"""Where the packages of robots lie: the one that a description belongs to, and others by their name."""

import os
import re
from collections.abc import Iterable, Iterator
from os.path import isdir, isfile  # which are false for names that no file can have
from pathlib import Path

MANIFEST = "package.xml"
_LEVELS = 4
"""How far up from a URDF the manifest of its package is looked for, and from a package others are."""
_INNER = ("urdf", "urdfs", "xacro", "robot", "robots", "description", "model", "models")
"""Names of folders that lie inside a package and hold its URDF."""
_DEPTH = 3
"""How far down below a folder of ``--mesh-path``."""
_FOLDERS = 5000
"""How many folders are looked into at most, so that ``--mesh-path /`` ends."""


def package_root(source: Path) -> Path:
    """Return the folder of a URDF's own package.

    It is the nearest one with a ``package.xml``. Without any it is the URDF's folder, or the one above where the
    folder's name says that it is only a part of the package.
    """
    folder = source.parent
    for candidate in [folder, *folder.parents][: _LEVELS + 1]:
        if isfile(candidate / MANIFEST):
            return candidate
    inner = folder.name.lower() in _INNER and folder.parent != Path(folder.anchor)
    return folder.parent if inner else folder


def find_package(name: str, *, root: Path, mesh_path: Iterable[Path]) -> Path | None:
    """Return the folder of the package ``name``, as in ``package://name/...``; None if there is none that may be read.

    ``root`` is the folder of the package that asks; folders that the user allows come last.
    """
    if not re.fullmatch(r"\w[\w.-]*", name):  # no way up, no hidden folder
        return None
    around = [root, *root.parents][:_LEVELS]
    for folder in (*around, *_children(around[1:3])):
        if _may_be(folder, name, beside=root.parent):
            return folder
    below = (folder for top in mesh_path for folder in _below(top))
    return next((folder for folder in below if folder.name == name or manifest_name(folder) == name), None)


def _may_be(folder: Path, name: str, *, beside: Path) -> bool:
    """Return whether a folder is that package by its manifest, or by its name at a place where packages lie."""
    if manifest_name(folder) == name:
        return True
    private = folder == Path.home() or folder.parent == Path(folder.anchor)  # neither /etc nor a home is a package
    return (
        folder.name == name
        and not private
        and (isfile(folder / MANIFEST) or folder.parent == beside or beside.is_relative_to(folder))
    )


def manifest_name(folder: Path) -> str:
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
    names = [name for name in sorted_entries(folder) if not name.startswith(".")]
    return [path for path in (folder / name for name in names[:_FOLDERS]) if isdir(path)]


def sorted_entries(folder: Path) -> list[str]:
    """Return the names in a folder, in order; none if it cannot be read."""
    try:
        return sorted(os.listdir(folder))
    except (OSError, ValueError):
        return []
