"""Evaluate the expressions of xacro files: a small part of Python, which is interpreted here and never run by Python.

A xacro file comes from anywhere, so that an expression may compute, and nothing else. It combines numbers, texts, lists
and mappings by operators, conditions, indices and functions. Three rules make this safe:

- Nothing of a Python object can be reached. In ``a.b``, ``b`` is a key of a mapping, never an attribute.
- Functions are listed one by one: some of Python, of ``math`` and of xacro. No other function exists for an expression.
- The size of each value is limited by :data:`LARGEST`, and so are the time and the memory of each function.
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

LARGEST = 1_000_000
"""Largest size of a value: its characters, and ten for each number and each entry in it."""

# Python's parser calls itself for each level of a nested expression, and could exhaust its stack.
_LONGEST = 20_000
"""Largest count of characters of an expression."""

# Powers of whole numbers grow without bound: 10 ** 10 ** 10 would fill the memory.
_MOST_BITS = 2048
"""Largest size of a whole number [bits]. The largest float has 1024."""

_PLAIN = (bool, int, float, str, list, tuple, dict, set, range, type(None))
"""Types of the values that an expression may have. None of them leads to code or to files."""

# A short format can make a huge text, such as '%99999999d', or '%*d' with the width as a value.
_WIDE = re.compile(r"%[^%a-zA-Z]*(\*|\d{4})")
"""Part of a format with a width or a precision of four digits or more, or one that is given as a value."""

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
    ast.In: lambda value, container: value in container,
    ast.NotIn: lambda value, container: value not in container,
}
"""Operators that an expression may use. Others are refused, such as shifts, which make huge numbers of small ones."""


class NotAllowed(Exception):
    """Raised when an expression contains something that no xacro file may do. The text of the error is the reason."""


# Not callable, because functions of Python such as max() call an argument `key` themselves, without any check.
@dataclass(frozen=True)
class Function:
    """A function that expressions may call. Python itself cannot call it, so that only the interpreter here does.

    Attributes:
        name: name of the function.
        run: the function of Python that computes the result.
    """

    name: str
    run: Callable[..., Any] = field(repr=False)


def evaluate(text: str, names: Mapping[str, Any]) -> Any:
    """Compute the value of an expression.

    Args:
        text: the expression.
        names: values and functions (:class:`Function`) by the names that the expression may use.

    Raises:
        SyntaxError: the text is no expression of Python.
        NotAllowed: the expression contains something that xacro files may not do, or a value is too large.
        Exception: errors that Python raises for the values, such as ZeroDivisionError.
    """
    if len(text) > _LONGEST:
        raise NotAllowed(
            message(
                "importer.expression_too_long",
                "an expression of more than {longest} characters is not allowed",
                longest=_LONGEST,
            )
        )
    # The parser only reads: it runs nothing of the text.
    return _Scope(names).value(ast.parse(text.strip(), mode="eval").body)


def check_value(value: Any) -> Any:
    """Check that a value is of an allowed type and not too large, with all values in it, and return it.

    Raises:
        NotAllowed: the value is too large, or a value in it has another type.
    """
    size_of(value)
    return value


def size_of(value: Any, size_before: int = 0) -> int:
    """Size of a value, as :data:`LARGEST` counts it, added to a size.

    Args:
        value: the value.
        size_before: size of the values before it. The sum is limited.

    Raises:
        NotAllowed: the sum is too large, or a value in the value has a type that is not allowed.
    """
    _check_type(value)
    if isinstance(value, int) and value.bit_length() > _MOST_BITS:
        raise NotAllowed(
            message(
                "importer.number_too_large",
                "a number of more than {bits} bits is not allowed",
                bits=_MOST_BITS,
            )
        )
    # A number counts as ten characters, as it takes about as much memory.
    size = size_before + (len(value) if isinstance(value, str) else 10)
    parts: Iterable[Any] = ()
    if isinstance(value, dict):
        # Keys may be long texts, too.
        parts = [*value.keys(), *value.values()]
    elif isinstance(value, list | tuple | set | range):
        parts = value
    # The count ends as soon as it is too large. Nested lists of one list can stand for 2**30 entries in little memory.
    for part in parts:
        size = size_of(part, size)
    if size > LARGEST:
        raise NotAllowed(
            message(
                "importer.value_too_long",
                "a value of more than {largest} characters is not allowed",
                largest=LARGEST,
            )
        )
    return size


@dataclass(frozen=True)
class _Scope:
    """Names that a part of an expression can use, and the evaluation of such a part.

    Attributes:
        names: values of the names of the whole expression.
        own: values of the names that the comprehensions around the part define. They hide equal names.
    """

    names: Mapping[str, Any]
    own: Mapping[str, Any] = field(default_factory=dict)

    def value(self, node: ast.expr) -> Any:
        """Compute the value of a part of the expression, given as a node of its syntax tree.

        Raises:
            NotAllowed: the part is of a form that is not allowed, such as a lambda, or its value is not allowed.
        """
        rule = _RULES.get(type(node))
        # A list of what is allowed, and not of what is forbidden: new versions of Python add new forms.
        if rule is None:
            raise NotAllowed(_not_in_expression(node))
        return rule(self, node)


def _not_in_expression(node: ast.AST) -> str:
    """Message that a form or an operator is not allowed, with its name in Python's syntax tree."""
    return message(
        "importer.not_in_expression",
        "{name} is not allowed in an expression",
        name=type(node).__name__,
    )


