"""The form of a station: every key, what it says, and what is typed into it."""

import pytest
import yaml

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.extensions.pendant.form import Field, as_text, as_value, form_fields
from simrob_drake.stations.load import load_station, station_names, station_yaml
from simrob_drake.stations.schema import station_schema

SCHEMA = station_schema()


def content_of(name, **overrides):
    return yaml.safe_load(station_yaml(load_station(name, overrides)))


def fields_of(name, **overrides) -> dict[str, Field]:
    return {field.key: field for field in form_fields(SCHEMA, content_of(name, **overrides))}


def paths(content, key=""):
    """Every dotted key that a file's content says something under."""
    if not isinstance(content, dict):
        return [key]
    return [
        key,
        *(
            path
            for name, value in content.items()
            for path in paths(value, f"{key}.{name}".lstrip("."))
        ),
    ]


@pytest.mark.parametrize("name", station_names())
def test_every_key_of_a_station_has_a_field_and_every_field_its_help(name):
    content = content_of(name)
    fields = {field.key: field for field in form_fields(SCHEMA, content)}
    assert len(fields) == len(form_fields(SCHEMA, content))  # none twice
    # a mapping there is typed as one
    whole = tuple(key for key, field in fields.items() if field.kind == "value")
    for path in filter(None, paths(content)):
        told = path in fields or path.startswith(tuple(f"{key}." for key in whole))
        # a section that is always there
        told = told or any(key.startswith(f"{path}.") for key in fields)
        # the kind of an entry, which its name or section tells
        assert told or path.endswith(".kind"), path
    assert all(field.help for field in fields.values())


@pytest.mark.parametrize(
    "name", ["irb120_cobot", "humanoid_balance", "two_irb120", "irb120_force_control"]
)
def test_what_a_field_shows_can_be_typed_into_it(name):
    config = load_station(name)
    leaves = [
        f
        for f in fields_of(name).values()
        if f.kind in ("number", "text", "choice", "switch", "value")
    ]
    given = {f.key: f for f in leaves if f.value is not None}
    assert len(given) > 30
    typed = {key: as_value(f, as_text(f.value)) for key, f in given.items()}
    assert typed == {key: f.value for key, f in given.items()}
    assert load_station(name, typed) == config


def test_a_field_tells_unit_bounds_choices_and_default():
    fields = fields_of("irb120_dynamic")
    assert fields["servo.kp"].unit == "N·m/rad"
    assert (fields["gravity"].unit, fields["gravity"].low, fields["gravity"].high) == (
        "m/s²",
        -1e4,
        1e4,
    )
    assert fields["reference.target_deg"].unit == "deg"
    assert fields["robot.base"].unit == ""  # lengths and angles
    assert fields["servo.law"].choices == ("pid", "cascade", "computed_torque")
    assert (fields["duration"].value, fields["duration"].default) == (3.0, 3.0)
    assert (fields["solver.error_control"].kind, fields["solver.error_control"].value) == (
        "switch",
        True,
    )
    assert fields["servo.kp"].top == "servo"


def test_a_kind_brings_its_own_keys():
    keys = {key for key in fields_of("irb120_dynamic") if key.startswith("reference.")}
    assert keys == {
        f"reference.{name}" for name in ("kind", "target_deg", "duration", "start", "blend")
    }
    changed = fields_of("irb120_dynamic", **{"reference.kind": "hold"})
    assert {key for key in changed if key.startswith("reference.")} == {
        "reference.kind",
        "reference.target_deg",
    }
    own = fields_of(
        "irb120_dynamic",
        **{"robot.reference": {"kind": "sine", "frequency": 1.0, "amplitude_deg": 5}},
    )
    assert own["robot.reference"].value is True
    assert own["robot.reference.kind"].value == "sine"
    assert "robot.reference.frequency" in own


def test_sections_that_may_be_missing_come_and_go():
    bare = fields_of("irb120_dynamic")
    assert (bare["contact"].kind, bare["contact"].value, bare["contact"].removable) == (
        "section",
        False,
        True,
    )
    assert "contact.stiffness" not in bare
    there = fields_of("irb120_dynamic", contact={})
    assert there["contact"].value is True
    assert "contact.stiffness" in there


def test_entries_have_their_names_and_kinds():
    fields = fields_of("humanoid_balance")
    assert fields["monitors"].kind == "entries"
    assert "fall" in fields["monitors"].choices
    assert fields["monitors.fall"].removable
    assert fields["pieces"].choices == ()
    assert not fields[
        "controllers.balance.strategies.left"
    ].removable  # overrides take out no inner entries
    two = fields_of("two_irb120")
    assert "robot" not in {field.top for field in two.values()}
    assert not two["robots.left"].removable


@pytest.mark.parametrize(
    ("key", "typed", "told"),
    [
        ("servo.kp", "-1", "servo.kp"),
        ("servo.kp", "{jont_1: 5}", "joint_1"),
        ("gravity", "fast", "gravity"),
        ("gravity", "1e6", "10000"),
        ("floor.incline_deg", "60", "45"),
        ("robot.base", "[0, 0, 0]", "6"),
        ("duration", "", ""),
    ],
)
def test_the_checker_has_the_last_word(key, typed, told):
    value = as_value(fields_of("irb120_dynamic")[key], typed)
    if told:
        with pytest.raises(InvalidConfig, match=told):
            load_station("irb120_dynamic", {key: value})
    else:
        assert value == 3.0  # the default


def test_no_yaml_is_told_with_the_key():
    with pytest.raises(InvalidConfig, match=r"servo\.kp.*is not YAML"):
        as_value(fields_of("irb120_dynamic")["servo.kp"], "{joint_1: ")


@pytest.mark.parametrize(
    ("name", "text"),
    [("yobotics_walking", "urdf"), ("zjudancer_walking", "{left_ankle_pitch: mx_106")],
)
def test_motors_by_name_or_by_axis_are_one_value(name, text):
    (field,) = (
        one for one in form_fields(SCHEMA, content_of(name)) if one.key.startswith("servo.motor")
    )
    assert field.kind == "value"
    assert as_text(field.value).startswith(text)
    assert as_value(field, as_text(field.value)) == field.value
