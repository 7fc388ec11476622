"""The schema beside the stations is the one of the code."""

import json

from simrob_drake.files import diagrams_root
from simrob_drake.parts import monitors
from simrob_drake.parts.monitors.sections import Fall
from simrob_drake.stations.schema import SCHEMA_FILE, station_schema


def test_the_schema_file_is_up_to_date():
    assert json.loads((diagrams_root() / SCHEMA_FILE).read_text()) == station_schema(), "renew it: make pictures"


def test_the_kinds_are_those_of_the_union():
    models = monitors.KINDS.models
    assert models["fall"] is Fall
    kinds = station_schema()["properties"]["monitors"]["additionalProperties"]["discriminator"]["mapping"]
    assert set(models) == set(kinds)


def test_every_key_of_the_schema_is_explained():
    schema = station_schema()
    sections = {"": schema, **schema["$defs"]}
    keys = {
        f"{name}.{key}": entry for name, section in sections.items() for key, entry in section["properties"].items()
    }
    assert [key for key, entry in keys.items() if "description" not in entry and not key.endswith(".kind")] == []