def _constant(_: _Scope, node: ast.Constant) -> Any:
    """Value of a number, a text, True, False or None."""
    return check_value(node.value)


def _name(scope: _Scope, node: ast.Name) -> Any:
    """Look up the value of a name.

    Raises:
        NameError: there is no such name.
    """
    # Names of a comprehension are found first, as in Python.
    values = scope.own if node.id in scope.own else scope.names
    try:
        value = values[node.id]
    except KeyError:
        raise NameError(
            message("importer.name_not_defined", "name '{name}' is not defined", name=node.id)
        ) from None
    _check_type(value)
    return value


def _list(scope: _Scope, node: ast.List | ast.Tuple) -> list[Any]:
    """Values of the entries of a list or a tuple."""
    values = [scope.value(part) for part in node.elts]
    # The parts may be small, and their sum may not.
    size_of(values)
    return values


def _tuple(scope: _Scope, node: ast.Tuple) -> tuple[Any, ...]:
    """Value of a tuple."""
    return tuple(_list(scope, node))


def _mapping(scope: _Scope, node: ast.Dict) -> dict[Any, Any]:
    """Value of a mapping such as ``{'a': 1}``.

    Raises:
        ValueError: it contains the entries of another mapping, as in ``{**other}``.
    """
    # For {**other}, Python has None as the key. The counts then differ, and zip() raises a ValueError.
    keys = [scope.value(key) for key in node.keys if key is not None]
    values = _list(scope, ast.List(node.values))
    return dict(zip(keys, values, strict=True))


def _unary(scope: _Scope, node: ast.UnaryOp) -> Any:
    """Value of an operator with one operand, such as ``-x``."""
    return _operator(node.op)(scope.value(node.operand))


def _binary(scope: _Scope, node: ast.BinOp) -> Any:
    """Value of an operator with two operands, such as ``x + y``.

    Raises:
        NotAllowed: the operator is not allowed, or the result would be too large.
    """
    left = scope.value(node.left)
    right = scope.value(node.right)
    # Some results must be refused before they are computed, because the computation itself would take too long.
    # Powers of floats end at 1e308 by themselves, with an OverflowError.
    are_whole = isinstance(left, int) and isinstance(right, int)
    if isinstance(node.op, ast.Pow) and are_whole:
        _check_power(left, right)
    if isinstance(node.op, ast.Mult) and not are_whole:
        _check_repetition(left, right)
        _check_repetition(right, left)
    if isinstance(node.op, ast.Mod) and isinstance(left, str) and _WIDE.search(left):
        raise NotAllowed(
            message(
                "importer.format_too_long",
                "a format with a width of more than 999 characters is not allowed",
            )
        )
    return check_value(_operator(node.op)(left, right))


def _check_power(base: int, exponent: int) -> None:
    """Check that a power of whole numbers does not have too many bits.

    Raises:
        NotAllowed: it has.
    """
    if base.bit_length() * exponent > _MOST_BITS:
        raise NotAllowed(
            message(
                "importer.power_too_large",
                "a power of more than {bits} bits is not allowed",
                bits=_MOST_BITS,
            )
        )


def _check_repetition(value: Any, count: Any) -> None:
    """Check that a product, if it is the repetition of a text or a list, does not become too large.

    Raises:
        NotAllowed: it does.
    """
    is_repetition = isinstance(value, str | list | tuple) and isinstance(count, int)
    if is_repetition and size_of(value) * count > LARGEST:
        raise NotAllowed(
            message(
                "importer.repetition_too_long",
                "a repetition to more than {largest} characters is not allowed",
                largest=LARGEST,
            )
        )


