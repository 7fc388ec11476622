"""The words of the pages, in each language one file beside, and what a session says in them."""

import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from simrob_drake.errors import one_of
from simrob_drake.yaml_files import read_yaml

_FOLDER = Path(__file__).parent / "strings"
_BETWEEN = "."


@dataclass(frozen=True)
class Words:
    """What the pages call ``t``: a text by its key, ``section.name``; and what the engine says, in the language."""

    _texts: dict[str, str]
    _sentences: tuple[tuple[re.Pattern[str], str], ...]

    def __call__(self, key: str, **values: object) -> str:
        """Return a text with figures put in where it has their names in braces."""
        return self._texts[key].format(**values) if values else self._texts[key]

    def of_engine(self, text: str) -> str:
        """Return what the engine says in English, line by line, in the language; what it does not know as it is."""
        return "\n".join(map(self._said, text.split("\n"))) if self._sentences else text

    def _said(self, line: str) -> str:
        """Return a line in the words of the first sentence that it is, and so its parts, which are shorter."""
        for pattern, sentence in self._sentences:
            if (found := pattern.fullmatch(line)) is not None:
                return sentence.format(**{name: self._said(part) for name, part in found.groupdict().items()})
        return line


def languages() -> list[str]:
    """Return the languages that there are, ``en`` first."""
    return sorted(file.stem for file in _FOLDER.glob("*.yaml"))


def words(language: str) -> Words:
    """Return the words of a language.

    Raises:
        UnknownName: there is no such language.
    """
    return Words(texts_of(one_of("language", language, languages())), _sentences_of(language))


@cache
def _sentences_of(language: str) -> tuple[tuple[re.Pattern[str], str], ...]:
    """Return the sentences of the engine that a language has words for, with patterns of them in English."""
    file = _FOLDER / "engine" / f"{language}.yaml"
    known = read_yaml(file) if file.is_file() else {}
    parts = re.compile(r"\\{(\w+)\\}")
    return tuple((re.compile(parts.sub(r"(?P<\1>.+?)", re.escape(english))), own) for english, own in known.items())


@cache
def texts_of(language: str) -> dict[str, str]:
    """Return all texts of a language by their keys."""
    sections = read_yaml(_FOLDER / f"{language}.yaml")
    return {
        f"{section}{_BETWEEN}{name}": text
        for section, texts in sections.items()
        for name, text in (texts or {}).items()
    }


@dataclass(frozen=True)
class Notice:
    """What is to be told.

    Attributes:
        key: of the section ``notice`` of the words; empty for an error, which has words of its own.
        fills: what is filled in; ``text`` alone for an error.
        wrong: whether something went wrong.
    """

    key: str = ""
    fills: dict[str, Any] = field(default_factory=dict)
    wrong: bool = False

    def __str__(self) -> str:
        """Return it in English."""
        return words("en")(f"notice.{self.key}", **self.fills) if self.key else str(self.fills.get("text", ""))
