"""The expressions of xacro files: a small part of Python, interpreted, so that a file can compute and nothing else.

Numbers, texts, lists and mappings are combined by operators, conditions, indices and named functions. Nothing of a
Python object can be reached: an attribute is the key of a mapping, a function is no callable, and what is written
behind a value as a method is a function of ours. What an expression gives is bounded in size.

What every expression knows are functions of Python, of ``math`` and of xacro, each listed by itself: the others do not
exist for a xacro file. None takes longer, or gives more, than its arguments and :data:`LARGEST` let expect.
"""

import ast
import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from simrob_drake.base.messages import message

LARGEST = (
    1_000_000  # how much a value may hold: letters, and ten for each number and each entry in it
)
_LONGEST = 20_000  # letters of an expression
_BITS = 2048  # of a whole number; a float reaches to 1024
_PLAIN = (bool, int, float, str, list, tuple, dict, set, range, type(None))
_WIDE = re.compile(r"%[^%a-zA-Z]*(\*|\d{4})")  # a format that makes a thousand letters of one

_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.In: lambda one, many: one in many,
    ast.NotIn: lambda one, many: one not in many,
}


class NotAllowed(Exception):
    """An expression with something that no xacro file may do."""


@dataclass(frozen=True)
class Function:
    """A function that expressions may call; it is no callable, so that nothing but the interpreter can call it."""

    name: str
    run: Callable[..., Any] = field(repr=False)


def evaluate(text: str, names: Mapping[str, Any]) -> Any:
    """Return the value of an expression, in which ``names`` stand for values and for each :class:`Function`.

    Raises SyntaxError: it is none; NotAllowed: it holds something that xacro files may not do, or its value is too
    large; Exception: what Python raises for such values, such as ZeroDivisionError.
    """
    if len(text) > _LONGEST:
        raise NotAllowed(
            message(
                "importer.expression_too_long",
                "an expression of more than {longest} letters is not allowed",
                longest=_LONGEST,
            )
        )
    return _Scope(names).value(ast.parse(text.strip(), mode="eval").body)


def bounded(value: Any) -> Any:
    """Return a value that is plain and not too large; raises NotAllowed: it is not."""
    size_of(value)
    return value


def size_of(value: Any, size: int = 0) -> int:
    """Return ``size`` and what a value adds to it: its letters, and ten for each number and each entry.

    Raises NotAllowed: that is too much, or there is something in it that no expression may hold.
    """
    if isinstance(_plain(value), int) and value.bit_length() > _BITS:
        raise NotAllowed(
            message(
                "importer.number_too_large",
                "a number of more than {bits} bits is not allowed",
                bits=_BITS,
            )
        )
    size += len(value) if isinstance(value, str) else 10
    if isinstance(value, dict):
        value = [*value.keys(), *value.values()]
    if isinstance(value, list | tuple | set | range):
        for part in value:
            size = size_of(part, size)
    if size > LARGEST:
        raise NotAllowed(
            message(
                "importer.value_too_long",
                "a value of more than {largest} letters is not allowed",
                largest=LARGEST,
            )
        )
    return size


@dataclass(frozen=True)
class _Scope:
    """What the names in a part of an expression stand for; ``own`` are those of the comprehensions around it."""

    names: Mapping[str, Any]
    own: Mapping[str, Any] = field(default_factory=dict)

    def value(self, node: ast.expr) -> Any:
        if type(node) not in _RULES:
            raise NotAllowed(
                message(
                    "importer.not_in_expression",
                    "{name} is not allowed in an expression",
                    name=type(node).__name__,
                )
            )
        return _RULES[type(node)](self, node)


def _name(scope: _Scope, node: ast.Name) -> Any:
    try:
        return _plain(scope.own[node.id] if node.id in scope.own else scope.names[node.id])
    except KeyError:
        raise NameError(
            message("importer.name_not_defined", "name '{name}' is not defined", name=node.id)
        ) from None


def _list(scope: _Scope, node: ast.List | ast.Tuple) -> Any:
    return bounded([scope.value(part) for part in node.elts])