def _junction(scope: _Scope, node: ast.BoolOp) -> Any:
    """Value of ``and`` or ``or``: that of the first part that decides it, or else of the last part.

    Parts after the decisive one are not evaluated, as in Python: ``x and 1 / x`` is no division by zero.
    """
    value = None
    for part in node.values:
        value = scope.value(part)
        # A true value decides an `or`, a false one decides an `and`.
        if bool(value) is isinstance(node.op, ast.Or):
            break
    return value


def _comparison(scope: _Scope, node: ast.Compare) -> bool:
    """Value of a comparison or of a chain such as ``0 < x <= 1``, which ends at the first pair that is not true."""
    left = scope.value(node.left)
    for op, comparator in zip(node.ops, node.comparators, strict=True):
        right = scope.value(comparator)
        if not _operator(op)(left, right):
            return False
        # A chain compares neighbours: in 0 < x <= 1, the x is the next left side.
        left = right
    return True


def _condition(scope: _Scope, node: ast.IfExp) -> Any:
    """Value of ``x if condition else y``, of which only one side is evaluated."""
    return scope.value(node.body if scope.value(node.test) else node.orelse)


def _entry(scope: _Scope, node: ast.Subscript) -> Any:
    """Value of an index such as ``x[0]`` or ``x['key']``, or of a slice such as ``x[1:3]``.

    Raises:
        NotAllowed: the value has no entries.
    """
    owner = scope.value(node.value)
    if not isinstance(owner, str | list | tuple | dict | range):
        raise NotAllowed(
            message(
                "importer.entry_not_allowed",
                "an index into a value of the type {name} is not allowed",
                name=type(owner).__name__,
            )
        )
    if isinstance(node.slice, ast.Slice):
        ends = (node.slice.lower, node.slice.upper, node.slice.step)
        # A slice is a part of a text or list, so that it cannot be too large.
        values = [None if end is None else scope.value(end) for end in ends]
        return owner[slice(*values)]
    entry = owner[scope.value(node.slice)]
    _check_type(entry)
    return entry


def _attribute(scope: _Scope, node: ast.Attribute) -> Any:
    """Value of ``x.key``, for a mapping x."""
    return _value_of_key(scope.value(node.value), node.attr)


def _call(scope: _Scope, node: ast.Call) -> Any:
    """Value of a call of a function or method that is allowed.

    Raises:
        NotAllowed: the function or the form of an argument (such as ``*x``) is not allowed, or the result is too large.
    """
    if any(keyword.arg is None for keyword in node.keywords):
        raise NotAllowed(message("importer.no_double_star", "** before an argument is not allowed"))
    run = _function(scope, node.func)
    by_name = {str(keyword.arg): scope.value(keyword.value) for keyword in node.keywords}
    # *arguments are refused here, as no rule exists for them.
    arguments = [scope.value(argument) for argument in node.args]
    return check_value(run(*arguments, **by_name))


def _function(scope: _Scope, node: ast.expr) -> Callable[..., Any]:
    """Function of Python that a call runs: a method such as ``text.lower``, or a named function such as ``math.sin``.

    Raises:
        NotAllowed: it is not allowed.
    """
    if isinstance(node, ast.Attribute):
        owner = scope.value(node.value)
        # The exact type counts: only the types themselves are known to have harmless methods.
        method = _METHODS.get((type(owner), node.attr))
        if method is not None:
            # The method gets its value as the first argument, as if Python had bound it.
            return partial(method, owner)
        # Not a method: a function in a mapping, such as the namespace `math`.
        found = _value_of_key(owner, node.attr)
    else:
        found = scope.value(node)
    # Also for 3(1) or "a"(): Python would call what it finds.
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
    """Value of a comprehension such as ``[2 * x for x in y]`` or ``[a + b for a, b in pairs]``.

    It goes over one list, or over another value that has entries.

    Raises:
        NotAllowed: the comprehension has conditions or several lists, or its value becomes too large.
    """
    loop = node.generators[0]
    # Each further list would multiply the time.
    if len(node.generators) > 1 or loop.ifs:
        raise NotAllowed(
            message(
                "importer.no_such_comprehension",
                "a comprehension with conditions, or over several lists, is not allowed in an expression",
            )
        )
    has_several_names = isinstance(loop.target, ast.Tuple)
    targets = loop.target.elts if isinstance(loop.target, ast.Tuple) else [loop.target]
    names = [ast.unparse(target) for target in targets]
    values = []
    size = 0
    for entry in check_value(scope.value(loop.iter)):
        entries = check_value(entry) if has_several_names else [entry]
        own = dict(zip(names, entries, strict=True))
        value = replace(scope, own={**scope.own, **own}).value(node.elt)
        values.append(value)
        # Counted in each turn, so that a long list of large values ends before it fills the memory.
        size = size_of(value, size)
    return values


