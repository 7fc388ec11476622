"""Encoding of values that pass between the process that measures an answer and the process that runs it.

The values pass as JSON. Pickled objects could run code of the answer in the process that measures, so plain data alone
passes: numbers, texts, booleans, None, lists, tuples, sets, mappings, complex numbers and arrays of real numbers. JSON
has no tuples, for example: a value of such a kind is tagged with its kind. Arrays of complex numbers are refused.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.base.errors import SimrobError, quote_value
from simrob_drake.base.messages import message

MOST_NESTED = 100
"""Largest count of levels of an encoded value. A list takes one level, a tuple or a set two, and a mapping three."""

TAG = "__value__"
"""Key of an encoded value with the name of its kind, for a kind that JSON does not have."""


class NotPlain(SimrobError):
    """A value that is more than plain data, such as a function or an object."""


def encode(value: Any, depth: int = 0) -> Any:
    """Turn a value into one that `json.dumps` accepts.

    A value of a kind that JSON does not have becomes ``{TAG: kind, "content": [...]}``.

    Args:
        value: a number, a text, None, or a container of them.
        depth: count of levels around the value. A caller from outside leaves it out.

    Raises:
        NotPlain: the value is no plain data, or nested too deeply.
    """
    if depth > MOST_NESTED:
        raise NotPlain(
            message("course.nested_too_deeply", "values nested so deeply cannot be passed on")
        )
    # A single number of NumPy becomes a number of Python.
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list):
        return [encode(part, depth + 1) for part in value]
    tagged = _tagged_list(value)
    return {TAG: tagged.kind, "content": encode(tagged.content, depth + 1)}


class _TaggedList(NamedTuple):
    """A value as a list, and the name of its kind.

    Attributes:
        kind: a key of `_MAKERS`.
        content: list from which the value can be made. Its elements are not encoded yet.
    """

    kind: str
    content: list[Any]


def _tagged_list(value: Any) -> _TaggedList:
    """Write a value of a kind that JSON does not have, such as a tuple, as a list.

    Raises:
        NotPlain: the value is no plain data, or an array of complex numbers.
    """
    if isinstance(value, complex):
        return _TaggedList("complex", [value.real, value.imag])
    # Booleans, integers and floats. Arrays of objects are refused: they cannot pass without pickle. Complex numbers
    # are refused in arrays, since JSON has none.
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        return _TaggedList("array", [value.dtype.str, list(value.shape), value.ravel().tolist()])
    # Keys of any kind are allowed, so a mapping is a list of pairs.
    if isinstance(value, Mapping):
        return _TaggedList("mapping", [[key, part] for key, part in value.items()])
    if isinstance(value, tuple):
        return _TaggedList("tuple", [*value])
    if isinstance(value, set):
        return _TaggedList("set", [*value])
    # A frozenset stays one, since it may be an element of a set or the key of a mapping.
    if isinstance(value, frozenset):
        return _TaggedList("frozenset", [*value])
    raise NotPlain(
        message(
            "course.not_plain",
            "{value} is of {kind}; it must be numbers, texts, lists, mappings or arrays",
            value=quote_value(value),
            kind=type(value).__name__,
        )
    )


def _make_array(content: list[Any]) -> np.ndarray[Any, Any]:
    """Make an array from a list of three: the name of its number type, its shape, and all its numbers in a row."""
    number_type, shape, numbers = content
    return np.array(numbers, dtype=np.dtype(number_type)).reshape(shape)


_MAKERS: dict[str, Callable[[list[Any]], Any]] = {
    "complex": lambda parts: complex(*parts),
    "array": _make_array,
    "mapping": dict,
    "tuple": tuple,
    "set": set,
    "frozenset": frozenset,
}
"""Functions that make a value from its content as a list, by the name of the value's kind."""


def decode(value: Any) -> Any:
    """Restore the value that `encode` has turned into plain JSON."""
    if isinstance(value, list):
        return [decode(part) for part in value]
    if isinstance(value, dict):
        return _MAKERS[value[TAG]](decode(value["content"]))
    return value
