"""All sentences that users meet are in plain English and plain Spanish: their words, and their lengths."""

import re

import pytest

from simrob_drake.base.messages import core_packages
from tests.sentences import Sentence, key_descriptions, messages, write_list

ENGLISH_WORDS = {
    "things do not tell, say, know or mind": (
        r"\b(tells?|told|knows?|minds?|says? (that|what|which|where))\b"
    ),
    "a thing is no person": r"\b(whoever|whom|nobody|somebody|anybody)\b|(?<!\{)\bwho\b",
    "a figure of speech": r"\b(lets? go|keeps? (its|their) feet|goes along|creeps?|runs? away)\b",
    "a word of this house, not of the field": r"\b(beside|anyhow|likewise|figures?|what becomes of)\b",
    "a pronoun needs a noun": (
        r"\b(there (is|are) none|which would do|what it (is|does|has)|is called so)\b"
    ),
    "a thing neither lies nor stands": r"\b(lies?|stands?) (in|outside|inside|within|for|twice)\b",
}
"""Rules that a sentence breaks, with the expressions that find it."""

SPANISH_WORDS = {
    "a calque of 'reset' or 'default'": r"\b(resete\w*|defaulte\w*)\b",
    "a thing is no person": r"\b(dice|sabe|cuenta) (que|qué|lo que)\b",
    "an English word": r"\b(the|with|and|missing|empty|finite|positive|gait)\b",
}

LONGEST = 34
"""Words of the longest sentence. A field counts as one word."""

core = set(core_packages())
core_messages = [entry for entry in messages() if entry.name.partition(".")[0] in core]
descriptions = list(key_descriptions())


def without_code(text: str) -> str:
    """Text without fields, code and names of options, which have words of their own."""
    return re.sub(r"`[^`]*`|\{[^}]*\}|--\w[\w-]*|\b\w+[._/]\w[\w./]*", "X", text)


def breaches(entries: list[Sentence], texts: list[str], rules: dict[str, str]) -> list[str]:
    """Sentences that break a rule, with its name."""
    return [
        f"{entry.name}: {rule}: {text}"
        for entry, text in zip(entries, texts, strict=True)
        for rule, expression in rules.items()
        if re.search(expression, without_code(text), re.IGNORECASE)
    ]


def test_the_list_has_all_messages_of_the_core_and_all_keys():
    text = write_list(None)

    assert len(core_messages) > 2000
    assert len(descriptions) > 800
    for entry in (core_messages[0], core_messages[-1], descriptions[0], descriptions[-1]):
        assert f"{entry.name}: {entry.english}" in text


def test_a_list_may_have_one_package_alone():
    lines = [line for line in write_list("blocks").splitlines() if not line.startswith(" ")]

    assert lines
    assert all(line.startswith("blocks.") for line in lines)


def test_messages_are_in_plain_english():
    texts = [entry.english for entry in core_messages]

    assert breaches(core_messages, texts, ENGLISH_WORDS) == []


def test_descriptions_of_keys_are_in_plain_english():
    texts = [entry.english for entry in descriptions]

    assert breaches(descriptions, texts, ENGLISH_WORDS) == []


def test_messages_are_in_plain_spanish():
    texts = [entry.spanish or "" for entry in core_messages]

    assert breaches(core_messages, texts, SPANISH_WORDS) == []


@pytest.mark.parametrize("entries", [core_messages, descriptions], ids=["messages", "keys"])
def test_no_sentence_is_too_long(entries):
    too_long = [
        f"{entry.name}: {sentence}"
        for entry in entries
        for sentence in re.split(r"[.;:?!]\s|\n\n", without_code(entry.english))
        if len(sentence.split()) > LONGEST
    ]

    assert too_long == []


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("the robot keeps its feet", "a figure of speech"),
        ("there is none", "a pronoun needs a noun"),
        ("the key stands twice", "a thing neither lies nor stands"),
        ("it tells the mass", "things do not tell, say, know or mind"),
    ],
)
def test_a_sentence_that_breaks_a_rule_is_found(text, rule):
    (found,) = breaches([Sentence("base.example", text, None)], [text], ENGLISH_WORDS)

    assert rule in found
