"""The outer loops that a station can have: its own, and those of other stations with its robot; switched on and off."""

from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from simrob_drake.errors import one_of
from simrob_drake.files import diagrams_root
from simrob_drake.parts.sensors import Sensors
from simrob_drake.stations.config import StationConfig
from simrob_drake.yaml_files import read_yaml

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
                known.setdefault(name, {f"controllers.{name}": section, **_sensors(section, content)})
    return known


def switched(known: dict[str, Settings], settings: Settings, name: str, on: bool) -> Settings:
    """Return the settings of a station with a loop switched on or off.

    Raises:
        UnknownName: no such loop; proposes the nearest.
    """
    needed, key = known[one_of("loop", name, known)], f"controllers.{name}"
    others = {other for loop in loops_on(known, settings) if loop != name for other in known[loop]}
    dropped = {key, *needed} - others
    left = {other: value for other, value in settings.items() if other not in dropped}
    return left | (needed if on else {} if needed else {key: None})


def loops_on(known: dict[str, Settings], settings: Settings) -> list[str]:
    """Return the loops that a station has with its settings: its own unless taken out, and those that are given."""
    return [name for name, needed in known.items() if settings.get(f"controllers.{name}", not needed)]


def _sensors(section: Any, content: dict[str, Any]) -> Settings:
    """Return the sensors that a loop reads, and those that they read, as settings."""
    read = section.get("reads", {}) if isinstance(section, dict) else {}
    named = {str(value) for value in (read.values() if isinstance(read, dict) else [])}
    sensors = content.get("sensors", {})
    sections = TypeAdapter(Sensors).validate_python(sensors)
    named |= {other for name in named & {*sections} for other in sections[name].read(sections).values()}
    return {f"sensors.{name}": sensor for name, sensor in sensors.items() if name in named}
