"""The seeds of all that is random in a station, each with a stream of its own."""

from collections.abc import Mapping
from typing import Any

MOST_SEEDS = 1000


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
