"""Problems that pydantic finds in values, as messages of this project.

Pydantic names each problem by a type, such as ``greater_than``, and gives its numbers. The message depends on these
alone, never on pydantic's English text. A type without an entry here keeps pydantic's own words.
"""

from collections.abc import Callable, Mapping
from typing import Any

from simrob_drake.base.messages import Message, message, message_of

Context = Mapping[str, Any]
"""Numbers and names of a problem, ``finding["ctx"]`` of pydantic. Empty if a problem has none."""

_A_NUMBER = message("base.must_be_a_number", "must be a number")
_AN_INTEGER = message("base.must_be_an_integer", "must be an integer")
_A_TEXT = message("base.must_be_a_text", "must be a text")
_A_LIST = message("base.must_be_a_list", "must be a list")
_TRUE_OR_FALSE = message("base.must_be_true_or_false", "must be true or false")
_A_PATH = message("base.must_be_a_path", "must be a path")

# Several problems have the same remedy, and so the same message: whether a text is no number, or a list is none, does
# not matter to the user.
_PLAIN_PROBLEMS: dict[str, Message] = {
    "float_type": _A_NUMBER,
    "float_parsing": _A_NUMBER,
    "finite_number": message("base.must_be_finite", "must be a finite number"),
    "int_type": _AN_INTEGER,
    "int_parsing": _AN_INTEGER,
    "int_from_float": _AN_INTEGER,
    # Python's integers have any size, pydantic's parser of texts does not.
    "int_parsing_size": message(
        "base.must_be_a_shorter_integer", "must be an integer with fewer digits"
    ),
    "string_type": _A_TEXT,
    "string_unicode": _A_TEXT,
    "bool_type": _TRUE_OR_FALSE,
    "bool_parsing": _TRUE_OR_FALSE,
    "list_type": _A_LIST,
    "tuple_type": _A_LIST,
    "set_type": _A_LIST,
    "frozen_set_type": _A_LIST,
    "iterable_type": _A_LIST,
    "none_required": message("base.must_be_null", "must be null"),
    "path_type": _A_PATH,
    "path_format": _A_PATH,
    "missing": message("base.key_needed", "this key is required"),
    "dict_type": message("base.must_be_a_mapping", "must be a mapping of keys to values"),
    "mapping_type": message("base.must_be_a_mapping", "must be a mapping of keys to values"),
    "invalid_key": message("base.keys_must_be_texts", "its keys must be texts"),
    "recursion_loop": message("base.must_not_contain_itself", "must not contain itself"),
}
"""Messages of problems without numbers, by pydantic's type of the problem."""


def _greater(context: Context) -> Message:
    return message("base.must_be_greater", "must be greater than {bound:g}", bound=context["gt"])


def _at_least(context: Context) -> Message:
    return message("base.must_be_at_least", "must be at least {bound:g}", bound=context["ge"])


def _less(context: Context) -> Message:
    return message("base.must_be_less", "must be less than {bound:g}", bound=context["lt"])


def _at_most(context: Context) -> Message:
    return message("base.must_be_at_most", "must be at most {bound:g}", bound=context["le"])


def _multiple(context: Context) -> Message:
    return message(
        "base.must_be_multiple", "must be a multiple of {factor:g}", factor=context["multiple_of"]
    )


def _too_few_values(context: Context) -> Message:
    """Message for a list or mapping that is too short."""
    return message(
        "base.needs_at_least_values",
        "needs at least {least} {least:value|values}, not {found}",
        least=context["min_length"],
        found=context["actual_length"],
    )


def _too_many_values(context: Context) -> Message:
    """Message for a list or mapping that is too long."""
    return message(
        "base.takes_at_most_values",
        "takes at most {most} {most:value|values}",
        most=context["max_length"],
    )


def _text_too_short(context: Context) -> Message:
    """Message for a text that is too short. The least length is 1 if only the empty text is refused."""
    return message(
        "base.needs_characters",
        "must have at least {least} {least:character|characters}",
        least=context["min_length"],
    )


def _text_too_long(context: Context) -> Message:
    """Message for a text that is too long."""
    return message(
        "base.has_too_many_characters",
        "must have at most {most} {most:character|characters}",
        most=context["max_length"],
    )


def _other_pattern(context: Context) -> Message:
    return message(
        "base.must_match", "must match the pattern {pattern}", pattern=context["pattern"]
    )


def _no_choice(context: Context) -> Message:
    """Message for a value that is none of the allowed ones, which pydantic lists in quotes: ``'a', 'b' or 'c'``."""
    # The names are joined without a word, so that the message needs no translation of "or".
    choices = str(context["expected"]).replace(" or ", ", ")
    return message("base.must_be_one_of", "must be one of {choices}", choices=choices)


def _other_class(context: Context) -> Message:
    return message("base.must_be_instance", "must be an instance of {name}", name=context["class"])


_PROBLEMS_WITH_CONTEXT: dict[str, Callable[[Context], Message]] = {
    "greater_than": _greater,
    "greater_than_equal": _at_least,
    "less_than": _less,
    "less_than_equal": _at_most,
    "multiple_of": _multiple,
    "too_short": _too_few_values,
    "too_long": _too_many_values,
    "string_too_short": _text_too_short,
    "string_too_long": _text_too_long,
    "string_pattern_mismatch": _other_pattern,
    "literal_error": _no_choice,
    "enum": _no_choice,
    "is_instance_of": _other_class,
}
"""Functions that make the message of a problem with numbers or names, by pydantic's type of the problem."""


def value_problem(finding: Mapping[str, Any]) -> str:
    """Describe a problem that pydantic found in a value.

    Args:
        finding: the problem, one of ``ValidationError.errors()``.

    Returns:
        the message of the validator that raised the error, if a validator of ours did; otherwise the message of the
        type of the problem. Pydantic's own text for a type without a message.
    """
    context: Context = finding.get("ctx", {})
    raised = context.get("error")
    # A validator of this package raises a ValueError with a Message, which pydantic keeps in the context. Its own text
    # of that error has lost the id of the message.
    if isinstance(raised, ValueError):
        own = message_of(raised)
        if isinstance(own, Message):
            return own
    kind = finding["type"]
    if kind in _PLAIN_PROBLEMS:
        return _PLAIN_PROBLEMS[kind]
    if kind in _PROBLEMS_WITH_CONTEXT:
        return _PROBLEMS_WITH_CONTEXT[kind](context)
    # A type of a newer pydantic, or an error of a user's class. The text follows a colon, so it has no capital letter.
    text = str(finding["msg"]).removeprefix("Value error, ")
    return f"{text[:1].lower()}{text[1:]}"
