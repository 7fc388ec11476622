"""Keys in which saved results differ, with which a legend distinguishes the results.

Keys are *dotted* as the option ``--set`` takes them: ``servo.kp.lift`` is the key ``lift`` in ``kp`` in ``servo``.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from simrob_drake.base.errors import list_names
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
        a text for each result, such as ``servo.kp.lift 14000``. Of more than three keys it has the first three and the
        count of the others. The texts are empty if the results have the same keys and values, or if neither their
        stations nor their programs are saved.
    """
    settings = _with_same_keys([_settings(folder) for folder in folders])
    keys = dict.fromkeys(key for values in settings for key in values)
    differing = dict[str, list[Any]]()
    for key in keys:
        values = [own.get(key, _NOT_SET) for own in settings]
        if any(value != values[0] for value in values):
            differing[key] = values
    # A saved station has the servo of its only robot twice: at its top, and in the section of the robot. The second is
    # left out if the first has the same values. `_key_at_top` is empty for other keys.
    shown = [key for key, values in differing.items() if differing.get(_key_at_top(key)) != values]
    texts = []
    for index in range(len(folders)):
        parts = [
            compound("{key} {value}", key=key, value=_in_words(differing[key][index]))
            for key in shown
        ]
        texts.append(list_names(parts))
    return texts


def _with_same_keys(settings: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Replace a number that is valid for all axes, such as a gain, by one for each axis that another result names.

    Args:
        settings: the values of each result by dotted keys. One result has ``servo.kp``, another ``servo.kp.lift``.

    Returns:
        the values of each result, with ``servo.kp.lift`` in both.
    """
    all_keys = dict.fromkeys(key for values in settings for key in values)
    subkeys = dict[str, list[str]]()  # for each key of a mapping, its keys one level below
    for key in all_keys:
        parent, _, _ = key.rpartition(".")
        subkeys.setdefault(parent, []).append(key)
    found = []
    for values in settings:
        spread = dict[str, Any]()
        for key, value in values.items():
            is_for_all = isinstance(value, int | float) and key in subkeys
            spread.update(dict.fromkeys(subkeys[key], value) if is_for_all else {key: value})
        found.append(spread)
    return found


def _key_at_top(key: str) -> str:
    """Key at the top of a station for a key in the servo section of its only robot. Empty for any other key."""
    return key.removeprefix("robot.") if key.startswith("robot.servo.") else ""


def _settings(folder: Path) -> dict[str, Any]:
    """Read the values of a result's station and program, by dotted keys.

    Keys without effect on the run, such as the name, are left out. The result is empty if neither is saved.

    Args:
        folder: folder of the result.
    """
    settings: dict[str, Any] = {}
    station = folder / STATION
    if station.is_file():
        content = read_yaml(station)
        effective = {key: content[key] for key in content if key not in _WITHOUT_EFFECT}
        settings.update(_values_by_key(effective))
    program = folder / PROGRAM
    if program.is_file():
        moves = read_yaml(program).get("moves", [])
        settings.update(_values_by_key({"program": {"moves": moves}}))
        # The duration of a program follows from its moves, which are compared already.
        settings.pop(_DURATION, None)
    return settings


def _values_by_key(content: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each value of nested mappings and lists, after its dotted key. Entries of lists have their index, from 0.

    A list of plain values is one value.

    Args:
        content: a mapping, a list or a value.
        key: dotted key of the content; empty at the top.
    """
    if isinstance(content, Mapping):
        entries = [(str(name), value) for name, value in content.items()]
    # A list of numbers, such as a position, is one value: single components would mean nothing in a legend.
    elif isinstance(content, list) and any(isinstance(value, Mapping | list) for value in content):
        entries = [(str(index), value) for index, value in enumerate(content)]
    else:
        yield key, content
        return
    for name, value in entries:
        yield from _values_by_key(value, f"{key}.{name}" if key else name)


def _in_words(value: Any) -> str:
    """Write a value of a key: numbers with decimals have six significant digits at most."""
    if isinstance(value, float):
        return compound("{value:g}", value=value)
    return str(value)
