"""YAML as users get it wrong: every finding is one line that names file, key and what would be right."""

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.messages import compound, in_language
from simrob_drake.base.sections import Number, Strict, validate_section
from simrob_drake.base.yaml_files import parse_yaml, place_of, read_yaml


class Slow(Strict):
    kind: Literal["slow"]
    period: Number = 1.0


class Fast(Strict):
    kind: Literal["fast"]
    rate: Number = 1.0


class Part(Strict):
    mass: Annotated[Number, Field(gt=0)] = 1.0
    size: tuple[Number, Number, Number] = (1.0, 1.0, 1.0)


class Machine(Strict):
    name: str
    speed: Number | list[Number] | dict[str, Number] = 0.0
    count: int = 1
    drive: Annotated[Slow | Fast, Field(discriminator="kind")] = Slow(kind="slow")
    parts: dict[str, Part] = Field(default_factory=dict)
    colour: Literal["red", "green"] = "red"


def finding(text: str) -> str:
    with pytest.raises(InvalidConfig) as problem:
        validate_section(Machine, {"name": "m", **parse_yaml(text, "m.yaml")}, "m.yaml")
    return str(problem.value)


def test_a_good_text_is_read_whole() -> None:
    content = parse_yaml(
        "{name: m, speed: {a: 1e-3}, drive: {kind: fast, rate: 2}, parts: {arm: {size: [1, 2, 3]}}}",
        "m.yaml",
    )
    machine = validate_section(Machine, content, "m.yaml")

    assert machine.speed == {"a": 1e-3}
    assert machine.drive == Fast(kind="fast", rate=2.0)
    assert machine.parts["arm"].size == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1E5", 1e5),
        ("-2e+1", -20.0),
        (".5e1", 5.0),
        ("1.0e-3", 1e-3),
        ("7", 7),
        ("1e", "1e"),
    ],
)
def test_numbers_are_those_of_yaml_1_2(text: str, value: float | str) -> None:
    assert parse_yaml(text, "here") == value


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nam: x", "m.yaml: nam: unknown key; did you mean 'name'?"),
        ("parts: {arm: {mas: 1}}", "m.yaml: parts.arm.mas: unknown key; did you mean 'mass'?"),
        ("drive: {kind: fast, rat: 1}", "m.yaml: drive.rat: unknown key; did you mean 'rate'?"),
        ("drive: {kind: fast, period: 1}", "m.yaml: drive.period: unknown key; known: kind, rate"),
        ("parts: {arm: {volume: 1}}", "m.yaml: parts.arm.volume: unknown key; known: mass, size"),
    ],
)
def test_an_unknown_key_brings_the_nearest_known_one(text: str, expected: str) -> None:
    assert finding(text) == expected


def test_an_unknown_key_goes_before_other_findings() -> None:
    assert "unknown key" in finding("{count: x, parts: {arm: {mas: 1}}}")


@pytest.mark.parametrize("text", ["a: 1\na: 2", "b: {a: 1, a: 1}", "1: x\n'1': y"])
def test_a_key_that_occurs_twice_is_an_error(text: str) -> None:
    with pytest.raises(InvalidConfig, match="occurs twice"):
        parse_yaml(text, "m.yaml")


@pytest.mark.parametrize("value", ["true", "off", "'1'", "null", "[true]", "{a: yes}", "{a: '1'}"])
def test_what_is_no_number_does_not_pass_for_one(value: str) -> None:
    assert finding(f"speed: {value}").startswith("m.yaml: speed")


@pytest.mark.parametrize("value", [".nan", ".inf", "-.inf", "1e400"])
def test_a_number_is_finite(value: str) -> None:
    message = finding(f"parts: {{arm: {{mass: {value}}}}}")
    assert message.startswith("m.yaml: parts.arm.mass: ")
    assert "finite" in message


def test_a_number_out_of_its_range_is_named_with_its_range() -> None:
    assert (
        finding("parts: {arm: {mass: -1}}")
        == "m.yaml: parts.arm.mass: must be greater than 0 (it is -1)"
    )


