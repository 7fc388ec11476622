"""From a name or a YAML file, and what the user wants changed, to a checked :class:`StationConfig`."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from functools import cache, partial
from os.path import exists, isdir, isfile  # which are false for names that no file can have
from pathlib import Path
from typing import Any

import yaml
from pydantic import TypeAdapter

from simrob_drake.arguments import as_path, instance
from simrob_drake.errors import InvalidConfig, InvalidParameter, SimrobError, UnknownName, one_of, quoted
from simrob_drake.files import diagrams_root, station_files
from simrob_drake.importer.packages import Border, is_robot_file
from simrob_drake.parts.sensors import Sensors
from simrob_drake.sections import validated
from simrob_drake.stations.change_of_kind import KeyLosses, kind_of
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.located import located, located_program
from simrob_drake.stations.resolve import check_parts, resolve
from simrob_drake.yaml_files import YAML_SUFFIXES, place_of, read_yaml

ONLY_ROBOT = "robot"  # the name of the robot of a station that says ``robot:`` instead of ``robots:``

ENTRIES = ("pieces", "sensors", "monitors", "couplings", "forces", "controllers")
"""Sections of entries by name, which an override can take out: `pieces.load=null`."""

_ROBOTS = (ONLY_ROBOT, "robots")
_ORIGINS = {"urdf": ("model",), "model": ("urdf", "import_options")}
"""What a robot can come from, and which keys of its section a change of that takes away."""


def station_names() -> list[str]:
    """Return the names of the stations that come with the package."""
    return list(station_files())


def load_station(
    name_or_path: str | Path,
    overrides: Mapping[str, Any] | None = None,
    *,
    called: Mapping[str, str] | None = None,
    allow_code: bool = False,
    mesh_path: Iterable[Path | str] = (),
) -> StationConfig:
    """Return the configuration of a station.

    What its file names (robots, meshes, tables, networks) lies in the file's own package, that is below the nearest
    folder with a ``package.xml`` or a repository in it, else below the file's own folder; or where ``mesh_path``, or
    the environment variable ``SIMROB_MESH_PATH``, allows. Overrides may name any file.

    Args:
        name_or_path: a name of :func:`station_names`, or a YAML file.
        overrides: what to change; keys may be dotted paths, as in ``{"servo.kp": 500}``, or nested mappings. A section
            of another ``kind`` begins from the defaults of that kind and the other overrides, without the keys that
            the file has for the old kind; the warning ``KeysLeftOut`` names these. None takes out a piece, sensor,
            monitor, force or controller.
        called: what errors call an override by its key; ``override KEY`` unless given.
        allow_code: whether the station may name Python code that is run with it, as controllers of kind ``own`` are.
        mesh_path: folders in which what it names, meshes and packages may be read, too.

    Raises:
        UnknownName: no such station, robot or piece.
        InvalidConfig: an entry that cannot be; the message names file or override, key and what would be right.
    """
    path, overrides = _station_file(name_or_path), {} if overrides is None else overrides
    allowed = tuple(as_path(folder, "mesh_path").absolute() for folder in mesh_path)
    for key in instance(overrides, "overrides", Mapping, "a mapping of keys to values"):
        instance(key, "overrides", str, "a mapping whose keys are texts, such as 'servo.kp'")
    load = partial(_loaded, path, allow_code=allow_code, mesh_path=allowed)
    try:
        return load(overrides, path)
    except SimrobError as problem:
        culprits = _culprits(load, overrides, getattr(problem, "key", ""))
        if not culprits:
            raise
    names = {key: f"override {key}" for key in culprits} | dict(called or {})
    return load(overrides, ", ".join(names[key] for key in culprits))


def _culprits(load: Callable[..., StationConfig], overrides: Mapping[str, Any], wrong: str) -> list[str]:
    """Return the keys of the overrides that spoil a station; none where its file is to blame.

    That is the one to which the ``wrong`` key belongs, else the first that spoils it alone, else all together.
    """

    def loads(changes: Mapping[str, Any]) -> bool:
        try:
            load(changes, "")
        except SimrobError:
            return False
        return True

    if not loads({}):
        return []
    named = [key for key in overrides if re.match(rf"{re.escape(key)}(\W|$)", wrong)]
    return named[-1:] or next(([key] for key in overrides if not loads({key: overrides[key]})), list(overrides))


def _loaded(
    path: Path, overrides: Mapping[str, Any], where: Path | str, *, allow_code: bool, mesh_path: tuple[Path, ...]
) -> StationConfig:
    """Read a station's file and apply overrides. Paths in the file start at the file's folder."""
    border = Border(path, mesh_path)
    content = located(read_yaml(path), path.parent, border)
    if "program" in content:
        content["program"] = _inlined(content["program"], path.parent, border)
    return _configured({"name": path.stem, **content}, overrides, where, allow_code, mesh_path)


def bare_station(robot: str, overrides: Mapping[str, Any] | None = None) -> StationConfig:
    """Return a station of a robot alone, by its name or the file of its URDF; kinematic unless overrides say otherwise.

    Raises SimrobError: no such robot, or an override that cannot be.
    """
    origin = "urdf" if is_robot_file(robot) else "model"
    content = {"name": Path(robot).stem, "mode": "kinematic", ONLY_ROBOT: {origin: robot}}
    return _configured(content, overrides or {}, robot, allow_code=False)


def with_settings(config: StationConfig, settings: Mapping[str, Any], where: str = "settings") -> StationConfig:
    """Return a configuration with changes, as :func:`load_station` takes them.

    Raises InvalidConfig: an entry that cannot be; names ``where``, the key, and what would be right.
    """
    if not settings:
        return config
    trusted = any(controller.kind == "own" for controller in config.controllers.values())
    content = station_content(config)
    return _configured(content, settings, where, allow_code=trusted, is_complete=True)


def _configured(
    content: dict[str, Any],
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
        overrides: new values, by dotted key such as ``servo.kp``.
        where: name of the file or of the overrides, for errors.
        allow_code: whether the station may name Python code that is run.
        mesh_path: further folders from which meshes and packages may be read.
        is_complete: whether the content has all keys, including those with default values, as the content of a
            configuration has.
        warns: whether to warn of keys that are dropped because the kind of their section changes.

    Raises:
        InvalidConfig: an entry is invalid; the error names ``where`` and the key.
    """
    # An override of one axis, such as servo.kp.joint_1, where the file has one number for all axes. The number must be
    # written by axis first, and the names of the axes are known only after the other overrides.
    alone = [key for key in overrides if _of_one_number(content, key.split("."))]
    if alone:
        others = {key: value for key, value in overrides.items() if key not in alone}
        config = _configured(deepcopy(content), others, where, allow_code, mesh_path, warns=False)
        _write_by_axis(content, alone, {name: robot.axes for name, robot in resolve(config).robots.items()})
    losses = KeyLosses(counts_defaults=not is_complete)
    # The kind of a section is changed first, which drops the keys of the old kind. Other overrides are set afterwards.
    for key, value in sorted(overrides.items(), key=lambda entry: _rank(entry[0].split("."))):
        _override(content, key.split("."), value, where, losses)
    content = located(content, Path.cwd())
    content = _without_sugar(content, where)
    robots = content.get("robots")
    for robot in robots.values() if isinstance(robots, dict) and mesh_path else ():
        options = (robot.get("import_options") or {}) if isinstance(robot, dict) and robot.get("urdf") else None
        if isinstance(options, dict):
            before = options.get("mesh_path") or []
            robot["import_options"] = {**options, "mesh_path": list(dict.fromkeys([*before, *map(str, mesh_path)]))}
    try:
        config = validated(StationConfig, content, where)
    except InvalidConfig as problem:
        raise InvalidConfig(where, _as_written(problem.key), _as_written(problem.problem)) from problem
    for name, controller in config.controllers.items():
        if controller.kind == "own" and not allow_code:
            expected = f"would run the code {controller.class_}; if you trust it, say allow_code=True, or --allow-code"
            raise InvalidConfig(where, f"controllers.{name}", expected)
    try:
        check_parts(resolve(config))
    except SimrobError as problem:
        raise InvalidConfig(where, "", _as_written(str(problem))) from problem
    if warns:
        losses.warn()
    return config