def _mapping(scope: _Scope, node: ast.Dict) -> dict[Any, Any]:
    keys = [scope.value(key) for key in node.keys if key is not None]
    return dict(zip(keys, _list(scope, ast.List(node.values)), strict=True))


def _binary(scope: _Scope, node: ast.BinOp) -> Any:
    one, other = scope.value(node.left), scope.value(node.right)
    whole = isinstance(one, int) and isinstance(other, int)
    match node.op:
        case ast.Pow() if whole and one.bit_length() * other > _BITS:
            raise NotAllowed(
                message(
                    "importer.power_too_large",
                    "a power of more than {bits} bits is not allowed",
                    bits=_BITS,
                )
            )
        case ast.Mult() if not whole:
            for many, times in ((one, other), (other, one)):
                if (
                    isinstance(many, str | list | tuple)
                    and isinstance(times, int)
                    and size_of(many) * times > LARGEST
                ):
                    raise NotAllowed(
                        message(
                            "importer.repetition_too_long",
                            "a repetition to more than {largest} letters is not allowed",
                            largest=LARGEST,
                        )
                    )
        case ast.Mod() if isinstance(one, str) and _WIDE.search(one):
            raise NotAllowed(
                message(
                    "importer.format_too_long", "a format of more than 999 letters is not allowed"
                )
            )
    return bounded(_operator(node.op)(one, other))


def _junction(scope: _Scope, node: ast.BoolOp) -> Any:
    """Return the first of the values that decides an ``and`` or an ``or``, else the last."""
    value = None
    for part in node.values:
        value = scope.value(part)
        if bool(value) is isinstance(node.op, ast.Or):
            break
    return value


def _comparison(scope: _Scope, node: ast.Compare) -> bool:
    left = scope.value(node.left)
    for op, comparator in zip(node.ops, node.comparators, strict=True):
        right = scope.value(comparator)
        if not _operator(op)(left, right):
            return False
        left = right
    return True


def _entry(scope: _Scope, node: ast.Subscript) -> Any:
    owner, place = scope.value(node.value), node.slice
    if not isinstance(owner, str | list | tuple | dict | range):
        raise NotAllowed(
            message(
                "importer.entry_not_allowed",
                "an entry of a {name} is not allowed",
                name=type(owner).__name__,
            )
        )
    if isinstance(place, ast.Slice):
        ends = (place.lower, place.upper, place.step)
        return owner[slice(*(None if end is None else scope.value(end) for end in ends))]
    return _plain(owner[scope.value(place)])


def _call(scope: _Scope, node: ast.Call) -> Any:
    if any(key.arg is None for key in node.keywords):
        raise NotAllowed(message("importer.no_double_star", "** is not allowed in an expression"))
    run, by_name = (
        _function(scope, node.func),
        {str(key.arg): scope.value(key.value) for key in node.keywords},
    )
    return bounded(run(*map(scope.value, node.args), **by_name))


def _function(scope: _Scope, node: ast.expr) -> Callable[..., Any]:
    if isinstance(node, ast.Attribute):
        owner = scope.value(node.value)
        if (type(owner), node.attr) in _METHODS:
            return partial(_METHODS[type(owner), node.attr], owner)
        found = _under(owner, node.attr)
    else:
        found = scope.value(node)
    if not isinstance(found, Function):
        raise NotAllowed(
            message(
                "importer.no_such_function",
                "{function} is no function that an expression may call",
                function=ast.unparse(node),
            )
        )
    return found.run


def _comprehension(scope: _Scope, node: ast.ListComp) -> list[Any]:
    """Return the values of a part for all entries of one list, under one name or several."""
    loop = node.generators[0]
    if len(node.generators) > 1 or loop.ifs:
        raise NotAllowed(
            message(
                "importer.no_such_comprehension",
                "a comprehension with conditions, or of several lists, is not allowed in an expression",
            )
        )
    several = isinstance(loop.target, ast.Tuple)
    names = [
        ast.unparse(name)
        for name in (loop.target.elts if isinstance(loop.target, ast.Tuple) else [loop.target])
    ]
    made, size = list[Any](), 0
    for entry in bounded(scope.value(loop.iter)):
        own = dict(zip(names, bounded(entry) if several else [entry], strict=True))
        made.append(replace(scope, own={**scope.own, **own}).value(node.elt))
        size = size_of(made[-1], size)
    return made


