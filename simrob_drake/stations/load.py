"""From a name or a YAML file, and what the user wants changed, to a checked :class:`StationConfig`."""

import re
from collections.abc import Mapping
from copy import deepcopy
from os.path import exists, isdir, isfile  # which are false for names that no file can have
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, TypeAdapter, ValidationError

from simrob_drake.errors import InvalidConfig, InvalidParameter, SimrobError, UnknownName, quoted
from simrob_drake.given import instance
from simrob_drake.parts.controllers.own import OwnController, class_beside
from simrob_drake.parts.kinds import models_by_kind
from simrob_drake.parts.references import ReferenceConfig
from simrob_drake.paths import diagrams_root
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import check_parts, resolve
from simrob_drake.stations.solver_config import SolverConfig
from simrob_drake.yaml_files import YAML_SUFFIXES, read_yaml, validated

ONLY_ROBOT = "robot"
"""The name of the robot of a station that says ``robot:`` instead of ``robots:``."""

ENTRIES = ("pieces", "sensors", "monitors", "forces", "controllers")
"""Sections of entries by name, which an override can take out: `pieces.load=null`."""

_ROBOTS = (ONLY_ROBOT, "robots")
_ORIGINS = {"urdf": ("model",), "model": ("urdf", "import_options")}
"""What a robot can come from, and which keys of its section a change of that takes away."""

_KINDS = {"reference": ReferenceConfig, "solver": SolverConfig}


def station_names() -> list[str]:
    """Return the names of the stations that come with the package."""
    return sorted(file.stem for file in diagrams_root().glob("*.yaml"))


def load_station(
    name_or_path: str | Path,
    overrides: Mapping[str, Any] | None = None,
    *,
    called: Mapping[str, str] | None = None,
    allow_code: bool = False,
) -> StationConfig:
    """Return the configuration of a station.

    Args:
        name_or_path: a name of :func:`station_names`, or a YAML file.
        overrides: what to change; keys may be dotted paths, as in ``{"servo.kp": 500}``, or nested mappings. A mapping
            of another ``kind`` takes the place of the section; a dotted ``.kind`` alone keeps those keys of the file
            that the new kind knows. None takes out a piece, sensor, monitor, force or controller.
        called: what errors call an override by its key; ``override KEY`` unless given.
        allow_code: whether the station may name Python code that is run with it, as controllers of kind ``own`` are.

    Raises:
        UnknownName: no such station, robot or piece.
        InvalidConfig: an entry that cannot be; the message names file or override, key and what would be right.
    """
    path, overrides = _station_file(name_or_path), {} if overrides is None else overrides
    for key in instance(overrides, "overrides", Mapping, "a mapping of keys to values"):
        instance(key, "overrides", str, "a mapping whose keys are texts, such as 'servo.kp'")
    try:
        return _loaded(path, overrides, path, allow_code)
    except SimrobError as problem:
        culprits = _culprits(path, overrides, getattr(problem, "key", ""), allow_code)
        if not culprits:
            raise
    names = {key: f"override {key}" for key in culprits} | dict(called or {})
    return _loaded(path, overrides, ", ".join(names[key] for key in culprits), allow_code)


def _culprits(path: Path, overrides: Mapping[str, Any], wrong: str, allow_code: bool) -> list[str]:
    """Return the keys of the overrides that spoil a station; none where its file is to blame.

    That is the one to which the ``wrong`` key belongs, else the first that spoils it alone, else all together.
    """

    def loads(changes: Mapping[str, Any]) -> bool:
        try:
            _loaded(path, changes, path, allow_code)
        except SimrobError:
            return False
        return True

    if not loads({}):
        return []
    named = [key for key in overrides if re.match(rf"{re.escape(key)}(\W|$)", wrong)]
    return named[-1:] or next(([key] for key in overrides if not loads({key: overrides[key]})), list(overrides))


def _loaded(path: Path, overrides: Mapping[str, Any], where: Path | str, allow_code: bool) -> StationConfig:
    """Return the configuration of a station's file; ``where`` is to blame for what is wrong with it."""
    content = _with_absolute_paths(read_yaml(path), path.parent)
    return _configured({"name": path.stem, **content}, overrides, where, allow_code)


def with_settings(config: StationConfig, settings: Mapping[str, Any], where: str = "settings") -> StationConfig:
    """Return a configuration with changes, as :func:`load_station` takes them.

    Raises:
        InvalidConfig: an entry that cannot be; the message names ``where``, key and what would be right.
    """
    if not settings:
        return config
    trusted = any(isinstance(controller, OwnController) for controller in config.controllers.values())
    return _configured(yaml.safe_load(station_yaml(config)), settings, where, allow_code=trusted)


def _configured(
    content: dict[str, Any], overrides: Mapping[str, Any], where: Path | str, allow_code: bool
) -> StationConfig:
    for key, value in sorted(overrides.items(), key=lambda entry: not entry[0].endswith(".kind")):
        _override(content, key.split("."), value, where)
    content = _with_absolute_paths(content, Path.cwd())
    content = _without_sugar(content, where)
    try:
        config = validated(StationConfig, content, where)
    except InvalidConfig as problem:
        raise InvalidConfig(where, _as_written(problem.key), _as_written(problem.problem)) from problem
    for name, controller in config.controllers.items():
        if isinstance(controller, OwnController) and not allow_code:
            told = f"would run the code {controller.class_}; if you trust it, say allow_code=True, or --allow-code"
            raise InvalidConfig(where, f"controllers.{name}", told)
    try:
        check_parts(resolve(config))
    except SimrobError as problem:
        raise InvalidConfig(where, "", _as_written(str(problem))) from problem
    return config