def station_content(config: StationConfig, *, only: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return a configuration, or the keys of it that are named, as a station's file has them."""
    content = config.model_dump(mode="json", exclude_none=True, include=only)
    if only is None and list(config.robots) == [ONLY_ROBOT]:
        content["robot"] = content.pop("robots")[ONLY_ROBOT]
    return content


def station_yaml(config: StationConfig, *, only: Mapping[str, Any] | None = None) -> str:
    """Return the YAML text of a configuration, or of the keys that are named; loading all of it gives an equal one."""
    content = station_content(config, only=only)
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None)


def _station_file(name_or_path: str | Path) -> Path:
    """Find the file of a station by its name or path; raises UnknownName or InvalidConfig if there is no such file."""
    if not isinstance(name_or_path, (str, Path)):
        raise InvalidParameter("station", quoted(name_or_path), "a name of `simrob list`, or a YAML file")
    path = Path(name_or_path)
    if str(name_or_path) in station_names():
        return station_files()[str(name_or_path)]
    if isdir(path):
        inside = path / "station.yaml"
        hint = f"; did you mean {inside}?" if isfile(inside) else ""
        raise InvalidConfig(path, "", f"is a folder, and a station is a name or a YAML file{hint}")
    named_file = path.suffix or len(path.parts) > 1
    if path.suffix not in YAML_SUFFIXES and (exists(path) or not named_file):
        raise UnknownName("station", str(name_or_path), station_names())
    if not exists(path):
        raise InvalidConfig(path, "", "there is no such file")
    return path.resolve()


