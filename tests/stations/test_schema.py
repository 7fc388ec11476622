"""The schema in the folder of the stations is that of the code."""

import json
import re
from functools import cache
from pathlib import Path

import pytest

from simrob_drake.base.files import diagrams_root
from simrob_drake.parts import monitors
from simrob_drake.parts.monitors.sections import Fall
from simrob_drake.stations.schema import SCHEMA_FILE, station_schema

ROOT = Path(__file__).parents[2]


def test_the_schema_file_is_up_to_date():
    assert json.loads((diagrams_root() / SCHEMA_FILE).read_text()) == station_schema(), (
        "renew it: make pictures"
    )


def test_the_kinds_are_those_of_the_union():
    models = monitors.KINDS.models

    assert models["fall"] is Fall

    kinds = station_schema()["properties"]["monitors"]["additionalProperties"]["discriminator"][
        "mapping"
    ]
    assert set(models) == set(kinds)


def test_every_key_of_the_schema_is_explained():
    schema = station_schema()

    sections = {"": schema, **schema["$defs"]}
    keys = {
        f"{name}.{key}": entry
        for name, section in sections.items()
        for key, entry in section["properties"].items()
    }
    assert [
        key
        for key, entry in keys.items()
        if "description" not in entry and not key.endswith(".kind")
    ] == []


CLASS_NAME = re.compile(r"^[A-Z][a-z]+[A-Z]")


def descriptions(schema):
    """Yield every description of a schema."""
    if isinstance(schema, dict):
        if isinstance(schema.get("description"), str):
            yield schema["description"]
        for part in schema.values():
            yield from descriptions(part)
    elif isinstance(schema, list):
        for part in schema:
            yield from descriptions(part)


@cache
def names_of_classes():
    """Names of all classes of the package, those in functions included."""
    sources = (ROOT / "simrob_drake").rglob("*.py")
    return {
        name
        for source in sources
        for name in re.findall(r"^ *class (\w+)", source.read_text(), re.MULTILINE)
    }


@pytest.mark.parametrize(
    "file", [*ROOT.glob("models/*.schema.json"), ROOT / "diagrams" / "station.schema.json"]
)
def test_no_description_of_a_key_names_a_class(file):
    """Users of YAML files do not see the classes behind them."""
    inner = {name for name in names_of_classes() if CLASS_NAME.match(name)}
    words = {
        word
        for text in descriptions(json.loads(file.read_text()))
        for word in re.findall(r"\w+", text)
    }
    assert inner & words == set()
