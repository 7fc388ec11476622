"""Packages of files that belong together, and the files that another file may name.

A *package* is a folder with a robot's URDF, its meshes and often a manifest ``package.xml``, as ROS has it. The
*border* of a file are the folders in which the files may be that it names. A file may have been written by somebody
else, so it may not name any file of the user's: only files of its own package, of packages that it names and that are
found at the usual places, and files in folders that the user allows. The user allows folders with ``--mesh-path``,
with the argument ``mesh_path`` of a function, or with the environment variable :data:`MESH_PATH_VARIABLE`. A station
that ``simrob station`` has written for a robot may read the package of that robot, as long as the station stays at its
path: see :func:`remember_grants`. The content of a file never allows anything.
"""

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import chain

# These return False for names that no file can have, where methods of a Path would raise an error.
from os.path import exists, isdir, isfile
from pathlib import Path
from typing import TYPE_CHECKING

from simrob_drake.base.errors import InvalidConfig, OutputError, shorten
from simrob_drake.base.files import NotRead, diagrams_root, models_root, open_regular
from simrob_drake.base.folders import cache_root, written_at_once
from simrob_drake.base.messages import compound, message
from simrob_drake.base.renaming import former_names_of

MANIFEST = "package.xml"
"""File with the name of a package of ROS."""

MODEL_MANIFEST = "model.config"
"""File that makes a folder a model of Gazebo."""

REPOSITORY = ".git"
"""Folder, or in a worktree a file, that makes a folder a repository of git."""

_PACKAGES = ("ROS_PACKAGE_PATH", "GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH")
"""Environment variables with the folders below which ROS 1 looks for packages, and Gazebo for models."""

_PREFIXES = "AMENT_PREFIX_PATH"
"""Environment variable with the folders in which ROS 2 installs packages, as ``share/NAME``."""

DESCRIPTIONS_VARIABLE = "ROBOT_DESCRIPTIONS_CACHE"
"""Environment variable with the folder in which ``robot_descriptions`` stores what it downloads."""

_LEVELS = 4
"""Count of levels above a URDF at which its package is looked for, and above a package at which others are."""

_INNER = (
    "urdf",
    "urdfs",
    "xacro",
    "mjcf",
    "sdf",
    "xml",
    "robot",
    "robots",
    "description",
    "model",
    "models",
)
"""Names of folders inside of a package that contain its URDF."""

_DEPTH = 3
"""Count of levels below a folder of ``--mesh-path`` at which packages are looked for."""

_FOLDERS = 5000
"""Largest count of folders that are searched, so that the search of ``--mesh-path /`` ends."""


def package_root(source: Path) -> Path:
    """Find the folder of the package to which a file belongs, such as a URDF.

    It is the nearest folder above the file with a ``package.xml``, or that is a repository, at most four levels above
    the folder of the file. If there is none, it is the folder of the file, or the one above it if the folder has a name
    that parts of packages usually have.
    """
    folder = source.parent
    for candidate in [folder, *folder.parents][: _LEVELS + 1]:
        if isfile(candidate / MANIFEST) or _is_repository(candidate):
            return candidate
    is_part = folder.name.lower() in _INNER
    # If the folder is /urdf, the one above is the whole disk, all of which could then be read.
    is_below_root = folder.parent == Path(folder.anchor)
    return folder.parent if is_part and not is_below_root else folder


def find_package(name: str, *, root: Path, mesh_path: Iterable[Path]) -> Path | None:
    """Find the folder of a package that another package may read.

    It is looked for near this other package and in it (any folder in a repository, else models of Gazebo), in the
    folders that the user allows, where ROS and Gazebo look, and in the cache of ``robot_descriptions``, in this order.

    Args:
        name: name of the package, as in ``package://name/...``.
        root: folder of the other package.
        mesh_path: folders that the user allows.

    Returns:
        the folder, or None if no such package is found.
    """
    # Neither "..", which would lead out of the allowed folders, nor a hidden folder, such as .ssh.
    is_plain_name = re.fullmatch(r"\w[\w.-]*", name)
    if not is_plain_name:
        return None
    # The package and the folders above it, then the neighbours of the package and of its parent folder.
    around = [root, *root.parents][:_LEVELS]
    for folder in chain(around, *map(_folders_in, around[1:3])):
        if _is_package(folder, name, workspace=root.parent):
            return folder
    # A repository, or a collection of models of Gazebo, may contain several packages.
    inside = (
        folder for folder in _below(root) if _is_repository(root) or isfile(folder / MODEL_MANIFEST)
    )
    # The user's own folders come before those of the environment, so that an option decides.
    tops = [*mesh_path, *_ros_folders(name), descriptions_cache()]
    for folder in chain(inside, *map(_below, tops)):
        if folder.name == name or manifest_name(folder) == name:
            return folder
    return None


def descriptions_cache() -> Path:
    """Folder in which ``robot_descriptions`` stores the repositories that it downloads."""
    return Path(os.environ.get(DESCRIPTIONS_VARIABLE) or "~/.cache/robot_descriptions").expanduser()


