"""Messages that users meet: one line each, with what would be right."""

from pathlib import Path

import pytest

from simrob_drake.base.errors import (
    InvalidConfig,
    InvalidModel,
    InvalidParameter,
    SimrobError,
    UnknownName,
    format_count,
    list_names,
    nearest,
)


def test_the_nearest_name_is_proposed() -> None:
    assert str(UnknownName("robot", "irb12", ["irb120", "ur5"])) == (
        "there is no robot 'irb12'; did you mean 'irb120'?"
    )


def test_without_a_near_name_all_are_listed_in_order() -> None:
    assert nearest("tractor", ["ur5", "irb120", "ur5"]) == "; known: irb120, ur5"


def test_where_nothing_is_known_nothing_is_proposed() -> None:
    assert nearest("x", []) == ""


def test_a_place_without_an_element_leaves_no_empty_colons() -> None:
    assert str(InvalidModel("arm.urdf", "", "is not XML")) == "arm.urdf: is not XML"
    assert str(InvalidConfig("a.yaml", "b.c", "unknown key")) == "a.yaml: b.c: unknown key"


def test_a_long_path_keeps_the_name_of_its_file() -> None:
    file = Path("/folder" * 50, "net.onnx")
    message = str(InvalidParameter("policy", file, "a network"))

    assert message.startswith("policy is …")
    assert message.endswith("/folder/net.onnx; it must be a network")
    assert len(message) < 120
    assert str(InvalidParameter("policy", Path("a/net.onnx"), "a network")) == (
        "policy is a/net.onnx; it must be a network"
    )


@pytest.mark.parametrize("value", ["line\n" * 100, list(range(1000)), None])
def test_a_parameter_message_is_one_short_line(value: object) -> None:
    message = str(InvalidParameter("gain", value, "positive"))

    assert message.startswith("gain is ")
    assert message.endswith("; it must be positive")
    assert "\n" not in message
    assert len(message) < 130


@pytest.mark.parametrize(
    "error", [InvalidConfig("a", "b", "c"), InvalidModel("a", "b", "c"), UnknownName("a", "b", [])]
)
def test_every_error_can_be_caught_as_one(error: Exception) -> None:
    assert isinstance(error, SimrobError)
    assert isinstance(error, ValueError)


def test_names_in_a_row_are_the_first_of_many():
    assert list_names(["a", "b", "c"]) == "a, b, c"
    assert list_names(["a", "b", "c", "d", "e"]) == "a, b, c and 2 more"


def test_things_are_counted_in_words():
    counts = (
        (1, "move"),
        (2, "move"),
        (2, "PS Abs"),
        (3, "flexible body"),
        (0, "joint"),
        (2, "axis"),
    )
    assert [format_count(*one) for one in counts] == [
        "1 move", "2 moves", "2 PS Abs", "3 flexible bodies", "0 joints", "2 axes",
    ]  # fmt: skip
