"""Groups of equal findings, so that each is reported once: a robot often has the same mistake in many links."""

import re
from collections.abc import Iterable
from typing import NamedTuple

# A decimal number as it appears in the text of a finding: "3", "-0.25", "1.5e-07".
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")


class WordGroup(NamedTuple):
    """Findings whose texts are equal, except for the numbers in the texts."""

    places: list[str]  # where each finding is, such as ``link 'rod'``
    text: str  # text of the first finding, with its numbers


def group_by_words(found: Iterable[tuple[str, str]]) -> list[WordGroup]:
    """Group findings whose texts are equal, except for the numbers in the texts.

    Args:
        found: the findings, each as a pair: where it is, such as ``link 'rod'``, and its text.

    Returns:
        the groups, in the order of their first findings.
    """
    groups: dict[str, WordGroup] = {}  # by the text without its numbers
    for place, text in found:
        words = _NUMBER.sub("", text)
        if words not in groups:
            groups[words] = WordGroup(places=[], text=text)
        groups[words].places.append(place)
    return list(groups.values())
