"""Helps of a station's keys in the language of the page.

The English ones are the descriptions in the schema of station files. Those of another language are in a file of their
own, by key; a key without one shows the English help.
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
    helps = helps_of(language)
    return [replace(field, help=_help_of(field, helps)) for field in fields]


@cache
def helps_of(language: str) -> Mapping[str, str]:
    """Helps in a language, by key; an asterisk stands for a name. Empty if the language has none."""
    file = _FOLDER / f"{language}.yaml"
    return read_yaml(file) if file.is_file() else {}


def _help_of(field: Field, helps: Mapping[str, str]) -> str:
    """Help of a field in a language, or the one that the field has."""
    return next((helps[key] for key in _patterns(field.key) if key in helps), field.help)


def _patterns(key: str) -> Iterator[str]:
    """Yield the keys under which a help may be: the key itself, then with an asterisk for a name in it."""
    yield key
    parts = key.split(".")
    for index in range(1, len(parts)):
        yield ".".join([*parts[:index], _ANY_NAME, *parts[index + 1 :]])
    # The sections of one of several robots are those of a single one.
    if parts[0] == "robots" and len(parts) > 2:
        yield ".".join(["robot", *parts[2:]])