_RULES: dict[type[ast.expr], Callable[[_Scope, Any], Any]] = {
    ast.Constant: _constant,
    ast.Name: _name,
    ast.List: _list,
    ast.Tuple: _tuple,
    ast.Dict: _mapping,
    ast.UnaryOp: _unary,
    ast.BinOp: _binary,
    ast.BoolOp: _junction,
    ast.Compare: _comparison,
    ast.IfExp: _condition,
    ast.Subscript: _entry,
    ast.Attribute: _attribute,
    ast.Call: _call,
    ast.ListComp: _comprehension,
}
"""Functions that evaluate the forms of an expression, by the node of Python's syntax tree. Other forms are refused."""


def _operator(op: ast.AST) -> Callable[..., Any]:
    """Function of Python for an operator.

    Raises:
        NotAllowed: the operator is not allowed.
    """
    if type(op) not in _OPERATORS:
        raise NotAllowed(_not_in_expression(op))
    return _OPERATORS[type(op)]


def _value_of_key(owner: Any, key: str) -> Any:
    """Value of a key of a mapping, written as ``owner.key``.

    Raises:
        NotAllowed: the owner is no mapping.
        NameError: the mapping has no such key.
    """
    # The attributes of all other values lead to Python's interpreter.
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
        value = owner[key]
    except KeyError:
        raise NameError(message("importer.no_key", "there is no key '{key}'", key=key)) from None
    _check_type(value)
    return value


def _check_type(value: Any) -> None:
    """Check that a value is of a type that expressions may have. The values in it are not checked.

    Raises:
        NotAllowed: the value has another type.
    """
    if not isinstance(value, (*_PLAIN, Function)):
        raise NotAllowed(
            message(
                "importer.kind_not_allowed",
                "a value of the type {name} is not allowed in an expression",
                name=type(value).__name__,
            )
        )


_MATH_FUNCTIONS = re.findall(
    r"\w+",
    """acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh degrees dist erf erfc exp exp2 expm1 fabs
    floor fmod frexp fsum gamma gcd hypot isclose isfinite isinf isnan isqrt ldexp lgamma log log10 log1p log2 modf pow
    radians remainder sin sinh sqrt tan tanh trunc ulp""",
)
"""Functions of ``math`` for expressions. ``factorial``, ``comb`` and ``perm`` make huge numbers of small ones."""

_MATH_CONSTANTS = ("e", "inf", "nan", "pi", "tau")

_TYPES = {
    "bool": bool,
    "dict": dict,
    "float": float,
    "int": int,
    "list": list,
    "set": set,
    "str": str,
    "tuple": tuple,
}
"""Types that an expression may call to convert a value, by name."""

# round(12345, -10**9) would compute a power of ten with a billion digits.
_MOST_DIGITS = 400
"""Largest count of digits, on either side of the point, to which a number is rounded: 1e-324 to 1e308 are floats."""


def symbols(**xacro_functions: Callable[..., Any]) -> dict[str, Any]:
    """Values and functions of the names that expressions can use, for :func:`evaluate`.

    Args:
        xacro_functions: functions of the namespace ``xacro``, by name: at least ``abs_filename`` and ``load_yaml``.
    """
    math_functions = {name: getattr(math, name) for name in _MATH_FUNCTIONS}
    math_constants = {name: getattr(math, name) for name in _MATH_CONSTANTS}
    # Constants are plain values, all others must be wrapped to be called.
    math_names = {**_functions(math_functions), **math_constants}
    python_names = {**_functions(_PYTHON_FUNCTIONS), "True": True, "False": False}
    xacro_names = _functions({**xacro_functions, "dotify": dict, "tokenize": _tokenize})

    # As in xacro, some names are also available without their namespace.
    short_names = [name for name in _TYPES if name not in ("set", "tuple")]
    short_names += ["len", "max", "min", "range", "round", "sorted", "map", "True", "False"]
    return {
        **{name: python_names[name] for name in short_names},
        **math_names,
        **{name: xacro_names[name] for name in ("abs_filename", "dotify", "load_yaml")},
        "math": math_names,
        "python": python_names,
        "xacro": xacro_names,
    }


