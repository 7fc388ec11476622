"""Groups of findings with the same words, to report them once: a robot often has the same slip in many links."""

import re
from collections.abc import Iterable
from typing import NamedTuple

_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")


class WordGroup(NamedTuple):
    """Places whose findings have the same text, except for the numbers in the text."""

    places: list[str]
    text: str  # the finding's text, with the numbers of the first place


def group_by_words(found: Iterable[tuple[str, str]]) -> list[WordGroup]:
    """WordGroup findings whose texts are equal, except for the numbers in the texts.

    Args:
        found: pairs of a place, such as ``link 'rod'``, and a text.

    Returns:
        the groups, in the order of their first findings.
    """
    groups: dict[str, WordGroup] = {}
    for place, text in found:
        words = _NUMBER.sub("", text)
        group = groups.setdefault(words, WordGroup(places=[], text=text))
        group.places.append(place)
    return list(groups.values())
