"""Packages of files that belong together, and the border of what a file may name.

A file that somebody else may have written may name files of its own package, and files in the folders that the user
allows: with ``--mesh-path``, with the argument ``mesh_path`` of a function, or with the environment variable
:data:`MESH_PATH_VARIABLE` for everything that is started with it. A station that ``simrob station`` wrote for a robot
may read the package of that robot, as long as the station stays where it is: see :func:`remember_grants`. The file
itself allows nothing.
"""

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import chain
from os.path import exists, isdir, isfile  # which are false for names that no file can have
from pathlib import Path

from simrob_drake.base.errors import InvalidConfig, OutputError, shortened
from simrob_drake.base.files import NotRead, diagrams_root, models_root, opened
from simrob_drake.base.folders import cache_root, written_at_once
from simrob_drake.base.messages import compound, message

MANIFEST = "package.xml"
MODEL_MANIFEST = "model.config"  # of a model of Gazebo
REPOSITORY = ".git"  # a folder, or a file in the worktree of a repository
_PACKAGES = "ROS_PACKAGE_PATH", "GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH"
"""Environment variables with folders below which ROS 1 looks for packages, and Gazebo for models."""
_PREFIXES = "AMENT_PREFIX_PATH"  # the one with folders in which ROS 2 installs packages, as ``share/NAME``
DESCRIPTIONS_VARIABLE = "ROBOT_DESCRIPTIONS_CACHE"
"""The environment variable that says where ``robot_descriptions`` keeps what it downloaded."""
_LEVELS = 4  # how far up from a URDF the manifest of its package is looked for, and from a package others are
_INNER = ("urdf", "urdfs", "xacro", "mjcf", "sdf", "xml", "robot", "robots", "description", "model", "models")
"""Names of folders that lie inside a package and hold its URDF."""
_DEPTH = 3  # how far down below a folder of ``--mesh-path``
_FOLDERS = 5000  # how many folders are looked into at most, so that ``--mesh-path /`` ends


def package_root(source: Path) -> Path:
    """Return the folder of a URDF's own package.

    It is the nearest one with a ``package.xml``, or the repository that the URDF lies in. Without any it is the URDF's
    folder, or the one above where the folder's name says that it is only a part of the package.
    """
    folder = source.parent
    for candidate in [folder, *folder.parents][: _LEVELS + 1]:
        if isfile(candidate / MANIFEST) or _is_repository(candidate):
            return candidate
    inner = folder.name.lower() in _INNER and folder.parent != Path(folder.anchor)
    return folder.parent if inner else folder


def find_package(name: str, *, root: Path, mesh_path: Iterable[Path]) -> Path | None:
    """Return the folder of the package ``name``, as in ``package://name/...``; None if there is none that may be read.

    ``root`` is the folder of the package that asks. It is looked for around that and in it, in the folders that are
    allowed, where ROS and Gazebo look, and in the cache of ``robot_descriptions``.
    """
    if not re.fullmatch(r"\w[\w.-]*", name):  # no way up, no hidden folder
        return None
    around = [root, *root.parents][:_LEVELS]
    for folder in chain(around, *map(_folders_in, around[1:3])):
        if _may_be(folder, name, workspace=root.parent):
            return folder
    inside = (folder for folder in _below(root) if _is_repository(root) or isfile(folder / MODEL_MANIFEST))
    tops = [*mesh_path, *_ros_folders(name), descriptions_cache()]
    below = chain(inside, *map(_below, tops))
    return next((folder for folder in below if folder.name == name or manifest_name(folder) == name), None)


def descriptions_cache() -> Path:
    """Return the folder in which ``robot_descriptions`` keeps the repositories that it downloaded."""
    return Path(os.environ.get(DESCRIPTIONS_VARIABLE) or "~/.cache/robot_descriptions").expanduser()


def _is_repository(folder: Path) -> bool:
    owner = folder in (Path.home(), Path(folder.anchor))  # dotfiles make a repository of many a home
    return exists(folder / REPOSITORY) and not owner


def _ros_folders(name: str) -> Iterator[Path]:
    """Yield the folders in which, or below which, ROS or Gazebo would look for a package."""
    for variable in _PACKAGES:
        yield from (Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder)
    yield from (Path(folder) / "share" / name for folder in os.environ.get(_PREFIXES, "").split(os.pathsep) if folder)


def _may_be(folder: Path, name: str, *, workspace: Path) -> bool:
    """Return whether a folder is that package by its manifest, or by its name at a place where packages lie."""
    if manifest_name(folder) == name:
        return True
    private = folder == Path.home() or folder.parent == Path(folder.anchor)  # neither /etc nor a home is a package
    return (
        folder.name == name
        and not private
        and (isfile(folder / MANIFEST) or folder.parent == workspace or workspace.is_relative_to(folder))
    )


def manifest_name(folder: Path) -> str:
    """Return the name in a folder's ``package.xml``; empty without one. Read as text: no parser, no entities."""
    try:
        with opened(folder / MANIFEST) as file:
            found = re.search(r"<name>\s*([^<]*?)\s*</name>", file.read(100_000).decode("utf-8", "replace"))
    except NotRead:
        return ""
    return found.group(1) if found else ""


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


PACKAGE_URI = "package://"
"""Beginning of a path that starts at the folder of a package: ``package://NAME/path``."""


MESH_PATH_VARIABLE = "SIMROB_MESH_PATH"
"""The environment variable with folders that may be read, with colons between them."""


class OutsideBorder(Exception):
    """A file that may not be read; the text says where it may lie, and how the user allows it."""