def _inlined(program: Any, folder: Path, border: Border | None = None) -> Any:
    """Return a station's program, which may be a file's path, as its content with absolute paths."""
    if isinstance(program, str):
        file = folder / program
        return located_program(read_yaml(file), file.parent, Border(file))
    return located_program(program, folder, border) if isinstance(program, Mapping) else program


def _rank(key: list[str]) -> int:
    """Return the rank of an override: kinds (0) are applied first, then the origins of robots (1), then other keys (2).

    A change of a kind or of an origin (``model`` or ``urdf``) drops keys, which other overrides may set again.
    """
    if key[-1] == "kind" and len(key) > 1:
        return 0
    return 1 if key[0] in _ROBOTS and key[-1] in _ORIGINS else 2


def _override(content: dict[str, Any], key: list[str], value: Any, where: Path | str, losses: KeyLosses) -> None:
    """Change one key of a station's content.

    Args:
        content: content of the station's file, which is changed.
        key: path of keys to the value that is changed.
        value: the new value. A mapping without a kind, or with the kind of the section, changes only the keys that the
            mapping has. A mapping of another kind replaces the section. None removes an entry, such as a piece.
        where: name of the overrides, for errors.
        losses: records the keys that sections lose because their ``kind`` changes.

    Raises:
        InvalidConfig: the key or the value is invalid.
    """
    if key == ["program"]:
        content["program"] = _inlined(value, Path.cwd())
        return
    node, last = place_of(content, key, where)
    if isinstance(node, list):
        node[int(last)] = value
        return
    section = key[-2] if len(key) > 1 else ""
    if value is None and section in ENTRIES and len(key) == 2 and last in node:
        del node[last]
        return
    if key[0] in _ROBOTS and last in _ORIGINS and value is not None:
        _drop_former_robot(node, last, value)
    if last == "kind" and section and isinstance(value, str):
        losses.begin_new_kind(node, key[:-1], value)
    if _is_part(value, node.get(last), key):
        for inner in value:
            instance(inner, ".".join(key), str, "a section whose keys are texts")
        for inner in sorted(value, key=lambda inner: _rank([*key, inner])):
            _override(content, [*key, inner], value[inner], where, losses)
    else:
        node[last] = _copied(value, key, where)


def _is_part(value: Any, old: Any, key: list[str]) -> bool:
    """Whether a new value changes some keys of the section ``old`` at a path of keys, and does not replace it."""
    # An empty mapping replaces the section.
    if not (isinstance(value, Mapping) and value and isinstance(old, dict)):
        return False
    old_kind = kind_of(old, key)
    return old_kind is None or value.get("kind", old_kind) == old_kind


def _drop_former_robot(section: dict[str, Any], origin: str, value: Any) -> None:
    """Remove the keys from a robot's section that belong to the former robot, before a new robot replaces it.

    Args:
        section: the robot's section.
        origin: ``model`` or ``urdf``, the key that names the new robot.
        value: name or file of the new robot.
    """
    for other in _ORIGINS[origin]:
        section.pop(other, None)
    if section.get(origin) != value and isinstance(section.get("initial_deg"), int | float):
        # One number for all axes was meant for the former robot. The new robot begins at its home posture.
        del section["initial_deg"]