def _is_repository(folder: Path) -> bool:
    """Whether a folder is a repository of git. The user's home counts as none, though it is one for some users."""
    # Some users keep their settings in a repository of the whole home. Everything in it would belong to one package.
    is_home_or_root = folder in (Path.home(), Path(folder.anchor))
    return exists(folder / REPOSITORY) and not is_home_or_root


def _ros_folders(name: str) -> Iterator[Path]:
    """Yield the folders in which, or below which, ROS or Gazebo would look for a package."""
    for variable in _PACKAGES:
        yield from _folders_of_variable(variable)
    for folder in _folders_of_variable(_PREFIXES):
        yield folder / "share" / name


def _folders_of_variable(variable: str) -> list[Path]:
    """Folders in an environment variable, which are separated by colons. Empty if it is not set."""
    return [Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder]


def _is_package(folder: Path, name: str, *, workspace: Path) -> bool:
    """Whether a folder is a package of a name: by its manifest, or by its own name at a place where packages are.

    Args:
        folder: the folder.
        name: name of the package.
        workspace: folder that contains the package from which the name was read.
    """
    # A manifest is a clear statement that the folder is this package, wherever it is.
    if manifest_name(folder) == name:
        return True
    is_home = folder == Path.home()
    # A file that names the package "etc" must not get the folder /etc.
    is_below_root = folder.parent == Path(folder.anchor)
    if folder.name != name or is_home or is_below_root:
        return False
    # A name alone proves little, so a folder without a manifest must be near the package that names it.
    is_neighbour = folder.parent == workspace
    is_above = workspace.is_relative_to(folder)
    return isfile(folder / MANIFEST) or is_neighbour or is_above


def manifest_name(folder: Path) -> str:
    """Name in the ``package.xml`` of a folder. Empty if the folder has no such file, or the file no name.

    The file is searched as text: an XML parser would expand entities, which a hostile file can make arbitrarily long.
    """
    try:
        with open_regular(folder / MANIFEST) as file:
            # The name is near the beginning. A longer file may be one that was made to fill the memory.
            text = file.read(100_000).decode("utf-8", "replace")
    except NotRead:
        return ""
    found = re.search(r"<name>\s*([^<]*?)\s*</name>", text)
    return found.group(1) if found else ""


def _below(top: Path) -> Iterator[Path]:
    """Yield a folder and the next `_DEPTH` levels of folders below it, so that the nearest come first."""
    level = [top]
    count = 0
    for _ in range(_DEPTH + 1):
        yield from level
        count += len(level)
        # A search of the whole disk ends here; the folders that are near the top were searched.
        if count > _FOLDERS:
            return
        level = [child for folder in level for child in _folders_in(folder)]


def _folders_in(folder: Path) -> list[Path]:
    """Folders in a folder, sorted, without hidden ones."""
    names = [name for name in sorted_entries(folder) if not name.startswith(".")]
    paths = [folder / name for name in names[:_FOLDERS]]
    return [path for path in paths if isdir(path)]


def sorted_entries(folder: Path) -> list[str]:
    """Names of the files and folders in a folder, sorted. Empty if the folder cannot be read."""
    try:
        return sorted(os.listdir(folder))
    except (OSError, ValueError):
        return []


PACKAGE_URI = "package://"
"""Beginning of a path that starts at the folder of a package: ``package://NAME/path``."""


MESH_PATH_VARIABLE = "SIMROB_MESH_PATH"
"""Environment variable with folders that may be read, separated by colons."""


class OutsideBorder(Exception):
    """Raised when a file may not be read. Its text names the allowed folders, and how the user allows others."""


@dataclass
class Border:
    """The folders that may be read for one file.

    Attributes:
        source: the file.
        mesh_path: folders that the user allows. Those of the environment and the remembered ones are added.
        named_packages: folders of packages that the user names, by the name of the package.
        root: folder of the package of the file.
    """

    source: Path
    mesh_path: tuple[Path, ...] = ()
    named_packages: Mapping[str, Path] = field(default_factory=dict)
    # Folders of the packages that were looked for so far, None for those that were not found: a search takes long.
    _packages: dict[str, Path | None] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        """Find the package of the file, and the folders that the user allows."""
        self.root = package_root(self.source)
        allowed = (*self.mesh_path, *granted_folders(), *remembered_grants(self.source))
        # A dict keeps the order and drops repeated folders.
        self.mesh_path = tuple(dict.fromkeys(resolve_path(folder) for folder in allowed))

    def package(self, name: str) -> Path | None:
        """Find the folder of a package by its name. Returns None if there is no such package that may be read."""
        # What the user names comes before what is found.
        if name in self.named_packages:
            return resolve_path(self.named_packages[name])
        if name not in self._packages:
            self._packages[name] = find_package(name, root=self.root, mesh_path=self.mesh_path)
        return self._packages[name]

    def readable(self, path: Path) -> Path:
        """Check that a path may be read.

        Returns:
            the path without symbolic links.

        Raises:
            OutsideBorder: the path may not be read.
        """
        # A symbolic link in an allowed folder may lead out of it, so the path behind all links counts.
        found = resolve_path(path)
        # A file that may be named by its package may be named by its path, too: the package is added to those found.
        self.package(manifest_name(package_root(found)))
        packages = [folder for folder in self._packages.values() if folder is not None]
        packages += self.named_packages.values()
        allowed = [resolve_path(folder) for folder in (self.root, *packages, *self.mesh_path)]
        if any(found.is_relative_to(folder) for folder in allowed):
            return found
        listed = ", ".join(dict.fromkeys(map(str, allowed)))
        grant = found if found.is_dir() else found.parent
        raise OutsideBorder(
            message(
                "base.outside_allowed_folders",
                "is outside the allowed folders ({folders}); allow it with --mesh-path {grant}",
                folders=listed,
                grant=grant,
            )
        )

    def check(self, path: Path, key: str) -> None:
        """Check that a path under a key of a station may be read. Models of this package and its caches always may.

        Args:
            path: the path.
            key: the dotted key, for the error.

        Raises:
            InvalidConfig: the path may not be read. The message says how the user allows it.
        """
        # These folders contain nothing of the user's.
        own_folders = (models_root(), diagrams_root(), cache_root())
        if any(resolve_path(path).is_relative_to(resolve_path(folder)) for folder in own_folders):
            return
        try:
            self.readable(path)
        except OutsideBorder as problem:
            raise InvalidConfig(
                self.source,
                key,
                compound("{path} {problem}", path=shorten(str(path), 300), problem=problem),
            ) from None


