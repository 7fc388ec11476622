"""Keys in which saved results differ, by which a legend tells them apart."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from simrob_drake.base.errors import listed
from simrob_drake.base.messages import compound
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.results.files import PROGRAM, STATION

_WITHOUT_EFFECT = ("name", "description", "verdict")
"""Keys of a station that do not change what it does."""

_DURATION = "duration"
"""Key of a station that a program decides, if there is one."""

_NOT_SET = "–"
"""What a legend shows for a key that a result does not have."""


def differing_settings(folders: Sequence[Path]) -> list[str]:
    """Describe each result by the keys of station and program in which it differs from the others.

    Args:
        folders: folders of the results.

    Returns:
        a text for each result, such as ``servo.kp.lift 14000``. It is empty if the results have the same keys and
        values, or if their stations are not saved.
    """
    settings = [_settings(folder) for folder in folders]
    keys = dict.fromkeys(key for values in settings for key in values)
    differing = []
    for key in keys:
        values = [own.get(key, _NOT_SET) for own in settings]
        if any(value != values[0] for value in values):
            differing.append(key)
    texts = []
    for own in settings:
        parts = [compound("{key} {value}", key=key, value=_in_words(own.get(key, _NOT_SET))) for key in differing]
        texts.append(listed(parts))
    return texts


def _settings(folder: Path) -> dict[str, Any]:
    """Read the values of a result's station and program, by dotted keys as ``--set`` takes them."""
    settings: dict[str, Any] = {}
    station = folder / STATION
    if station.is_file():
        content = read_yaml(station)
        settings.update(_flatten({key: content[key] for key in content if key not in _WITHOUT_EFFECT}))
    program = folder / PROGRAM
    if program.is_file():
        moves = read_yaml(program).get("moves", [])
        settings.update(_flatten({"program": {"moves": moves}}))
        settings.pop(_DURATION, None)
    return settings


def _flatten(content: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each value of nested mappings and lists with its dotted key. Entries of lists have their index, from 0."""
    if isinstance(content, Mapping):
        entries = [(str(name), value) for name, value in content.items()]
    elif isinstance(content, list) and any(isinstance(value, Mapping | list) for value in content):
        entries = [(str(index), value) for index, value in enumerate(content)]
    else:
        yield key, content
        return
    for name, value in entries:
        yield from _flatten(value, f"{key}.{name}" if key else name)


def _in_words(value: Any) -> str:
    """Write a value of a key: numbers with six significant digits at most."""
    if isinstance(value, float):
        return compound("{value:g}", value=value)
    return str(value)
