"""The words of the pages, in each language one file beside, and what a session says in them."""

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from simrob_drake.errors import one_of
from simrob_drake.yaml_files import read_yaml

_FOLDER = Path(__file__).parent / "strings"
_BETWEEN = "."


class Words(Protocol):
    """What the pages call ``t``: a text by its key, ``section.name``."""

    def __call__(self, key: str, **values: object) -> str:
        """Return a text with figures put in where it has their names in braces."""


def languages() -> list[str]:
    """Return the languages that there are, ``en`` first."""
    return sorted(file.stem for file in _FOLDER.glob("*.yaml"))


def words(language: str) -> Words:
    """Return the words of a language.

    Raises:
        UnknownName: there is no such language.
    """
    texts = texts_of(one_of("language", language, languages()))

    def t(key: str, **values: object) -> str:
        return texts[key].format(**values) if values else texts[key]

    return t


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