_RULES: dict[type[ast.expr], Callable[[_Scope, Any], Any]] = {
    ast.Constant: lambda _, node: bounded(node.value),
    ast.Name: _name,
    ast.List: _list,
    ast.Tuple: lambda scope, node: tuple(_list(scope, node)),
    ast.Dict: _mapping,
    ast.UnaryOp: lambda scope, node: _operator(node.op)(scope.value(node.operand)),
    ast.BinOp: _binary,
    ast.BoolOp: _junction,
    ast.Compare: _comparison,
    ast.IfExp: lambda scope, node: scope.value(
        node.body if scope.value(node.test) else node.orelse
    ),
    ast.Subscript: _entry,
    ast.Attribute: lambda scope, node: _under(scope.value(node.value), node.attr),
    ast.Call: _call,
    ast.ListComp: _comprehension,
}  # what may stand in an expression; everything else is refused


def _operator(op: ast.AST) -> Callable[..., Any]:
    if type(op) not in _OPERATORS:
        raise NotAllowed(
            message(
                "importer.not_in_expression",
                "{name} is not allowed in an expression",
                name=type(op).__name__,
            )
        )
    return _OPERATORS[type(op)]


def _under(owner: Any, key: str) -> Any:
    """Return what stands under a key of a mapping."""
    if not isinstance(owner, dict):
        raise NotAllowed(
            message(
                "importer.key_not_allowed",
                ".{key} of a {name} is not allowed: only mappings have keys",
                key=key,
                name=type(owner).__name__,
            )
        )
    try:
        return _plain(owner[key])
    except KeyError:
        raise NameError(message("importer.no_key", "there is no key '{key}'", key=key)) from None


def _plain(value: Any) -> Any:
    if not isinstance(value, (*_PLAIN, Function)):
        raise NotAllowed(
            message(
                "importer.kind_not_allowed",
                "a value of the kind {name} is not allowed in an expression",
                name=type(value).__name__,
            )
        )
    return value


_OF_MATH = re.findall(
    r"\w+",
    """acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh degrees dist erf erfc exp exp2 expm1 fabs
    floor fmod frexp fsum gamma gcd hypot isclose isfinite isinf isnan isqrt ldexp lgamma log log10 log1p log2 modf pow
    radians remainder sin sinh sqrt tan tanh trunc ulp""",
)
_CONSTANTS = ("e", "inf", "nan", "pi", "tau")
_KINDS = {
    "bool": bool,
    "dict": dict,
    "float": float,
    "int": int,
    "list": list,
    "set": set,
    "str": str,
    "tuple": tuple,
}
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
        raise NotAllowed(message("importer.map_needs_function", "map needs a function"))
    return [function.run(one) for one in bounded(many)]


def _isinstance(value: Any, kinds: Function | tuple[Function, ...]) -> bool:
    return isinstance(
        value,
        tuple(_KINDS[kind.name] for kind in (kinds if isinstance(kinds, tuple) else (kinds,))),
    )


def _round(value: float, ndigits: int | None = None) -> float:
    return round(value, None if ndigits is None else max(-_FINEST, min(ndigits, _FINEST)))


def _sum(many: Iterable[float], start: float = 0) -> float:
    # numbers alone: lists would be copied again and again
    return sum((value + 0 for value in many), start)


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
        raise NotAllowed(
            message(
                "importer.text_too_long",
                "a text of more than {largest} letters is not allowed",
                largest=LARGEST,
            )
        )


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

_METHODS: dict[tuple[type, str], Callable[..., Any]] = {
    **{
        (kind, name): getattr(kind, name)
        for kind, names in _OF_VALUES.items()
        for name in names.split()
    },
    (str, "join"): _joined,
    (str, "replace"): _replaced,
    **{(dict, name): partial(_listed, name) for name in ("items", "keys", "values")},
}  # what is written behind a value, as in ``text.lower()``: what published files need, by the value's type and name