@dataclass
class Border:
    """What may be read for one file."""

    source: Path  # the file
    mesh_path: tuple[Path, ...] = ()  # folders that the user allows, beside those of the environment
    named_packages: Mapping[str, Path] = field(default_factory=dict)  # folders of packages that the user names
    _packages: dict[str, Path | None] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.root = package_root(self.source)  # the folder of its package
        allowed = (*self.mesh_path, *granted(), *remembered_grants(self.source))
        self.mesh_path = tuple(dict.fromkeys(resolved(folder) for folder in allowed))

    def package(self, name: str) -> Path | None:
        """Return the folder of a package by its name; None if there is none that may be read."""
        if name in self.named_packages:
            return resolved(self.named_packages[name])
        if name not in self._packages:
            self._packages[name] = find_package(name, root=self.root, mesh_path=self.mesh_path)
        return self._packages[name]

    def readable(self, path: Path) -> Path:
        """Return a path without symbolic links, if it may be read; raises OutsideBorder: it may not."""
        found = resolved(path)
        self.package(manifest_name(package_root(found)))  # what its package's name may be used for, its path may, too
        packages = [folder for folder in self._packages.values() if folder is not None]
        packages += self.named_packages.values()
        allowed = [resolved(folder) for folder in (self.root, *packages, *self.mesh_path)]
        if any(found.is_relative_to(folder) for folder in allowed):
            return found
        listed = ", ".join(dict.fromkeys(map(str, allowed)))
        grant = found if found.is_dir() else found.parent
        raise OutsideBorder(
            message(
                "base.outside_allowed_folders",
                "lies outside of the allowed folders ({folders}); allow it with --mesh-path {grant}",
                folders=listed,
                grant=grant,
            )
        )

    def check(self, path: Path, key: str) -> None:
        """Check that a path under a key may be read, as ours may; raises InvalidConfig: what would allow it."""
        own = (models_root(), diagrams_root(), cache_root())
        if any(resolved(path).is_relative_to(resolved(folder)) for folder in own):
            return
        try:
            self.readable(path)
        except OutsideBorder as problem:
            raise InvalidConfig(
                self.source, key, compound("{path} {problem}", path=shortened(str(path), 300), problem=problem)
            ) from None


def package_path(uri: str, border: Border) -> Path:
    """Find the file or folder that a URI ``package://NAME/path`` names.

    Args:
        uri: the URI.
        border: border of the file that has the URI.

    Raises:
        OutsideBorder: there is no such package, or it may not be read.
    """
    name, _, path = uri.removeprefix(PACKAGE_URI).partition("/")
    folder = border.package(name)
    if folder is None:
        raise OutsideBorder(
            message(
                "base.package_not_found",
                "names the package {name}, which is not found; give its folder as packages.{name}, with --mesh-path, "
                "or in ROS_PACKAGE_PATH",
                name=name,
            )
        )
    return folder / path


_MOST_REMEMBERED = 1000  # stations; the oldest are forgotten
_LARGEST_MEMORY = 10_000_000  # size of the file of grants that is read at most [bytes]


def _grants_file() -> Path:
    """File that remembers which folders stations may read, for this user."""
    return cache_root() / "station_grants.json"


def remember_grants(source: Path, folders: Iterable[Path]) -> bool:
    """Remember that a file may read folders, because the user named both in one command.

    Only this user and this computer remember it, and only for the file at this path.

    Args:
        source: the file, such as a station that was written for a robot.
        folders: the folders, such as the package of the robot.

    Returns:
        whether it is remembered. A disk that is full or only read remembers nothing.
    """
    known = _read_grants()
    name = str(resolved(source))
    # The entry moves to the end, so that the oldest entries come first.
    known.pop(name, None)
    known[name] = [str(resolved(folder)) for folder in folders]
    kept = dict(list(known.items())[-_MOST_REMEMBERED:])
    try:
        written_at_once(_grants_file(), json.dumps(kept, indent=1))
    except OutputError:
        return False
    return True


def remembered_grants(source: Path) -> list[Path]:
    """Folders that a file may read because of :func:`remember_grants`."""
    folders = _read_grants().get(str(resolved(source)), [])
    return [Path(folder) for folder in folders if isinstance(folder, str)]


def _read_grants() -> dict[str, list[str]]:
    """Read the remembered folders, by the path of the file that may read them. Empty if there are none."""
    try:
        with opened(_grants_file()) as file:
            content = json.loads(file.read(_LARGEST_MEMORY))
    except (NotRead, ValueError):  # nothing is remembered, or the file is damaged
        return {}
    is_mapping = isinstance(content, dict)
    return {name: found for name, found in content.items() if isinstance(found, list)} if is_mapping else {}


def granted() -> list[Path]:
    """Return the folders that the environment allows."""
    return [Path(folder) for folder in os.environ.get(MESH_PATH_VARIABLE, "").split(os.pathsep) if folder]


@contextmanager
def granting(folders: Iterable[Path]) -> Iterator[None]:
    """Allow folders for a while, to this process and to those that it starts meanwhile."""
    added = [resolved(folder) for folder in folders]
    _grant([*granted(), *added])
    try:
        yield
    finally:
        left = granted()
        for folder in added:
            with suppress(ValueError):  # somebody else took it back
                left.remove(folder)
        _grant(left)


def _grant(folders: Iterable[Path]) -> None:
    os.environ[MESH_PATH_VARIABLE] = os.pathsep.join(map(str, folders))


def resolved(path: Path) -> Path:
    """Return a path without symbolic links; as it is where no file can have that name."""
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError):  # links that go in a circle, the character 0
        return path.absolute()
