"""The keys of a station that name files.

Relative paths in a station's file begin at the folder of that file, and become absolute when the file is read. A
*border* limits the files that a station may name. The copy of a station that is saved with a result names copies of
its files, by relative paths.

A *key* is dotted, such as ``robot.urdf``. In the patterns of keys, ``*`` stands for any name.
"""

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from os.path import isfile
from pathlib import Path
from typing import Any, NamedTuple

from simrob_drake.base.errors import InvalidConfig, SimrobError, shorten
from simrob_drake.base.files import ROBOT_FILE
from simrob_drake.base.messages import compound
from simrob_drake.base.packages import (
    PACKAGE_URI,
    Border,
    OutsideBorder,
    package_path,
    resolve_path,
)
from simrob_drake.base.yaml_files import is_yaml_name
from simrob_drake.importer.importing import robot_from_file
from simrob_drake.importer.meshes.places import MeshPlaces
from simrob_drake.parts.controllers.own import class_from
from simrob_drake.robots.catalog import RobotModel, load_robot_file
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.robots.pieces import described_piece
from simrob_drake.robots.urdf import mesh_file
from simrob_drake.stations.config import StationConfig

_KEYS_WITH_LISTS = ("mesh_path", "add_directives")
"""Last parts of the keys whose values are lists of paths."""

_KEYS_OF_ROBOT = (
    "urdf",
    "model",
    "reference.file",
    "import_options.mesh_path",
    "import_options.hand",
    "import_options.srdf",
)
_KEYS = (
    "start",
    "add_directives",
    "packages.*",
    "program",
    "program.file",
    "reference.file",
    "prescribed.*.file",
    "floor.terrain.file",
    *(f"robot.{key}" for key in _KEYS_OF_ROBOT),
    *(f"robots.*.{key}" for key in _KEYS_OF_ROBOT),
    "pieces.*.mesh",
    "pieces.*.model",
    "controllers.*.network",
    "controllers.*.class",
)
"""Patterns of the keys that name files or folders."""


class NamedPath(NamedTuple):
    """A key of a station that names a file or a folder.

    Attributes:
        section: the section that contains the key. Its value can be replaced.
        last: last part of the key, such as ``urdf``.
        key: the whole key, such as ``robot.urdf``.
    """

    section: dict[str, Any]
    last: str
    key: str


class FilesToCopy(NamedTuple):
    """The files behind a key.

    Attributes:
        main: the file that the key names, without symbolic links.
        needed: further files that are read with it, such as meshes.
    """

    main: Path
    needed: list[Path]


def with_absolute_paths(
    content: Mapping[str, Any],
    folder: Path,
    border: Border | None = None,
) -> dict[str, Any]:
    """Copy a station's content with absolute paths. The value of a key ``class`` becomes absolute if it names a file.

    Args:
        content: content of a station's file, or a part of it with the same keys.
        folder: folder at which relative paths begin.
        border: limit of the files that the station may name, or None for no limit.

    Raises:
        InvalidConfig: a path is beyond the border, or begins with ``package://`` and its package is not found.
    """
    # A copy, as the paths are replaced in place below; the caller keeps its content.
    result: dict[str, Any] = deepcopy(dict(content))
    for section, last, key in paths_in(result):
        value = section[last]
        if last == "class":
            # Code needs a permission of its own, which is checked elsewhere.
            section[last] = class_from(value, folder)
            continue
        named = value if isinstance(value, list) else [value]
        paths = [_absolute_path(path, key, folder, border) for path in named]
        if border is not None:
            for path in paths:
                border.check(Path(path), key)
        section[last] = paths if isinstance(value, list) else paths[0]
    return result


def _absolute_path(path: object, key: str, folder: Path, border: Border | None) -> str:
    """Make a path absolute. A path ``package://NAME/…`` starts at the folder of the package.

    Args:
        path: value in a station's file.
        key: its dotted key, for errors.
        folder: folder at which relative paths start.
        border: border of the file. None if the value is not from a file: then packages are looked for from the folder.

    Raises:
        InvalidConfig: the package is not found.
    """
    text = str(path)
    if not text.startswith(PACKAGE_URI):
        # An absolute path replaces the folder, as pathlib joins paths.
        return str(folder / text)
    # Packages are looked for from a file: any name in the folder does.
    own_border = border or Border(folder / "station.yaml")
    try:
        return str(package_path(text, own_border))
    except OutsideBorder as problem:
        raise InvalidConfig(
            own_border.source,
            key,
            compound("{path} {problem}", path=shorten(text, 300), problem=problem),
        ) from None


