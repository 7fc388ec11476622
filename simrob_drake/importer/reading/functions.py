"""The names that every expression of a xacro file knows: functions of Python, of ``math`` and of xacro, each by itself.

What is not listed here does not exist for a xacro file. No function takes longer, or gives more, than its arguments
and :data:`~simrob_drake.importer.reading.expressions.LARGEST` let expect.
"""

import math
import re
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from simrob_drake.importer.reading.expressions import LARGEST, Function, Methods, NotAllowed, bounded

_OF_MATH = re.findall(
    r"\w+",
    """acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh degrees dist erf erfc exp exp2 expm1 fabs
    floor fmod frexp fsum gamma gcd hypot isclose isfinite isinf isnan isqrt ldexp lgamma log log10 log1p log2 modf pow
    radians remainder sin sinh sqrt tan tanh trunc ulp""",
)
_CONSTANTS = ("e", "inf", "nan", "pi", "tau")
_KINDS = {"bool": bool, "dict": dict, "float": float, "int": int, "list": list, "set": set, "str": str, "tuple": tuple}
_FINEST = 400  # digits that a float can be rounded to


def symbols(**of_xacro: Callable[..., Any]) -> dict[str, Any]:
    """Return what the names of expressions stand for; ``of_xacro`` are the functions of its namespace ``xacro``."""
    numeric = {name: getattr(math, name) for name in _OF_MATH}
    constants = {name: getattr(math, name) for name in _CONSTANTS}
    math_names = {**_functions(numeric), **constants}
    python_names = {**_functions(_OF_PYTHON), "True": True, "False": False}
    xacro_names = _functions({**of_xacro, "dotify": dict, "tokenize": _tokenize})
    direct = (*_KINDS, "len", "max", "min", "range", "round", "sorted", "map", "True", "False")
    return {
        **{name: python_names[name] for name in direct if name not in ("set", "tuple")},
        **math_names,
        **{name: xacro_names[name] for name in ("abs_filename", "dotify", "load_yaml")},
        "math": math_names,
        "python": python_names,
        "xacro": xacro_names,
    }


def _functions(run: dict[str, Callable[..., Any]]) -> dict[str, Function]:
    return {name: Function(name, one) for name, one in run.items()}


def _map(function: Function, many: Iterable[Any]) -> list[Any]:
    if not isinstance(function, Function):
        raise NotAllowed("map needs a function")
    return [function.run(one) for one in bounded(many)]


def _isinstance(value: Any, kinds: Function | tuple[Function, ...]) -> bool:
    return isinstance(value, tuple(_KINDS[kind.name] for kind in (kinds if isinstance(kinds, tuple) else (kinds,))))


def _round(value: float, ndigits: int | None = None) -> float:
    return round(value, None if ndigits is None else max(-_FINEST, min(ndigits, _FINEST)))


def _sum(many: Iterable[float], start: float = 0) -> float:
    return sum((value + 0 for value in many), start)  # numbers alone: lists would be copied again and again


def _tokenize(text: str, sep: str = ",; ", skip_empty: bool = True) -> list[str]:
    parts = re.split(f"[{re.escape(sep)}]", text)
    return [part for part in parts if part] if skip_empty else parts


def _replaced(text: str, old: str, new: str, count: int = -1) -> str:
    _check_size((text.count(old) + 1) * len(new))
    return text.replace(old, new, count)


def _joined(text: str, many: Iterable[str]) -> str:
    parts = list(bounded(many))
    _check_size(len(text) * len(parts))
    return text.join(parts)


def _listed(name: str, mapping: dict[Any, Any]) -> list[Any]:
    return list(getattr(mapping, name)())


def _check_size(size: int) -> None:
    if size > LARGEST:
        raise NotAllowed(f"a text of more than {LARGEST} letters is not allowed")


_OF_PYTHON: dict[str, Callable[..., Any]] = {
    **_KINDS,
    **{run.__name__: run for run in (abs, all, any, divmod, len, max, min, ord, range)},
    "enumerate": lambda many, start=0: list(enumerate(many, start)),
    "isinstance": _isinstance,
    "map": _map,
    "reversed": lambda many: list(reversed(many)),
    "round": _round,
    "sorted": lambda many, reverse=False: sorted(many, reverse=reverse),
    "sum": _sum,
    "zip": lambda *many: list(zip(*many, strict=False)),
}
_OF_VALUES = {
    str: "endswith find lower lstrip rstrip split startswith strip upper",
    list: "count index pop",
    dict: "get",
}

METHODS: Methods = {
    **{(kind, name): getattr(kind, name) for kind, names in _OF_VALUES.items() for name in names.split()},
    (str, "join"): _joined,
    (str, "replace"): _replaced,
    **{(dict, name): partial(_listed, name) for name in ("items", "keys", "values")},
}
"""What is written behind a value: functions of texts, lists and mappings that published files need."""
