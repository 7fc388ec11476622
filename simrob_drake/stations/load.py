"""Load stations: read the YAML file, apply the user's overrides, and make a checked :class:`StationConfig`.

The *content* of a station is what its YAML file contains: nested dicts and lists that are not validated yet. An
*override* changes one value of the content. Its key is a *dotted key*, such as ``servo.kp``; split at the dots, it is
the *path* ``["servo", "kp"]`` to the value. Functions that change a content in place say so.

A station has either the section ``robots``, with a name for each robot, or the short form ``robot`` for a single one,
which is loaded as ``robots`` with the name "robot".

Errors name the file or the override that causes them: the parameter ``where`` of many functions is this name.

A *scene* is a file of another tool, such as model directives of Drake, whose models become robots and pieces. A
*border* limits the files that a station's file may name. The *kind* of a section selects one of several classes for its
keys.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace

# These functions return False for names that no file can have; methods of Path raise.
from os.path import exists, isdir, isfile
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.base.arguments import as_path, instance
from simrob_drake.base.errors import (
    InvalidConfig,
    InvalidParameter,
    SimrobError,
    UnknownName,
    quote_value,
)
from simrob_drake.base.extension import installed_extensions
from simrob_drake.base.files import model_file, station_files
from simrob_drake.base.messages import Message, join_texts, message
from simrob_drake.base.packages import Border
from simrob_drake.base.renaming import former_argument
from simrob_drake.base.sections import validate_section
from simrob_drake.base.yaml_files import is_yaml_name, place_of, read_yaml
from simrob_drake.importer.importer import CORE_SUFFIXES, SceneRequest, find_station_importer
from simrob_drake.importer.robot_files import is_robot_file
from simrob_drake.stations.change_of_kind import KeyLosses, kind_of
from simrob_drake.stations.config import NAME_OF_ONLY_ROBOT, StationConfig
from simrob_drake.stations.file_paths import program_with_absolute_paths, with_absolute_paths
from simrob_drake.stations.resolve import check_parts, resolve

ONLY_ROBOT = NAME_OF_ONLY_ROBOT
"""Name of the robot of a station that has the section ``robot:`` instead of ``robots:``."""

ENTRIES = ("pieces", "sensors", "monitors", "couplings", "forces", "controllers")
"""Sections with entries by name, each of which an override can remove: ``pieces.load=null``."""

_FILE_OF_MAPPING = "station.yaml"
"""Name of the file that a station would have that is loaded from a mapping: its stem is the name of the station."""

_ROBOT_SECTIONS = (ONLY_ROBOT, "robots")

_KEYS_OF_OTHER_ORIGIN = {"urdf": ("model",), "model": ("urdf", "import_options")}
"""The two keys that can say where a robot comes from (its *origin*), and for each of them the keys of a robot's section
that do not go with it."""

# Order in which overrides are applied: see _rank.
_KIND_RANK = 0
_ORIGIN_RANK = 1
_OTHER_RANK = 2

Content = dict[str, Any]
"""Content of a station's file or of a section: values by key, not validated."""


def station_names() -> list[str]:
    """Names of the stations that come with the package."""
    return list(station_files())