def changes_with_absolute_paths(
    changes: Mapping[str, Any], folder: Path, border: Border | None = None
) -> dict[str, Any]:
    """Copy the changes of a station, values by dotted key, with absolute paths.

    Arguments and errors are those of :func:`with_absolute_paths`.
    """
    result = dict[str, Any]()
    for key, value in changes.items():
        whole: Any = value
        # The dotted key becomes nested sections, as `paths_in` expects them, and is taken apart
        # again.
        for part in reversed(key.split(".")):
            whole = {part: whole}
        whole = with_absolute_paths(whole, folder, border)
        for part in key.split("."):
            whole = whole[part]
        # Taken apart, `whole` is the value again, now with absolute paths.
        result[key] = whole
    return result


def program_with_absolute_paths(
    program: Mapping[str, Any],
    folder: Path,
    border: Border | None,
) -> dict[str, Any]:
    """Copy a program, with absolute paths in the changes that it makes to its station.

    A program is a mapping with a list of moves and a list ``changes``. The key ``set`` of a change has values of the
    station by dotted key, which may be paths. The copy has no key ``station``: a program in a station's file belongs to
    that station. The program has not been checked yet, so entries of an unexpected type stay as they are.

    Arguments and errors are those of :func:`with_absolute_paths`.
    """
    result = deepcopy({key: value for key, value in program.items() if key != "station"})
    changes = result.get("changes")
    for change in changes if isinstance(changes, list) else []:
        if isinstance(change, dict) and isinstance(change.get("set"), dict):
            change["set"] = changes_with_absolute_paths(change["set"], folder, border)
    return result


def station_with_absolute_path(station: str, file: Path) -> str:
    """Resolve the station that a file names: a name of the package stays, a path becomes absolute.

    Args:
        station: name or path of the station.
        file: the file that names it. A relative path begins at its folder or, if it does not exist there, at the
            working directory.

    Raises:
        InvalidConfig: the path is beyond the file's border.
    """
    if not is_yaml_name(station):
        return station
    # First the folder of the file, so that a program works from any working directory.
    near = file.absolute().parent / station
    path = near if near.is_file() else Path(station).absolute()
    Border(file).check(path, "station")
    return str(path)


def paths_in(content: dict[str, Any]) -> Iterator[NamedPath]:
    """Yield the keys of a station's content that name files or folders; names of the package's models are left out."""
    for pattern in _KEYS:
        yield from _paths_at(content, pattern.split("."))


def _paths_at(node: Any, pattern: list[str], prefix: str = "") -> Iterator[NamedPath]:
    """Yield the keys below a node that match a pattern and name a file or a folder.

    Args:
        node: a section, or any other value, which has no keys.
        pattern: names of the keys from the node on; ``*`` stands for any name.
        prefix: key of the node with a final dot; empty for the whole content.
    """
    if not isinstance(node, dict):
        return
    # A list of its own, since callers remove keys of the section while they go through the paths.
    keys = list(node) if pattern[0] == "*" else pattern[:1]
    for key in keys:
        value = node.get(key)
        if len(pattern) > 1:
            yield from _paths_at(value, pattern[1:], f"{prefix}{key}.")
            continue
        # `model` is the name of a model of the package, or a file.
        is_model_name = key == "model" and not is_yaml_name(str(value))
        expected_type = list if key in _KEYS_WITH_LISTS else str
        if isinstance(value, expected_type) and not is_model_name:
            yield NamedPath(node, key, f"{prefix}{key}")


FILES = "files"
"""Name of the folder with the copies of a station's files."""

_ROBOT_FILES = (ROBOT_FILE, "gaits.yaml", "walking.yaml")
"""Files of a robot's folder that are read in addition to its URDF."""