def test_a_finding_in_a_union_is_of_the_branch_that_was_meant() -> None:
    assert finding("speed: {a: fast}").startswith("m.yaml: speed.a: must be a number")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("drive: {kind: fats}", "m.yaml: drive.kind: there is no 'fats'; did you mean 'fast'?"),
        ("drive: {rate: 1}", "m.yaml: drive.kind: this key is required; known: slow, fast"),
        ("colour: reed", "m.yaml: colour: there is no 'reed'; did you mean 'red'?"),
        ("colour: 7", "m.yaml: colour: there is no '7'; known: green, red"),
    ],
)
def test_a_wrong_choice_brings_the_choices(text: str, expected: str) -> None:
    assert finding(text) == expected


@pytest.mark.parametrize("size", ["[]", "[1, 2]"])
def test_a_list_that_is_too_short_tells_its_length(size: str) -> None:
    assert finding(f"parts: {{arm: {{size: {size}}}}}").startswith(
        "m.yaml: parts.arm.size: needs 3 values"
    )


def test_a_list_that_is_too_long_is_an_error() -> None:
    assert finding("parts: {arm: {size: [1, 2, 3, 4]}}").startswith("m.yaml: parts.arm.size: ")


def test_a_key_that_is_needed_is_named() -> None:
    with pytest.raises(InvalidConfig, match=r"^m\.yaml: name: this key is required$"):
        validate_section(Machine, {}, "m.yaml")


@pytest.mark.parametrize("value", ["3", "[1]", "text", "null"])
def test_a_value_where_a_mapping_belongs_names_its_key(value: str) -> None:
    assert finding(f"parts: {{arm: {value}}}").startswith("m.yaml: parts.arm: ")


def test_a_long_value_is_shortened_in_the_message() -> None:
    assert len(finding(f"count: {'x' * 5000}")) < 250


def test_a_model_does_not_change_after_reading() -> None:
    with pytest.raises(ValueError, match="frozen"):
        Part().mass = 2.0  # type: ignore[misc]


@pytest.mark.parametrize(
    "text",
    [
        "a: [1",
        "a: b: c",
        "\tb: 1",
        "a: *nowhere",
        "a: 1\n---\nb: 2",
        "{[1, 2]: 3}",
        "a: !!python/object/apply:os.getcwd []",
        "a: !!int x",
        "a: 2001-99-99",
        "a: !!timestamp x",
        "\0",
        pytest.param("[" * 5000, id="nested-too-deeply"),
    ],
)
def test_what_is_not_yaml_is_a_named_error(text: str) -> None:
    with pytest.raises(InvalidConfig, match=r"^m\.yaml: is not YAML: ") as problem:
        parse_yaml(text, "m.yaml")
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize("content", ["", "- 1", "3", "text", "null"])
def test_a_file_must_hold_a_mapping(tmp_path: Path, content: str) -> None:
    file = tmp_path / "station.yaml"
    file.write_text(content)
    with pytest.raises(InvalidConfig, match=r"station\.yaml: must contain a mapping"):
        read_yaml(file)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidConfig, match=r"nowhere\.yaml: cannot be read"):
        read_yaml(tmp_path / "nowhere.yaml")


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(InvalidConfig, match="cannot be read"):
        read_yaml(tmp_path)


def test_a_path_that_no_file_can_have_is_named() -> None:
    with pytest.raises(InvalidConfig, match="cannot be read"):
        read_yaml(Path("a\0b.yaml"))


def test_a_binary_file_is_named(tmp_path: Path) -> None:
    file = tmp_path / "station.yaml"
    file.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(InvalidConfig, match=r"station\.yaml: cannot be read"):
        read_yaml(file)


def test_an_index_into_an_empty_list_says_that_the_list_is_empty():
    """The error names no range of indices, which an empty list does not have."""
    with pytest.raises(
        InvalidConfig, match=r"moves\.0: has no entry '0'; the list is empty$"
    ) as error:
        place_of({"moves": []}, ["moves", "0"], "station.yaml")
    spanish = in_language(compound("{problem}", problem=error.value), "es")
    assert spanish.endswith("moves.0: no tiene la entrada '0'; la lista está vacía")
