"""Every sentence of the package that a user can meet: ``python -m tests.sentences [--package NAME] [FILE]``.

Written one below the other, the sentences can be read as a whole, in both languages. They come from

- the templates of all messages: errors, verdicts, warnings, remarks of ``check``, titles and labels of plots, and the
  helps of commands and of their options;
- the descriptions of keys in the schemas of stations, robots, pieces, programs and gaits.

The wording of the list is tested in ``test_sentences.py``.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from simrob_drake.base.messages import catalogue, core_packages
from tests.test_message_catalogues import templates

ROOT = Path(__file__).parent.parent

SCHEMAS = (
    "diagrams/station.schema.json",
    "models/robot.schema.json",
    "models/piece.schema.json",
    "models/program.schema.json",
    "models/gaits.schema.json",
)


class Sentence(NamedTuple):
    """A text that a user can meet.

    Attributes:
        name: id of the message, or path of the key in its schema.
        english: the English text; of a message its template.
        spanish: the Spanish text. None for the descriptions of schemas, which are English alone.
    """

    name: str
    english: str
    spanish: str | None


def messages() -> Iterator[Sentence]:
    """All messages of the core and of the extensions, by their ids."""
    for message_id, texts in sorted(templates().items()):
        (english,) = texts
        package = message_id.partition(".")[0]
        yield Sentence(message_id, english, catalogue(package, "es").get(message_id))


def key_descriptions() -> Iterator[Sentence]:
    """Descriptions of all keys in the schemas, each text once."""
    seen = set()
    for schema in SCHEMAS:
        content = json.loads((ROOT / schema).read_text(encoding="utf-8"))
        for path, text in _descriptions(content, Path(schema).name.partition(".")[0]):
            if text not in seen:
                seen.add(text)
                yield Sentence(path, text, None)


def _descriptions(content: Any, path: str) -> Iterator[tuple[str, str]]:
    """Yield all descriptions of a part of a schema with their paths."""
    if isinstance(content, list):
        for entry in content:
            yield from _descriptions(entry, path)
    if not isinstance(content, dict):
        return
    if isinstance(text := content.get("description"), str):
        yield path, text
    for key, value in content.items():
        yield from _descriptions(value, f"{path}.{key}" if key not in _OF_SCHEMAS else path)


_OF_SCHEMAS = {"$defs", "properties", "items", "anyOf", "oneOf", "allOf", "additionalProperties"}
"""Words of JSON Schema, which are no keys of the file that it describes."""


def write_list(package: str | None) -> str:
    """Write the sentences one below the other: name, English text and, below it, the Spanish text.

    Args:
        package: package whose messages are listed, such as ``stations``. None for those of the core, and then the
            descriptions of keys follow.
    """
    packages = {package} if package else set(core_packages())
    listed = [entry for entry in messages() if entry.name.partition(".")[0] in packages]
    if package is None:
        listed += key_descriptions()
    lines = []
    for entry in listed:
        lines.append(f"{entry.name}: {entry.english}")
        if entry.spanish is not None:
            lines.append(f"    {entry.spanish}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the list to a file, or to the screen."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--package", help="list the messages of this package or extension only")
    parser.add_argument("file", nargs="?", type=Path, help="file to write; otherwise the screen")
    arguments = parser.parse_args()

    text = write_list(arguments.package)
    if arguments.file is None:
        print(text, end="")
    else:
        arguments.file.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