def with_copied_files(config: StationConfig, folder: Path) -> StationConfig:
    """Copy the files of a station into a folder, and name the copies in the station by paths from that folder.

    Robots are copied as they were imported. Keys that name no single file of data, such as a folder of packages or a
    class, stay as they are. So do keys with relative paths, keys of files that cannot be read any more, and keys of
    meshes with a texture that may not be read.

    Args:
        config: the station. Its paths are absolute.
        folder: the folder, in which a folder ``files`` is made.

    Returns:
        the changed station.

    Raises:
        OSError: the copies cannot be written.
    """
    content = config.model_dump(mode="json", exclude_none=True)
    for section, last, key in paths_in(content):
        # `_FILES_OF` finds the files that are copied, by the last part of the key. A relative path names a copy
        # already, of a result that is saved again.
        if last not in _FILES_OF or not Path(section[last]).is_absolute():
            continue
        # A folder for each section, as files of two robots may have the same name.
        subfolder = Path(FILES, *key.split(".")[:-1])
        options = ImportOptions.model_validate(section.get("import_options") or {})
        try:
            files = _FILES_OF[last](Path(section[last]), key, options)
        except (SimrobError, OSError, OutsideBorder):
            # A file cannot be read any more, or a texture is in a folder that is not allowed. A result is saved all the
            # same, and names where the file is or was.
            continue
        if not all(isfile(file) for file in (files.main, *files.needed)):
            continue
        _copy_files(files, folder / subfolder)
        section[last] = str(subfolder / files.main.name)
        section.pop("import_options", None)  # the copy has been imported already
    return StationConfig.model_validate(content)


def _copy_files(files: FilesToCopy, folder: Path) -> None:
    """Copy a file, and those needed files that are in its folder or below, into a folder."""
    source = files.main.parent
    for file in dict.fromkeys((files.main, *files.needed)):
        # Other files would have to be written outside of the folder to keep their relative paths.
        if file.is_relative_to(source):
            copy = folder / file.relative_to(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)


def _files_of_robot(model: RobotModel, main: Path) -> FilesToCopy:
    """Find the files of a robot: those of its folder that are read, and its meshes with materials and textures.

    Args:
        model: the robot.
        main: the file in its folder that the key names.
    """
    folder = resolve_path(model.folder)
    names = [*_ROBOT_FILES]
    mesh_names: list[str] = []
    # A robot that is described by Denavit-Hartenberg parameters has no URDF, and so no meshes.
    if model.urdf:
        names.append(model.urdf)
        mesh_names = [mesh.get("filename", "") for mesh in model.element.iter("mesh")]
    # Most robots have only some of these files: an arm has no gaits.
    files = [folder / name for name in names if (folder / name).is_file()]
    # Several links may have the same mesh.
    meshes = [mesh_file(name, folder) for name in dict.fromkeys(mesh_names)]
    return FilesToCopy(folder / main.name, [*files, *_with_textures(meshes)])


def _files_of_urdf(file: Path, _: str, options: ImportOptions) -> FilesToCopy:
    """Files of a robot whose key names a URDF."""
    model = robot_from_file(file, options)
    return _files_of_robot(model, model.urdf_path)


def _files_of_description(file: Path, key: str, _: ImportOptions) -> FilesToCopy:
    """Find the files of a robot or a piece whose key names a `robot.yaml` or a `piece.yaml`."""
    if not key.startswith("pieces."):
        return _files_of_robot(load_robot_file(file), file)
    piece = described_piece(file)
    main = resolve_path(file)
    meshes = [mesh_file(shape.mesh, main.parent) for shape in piece.shapes if shape.mesh]
    return FilesToCopy(main, _with_textures(meshes))


def _files_of_mesh(file: Path, _: str, __: ImportOptions) -> FilesToCopy:
    """A mesh file with its materials and textures."""
    return FilesToCopy(resolve_path(file), _with_textures([resolve_path(file)]))


def _single_file(file: Path, _: str, __: ImportOptions) -> FilesToCopy:
    """A file that needs no other files."""
    return FilesToCopy(resolve_path(file), [])


_FILES_OF: Mapping[str, Callable[[Path, str, ImportOptions], FilesToCopy]] = {
    "urdf": _files_of_urdf,
    "model": _files_of_description,
    "mesh": _files_of_mesh,
    "network": _single_file,
    "file": _single_file,
    "start": _single_file,
}
"""By the last part of a key, the function that finds the files behind it.

Its arguments are the file, the whole key, and the import options in the key's section.
"""


def _with_textures(meshes: Iterable[Path]) -> list[Path]:
    """List mesh files, each with the material and texture files that it names, as far as these exist.

    Raises:
        OutsideBorder: a material or a texture is outside of the folders from which files may be read.
        OSError: a mesh cannot be read.
    """
    files = list[Path]()
    for mesh in meshes:
        # The folder of the mesh is searched for the files; those that are missing are left out.
        found, _missing = MeshPlaces(mesh).needed_by(mesh)
        files += [mesh, *found.values()]
    return files
