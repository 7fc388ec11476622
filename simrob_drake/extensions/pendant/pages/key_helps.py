"""Helps of a station's keys in the language of the page.

The English ones are the descriptions in the schema of station files. Those of another language are in two files: by
key, and by the English help for keys that many sections have, or whose meaning depends on the kind of their section.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.pendant.form import Field

_FOLDER = Path(__file__).parent / "key_helps"
_ANY_NAME = "*"


def in_own_language(fields: Sequence[Field], language: str) -> list[Field]:
    """Fields with their helps in a language, as far as there are any, otherwise in English."""
    return [replace(field, help=_help_of(field, language)) for field in fields]


@cache
def helps_of(language: str) -> Mapping[str, str]:
    """Helps in a language, by key; an asterisk stands for a name. Empty if the language has none."""
    return _read_helps(f"{language}.yaml")


@cache
def helps_by_text(language: str) -> Mapping[str, str]:
    """Helps in a language, by the English help. Empty if the language has none."""
    return _read_helps(f"{language}_by_text.yaml")


def _read_helps(file_name: str) -> Mapping[str, str]:
    """Read a file with helps. Returns an empty mapping if there is no such file."""
    file = _FOLDER / file_name
    return read_yaml(file) if file.is_file() else {}


def _help_of(field: Field, language: str) -> str:
    """Help of a field in a language, or the one that the field has."""
    by_key = helps_of(language)
    for key in _patterns(field.key):
        if key in by_key:
            return by_key[key]
    return helps_by_text(language).get(field.help, field.help)


def _patterns(key: str) -> Iterator[str]:
    """Yield the keys under which a help may be: the key itself, then with an asterisk for a name in it."""
    yield key
    parts = key.split(".")
    for index in range(1, len(parts)):
        yield ".".join([*parts[:index], _ANY_NAME, *parts[index + 1 :]])
    # The sections of one of several robots are those of a single one.
    if parts[0] == "robots" and len(parts) > 2:
        yield ".".join(["robot", *parts[2:]])
