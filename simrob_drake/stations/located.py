"""The keys of a station that name files: where relative paths start, and what a file may name."""

from collections.abc import Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

from simrob_drake.importer.packages import Border
from simrob_drake.parts.controllers.own import class_from
from simrob_drake.yaml_files import YAML_SUFFIXES

_ROBOT = ("urdf", "model", "reference.file", "import_options.mesh_path")
_KEYS = (
    "start",
    "program",
    "program.file",
    "reference.file",
    "prescribed.*.file",
    *(f"{robot}.{key}" for robot in ("robot", "robots.*") for key in _ROBOT),
    "pieces.*.mesh",
    "pieces.*.model",
    "controllers.*.network",
    "controllers.*.class",
)


def located(content: Mapping[str, Any], folder: Path, border: Border | None = None) -> dict[str, Any]:
    """Return sections of a station with absolute paths.

    Args:
        content: the sections.
        folder: where relative paths start.
        border: of the file in which they stand; None where the user says them.

    Raises:
        InvalidConfig: a path that may not be read; the message names file, key and what would allow it.
    """
    result: dict[str, Any] = deepcopy(dict(content))
    for section, last, key in paths_in(result):
        value = section[last]
        if last == "class":
            section[last] = class_from(value, folder)  # which is code: that is allowed by itself
            continue
        paths = [str(folder / str(path)) for path in (value if isinstance(value, list) else [value])]
        if border is not None:
            for path in paths:
                border.check(Path(path), key)
        section[last] = paths if isinstance(value, list) else paths[0]
    return result


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
    """Return the content of a program as a station carries it: its changes with absolute paths, and no station's name.

    Parameters and errors are as of :func:`located`.
    """
    result = deepcopy({key: value for key, value in program.items() if key != "station"})
    changes = result.get("changes")
    for change in changes if isinstance(changes, list) else []:
        if isinstance(change, dict) and isinstance(change.get("set"), dict):
            change["set"] = located_changes(change["set"], folder, border)
    return result


def located_station(station: str, file: Path) -> str:
    """Return the name of a station, or the path of its file, that another file names from where it lies.

    Raises:
        InvalidConfig: a path that may not be read; the message names file, key and what would allow it.
    """
    if Path(station).suffix not in YAML_SUFFIXES:
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
        elif isinstance(value, list if key == "mesh_path" else str) and _is_path(key, value):
            yield node, key, f"{before}{key}"


def _is_path(key: str, value: object) -> bool:
    return key != "model" or str(value).endswith(YAML_SUFFIXES)  # else it is a name