@former_argument("name_or_path", "station")
def load_station(
    station: str | Path | Mapping[str, Any],
    overrides: Mapping[str, Any] | None = None,
    *,
    called: Mapping[str, str] | None = None,
    allow_code: bool = False,
    mesh_path: Iterable[Path | str] = (),
) -> StationConfig:
    """Load the configuration of a station.

    The files that the station's file names (robots, meshes, tables, networks) may be read if they are in the same
    package, that is below the nearest folder with a ``package.xml`` or a repository in it. If there is no such folder,
    they must be below the folder of the station's file. The folders ``mesh_path`` and those of the environment variable
    ``SIMROB_MESH_PATH`` are allowed as well. Overrides may name any file.

    Args:
        station: a name of :func:`station_names`, a YAML file, or the content of such a file as a mapping with values of
            Python, also arrays of NumPy. Relative paths in a mapping start at the current folder.
        overrides: new values. Keys may be dotted, as in ``{"servo.kp": 500}``, or values nested mappings. A section
            whose ``kind`` changes has the defaults of the new kind and the other overrides; the keys that the file has
            for the old kind are left out. The warning ``KeysLeftOut`` names them; there is none if a mapping that
            contains the new kind replaces the whole section. The value None removes a piece, sensor, monitor, coupling,
            force or controller.
        called: names of overrides for error messages, by the key of the override; ``override KEY`` by default.
        allow_code: whether the station may name Python code that is run with it, as controllers of kind ``own`` do.
        mesh_path: further folders from which files, meshes and packages may be read.

    Raises:
        UnknownName: the package has no station of this name.
        InvalidConfig: there is no such file, or an entry is invalid, such as the name of a robot that does not exist;
            the message names file or override, key and what would be right.
        InvalidParameter: an argument has a wrong type.
    """
    where: Path | str
    if isinstance(station, Mapping):
        source = Path.cwd() / _FILE_OF_MAPPING
        where = message("stations.the_mapping", "station")
    else:
        source = where = _station_file(station)
    changes = {} if overrides is None else overrides
    folders = tuple(as_path(folder, "mesh_path").absolute() for folder in mesh_path)
    # Checked here, since a wrong type would only show as an unclear error of the code below.
    mapping = message("stations.mapping_to_values", "a mapping of keys to values")
    text_keys = message(
        "stations.keys_are_texts", "a mapping whose keys are texts, such as 'servo.kp'"
    )
    for key in instance(changes, "overrides", Mapping, mapping):
        instance(key, "overrides", str, text_keys)

    def load(some_changes: Mapping[str, Any], cause: Path | str) -> StationConfig:
        """Load the station with some of the overrides; errors begin with the cause."""
        if isinstance(station, Mapping):
            # The overrides change the content, and the user's mapping is to stay.
            content = _plain_content(station)
            return _make_station(
                source, content, some_changes, cause, allow_code=allow_code, mesh_path=folders
            )
        return _read_station(source, some_changes, cause, allow_code=allow_code, mesh_path=folders)

    try:
        return load(changes, where)
    except SimrobError as problem:
        culprits = _culprits(load, changes, wrong_key=getattr(problem, "key", ""))
        if not culprits:
            raise
    # Load once more: the error is raised again, and now names the overrides that cause it instead of the file.
    names: dict[str, str] = {
        key: message("stations.override", "override {key}", key=key) for key in culprits
    }
    names.update(called or {})
    return load(changes, join_texts(names[key] for key in culprits))


def _culprits(
    load: Callable[[Mapping[str, Any], str], StationConfig],
    overrides: Mapping[str, Any],
    wrong_key: str,
) -> list[str]:
    """Find the overrides that make a station invalid.

    Args:
        load: loads the station with some overrides; its second argument is the name for errors.
        overrides: all overrides, with which loading fails.
        wrong_key: dotted key that the error names; an empty text if it names none.

    Returns:
        the key of the override to which the wrong key belongs; of several, the last. If there is none, the key of the
        first override that makes the station invalid on its own. If there is none either, all keys. The list is empty
        if the station is invalid without overrides, so that its file is the cause.
    """

    def is_valid(changes: Mapping[str, Any]) -> bool:
        """Whether the station can be loaded with these overrides."""
        try:
            load(changes, "")
        except SimrobError:
            return False
        return True

    if not is_valid({}):
        return []
    # The wrong key is the key of the override or below it, such as "servo.kp.joint_1" or "pieces[0]".
    matching = [key for key in overrides if re.match(rf"{re.escape(key)}(\W|$)", wrong_key)]
    if matching:
        return matching[-1:]
    # The error names no key of an override: try each override alone.
    for key, value in overrides.items():
        if not is_valid({key: value}):
            return [key]
    return list(overrides)


