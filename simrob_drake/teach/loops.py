"""The outer loops that a station's robot can be given: its own, and those of the package's stations with that robot."""

from typing import Any

from simrob_drake.errors import one_of
from simrob_drake.paths import diagrams_root
from simrob_drake.stations.config import StationConfig
from simrob_drake.yaml_files import read_yaml

Settings = dict[str, Any]


def loops_known(own: StationConfig) -> dict[str, Settings]:
    """Return loops by name, each with the settings that give it to a station; none for the station's own."""
    known: dict[str, Settings] = {name: {} for name in own.controllers}
    models = {entry.model for entry in own.robots.values()}
    if len(own.robots) != 1 or own.mode != "dynamic":
        return known
    for file in sorted(diagrams_root().glob("*.yaml")):
        content = read_yaml(file)
        if content.get("robot", {}).get("model") in models:
            for name, section in content.get("controllers", {}).items():
                known.setdefault(name, {f"controllers.{name}": section, **_sensors(section, content)})
    return known


def switched(own: StationConfig, settings: Settings, name: str, on: bool) -> Settings:
    """Return the settings with a loop switched on or off.

    Raises:
        UnknownName: no such loop; proposes the nearest.
    """
    known = loops_known(own)
    needed, key = known[one_of("loop", name, known)], f"controllers.{name}"
    others = {other for loop in loops_on(own, settings) - {name} for other in known[loop]}
    left = {other: value for other, value in settings.items() if other != key and other not in needed.keys() - others}
    return left | (needed if on else {} if needed else {key: None})


def loops_on(own: StationConfig, settings: Settings) -> set[str]:
    """Return the loops that a station has with its settings."""
    given = {key.removeprefix("controllers."): value for key, value in settings.items() if key.count(".") == 1}
    return {name for name in loops_known(own) if given.get(name, name in own.controllers or None)}


def _sensors(section: Any, content: dict[str, Any]) -> Settings:
    """Return the sensors that a loop reads, as settings."""
    read = section.get("reads", {}) if isinstance(section, dict) else {}
    named = {str(value) for value in (read.values() if isinstance(read, dict) else [])}
    return {f"sensors.{name}": sensor for name, sensor in content.get("sensors", {}).items() if name in named}