def _functions(run_by_name: dict[str, Callable[..., Any]]) -> dict[str, Function]:
    """Wrap functions of Python for expressions, by their names."""
    return {name: Function(name, run) for name, run in run_by_name.items()}


def _map(function: Function, values: Iterable[Any]) -> list[Any]:
    """Call a function for each value. Unlike that of Python, the result is a list: an iterator is no plain value."""
    if not isinstance(function, Function):
        raise NotAllowed(
            message("importer.map_needs_function", "the first argument of map must be a function")
        )
    return [function.run(value) for value in check_value(values)]


def _isinstance(value: Any, types: Function | tuple[Function, ...]) -> bool:
    """Whether a value is of one of some types, which expressions name by functions such as ``float``."""
    functions = types if isinstance(types, tuple) else (types,)
    return isinstance(value, tuple(_TYPES[function.name] for function in functions))


def _round(value: float, ndigits: int | None = None) -> float:
    """Round a number as Python does, but to at most 400 digits on either side of the point."""
    if ndigits is None:
        return round(value)
    return round(value, max(-_MOST_DIGITS, min(ndigits, _MOST_DIGITS)))


def _sum(values: Iterable[float], start: float = 0) -> float:
    """Sum of numbers. Lists are refused: their sum would copy all entries again and again."""
    # `value + 0` raises a TypeError for a list.
    return sum((value + 0 for value in values), start)


def _tokenize(text: str, sep: str = ",; ", skip_empty: bool = True) -> list[str]:
    """Split a text at any of some characters, as xacro's function of this name does."""
    parts = re.split(f"[{re.escape(sep)}]", text)
    return [part for part in parts if part] if skip_empty else parts


def _replace_in_text(text: str, old: str, new: str, count: int = -1) -> str:
    """Replace parts of a text. Raises NotAllowed if the result could be too large."""
    _check_size((text.count(old) + 1) * len(new))
    return text.replace(old, new, count)


def _join_by_text(text: str, parts: Iterable[str]) -> str:
    """Join texts, with a text between them. Raises NotAllowed if the result would be too large."""
    # The size of the text between them counts once for each part.
    checked_parts = list(check_value(parts))
    _check_size(len(text) * len(checked_parts))
    return text.join(checked_parts)


def _list_of_mapping(method: str, mapping: dict[Any, Any]) -> list[Any]:
    """List the items, keys or values of a mapping. The view that the method of Python returns is no plain value."""
    return list(getattr(mapping, method)())


def _check_size(size: int) -> None:
    """Check that a text does not become too large, before it is made.

    Raises:
        NotAllowed: it does.
    """
    if size > LARGEST:
        raise NotAllowed(
            message(
                "importer.text_too_long",
                "a text of more than {largest} characters is not allowed",
                largest=LARGEST,
            )
        )


# Functions that return iterators in Python return lists here: an iterator has no size that could be checked.
_PYTHON_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **_TYPES,
    # Their results are no larger than their arguments. A range is counted entry by entry.
    **{run.__name__: run for run in (abs, all, any, divmod, len, max, min, ord, range)},
    "enumerate": lambda values, start=0: list(enumerate(values, start)),
    "isinstance": _isinstance,
    "map": _map,
    "reversed": lambda values: list(reversed(values)),
    "round": _round,
    "sorted": lambda values, reverse=False: sorted(values, reverse=reverse),
    "sum": _sum,
    "zip": lambda *lists: list(zip(*lists, strict=False)),
}
"""Functions of Python that an expression may call, by name."""

_PYTHON_METHODS = {
    str: "endswith find lower lstrip rstrip split startswith strip upper",
    list: "count index pop",
    dict: "get",
}
"""Names of the methods that are those of Python, by the type of their value: those that published files use."""

_METHODS: dict[tuple[type, str], Callable[..., Any]] = {
    **{
        # getattr() is called with names of this module only, never with those of a file.
        (kind, name): getattr(kind, name)
        for kind, names in _PYTHON_METHODS.items()
        for name in names.split()
    },
    (str, "join"): _join_by_text,
    (str, "replace"): _replace_in_text,
    **{(dict, name): partial(_list_of_mapping, name) for name in ("items", "keys", "values")},
}
"""Functions that run a method such as ``text.lower()``, by the type of the value and the name of the method."""