def _read_station(
    path: Path,
    overrides: Mapping[str, Any],
    where: Path | str,
    *,
    allow_code: bool,
    mesh_path: tuple[Path, ...],
) -> StationConfig:
    """Read a station's file and apply overrides. Relative paths in the file start at the file's folder.

    Args:
        path: the file: YAML with the keys of a station, or a scene of another tool.
        overrides: new values, by dotted key.
        where: name of the file or of the overrides, for errors.
        allow_code: whether the station may name Python code that is run.
        mesh_path: further folders from which files may be read.
    """
    scenes = find_station_importer(path)
    if scenes is not None:
        # The file is a scene of another tool. It has no keys of a station but those of the overrides.
        named = _named_packages({}, overrides, path.parent)
        content = scenes.station_sections(path, SceneRequest(packages=named, mesh_path=mesh_path))
        return _make_config({"name": path.stem, **content}, overrides, where, allow_code, mesh_path)
    return _make_station(
        path, read_yaml(path), overrides, where, allow_code=allow_code, mesh_path=mesh_path
    )


def _make_station(
    path: Path,
    content: Content,
    overrides: Mapping[str, Any],
    where: Path | str,
    *,
    allow_code: bool,
    mesh_path: tuple[Path, ...],
) -> StationConfig:
    """Make a configuration of the content of a station's file, whose relative paths start at the file's folder.

    Args:
        path: the file, whose name is that of a station without a name of its own. A mapping in place of a file has a
            path as if it were a file of the current folder.
        content: content of the file.
        overrides: new values.
        where: name of the file or of the overrides, for errors.
        allow_code: whether the station may name Python code that is run.
        mesh_path: further folders from which files may be read.
    """
    # The border decides which files the station's file may name.
    border = Border(path, mesh_path, _named_packages(content, overrides, path.parent))
    content = with_absolute_paths(content, path.parent, border)
    if "program" in content:
        content["program"] = _program_content(content["program"], path.parent, border)
    # The station has the name of the file, unless the file gives another one.
    content = {"name": path.stem, **content}
    return _make_config(content, overrides, where, allow_code, mesh_path)


