"""What the engine says of a run, in the language of the pages: how it ended, and its verdict."""

import re
from functools import cache
from pathlib import Path

from simrob_drake.yaml_files import read_yaml

_FOLDER = Path(__file__).parent / "strings" / "engine"
_PART = re.compile(r"\\{(\w+)\\}")
_LIST = ", "


def spoken(text: str, language: str) -> str:
    """Return what the engine says, line by line; a sentence for which a language has no words stays as it is."""
    return "\n".join(_spoken(line, language) for line in text.splitlines())


def _spoken(text: str, language: str) -> str:
    for pattern, words in _sentences(language):
        if found := pattern.fullmatch(text):
            return words.format(**{name: _spoken(part, language) for name, part in found.groupdict().items()})
    first, comma, rest = text.partition(_LIST)
    return f"{_spoken(first, language)}{comma}{_spoken(rest, language)}" if comma else text


@cache
def _sentences(language: str) -> list[tuple[re.Pattern[str], str]]:
    """Return the sentences that a language has words for, as patterns, with those words."""
    file = _FOLDER / f"{language}.yaml"
    texts = read_yaml(file) if file.is_file() else {}
    return [(re.compile(_PART.sub(r"(?P<\1>.+?)", re.escape(said))), words) for said, words in texts.items()]
