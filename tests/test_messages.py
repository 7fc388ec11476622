"""Messages: English text, id and fields, and the same sentence in another language."""

import copy
import json
import pickle
import warnings

import numpy as np
import pytest

from simrob_drake.base import messages as messages_module
from simrob_drake.base.messages import (
    Message,
    MessageWarning,
    as_data,
    compound,
    from_data,
    in_language,
    join_texts,
    message,
)

SPANISH = {
    "kit.ends_off": "{move} acaba a {distance:.3g} mm de su meta (límite {bound:g} mm)",
    "kit.move": "movimiento {number} ({kind})",
    "kit.steps": "{count} {count:paso|pasos}",
    "kit.stands": "está de pie",
    "kit.broken": "{nobody} está de pie",
}


@pytest.fixture(autouse=True)
def spanish(tmp_path, monkeypatch):
    """Messages of a package `kit` in Spanish."""
    (tmp_path / "es.yaml").write_text(json.dumps(SPANISH), encoding="utf-8")
    finders = [lambda package: tmp_path if package == "kit" else None]
    monkeypatch.setattr(messages_module, "_folder_finders", finders)
    messages_module._catalogue_file.cache_clear()
    yield tmp_path
    messages_module._catalogue_file.cache_clear()
    messages_module._read_catalogue.cache_clear()


def ends_off(distance):
    move = message("kit.move", "move {number} ({kind})", number=1, kind="move_j")
    template = "{move} ends {distance:.3g} mm beside its target (bound {bound:g} mm)"
    return message("kit.ends_off", template, move=move, distance=distance, bound=2)


def test_a_message_is_its_english_text():
    ending = ends_off(31.2567)

    assert ending == "move 1 (move_j) ends 31.3 mm beside its target (bound 2 mm)"
    assert isinstance(ending, str)
    assert (ending.id, ending.fields["distance"]) == ("kit.ends_off", 31.2567)
    assert in_language(ending, "en") == ending


def test_one_sentence_is_in_one_language():
    """The fault of before: "move 1 (move_j) ends 31.3 mm beside its target (límite 2 mm)"."""
    assert (
        in_language(ends_off(31.2567), "es")
        == "movimiento 1 (move_j) acaba a 31,3 mm de su meta (límite 2 mm)"
    )


@pytest.mark.parametrize("number", [1234.5, np.float64(1234.5), np.float32(1234.5)])
def test_numbers_have_the_decimal_sign_of_the_language(number):
    text = compound("{number:,.1f}", number=number)

    assert text == "1,234.5"
    assert in_language(text, "es") == "1.234,5"
    assert in_language(compound("{name}", name="v1.5"), "es") == "v1.5"  # a name is no number


def test_words_follow_a_count():
    def steps(count):
        return message("kit.steps", "{count} {count:step|steps}", count=count)

    assert [str(steps(count)) for count in (0, 1, 2)] == ["0 steps", "1 step", "2 steps"]
    assert [in_language(steps(count), "es") for count in (0, 1, 2)] == [
        "0 pasos",
        "1 paso",
        "2 pasos",
    ]


def test_parts_of_a_compound_are_rendered_each():
    stands = message("kit.stands", "stands")

    assert (
        in_language(join_texts([stands, "R1", stands], "; "), "es")
        == "está de pie; R1; está de pie"
    )

    located = compound("{file}: {problem}", file="a{b}.yaml", problem=stands)
    assert str(located) == "a{b}.yaml: stands"
    assert in_language(located, "es") == "a{b}.yaml: está de pie"
    assert str(join_texts([], ", ")) == ""


def test_an_error_in_a_field_keeps_its_message():
    error = ValueError("plain")

    assert in_language(compound("{problem}", problem=error), "es") == "plain"

    error.message = message("kit.stands", "stands")
    assert in_language(compound("{problem}", problem=error), "es") == "está de pie"


def test_a_message_survives_pickle_copies_and_json():
    ending = ends_off(np.float64(31.2567))
    copies = [
        pickle.loads(pickle.dumps(ending)),
        copy.deepcopy(ending),
        from_data(json.loads(json.dumps(as_data(ending)))),
    ]

    for other in copies:
        assert type(other) is Message
        assert other == ending
        assert in_language(other, "es") == in_language(ending, "es")
    assert as_data("plain") == from_data("plain") == "plain"


def test_an_unknown_id_or_language_is_shown_in_english():
    stands = message("kit.stands", "stands")
    unknown = message("kit.falls", "{who} falls: it {how}", who="R1", how=stands)

    assert in_language(unknown, "es") == "R1 falls: it está de pie"
    assert in_language(stands, "fr") == "stands"
    assert in_language(message("nobody.stands", "stands"), "es") == "stands"
    assert in_language("plain", "es") == "plain"


def test_a_missing_field_is_an_error_in_english_and_a_warning_in_another_language():
    with pytest.raises(KeyError, match="who"):
        message("kit.falls", "{who} falls")
    with pytest.warns(
        MessageWarning, match=r"kit\.broken in 'es' cannot be filled \(KeyError: 'nobody'\)"
    ):
        assert in_language(message("kit.broken", "{who} stands", who="R1"), "es") == "R1 stands"


def test_a_long_message_is_cut_in_each_language():
    long = compound("{a}, {b}", a="x" * 30, b=message("kit.stands", "stands")).limited_to(34)
    assert str(long) == f"{'x' * 30}, s…"
    assert in_language(long, "es") == f"{'x' * 30}, e…"


def test_a_catalogue_is_read_once(spanish):
    stands = message("kit.stands", "stands")

    assert in_language(stands, "es") == "está de pie"

    (spanish / "es.yaml").unlink()
    assert in_language(stands, "es") == "está de pie"


@pytest.mark.parametrize("content", ["[", "- a list"])
def test_a_catalogue_that_is_none_is_a_warning_and_english(spanish, content):
    (spanish / "es.yaml").write_text(content)
    with pytest.warns(MessageWarning, match=r"es\.yaml"):
        assert in_language(message("kit.stands", "stands"), "es") == "stands"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert in_language(message("kit.stands", "stands"), "es") == "stands"  # it is said once


def test_a_sentence_begins_with_a_capital_letter_in_each_language():
    sentence = message("kit.stands", "stands").as_sentence()

    assert sentence == "Stands"
    assert in_language(pickle.loads(pickle.dumps(sentence)), "es") == "Está de pie"
    assert in_language(from_data(as_data(sentence)), "es") == "Está de pie"