def _of_one_number(content: Any, key: list[str]) -> bool:
    """Tell whether a key would be that of one axis in what is a number for all of them."""
    for part in key[:-1]:
        content = content.get(part) if isinstance(content, dict) else None
    return isinstance(content, (int, float)) and not isinstance(content, bool)


def _write_by_axis(content: dict[str, Any], keys: list[str], axes: Mapping[str, Sequence[str]]) -> None:
    """Write numbers for all axes of a robot as one an axis, which keys below them change for one axis alone."""
    for key in keys:
        *way, last, axis = key.split(".")
        names = axes.get(way[1] if way[:1] == ["robots"] else ONLY_ROBOT, ())
        node = content
        for part in way:
            node = node[part]
        if isinstance(number := node[last], (int, float)):
            if axis in names:
                node[last] = dict.fromkeys(names, number)
            elif axis.isdecimal():
                node[last] = [number] * len(names)


def _copied(value: Any, key: list[str], where: Path | str) -> Any:
    try:
        return deepcopy(value)
    except Exception as problem:  # what cannot be copied raises whatever it likes
        expected = f"is {quoted(value)}, which no station's file could hold"
        raise InvalidConfig(where, ".".join(key), expected) from problem


def _as_written(text: str) -> str:
    return re.sub(rf"\brobots\.{ONLY_ROBOT}\b", ONLY_ROBOT, text)


def _without_sugar(content: dict[str, Any], where: Path | str) -> dict[str, Any]:
    """Write ``robot:`` as ``robots:`` with one entry."""
    if "robot" not in content:
        return content
    if "robots" in content:
        raise InvalidConfig(where, "robot", "a station has either robot: or robots:")
    return {"robots" if key == "robot" else key: {ONLY_ROBOT: v} if key == "robot" else v for key, v in content.items()}


Settings = dict[str, Any]


def loops_known(own: StationConfig) -> dict[str, Settings]:
    """Return loops by name, each with the settings that give it to a station; none for the station's own."""
    known: dict[str, Settings] = {name: {} for name in own.controllers}
    if len(own.robots) != 1 or own.mode != "dynamic":
        return known
    (robot,) = own.robots.values()
    lent = _loops_of(diagrams_root(), robot.model)
    return known | {name: needed for name, needed in lent.items() if name not in known}


@cache
def _loops_of(folder: Path, model: str | None) -> dict[str, Settings]:
    """Return the loops of a folder's stations with a robot of a model, each with the settings that give it."""
    known: dict[str, Settings] = {}
    for file in sorted(folder.glob("*.yaml")):
        content = read_yaml(file)
        if content.get("robot", {}).get("model") == model:
            for name, section in content.get("controllers", {}).items():
                known.setdefault(name, {f"controllers.{name}": section, **_sensors_of(section, content)})
    return known


def switched(known: dict[str, Settings], settings: Settings, name: str, on: bool) -> Settings:
    """Return a station's settings with a loop on or off; raises UnknownName: no such loop; proposes the nearest."""
    needed, key = known[one_of("loop", name, known)], f"controllers.{name}"
    others = {other for loop in loops_on(known, settings) if loop != name for other in known[loop]}
    dropped = {key, *needed} - others
    left = {other: value for other, value in settings.items() if other not in dropped}
    return left | (needed if on else {} if needed else {key: None})


def loops_on(known: dict[str, Settings], settings: Settings) -> list[str]:
    """Return the loops that a station has with its settings: its own unless taken out, and those that are given."""
    return [name for name, needed in known.items() if settings.get(f"controllers.{name}", not needed)]


def _sensors_of(section: Any, content: dict[str, Any]) -> Settings:
    """Return the sensors that a loop reads, and those that they read, as settings."""
    read = section.get("reads", {}) if isinstance(section, dict) else {}
    named = {str(value) for value in (read.values() if isinstance(read, dict) else [])}
    sensors = content.get("sensors", {})
    sections = TypeAdapter(Sensors).validate_python(sensors)
    named |= {other for name in named & {*sections} for other in sections[name].read(sections).values()}
    return {f"sensors.{name}": sensor for name, sensor in sensors.items() if name in named}
