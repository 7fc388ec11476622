"""Feedback loops that a user can switch on or off for a station, such as a force controller.

A *loop* is an entry of the section ``controllers`` of a station. A station has its *own* loops. Other loops can be
*added*: those of the package's stations with the same robot. Switching a loop changes the station's *settings*: values
by dotted key that are applied to the station when it is loaded, such as ``{"controllers.force": {...}}``. The value
None removes an entry.
"""

from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from simrob_drake.base.errors import one_of
from simrob_drake.base.files import diagrams_root
from simrob_drake.base.messages import message
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.parts.sensors import Sensors
from simrob_drake.stations.config import StationConfig

Settings = dict[str, Any]
"""Values by dotted key that change a station when it is loaded."""

KnownLoops = dict[str, Settings]
"""Loops by name, each with the settings that add it to a station; no settings for a station's own loop."""


def loops_known(station: StationConfig) -> KnownLoops:
    """Find the loops that can be switched on or off for a station: its own, and those that can be added.

    Loops can be added only to a dynamic station with a single robot that is named by its model: those of the package's
    stations with this model.
    """
    # A loop of the station's own needs no settings: its file has the section already.
    known: KnownLoops = {name: {} for name in station.controllers}
    if len(station.robots) != 1 or not station.engine.moves_by_forces:
        return known
    (robot,) = station.robots.values()
    # The stations of the package name models. A robot of a URDF file has none.
    if robot.model is None:
        return known
    for name, settings in _loops_of_stations(diagrams_root(), robot.model).items():
        if name not in known:
            known[name] = settings
    return known


@cache
def _loops_of_stations(folder: Path, model: str) -> KnownLoops:
    """Collect the loops of all stations in a folder whose section ``robot`` names a model.

    The results are kept until the program ends.

    Args:
        folder: folder with the stations' files.
        model: name of the robot's model.

    Returns:
        the loops, each with the settings that add it and its sensors to another station. Of loops with the same name,
        the one of the first station in alphabetical order is taken.
    """
    known: KnownLoops = {}
    # Sorted, as the order in which a file system lists its files is not defined.
    for file in sorted(folder.glob("*.yaml")):
        content = read_yaml(file)
        if content.get("robot", {}).get("model") != model:
            continue
        for name, section in content.get("controllers", {}).items():
            if name not in known:
                known[name] = {f"controllers.{name}": section, **_sensors_of(section, content)}
    return known


def settings_with_loop(
    known: KnownLoops,
    settings: Settings,
    name: str,
    on: bool,
) -> Settings:
    """Switch a loop on or off in the settings of a station. Returns a changed copy of the settings.

    Sensors that were added for a loop are removed with the loop, unless another loop needs them.

    Args:
        known: loops of the station, from :func:`loops_known`.
        settings: present settings of the station.
        name: name of the loop.
        on: whether to switch the loop on.

    Raises:
        UnknownName: there is no such loop; the message proposes the nearest name.
    """
    added = known[one_of(message("stations.loop", "loop"), name, known)]
    key = f"controllers.{name}"
    needed_by_others = set[str]()
    for loop in loops_on(known, settings):
        if loop != name:
            needed_by_others.update(known[loop])
    # Two loops may read the same sensor, which stays as long as one of them is on.
    dropped = {key, *added} - needed_by_others
    changed = {other: value for other, value in settings.items() if other not in dropped}
    is_own = not added
    if on:
        changed.update(added)  # nothing for an own loop, which is on without a setting
    elif is_own:
        # The file of the station has the loop, so only a setting can remove it.
        changed[key] = None
    return changed


def loops_on(known: KnownLoops, settings: Settings) -> list[str]:
    """Names of the loops that are on: the station's own unless its settings remove them, and those that are added.

    Args:
        known: loops of the station, from :func:`loops_known`.
        settings: present settings of the station.
    """
    names = []
    for name, added in known.items():
        is_own = not added
        # The setting is the section of the loop, or None if it is removed. Without a setting, only own loops are on.
        if settings.get(f"controllers.{name}", is_own):
            names.append(name)
    return names


def _sensors_of(section: Any, content: dict[str, Any]) -> Settings:
    """Find the sensors that a loop reads directly, and the sensors that these sensors read.

    Args:
        section: section of the loop.
        content: content of the station's file with the loop.

    Returns:
        settings that add the sensors to another station.
    """
    reads = section.get("reads", {}) if isinstance(section, dict) else {}
    sensors_read = (
        {str(value) for value in reads.values()} if isinstance(reads, dict) else set[str]()
    )
    contents = content.get("sensors", {})
    sensors = TypeAdapter(Sensors).validate_python(contents)
    # A loop may read other signals, too: names that are no sensors drop out.
    for name in sensors_read & set(sensors):
        sensors_read = sensors_read | set(sensors[name].read(sensors).values())
    # As the file has them, since settings are content of a file.
    return {f"sensors.{name}": sensor for name, sensor in contents.items() if name in sensors_read}
