"""Helps of a station's keys in Spanish: they are about keys that there are, and reach the fields of the page."""

import re
from functools import cache

import pytest

from simrob_drake.base.files import station_files
from simrob_drake.extensions.pendant.form import Field, form_fields
from simrob_drake.extensions.pendant.pages.key_helps import helps_by_text, helps_of, in_own_language
from simrob_drake.extensions.pendant.tours import tours
from simrob_drake.stations.load import load_station, station_content
from simrob_drake.stations.schema import station_schema

STATIONS = "irb120_dynamic", "irb120_force_stop", "humanoid_walking"


@cache
def fields_of(station: str) -> list[Field]:
    """Fields of a station as the schema of station files has them, in English."""
    return form_fields(station_schema(), station_content(load_station(station)))


def as_pattern(key: str) -> str:
    """Regular expression of a key of the catalogue, in which an asterisk stands for a name."""
    return re.escape(key).replace(r"\*", r"\w+")


@pytest.mark.parametrize("key", helps_of("es"))
def test_a_translated_key_is_one_of_a_station(key):
    keys = {field.key for station in STATIONS for field in fields_of(station)}
    assert any(re.fullmatch(as_pattern(key), known) for known in keys)


def test_all_keys_of_the_lessons_have_spanish_helps():
    text = " ".join(text for tour in tours() for step in tour.steps for text in step.text.values())
    keys = set(re.findall(r"`(\w+(?:\.\w+)+)`", text))
    assert {"servo.kp", "pieces.load.mass", "contact.stiffness"} <= keys
    english = {field.key: field.help for station in STATIONS for field in fields_of(station)}
    for station in STATIONS:
        for field in in_own_language(fields_of(station), "es"):
            if field.key in keys:
                assert field.help != english[field.key]


@pytest.mark.long
def test_all_keys_of_all_stations_have_spanish_helps():
    """A new key needs a Spanish help: in es.yaml by its key, or in es_by_text.yaml by its English help."""
    english = dict[str, str]()
    for station in station_files():
        for field in fields_of(station):
            english.setdefault(field.help, field.key)
    fields = [Field(key, "value", text) for text, key in english.items()]
    missing = [
        old.key
        for old, new in zip(fields, in_own_language(fields, "es"), strict=True)
        if old.help == new.help
    ]
    assert not missing
    assert helps_by_text("es").keys() <= english.keys(), (
        "a help whose English text has changed or is gone"
    )
    assert in_own_language(fields, "en") == fields


def test_a_robot_of_several_has_the_helps_of_a_single_one():
    (field,) = in_own_language([Field("robots.left.tcp", "text", "English")], "es")
    assert field.help == helps_of("es")["robot.tcp"]


def test_units_are_those_of_the_english_helps():
    for station in STATIONS:
        for new, old in zip(
            in_own_language(fields_of(station), "es"), fields_of(station), strict=True
        ):
            unit = re.search(r"\[(\S+?)[\];,]", old.help)
            if unit and new.help != old.help:
                assert unit[1] in new.help, new.key
