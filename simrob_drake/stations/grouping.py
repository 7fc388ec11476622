"""Findings of the same words in one: a robot often has the same slip in many links."""

import re
from collections.abc import Iterable
from typing import NamedTuple

_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")


class Group(NamedTuple):
    """Places of which the same is said, but for the numbers."""

    places: list[str]
    text: str  # with the numbers of the first place


def group_by_words(found: Iterable[tuple[str, str]]) -> list[Group]:
    """Group places and texts by the words of the texts, in order."""
    groups: dict[str, Group] = {}
    for place, text in found:
        groups.setdefault(_NUMBER.sub("", text), Group([], text)).places.append(place)
    return list(groups.values())