def station_yaml(config: StationConfig, *, only: Mapping[str, Any] | None = None) -> str:
    """Return the YAML text of a configuration, or of the keys that are named; loading all of it gives an equal one."""
    content = config.model_dump(mode="json", exclude_none=True, include=only)
    if only is None and list(config.robots) == [ONLY_ROBOT]:
        content["robot"] = content.pop("robots")[ONLY_ROBOT]
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None)


def _station_file(name_or_path: str | Path) -> Path:
    if not isinstance(name_or_path, (str, Path)):
        raise InvalidParameter("station", quoted(name_or_path), "a name of `simrob list`, or a YAML file")
    path = Path(name_or_path)
    if str(name_or_path) in station_names():
        return diagrams_root() / f"{name_or_path}.yaml"
    if isdir(path):
        inside = path / "station.yaml"
        hint = f"; did you mean {inside}?" if isfile(inside) else ""
        raise InvalidConfig(path, "", f"is a folder, and a station is a name or a YAML file{hint}")
    if path.suffix not in YAML_SUFFIXES:
        raise UnknownName("station", str(name_or_path), station_names())
    if not exists(path):
        raise InvalidConfig(path, "", "there is no such file")
    return path.resolve()


def _section_of(content: dict[str, Any], key: list[str], where: Path | str) -> dict[str, Any]:
    """Return the section that a dotted key stands in, making sections on the way."""
    node = content
    for depth, part in enumerate(key[:-1]):
        child = node.get(part)
        if child is None:
            child = node[part] = {}
        if not isinstance(child, dict):
            raise InvalidConfig(
                where, ".".join(key[: depth + 1]), f"is {quoted(child)}, so it has no key '{key[depth + 1]}'"
            )
        node = child
    return node


def _override(content: dict[str, Any], key: list[str], value: Any, where: Path | str) -> None:
    """Set the value under a dotted key."""
    node = _section_of(content, key, where)
    section = key[-2] if len(key) > 1 else ""
    if value is None and section in ENTRIES and len(key) == 2 and key[-1] in node:
        del node[key[-1]]
        return
    if key[0] in _ROBOTS and key[-1] in _ORIGINS and value is not None:
        for other in _ORIGINS[key[-1]]:
            node.pop(other, None)
    if key[-1] == "kind" and section in _KINDS and isinstance(value, str) and node.get("kind") != value:
        _change_kind(node, _KINDS[section], value)
    old, kind = node.get(key[-1]), value.get("kind") if isinstance(value, Mapping) else None
    if isinstance(value, Mapping) and value and isinstance(old, dict) and kind in (None, old.get("kind", key[-1])):
        for inner in value:
            instance(inner, ".".join(key), str, "a section whose keys are texts")
        for inner in value:
            _override(content, [*key, inner], value[inner], where)
    else:
        node[key[-1]] = _copied(value, key, where)


def _copied(value: Any, key: list[str], where: Path | str) -> Any:
    try:
        return deepcopy(value)
    except Exception as problem:  # what cannot be copied raises whatever it likes
        told = f"is {quoted(value)}, which no station's file could hold"
        raise InvalidConfig(where, ".".join(key), told) from problem


def _change_kind(section: dict[str, Any], union: Any, kind: Any) -> None:
    """Drop the keys of a section that its new kind does not know, or whose values it does not take."""
    for name, model in models_by_kind(union).items():
        if name == kind:
            for key in [key for key in section if not _accepted(model, key, section[key])]:
                del section[key]


def _accepted(model: type[BaseModel], key: str, value: Any) -> bool:
    if key not in model.model_fields:
        return False
    kind: Any = model.model_fields[key].annotation
    try:
        TypeAdapter[Any](kind).validate_python(value)
    except ValidationError:
        return False
    return True


def _with_absolute_paths(content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Make the paths in a station's sections absolute, wherever a robot, a reference or a piece may stand."""
    result = deepcopy(content)
    if isinstance(result.get("start"), str):
        result["start"] = str(folder / result["start"])
    robots, pieces = (entries if isinstance(entries := result.get(key), dict) else {} for key in ("robots", "pieces"))
    sections = [result, result.get("robot"), *robots.values(), *pieces.values()]
    controllers = entries if isinstance(entries := result.get("controllers"), dict) else {}
    for controller in controllers.values():
        if isinstance(controller, dict) and isinstance(controller.get("class"), str):
            controller["class"] = class_beside(controller["class"], folder)
        if isinstance(controller, dict) and isinstance(controller.get("network"), str):
            controller["network"] = str(folder / controller["network"])
    for section in [section for section in sections if isinstance(section, dict)]:
        for owner, key in ((section, "urdf"), (section, "mesh"), (section.get("reference"), "file")):
            if isinstance(owner, dict) and isinstance(owner.get(key), str):
                owner[key] = str(folder / owner[key])
        options = section.get("import_options")
        if isinstance(options, dict) and isinstance(options.get("mesh_path"), list):
            options["mesh_path"] = [str(folder / str(place)) for place in options["mesh_path"]]
        if str(section.get("model")).endswith(YAML_SUFFIXES):  # else it is a name
            section["model"] = str(folder / section["model"])
    return result


def _as_written(text: str) -> str:
    """Return a key or a message with the keys as the user wrote them."""
    return re.sub(rf"\brobots\.{ONLY_ROBOT}\b", ONLY_ROBOT, text)


def _without_sugar(content: dict[str, Any], where: Path | str) -> dict[str, Any]:
    """Write ``robot:`` as ``robots:`` with one entry."""
    if "robot" not in content:
        return content
    if "robots" in content:
        raise InvalidConfig(where, "robot", "a station has either robot: or robots:")
    return {"robots" if key == "robot" else key: {ONLY_ROBOT: v} if key == "robot" else v for key, v in content.items()}
