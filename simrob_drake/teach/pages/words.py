"""The words of the pages, in each language one file beside."""

from functools import cache
from pathlib import Path
from typing import Protocol

from simrob_drake.errors import one_of
from simrob_drake.yaml_files import read_yaml

_FOLDER = Path(__file__).parent / "strings"
_BETWEEN = "."


class Words(Protocol):
    """What the pages call ``t``: a text by its key, ``section.name``."""

    def __call__(self, key: str, **figures: object) -> str:
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

    def t(key: str, **figures: object) -> str:
        return texts[key].format(**figures) if figures else texts[key]

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
