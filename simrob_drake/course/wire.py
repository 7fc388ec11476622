"""Values as they pass between the process that measures and the one that runs an answer: as JSON, and never as code.

Pickled objects could run code of the answer in the process that measures, so plain data alone passes: numbers, texts,
truth values, None, lists, tuples, sets, mappings, complex numbers and arrays of numbers.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from simrob_drake.errors import SimrobError, quoted

MOST_NESTED = 100
"""Most levels of an encoded value. A list takes one, a tuple or a set two, and a mapping three."""

TAG = "__value__"
"""Key under which an encoded value has its kind, if JSON does not know that kind."""


class NotPlain(SimrobError):
    """A value that is more than plain data, such as a function or an object."""


def encode(value: Any, depth: int = 0) -> Any:
    """Turn a value into one that `json.dumps` accepts.

    A kind of value that JSON does not know becomes ``{TAG: kind, "content": ...}``.

    Args:
        value: numbers, texts, None, and containers of them.
        depth: levels around the value.

    Raises:
        NotPlain: the value is no plain data, or nested too deeply.
    """
    if depth > MOST_NESTED:
        raise NotPlain("values nested so deeply cannot be passed on")
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list):
        return [encode(part, depth + 1) for part in value]
    kind, content = _kind_and_content(value)
    return {TAG: kind, "content": encode(content, depth + 1)}


def _kind_and_content(value: Any) -> tuple[str, list[Any]]:
    """Return the kind, and the content as a list, of a value that JSON does not know, such as a tuple.

    A frozenset comes back as a set.
    """
    if isinstance(value, complex):
        return "complex", [value.real, value.imag]
    # Truth values, integers and floats; not arrays of objects, which pickle would be needed for.
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        return "array", [value.dtype.str, list(value.shape), value.ravel().tolist()]
    if isinstance(value, Mapping):
        return "mapping", [[key, part] for key, part in value.items()]
    if isinstance(value, tuple):
        return "tuple", [*value]
    if isinstance(value, set | frozenset):
        return "set", [*value]
    raise NotPlain(
        f"{quoted(value)} is of {type(value).__name__}; it must be numbers, texts, lists, mappings or arrays"
    )


def _array(content: list[Any]) -> np.ndarray[Any, Any]:
    """Make an array of its type, shape and numbers."""
    kind, shape, numbers = content
    return np.array(numbers, dtype=np.dtype(kind)).reshape(shape)


_MAKERS: dict[str, Callable[[list[Any]], Any]] = {
    "complex": lambda parts: complex(*parts),
    "array": _array,
    "mapping": dict,
    "tuple": tuple,
    "set": set,
}


def decode(value: Any) -> Any:
    """Make the value that `encode` has turned into plain JSON."""
    if isinstance(value, list):
        return [decode(part) for part in value]
    if isinstance(value, dict):
        return _MAKERS[value[TAG]](decode(value["content"]))
    return value