def _plain_content(value: Any) -> Any:
    """Copy a mapping of Python as a YAML file would contain it: dicts, lists, numbers and texts, and no arrays."""
    if isinstance(value, Mapping):
        return {key: _plain_content(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain_content(part) for part in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value


def bare_station(robot: str, overrides: Mapping[str, Any] | None = None) -> StationConfig:
    """Make a station that contains only a robot. The station is kinematic unless an override sets its ``mode``.

    Args:
        robot: name of a robot, or path of the file that describes it, such as a URDF.
        overrides: new values, as in :func:`load_station`.

    Raises:
        SimrobError: there is no such robot, or an override is invalid. The message begins with ``robot``
            where that of a station's file begins with the file.
    """
    origin = "urdf" if is_robot_file(robot) else "model"
    content = {"name": Path(robot).stem, "mode": "kinematic", ONLY_ROBOT: {origin: robot}}
    return _make_config(content, overrides or {}, robot, allow_code=False)


def with_settings(
    config: StationConfig,
    settings: Mapping[str, Any],
    where: str = "settings",
) -> StationConfig:
    """Change a configuration. Returns the changed copy, or the same configuration if there are no settings.

    Args:
        config: configuration of a station.
        settings: new values, as the overrides of :func:`load_station`. They may name Python code only if the
            configuration already contains controllers of kind ``own``.
        where: name of the settings for errors.

    Raises:
        InvalidConfig: a setting is invalid; the message contains ``where``, the key, and what would be right.
        InvalidParameter: a mapping among the settings has a key that is no text.
    """
    if not settings:
        return config
    # Code in the configuration has been allowed when it was loaded; settings may not bring the
    # first.
    has_own_code = any(controller.runs_code for controller in config.controllers.values())
    # Through the content of a file, so that settings mean the same as overrides.
    content = station_content(config)
    return _make_config(content, settings, where, allow_code=has_own_code, is_complete=True)


def _make_config(
    content: Content,
    overrides: Mapping[str, Any],
    where: Path | str,
    allow_code: bool,
    mesh_path: tuple[Path, ...] = (),
    *,
    is_complete: bool = False,
    warns: bool = True,
) -> StationConfig:
    """Make the configuration of a station from the content of its file and overrides.

    Args:
        content: content of the station's file, which is changed.
        overrides: new values, by dotted key.
        where: name of the file or of the overrides, for errors.
        allow_code: whether the station may name Python code that is run.
        mesh_path: further folders from which meshes and packages may be read.
        is_complete: whether the content has all keys, including those with default values, as the content of a
            configuration has. Then there is no warning of dropped keys that have default values.
        warns: whether to warn of keys that are dropped because the kind of their section changes.

    Raises:
        InvalidConfig: an entry is invalid; the error names ``where`` and the key.
        InvalidParameter: a mapping among the overrides has a key that is no text.
    """
    # An override may change one axis, such as servo.kp.joint_1, where the content, or another override, has one number
    # for all axes. The names of the axes are known only after the other overrides, which may choose another robot.
    keys_of_axes = [
        key for key in overrides if _is_below_number(content, overrides, key.split("."))
    ]
    axes: dict[str, Sequence[str]] = {}
    others = {key: value for key, value in overrides.items() if key not in keys_of_axes}
    if keys_of_axes:
        # A first configuration, of a copy of the content, only to find the names of the axes of each robot.
        before = _make_config(deepcopy(content), others, where, allow_code, mesh_path, warns=False)
        axes = {name: robot.axes for name, robot in resolve(before).robots.items()}

    # Collects warnings about keys that are dropped.
    losses = KeyLosses(counts_defaults=not is_complete)
    paths = {key: key.split(".") for key in overrides}
    for key in sorted(others, key=lambda key: _rank(paths[key])):
        _override(content, paths[key], overrides[key], where, losses)
    # Write the number for each axis before single axes get their own.
    _write_by_axis(content, keys_of_axes, axes)
    for key in keys_of_axes:
        _override(content, paths[key], overrides[key], where, losses)
    # Relative paths in overrides start at the current folder.
    content = with_absolute_paths(content, Path.cwd())
    content = _with_robots_section(content, where)
    packages = _named_packages(content, {}, Path.cwd())
    content.pop("packages", None)
    content = _with_directives(content, where, SceneRequest(packages=packages, mesh_path=mesh_path))
    _add_to_imports(content, "mesh_path", [str(folder) for folder in mesh_path])
    _add_to_imports(content, "packages", [f"{name}={folder}" for name, folder in packages.items()])
    config = _validate(content, where, allow_code)
    if warns:
        losses.warn()
    return config


def _validate(content: Content, where: Path | str, allow_code: bool) -> StationConfig:
    """Make a configuration of a complete content, and check that its parts fit each other.

    Args:
        content: content of a station, with the section ``robots``.
        where: name of the file or of the overrides, for errors.
        allow_code: whether the station may name Python code that is run.

    Raises:
        InvalidConfig: an entry is invalid; the error names ``where`` and the key.
    """
    _check_extensions(content, where)
    try:
        # Pydantic's key has the section `robots`, though the user may have written `robot`.
        config = validate_section(StationConfig, content, where)
    except InvalidConfig as problem:
        raise InvalidConfig(
            where, _in_short_form(problem.key), _in_short_form(problem.problem)
        ) from None
    for name, controller in config.controllers.items():
        if controller.runs_code and not allow_code:
            expected = message(
                "stations.would_run_code",
                "would run the Python code {code}; if you trust this code, use "
                "load_station(..., allow_code=True) or --allow-code",
                code=controller.class_,
            )
            raise InvalidConfig(where, f"controllers.{name}", expected)
    try:
        # Only now are the robots read, whose names of axes and links the parts need.
        check_parts(resolve(config))
    except SimrobError as problem:
        raise InvalidConfig(where, "", _in_short_form(str(problem))) from None
    return config


def _check_extensions(content: Content, where: Path | str) -> None:
    """Check that the extensions that a station lists under ``extensions`` are installed and in use.

    They are checked before the parts: an unknown kind of part would only be a consequence.

    Args:
        content: content of the station's file. An entry of ``extensions`` names a package, with all of its extensions,
            or one extension.
        where: name of the file, for errors.

    Raises:
        InvalidConfig: an extension is not installed, or is left out.
    """
    # Without the extension, its kinds of sensors and moves are unknown, and that error would name no package.
    entries = content.get("extensions", ())
    # If the value has a wrong type, the validation reports it later.
    are_names = isinstance(entries, list | tuple) and all(
        isinstance(entry, str) for entry in entries
    )
    if not entries or not are_names:
        return
    for entry in entries:
        matching = [
            found for found in installed_extensions() if entry in (found.package, found.name)
        ]
        if not matching:
            problem = message(
                "stations.needs_package",
                "the station needs the package {package}, which is not installed: pip install {package}",
                package=entry,
            )
            raise InvalidConfig(where, "extensions", problem)
        # An entry may name a package, which has several extensions.
        for found in matching:
            if found.problem:
                state = message(
                    "stations.extension_left_out",
                    "the extension {extension} of {package} is not used: {problem}",
                    extension=found.name,
                    package=found.package,
                    problem=found.problem,
                )
                problem = message(
                    "stations.needs_and",
                    "the station needs {package}, but {state}",
                    package=entry,
                    state=state,
                )
                raise InvalidConfig(where, "extensions", problem)


def _named_packages(
    content: Content,
    overrides: Mapping[str, Any],
    folder: Path,
) -> dict[str, Path]:
    """Find the folders of packages that the section ``packages`` of a file and its overrides name.

    Args:
        content: content of the file. A section of another form is refused by the validation later.
        overrides: new values. Their relative paths start at the current folder.
        folder: folder at which relative paths in the file start.

    Returns:
        the folders by the name of the package. Overrides replace those of the file.
    """
    found = dict[str, Path]()
    section = content.get("packages")
    if isinstance(section, dict):
        found |= {str(name): folder / str(path) for name, path in section.items()}
    changed = overrides.get("packages")
    if isinstance(changed, Mapping):
        found |= {str(name): Path.cwd() / str(path) for name, path in changed.items()}
    for key, path in overrides.items():
        if key.startswith("packages."):
            found[key.removeprefix("packages.")] = Path.cwd() / str(path)
    return found


def _with_directives(content: Content, where: Path | str, request: SceneRequest) -> Content:
    """Add the robots and pieces of the files under ``add_directives``.

    Returns a copy without this key, or the same object if it lacks the key.

    Args:
        content: content of the station's file, with absolute paths. Its own keys take the place of the same keys of
            robots and pieces that the files add.
        where: name of the station's file, for errors.
        request: packages and folders that may be read.

    Raises:
        InvalidConfig: a file is missing or no scene, or two of them have a robot or a piece of the same name.
    """
    if "add_directives" not in content:
        return content
    rest = {key: value for key, value in content.items() if key != "add_directives"}
    entries = content["add_directives"]
    added: Content = {}
    for entry in entries if isinstance(entries, list) else [entries]:
        # FILE#NAME selects one scenario of a file with several.
        name, _, scenario = str(entry).partition("#")
        file = Path(name)
        if not isfile(file):
            problem = message("stations.no_file", "there is no file {file}", file=file)
            raise InvalidConfig(where, "add_directives", problem)
        scenes = find_station_importer(file)
        if scenes is None:
            problem = message(
                "stations.no_scene",
                "{file} has no model directives of Drake: no list under the key directives",
                file=file,
            )
            raise InvalidConfig(where, "add_directives", problem)
        sections = scenes.station_sections(file, replace(request, scenario=scenario))
        for section in ("robots", "pieces"):
            for key, value in sections.get(section, {}).items():
                # Two scenes may each describe a part of one station, but not the same part.
                known = added.setdefault(section, {})
                if key in known:
                    problem = message(
                        "stations.name_in_two_scenes",
                        "two files have a model {name}; give the models different names",
                        name=key,
                    )
                    raise InvalidConfig(where, "add_directives", problem)
                known[key] = value
    # The station's own keys win, so that a user can change a robot of a scene without editing the scene.
    return _merge(added, rest)


def _merge(lower: Content, upper: Content) -> Content:
    """Merge two nested mappings. Where both have a value, that of `upper` counts."""
    result = dict(lower)
    for key, value in upper.items():
        below = result.get(key)
        result[key] = (
            _merge(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
        )
    return result


def _add_to_imports(content: Content, key: str, values: list[str]) -> None:
    """Add values to a list in the import options of each robot that the station names by ``urdf``, in place.

    Args:
        content: content of a station with the section ``robots``.
        key: key of the import options, such as ``mesh_path``.
        values: values that are added. Without any, nothing changes.
    """
    robots = content.get("robots")
    # Sections and lists of a wrong type stay as they are, and are refused by the validation later.
    if not values or not isinstance(robots, dict):
        return
    for robot in robots.values():
        if not isinstance(robot, dict) or not robot.get("urdf"):
            continue
        options = robot.get("import_options") or {}
        own_values = (options.get(key) or []) if isinstance(options, dict) else None
        if isinstance(own_values, list | tuple):
            # The robot's own values come first, since they are searched first.
            without_duplicates = list(dict.fromkeys([*own_values, *values]))
            robot["import_options"] = {**options, key: without_duplicates}


def station_content(config: StationConfig, *, only: Mapping[str, Any] | None = None) -> Content:
    """Convert a configuration to the content of a station's file, with default values and without keys that are None.

    Args:
        config: the configuration.
        only: keys to convert, as pydantic's ``include``; all by default. An only robot named ``robot`` is written under
            ``robot`` if all keys are converted, otherwise under ``robots``.
    """
    return config.to_content(only=only)


def station_yaml(config: StationConfig, *, only: Mapping[str, Any] | None = None) -> str:
    """Write a configuration as YAML text. Loading the text of a whole configuration gives an equal configuration.

    Args:
        config: the configuration.
        only: keys to write, as pydantic's ``include``; all by default.
    """
    return config.to_yaml(only=only)


def _station_file(name_or_path: str | Path) -> Path:
    """Find the file of a station by its name or path.

    Raises:
        InvalidParameter: the argument is no text and no path.
        UnknownName: the package has no station of this name, or the path is that of an existing file that is neither
            YAML nor a robot.
        InvalidConfig: the path is a folder or the file of a robot, or the file does not exist.
    """
    if not isinstance(name_or_path, (str, Path)):
        expected = message(
            "stations.station_name_or_file",
            "a name of `simrob list`, a YAML file, or a mapping with the keys of such a file",
        )
        raise InvalidParameter("station", quote_value(name_or_path), expected)
    path = Path(name_or_path)
    # Names come before paths, so that a file of that name in the working directory changes nothing.
    named = model_file("stations", str(name_or_path))
    if named is not None:
        return named
    if isdir(path):
        inside = path / "station.yaml"
        hint = ""
        if isfile(inside):
            hint = message(
                "stations.did_you_mean_inside", "; did you mean {inside}?", inside=inside
            )
        problem = message(
            "stations.is_a_folder",
            "is a folder, but a station is given by its name or a YAML file{hint}",
            hint=hint,
        )
        raise InvalidConfig(path, "", problem)
    if isfile(path) and path.suffix.lower() in CORE_SUFFIXES:
        problem = message(
            "stations.is_a_robot_file",
            "is the file of a robot, but a station is given by its name or a YAML file; simrob station {file} writes "
            "one",
            file=path,
        )
        raise InvalidConfig(path, "", problem)
    if not is_yaml_name(path):
        # A plain word is a misspelt name of a station, and so is an existing file that is not YAML.
        has_form_of_path = bool(path.suffix) or len(path.parts) > 1
        if exists(path) or not has_form_of_path:
            raise UnknownName(
                message("stations.station", "station"), str(name_or_path), station_names()
            )
    if not exists(path):
        raise InvalidConfig(path, "", message("stations.no_such_file", "there is no such file"))
    return path.resolve()


def _program_content(program: Any, folder: Path, border: Border | None = None) -> Any:
    """Content of a station's program with absolute paths. A program in a file of its own is read from this file.

    Args:
        program: value of the key ``program``: the path of the program's file, or the content of the program itself.
            Another value is returned as it is, and refused by the validation later.
        folder: folder at which relative paths start.
        border: decides which files a program that is written in the station's file may name; None allows all files. A
            program in its own file may name the files that are allowed for that file.
    """
    if isinstance(program, str):
        file = folder / program
        return program_with_absolute_paths(read_yaml(file), file.parent, Border(file))
    if isinstance(program, Mapping):
        return program_with_absolute_paths(program, folder, border)
    return program


def _rank(path: list[str]) -> int:
    """Rank of an override by its path of keys: overrides with a lower rank are applied first.

    The kind of a section comes first, then the origin of a robot, then all others. A change of a kind or an origin
    drops keys of the section, which other overrides may set again. Overrides of single axes below a number of all axes
    are no part of this order: they are applied after all others.
    """
    is_in_section = len(path) > 1
    if path[-1] == "kind" and is_in_section:
        return _KIND_RANK
    if path[0] in _ROBOT_SECTIONS and path[-1] in _KEYS_OF_OTHER_ORIGIN:
        return _ORIGIN_RANK
    return _OTHER_RANK


def _override(
    content: Content,
    path: list[str],
    value: Any,
    where: Path | str,
    losses: KeyLosses,
) -> None:
    """Change one value of a station's content in place.

    Args:
        content: content of the station's file, which is changed.
        path: path of keys to the value that is changed.
        value: the new value. A mapping without a kind, or with the kind of the section, changes only the keys that the
            mapping has. A mapping of another kind replaces the section. None removes an entry, such as a piece.
        where: name of the overrides, for errors.
        losses: empties sections whose ``kind`` changes, and records the keys that they lose.

    Raises:
        InvalidConfig: the key or the value is invalid.
        InvalidParameter: a mapping has a key that is no text.
    """
    if path == ["program"]:
        content["program"] = _program_content(value, Path.cwd())
        return
    # The section, or the list, that contains the value, and the value's key in it.
    section, key = place_of(content, path, where)
    # An index such as in `robots.arm.base.2`, which replaces one number.
    if isinstance(section, list):
        section[int(key)] = value
        return
    is_entry = len(path) == 2 and path[0] in ENTRIES
    # None removes an entry. For other keys, such as `floor`, None is a value.
    if value is None and is_entry and key in section:
        del section[key]
        return
    # Before the new robot is written, as the former one is compared with it.
    # A robot's own key: `robot.urdf` or `robots.<name>.urdf`, but not a robot that is called `urdf`.
    is_robot_key = path[:-1] == [ONLY_ROBOT] or (path[0] == "robots" and len(path) == 3)
    is_origin = is_robot_key and key in _KEYS_OF_OTHER_ORIGIN
    if is_origin and value is not None:
        _drop_former_robot(section, key, value)
    if key == "kind" and len(path) > 1 and isinstance(value, str):
        # This empties the section if it had another kind.
        losses.begin_new_kind(section, path[:-1], value)
    if not _changes_keys_only(value, section.get(key), path):
        section[key] = _copy(value, path, where)
        return
    # YAML turns a key such as 1 or on into a number or a truth value, which no key of a station is.
    text_keys = message("stations.section_of_texts", "a section whose keys are texts")
    for inner_key in value:
        instance(inner_key, ".".join(path), str, text_keys)
    # Inside of a mapping the order is the same as between overrides: a kind first.
    for inner_key in sorted(value, key=lambda inner_key: _rank([*path, inner_key])):
        _override(content, [*path, inner_key], value[inner_key], where, losses)


def _changes_keys_only(value: Any, old: Any, path: list[str]) -> bool:
    """Whether a new value changes some keys of a section, instead of replacing the section.

    It does if it is a mapping that is not empty, the present value is a section, and this section has no kind, or the
    kind that the new value has. A new value without a kind has that of the section.

    Args:
        value: the new value.
        old: the present value, or None if there is none.
        path: path of keys to the value.
    """
    if not isinstance(value, Mapping) or not value or not isinstance(old, dict):
        return False
    # A section without kinds, such as `servo`, can only be changed key by key.
    old_kind = kind_of(old, path)
    if old_kind is None:
        return True
    new_kind = value.get("kind", old_kind)
    return bool(new_kind == old_kind)


def _drop_former_robot(section: Content, origin: str, value: Any) -> None:
    """Remove the keys from a robot's section that belong to the former robot, before a new robot replaces it.

    They are the key of the other origin, for a new ``model`` also the options of an import, and, if the robot is
    another one, one initial position for all axes.

    Args:
        section: the robot's section, which is changed.
        origin: ``model`` or ``urdf``, the key that names the new robot.
        value: name or file of the new robot.
    """
    for other in _KEYS_OF_OTHER_ORIGIN[origin]:
        section.pop(other, None)
    is_other_robot = section.get(origin) != value
    if is_other_robot and isinstance(section.get("initial_deg"), int | float):
        # One number for all axes was meant for the former robot. The new robot begins at its home posture. A list or a
        # mapping stays: it gives each axis its own position, and an error names it if it does not fit the new robot.
        del section["initial_deg"]


def _is_below_number(
    content: Content,
    overrides: Mapping[str, Any],
    path: list[str],
) -> bool:
    """Whether a path leads into a number, as ``servo.kp.joint_1`` does if ``servo.kp`` is one number for all axes.

    Args:
        content: content of the station's file.
        overrides: new values by dotted key, which replace those of the content.
        path: path of keys to the value of one axis.
    """
    node: Any = content
    for key in path[:-1]:
        node = node.get(key) if isinstance(node, dict) else None
    # An override of the whole, such as `servo.kp`, is applied before, and replaces the file's
    # value.
    node = overrides.get(".".join(path[:-1]), node)
    return isinstance(node, (int, float)) and not isinstance(node, bool)


def _write_by_axis(
    content: Content,
    keys: list[str],
    axes: Mapping[str, Sequence[str]],
) -> None:
    """Give each axis an entry of its own where the content has one number for all axes, in place.

    Overrides can then change the number of a single axis. The entries are a mapping if the override names the axis, and
    a list if it has the index of the axis. If the key ends with neither, the number stays, and the override is refused
    later. So it is in the shared section ``servo`` of several robots, which have no common axes.

    Args:
        content: content of the station's file, which is changed.
        keys: dotted keys of the overrides of single axes: ``servo.kp.joint_1`` makes a mapping of the number in
            ``servo.kp``, and ``servo.kp.0`` a list.
        axes: names of the axes, by the name of the robot.
    """
    for dotted_key in keys:
        *path, number_key, axis = dotted_key.split(".")
        robot = path[1] if path[:1] == ["robots"] else ONLY_ROBOT
        names = axes.get(robot, ())
        section: Any = content
        for key in path:
            section = section.get(key) if isinstance(section, dict) else None
        number = section.get(number_key) if isinstance(section, dict) else None
        if not isinstance(number, (int, float)):
            # Replaced already: for another axis, or by another override of the section.
            continue
        if axis in names:
            section[number_key] = dict.fromkeys(names, number)
        elif names and axis.isdecimal():
            section[number_key] = [number] * len(names)


def _copy(value: Any, path: list[str], where: Path | str) -> Any:
    """Copy the value of an override, so that later changes of the content do not change the caller's object.

    Raises:
        InvalidConfig: the value cannot be copied.
    """
    try:
        return deepcopy(value)
    except Exception as problem:  # an object may raise any exception when it is copied
        text = message(
            "stations.no_file_could_hold",
            "is {value}, which cannot be written in a station's file",
            value=quote_value(value),
        )
        raise InvalidConfig(where, ".".join(path), text) from problem


def _in_short_form(text: str) -> str:
    """Replace ``robots.robot`` in an error message by ``robot``, as the station's file has it.

    A message keeps its id, so that it can be translated: the names are in its fields.
    """
    if isinstance(text, Message):
        fields = dict(text.fields)
        for name, value in text.fields.items():
            if isinstance(value, str):
                fields[name] = _in_short_form(value)
        return Message(text.id, text.template, fields, text.longest, text.is_sentence)
    return re.sub(rf"\brobots\.{ONLY_ROBOT}\b", ONLY_ROBOT, text)


def _with_robots_section(content: Content, where: Path | str) -> Content:
    """Write the short form ``robot:`` as ``robots:`` with one entry.

    Returns a changed copy, or the same object if the content does not have the short form.

    Raises:
        InvalidConfig: the content has both sections.
    """
    if ONLY_ROBOT not in content:
        return content
    if "robots" in content:
        problem = message(
            "stations.robot_or_robots",
            "a station has either the section robot or the section robots, not both",
        )
        raise InvalidConfig(where, "robot", problem)
    # A loop instead of `pop`, so that the section keeps its place in the order of keys.
    changed = Content()
    for key, value in content.items():
        if key == ONLY_ROBOT:
            changed["robots"] = {ONLY_ROBOT: value}
        else:
            changed[key] = value
    return changed
