"""What differs from run to run: keys of a station, and the values that each takes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.yaml_files import parse_yaml

_EXPECTED = "VALUE,VALUE..., lin:FIRST:LAST:COUNT, log:FIRST:LAST:COUNT, uniform:LOW:HIGH or normal:MEAN:DEVIATION"
_MOST = 10_000
MOST_SEEDS = 1000
_GRIDS: dict[str, Callable[[float, float, int], Vector]] = {"lin": np.linspace, "log": np.geomspace}
_DRAWN = ("uniform", "normal")


@dataclass(frozen=True)
class Variation:
    """A key and its values.

    Attributes:
        key: a dotted path in the station, such as ``servo.kp``.
        text: its values as the user wrote them.
        values: each of them in turn; empty where they are drawn.
        drawn: by which distribution, and its two figures; None where values are listed.
    """

    key: str
    text: str
    values: tuple[Any, ...] = ()
    drawn: tuple[str, float, float] | None = None

    def draw(self, seed: int, place: int) -> float:
        """Return the value that a seed gives, other for each place among the variations."""
        assert self.drawn is not None  # who asks knows
        kind, first, second = self.drawn
        source = np.random.default_rng([seed, place])
        return source.uniform(first, second) if kind == "uniform" else source.normal(first, second)

    @property
    def logarithmic(self) -> bool:
        """Whether its values are spread evenly on a logarithmic axis."""
        return self.text.startswith("log:")


def parsed(key: str, text: str) -> Variation:
    """Return what a text says of a key's values.

    Args:
        key: a dotted path in a station.
        text: ``0.5,1,2``; ``lin:0:1:5`` and ``log:10:1000:9``, ends and count included; ``uniform:0.5:2`` or
            ``normal:1:0.1``, drawn anew for each seed.

    Raises:
        InvalidParameter: anything else, an empty range, or ends that a logarithm does not take.
    """
    option = f"--vary {key}"
    kind, *numbers = text.split(":")
    if kind not in _GRIDS and kind not in _DRAWN:
        values = parse_yaml(f"[{text}]", option)
        if not values or None in values:
            raise InvalidParameter(option, text or "nothing", _EXPECTED)
        return Variation(key, text, tuple(values))
    try:
        first, second, *count = (float(number) for number in numbers)
    except ValueError as problem:
        raise InvalidParameter(option, text, _EXPECTED) from problem
    if not np.isfinite([first, second, *count]).all() or len(count) != (kind in _GRIDS):
        raise InvalidParameter(option, text, _EXPECTED)
    if kind in _DRAWN:
        if second < 0 if kind == "normal" else first >= second:
            raise InvalidParameter(option, text, "a range: LOW below HIGH, and a deviation that is not negative")
        return Variation(key, text, drawn=(kind, first, second))
    if first == second or not 2 <= count[0] <= _MOST or count[0] % 1:
        raise InvalidParameter(option, text, f"a range of two ends that differ, and a count of 2 to {_MOST}")
    if kind == "log" and min(first, second) <= 0:
        raise InvalidParameter(option, text, "a range of positive numbers where it is logarithmic")
    return Variation(key, text, tuple(_GRIDS[kind](first, second, int(count[0])).tolist()))


def seeded(content: Mapping[str, Any], seed: int, changes: Mapping[str, Any]) -> dict[str, int]:
    """Return the seeds of all parts of a station that are random, each with a stream of its own.

    Args:
        content: the station's sections.
        seed: of the run.
        changes: what the user changes, whose seeds stay.
    """
    own = seed_keys(changes)
    return {key: seed + MOST_SEEDS * place for place, key in enumerate(seed_keys(content)) if key not in own}


def seed_keys(content: Mapping[str, Any], above: str = "") -> list[str]:
    """Return the dotted paths of all keys ``seed`` in a station's sections: of noise, terrain and biases."""
    found = []
    for key, value in content.items():
        path = f"{above}{key}"
        if key.rpartition(".")[2] == "seed":
            found.append(path)
        elif isinstance(value, Mapping):
            found += seed_keys(value, f"{path}.")
    return found