def package_path(uri: str, border: Border) -> Path:
    """Find the file or folder that a URI ``package://NAME/path`` names, which need not exist.

    The path may lead out of the package by ``..``: the caller checks the result with :meth:`Border.readable`.

    Args:
        uri: the URI.
        border: border of the file that has the URI.

    Raises:
        OutsideBorder: there is no such package that may be read.
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


_MOST_REMEMBERED = 1000
"""Largest count of stations whose grants are remembered. The oldest are forgotten."""

_LARGEST_MEMORY = 10_000_000
"""Largest size of the file of grants [bytes]."""


def _grants_file() -> Path:
    """File that remembers which folders stations may read, for this user."""
    return cache_root() / "station_grants.json"


def remember_grants(source: Path, folders: Iterable[Path]) -> bool:
    """Remember that a file may read folders, because the user named both in one command.

    Only this user and this computer remember it, and only for the file at this path. Whatever lies at the path
    later has the permission, too.

    Args:
        source: the file, such as a station that was written for a robot.
        folders: the folders, such as the package of the robot.

    Returns:
        whether it is remembered. A disk that is full or only read remembers nothing.
    """
    known = _read_grants()
    name = str(resolve_path(source))
    # The entry moves to the end, so that the oldest entries come first.
    known.pop(name, None)
    known[name] = [str(resolve_path(folder)) for folder in folders]
    kept = dict(list(known.items())[-_MOST_REMEMBERED:])
    try:
        written_at_once(_grants_file(), json.dumps(kept, indent=1))
    except OutputError:
        return False
    return True


def remembered_grants(source: Path) -> list[Path]:
    """Folders that a file may read because of :func:`remember_grants`."""
    folders = _read_grants().get(str(resolve_path(source)), [])
    return [Path(folder) for folder in folders if isinstance(folder, str)]


def _read_grants() -> dict[str, list[str]]:
    """Read the remembered folders, by the path of the file that may read them."""
    try:
        with open_regular(_grants_file()) as file:
            content = json.loads(file.read(_LARGEST_MEMORY))
    # Nothing was remembered yet, or the file is damaged: then nothing is allowed.
    except (NotRead, ValueError):
        return {}
    if not isinstance(content, dict):
        return {}
    return {name: folders for name, folders in content.items() if isinstance(folders, list)}


def granted_folders() -> list[Path]:
    """Folders that the environment variable allows."""
    return _folders_of_variable(MESH_PATH_VARIABLE)


@contextmanager
def granting(folders: Iterable[Path]) -> Iterator[None]:
    """Context manager that allows folders to this process, and to processes that it starts in the body."""
    added = [resolve_path(folder) for folder in folders]
    _set_granted([*granted_folders(), *added])
    try:
        yield
    finally:
        remaining = granted_folders()
        for folder in added:
            # Other code may have removed the folder already. Only one of two equal entries is removed.
            with suppress(ValueError):
                remaining.remove(folder)
        _set_granted(remaining)


def _set_granted(folders: Iterable[Path]) -> None:
    """Set the environment variable with the allowed folders."""
    os.environ[MESH_PATH_VARIABLE] = os.pathsep.join(map(str, folders))


def resolve_path(path: Path) -> Path:
    """Path without symbolic links. If it cannot be resolved, it only becomes absolute."""
    try:
        return path.resolve()
    # Links in a circle, or the character 0 in the name.
    except (OSError, RuntimeError, ValueError):
        return path.absolute()


if not TYPE_CHECKING:
    # The type checker does not see the former names, so that this package cannot use them.
    __getattr__ = former_names_of(__name__, {"resolved": "resolve_path"})
