"""The keys of a station that name files: where paths start, what a file may name, and copies that go with a result."""

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

from simrob_drake.base.errors import InvalidConfig, SimrobError, shortened
from simrob_drake.base.files import ROBOT_FILE
from simrob_drake.base.messages import compound
from simrob_drake.base.packages import PACKAGE_URI, Border, OutsideBorder, package_path, resolved
from simrob_drake.base.yaml_files import is_yaml_name
from simrob_drake.importer.importing import robot_from_file
from simrob_drake.importer.meshes.places import MeshPlaces
from simrob_drake.parts.controllers.own import class_from
from simrob_drake.robots.catalog import RobotModel, load_robot_file
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.robots.pieces import described_piece
from simrob_drake.robots.urdf import mesh_file
from simrob_drake.stations.config import StationConfig

_LISTS = ("mesh_path", "add_directives")
"""Keys whose values are lists of paths."""
_OF_ROBOTS = ("urdf", "model", "reference.file", *(f"import_options.{key}" for key in ("mesh_path", "hand", "srdf")))
_KEYS = (
    "start",
    "add_directives",
    "packages.*",
    "program",
    "program.file",
    "reference.file",
    "prescribed.*.file",
    "floor.terrain.file",
    *(f"{robot}.{key}" for robot in ("robot", "robots.*") for key in _OF_ROBOTS),
    "pieces.*.mesh",
    "pieces.*.model",
    "controllers.*.network",
    "controllers.*.class",
)


def located(content: Mapping[str, Any], folder: Path, border: Border | None = None) -> dict[str, Any]:
    """Return sections with absolute paths from a folder, within a border; raises InvalidConfig: beyond it."""
    result: dict[str, Any] = deepcopy(dict(content))
    for section, last, key in paths_in(result):
        value = section[last]
        if last == "class":
            section[last] = class_from(value, folder)  # which is code: that is allowed by itself
            continue
        paths = [_located_path(path, key, folder, border) for path in (value if isinstance(value, list) else [value])]
        if border is not None:
            for path in paths:
                border.check(Path(path), key)
        section[last] = paths if isinstance(value, list) else paths[0]
    return result


def _located_path(path: object, key: str, folder: Path, border: Border | None) -> str:
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
        return str(folder / text)
    own_border = border or Border(folder / "station.yaml")
    try:
        return str(package_path(text, own_border))
    except OutsideBorder as problem:
        raise InvalidConfig(
            own_border.source, key, compound("{path} {problem}", path=shortened(text, 300), problem=problem)
        ) from problem


def located_changes(changes: Mapping[str, Any], folder: Path, border: Border | None = None) -> dict[str, Any]:
    """Return changes of a station, by dotted keys, with absolute paths; parameters and errors as of :func:`located`."""
    result = dict[str, Any]()
    for key, value in changes.items():
        whole: Any = value
        for part in reversed(key.split(".")):
            whole = {part: whole}
        whole = located(whole, folder, border)
        for part in key.split("."):
            whole = whole[part]
        result[key] = whole
    return result


def located_program(program: Mapping[str, Any], folder: Path, border: Border | None) -> dict[str, Any]:
    """Return a program as its station carries it, unnamed, paths absolute; otherwise as :func:`located`."""
    result = deepcopy({key: value for key, value in program.items() if key != "station"})
    changes = result.get("changes")
    for change in changes if isinstance(changes, list) else []:
        if isinstance(change, dict) and isinstance(change.get("set"), dict):
            change["set"] = located_changes(change["set"], folder, border)
    return result


def located_station(station: str, file: Path) -> str:
    """Return a station's name, or its file's path from another file; raises InvalidConfig: it may not be read."""
    if not is_yaml_name(station):
        return station
    near = file.absolute().parent / station
    path = near if near.is_file() else Path(station).absolute()
    Border(file).check(path, "station")
    return str(path)


def paths_in(content: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str, str]]:
    """Yield each section of a station with a key that names a file or folders, that key, and its whole key."""
    for way in _KEYS:
        yield from _paths_at(content, way.split("."))


def _paths_at(node: Any, way: list[str], before: str = "") -> Iterator[tuple[dict[str, Any], str, str]]:
    """Yield the sections on a way that end in a path, with its key there and its whole key."""
    if not isinstance(node, dict):
        return
    for key in list(node) if way[0] == "*" else way[:1]:
        value = node.get(key)
        if len(way) > 1:
            yield from _paths_at(value, way[1:], f"{before}{key}.")
        elif key == "model" and not is_yaml_name(str(value)):
            continue  # it is a name
        elif isinstance(value, list if key in _LISTS else str):
            yield node, key, f"{before}{key}"


FILES = "files"  # the folder of the copies
_FILES = (ROBOT_FILE, "gaits.yaml", "walking.yaml")  # what is read of a robot beside its URDF


def carried(config: StationConfig, folder: Path) -> StationConfig:
    """Return a station that names copies of its files in a folder, by paths from there; robots as imported.

    Paths that are relative already stay, and so does what cannot be read any more. Raises OSError: the disk does not
    take the copies.
    """
    content = config.model_dump(mode="json", exclude_none=True)
    for section, last, key in paths_in(content):
        if last in _FILES_OF and Path(section[last]).is_absolute():
            place = Path(FILES, *key.split(".")[:-1])
            with suppress(SimrobError):
                options = ImportOptions.model_validate(section.get("import_options") or {})
                main, files = _FILES_OF[last](Path(section[last]), key, options)
                for file in dict.fromkeys((main, *files)):
                    if file.is_relative_to(main.parent):
                        copy = folder / place / file.relative_to(main.parent)
                        copy.parent.mkdir(parents=True, exist_ok=True)
                        shutil.copyfile(file, copy)
                section[last] = str(place / main.name)
                section.pop("import_options", None)
    return StationConfig.model_validate(content)


def _of_robot(model: RobotModel, main: Path) -> tuple[Path, list[Path]]:
    folder = resolved(model.folder)
    files = [folder / name for name in (*_FILES, *([model.urdf] if model.urdf else [])) if (folder / name).is_file()]
    names = [mesh.get("filename", "") for mesh in model.element.iter("mesh")] if model.urdf else []
    return folder / main.name, [*files, *_with_needed(mesh_file(name, folder) for name in dict.fromkeys(names))]


def _of_urdf(file: Path, _: str, options: ImportOptions) -> tuple[Path, list[Path]]:
    model = robot_from_file(file, options)
    return _of_robot(model, model.urdf_path)


def _of_description(file: Path, key: str, _: ImportOptions) -> tuple[Path, list[Path]]:
    if not key.startswith("pieces."):
        return _of_robot(load_robot_file(file), file)
    piece, main = described_piece(file), resolved(file)
    return main, _with_needed(mesh_file(shape.mesh, main.parent) for shape in piece.shapes if shape.mesh)


_FILES_OF: Mapping[str, Callable[[Path, str, ImportOptions], tuple[Path, list[Path]]]] = {
    "urdf": _of_urdf,
    "model": _of_description,
    "mesh": lambda file, *_: (resolved(file), _with_needed([resolved(file)])),
    **dict.fromkeys(("network", "file", "start"), lambda file, *_: (resolved(file), [])),
}  # by the last part of a key: the main file behind its path, and what else is read with it


def _with_needed(meshes: Iterable[Path]) -> list[Path]:
    """Return meshes, and the materials and textures that they name."""
    files = list[Path]()
    for mesh in meshes:
        files += [mesh, *MeshPlaces(mesh).needed_by(mesh)[0].values()]
    return files
