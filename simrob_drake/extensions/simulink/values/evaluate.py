"""The value of an expression, and the functions that it calls.

Values are matrices of shape (r, c), texts, structures (dict), and lists of these.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.values.elementary import CONSTANTS, EACH
from simrob_drake.extensions.simulink.values.growth import (
    LARGEST,
    Budget,
    check_growth,
    check_size,
    count_entries,
)
from simrob_drake.extensions.simulink.values.syntax import Expression, NotUnderstood, written
from simrob_drake.extensions.simulink.values.systems import SYSTEMS

_MOST_SIGNAL_PRODUCTS = 30_000
"""Most blocks that a product of matrices of signals may become."""


def matrix(value: Any) -> Vector:
    """Return a value as a matrix of shape (r, c) (raises NotUnderstood: it is no number, or too large)."""
    if isinstance(value, str):
        raise NotUnderstood(
            message(
                "simulink.text_as_number", "uses the text '{text}' as a number", text=value[:20]
            )
        )
    if isinstance(value, dict | list):
        raise NotUnderstood(message("simulink.structure_as_number", "uses a structure as a number"))
    symbolic = (
        isinstance(value, np.ndarray) and value.dtype == object and all(map(_is_value, value.flat))
    )
    array = np.atleast_2d(value if symbolic else np.asarray(value, dtype=float))
    if array.size > LARGEST:
        raise NotUnderstood(
            message(
                "simulink.matrix_too_large",
                "makes a matrix of more than {largest} elements",
                largest=LARGEST,
            )
        )
    return array


def _is_value(element: Any) -> bool:
    """Tell whether an element is a number, or stands for one that only a run of the model has."""
    return isinstance(element, int | float) or hasattr(element, "terms")


def count(value: Any) -> int:
    """Return a whole number that is not negative."""
    number = float(matrix(value).reshape(-1)[0]) if matrix(value).size else -1.0
    if not 0 <= number <= LARGEST or number != int(number):
        raise NotUnderstood(
            message(
                "simulink.whole_number_needed",
                "needs a whole number of at most {largest}, not {number:g}",
                largest=LARGEST,
                number=number,
            )
        )
    return int(number)


def _shape(arguments: tuple[Any, ...]) -> tuple[int, int]:
    sizes = [count(number) for argument in arguments for number in matrix(argument).reshape(-1)]
    if not sizes:
        return 1, 1
    # further dimensions lie side by side
    rows, columns = (
        sizes[0],
        math.prod(sizes[1:]) if sizes[1:] else sizes[0],
    )
    if rows * columns > LARGEST:
        raise NotUnderstood(
            message(
                "simulink.matrix_too_large",
                "makes a matrix of more than {largest} elements",
                largest=LARGEST,
            )
        )
    return rows, columns


def _along(reduce: Callable[..., Vector], value: Any, axis: Any = None, **options: bool) -> Vector:
    """Do something with a matrix down the columns, or along the only row, as MATLAB does."""
    return matrix(
        reduce(matrix(value), axis=count(axis) - 1 if axis is not None else _way(value), **options)
    )


def _way(value: Any) -> int:
    return int(matrix(value).shape[0] == 1)


def _extreme(pairwise: np.ufunc, first: Any, second: Any = None) -> Vector:
    if second is None:
        return _along(pairwise.reduce, first, keepdims=True)
    return matrix(pairwise(matrix(first), matrix(second)))


def _repmat(value: Any, *times: Any) -> Vector:
    (rows, columns), array = _shape(times), matrix(value)
    _shape((array.size, rows * columns))  # which must not be too large
    return np.tile(array, (rows, columns))


def _unique(value: Any, rows: Any = None) -> Vector:
    if rows == "rows":
        return np.unique(matrix(value), axis=0)
    return np.unique(matrix(value)).reshape((1, -1) if _way(value) else (-1, 1))


def _joined(axis: int, *parts: Any) -> Vector:
    return np.concatenate([matrix(part) for part in parts if matrix(part).size], axis=axis)


def _of_matrices(function: Callable[..., Any]) -> Callable[..., Vector]:
    def applied(*values: Any) -> Vector:
        with np.errstate(all="ignore"):
            return matrix(function(*(matrix(value) for value in values)))

    return applied


FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: _of_matrices(function) for name, function in EACH.items()},
    **{name: lambda value=value: value for name, value in CONSTANTS.items()},
    "zeros": lambda *sizes: np.zeros(_shape(sizes)),
    "ones": lambda *sizes: np.ones(_shape(sizes)),
    "eye": lambda *sizes: np.eye(*_shape(sizes)),
    "diag": lambda a: (
        np.diag(matrix(a).reshape(-1)) if 1 in matrix(a).shape else matrix(np.diag(matrix(a))).T
    ),
    **{
        name: partial(_along, getattr(np, name), keepdims=True)
        for name in ("sum", "prod", "mean", "any", "all")
    },
    "min": partial(_extreme, np.minimum),
    "max": partial(_extreme, np.maximum),
    **{name: partial(_along, getattr(np, name)) for name in ("diff", "unwrap", "cumsum", "flip")},
    "circshift": lambda value, by: np.roll(matrix(value), int(matrix(by)[0, 0]), _way(value)),
    "polyval": lambda coefficients, at: np.polyval(matrix(coefficients).reshape(-1), matrix(at)),
    "norm": lambda u, p=2: np.linalg.norm(
        matrix(u).ravel() if 1 in matrix(u).shape else matrix(u), count(p) or None
    ),
    "dot": lambda a, b: np.dot(matrix(a).reshape(-1), matrix(b).reshape(-1)),
    "cross": lambda a, b: np.cross(matrix(a).reshape(-1), matrix(b).reshape(-1)).reshape(
        matrix(a).shape
    ),
    **{
        name: _of_matrices(getattr(np, name))
        for name in ("kron", "trace", "transpose", "fliplr", "flipud")
    },
    **{name: _of_matrices(getattr(np.linalg, name)) for name in ("det", "inv")},
    "interp1": lambda x, y, at: np.interp(
        matrix(at), matrix(x).ravel(), matrix(y).ravel(), np.nan, np.nan
    ),
    "linspace": lambda start, stop, n=100: np.linspace(
        matrix(start)[0, 0], matrix(stop)[0, 0], count(np.floor(n))
    ),
    "unique": _unique,
    "repmat": _repmat,
    "reshape": lambda a, *to: matrix(a).reshape(
        _shape(tuple(n if np.size(n) else np.size(a) for n in to)), order="F"
    ),
    "size": lambda u, axis=None: matrix(
        matrix(u).shape if axis is None else matrix(u).shape[count(axis) - 1]
    ),
    "numel": lambda value: len(value) if isinstance(value, list) else matrix(value).size,
    "length": lambda value: (
        len(value) if isinstance(value, list) else matrix(value).size and max(matrix(value).shape)
    ),
    "isempty": lambda value: float(
        not (len(value) if isinstance(value, str | dict | list) else matrix(value).size)
    ),
    "isscalar": lambda value: float(np.size(value) == 1),
    "isnumeric": lambda value: float(not isinstance(value, str | dict | list)),
    "ischar": lambda value: float(isinstance(value, str)),
    "isstruct": lambda value: float(isinstance(value, dict)),
    "iscell": lambda value: float(isinstance(value, list)),
    "rot90": lambda value, times=1: np.rot90(matrix(value), int(matrix(times)[0, 0])),
    "find": lambda value, most=1e9: np.reshape(
        np.flatnonzero(matrix(value).T)[: int(np.max(most))] + 1,
        (1, -1) if _way(value) else (-1, 1),
    ),
    "horzcat": partial(_joined, 1),
    "vertcat": partial(_joined, 0),
    **SYSTEMS,
    "struct": lambda *parts: dict(zip(parts[::2], parts[1::2], strict=True)),
    "char": lambda value: value[0] if isinstance(value, list) else value,
    "isfield": lambda value, name: float(isinstance(value, dict) and name in value),
    "strcmp": lambda one, other: float(isinstance(one, str) and one == other),
    "num2str": lambda value: (
        value if isinstance(value, str) else f"{float(matrix(value)[0, 0]):.5g}"
    ),
    "strcmpi": lambda first, second: float(str(first).lower() == str(second).lower()),
}
"""By their names in MATLAB."""


def _unique_places(value: Any) -> list[Any]:
    _, first, which = np.unique(matrix(value), return_index=True, return_inverse=True)
    return [_unique(value), first.reshape(-1, 1) + 1, which.reshape(-1, 1) + 1]


SEVERAL: dict[str, Callable[..., list[Any]]] = {
    "size": lambda *values: [matrix(size) for size in FUNCTIONS["size"](*values).reshape(-1)],
    "unique": _unique_places,
    "min": lambda u: [FUNCTIONS["min"](u), matrix(np.argmin(matrix(u), axis=_way(u)) + 1)],
    "max": lambda u: [FUNCTIONS["max"](u), matrix(np.argmax(matrix(u), axis=_way(u)) + 1)],
}
"""Functions of several outputs."""
Lookup = Callable[[str], Any]  # returns the value of a variable, or raises `UndefinedVariable`
Algebra = Mapping[str, Callable[..., Any]]
"""What an expression is computed with: operators, elementwise on two matrices, and functions of matrices, by name."""


class UndefinedVariable(LookupError):
    """A name that no workspace knows.

    Attributes:
        name: it.
        why: what is known about its absence, in words; may be empty.
    """

    def __init__(self, name: str, why: str = "") -> None:
        super().__init__(name)
        self.name, self.why = name, why


class Evaluator:
    """Computes expressions of variables that are looked up, by an algebra."""

    def __init__(self, lookup: Lookup, algebra: Algebra) -> None:
        self._outside, self._algebra = lookup, algebra
        self._ends: list[int] = []  # what `end` is in the indices around
        self._budget = Budget()

    def evaluated(self, node: Expression) -> Any:
        """Return the value of an expression's tree.

        Raises:
            UndefinedVariable: a name that is no variable, and no function here.
            NotUnderstood: what cannot be computed.
        """
        try:
            return self._of(node)
        except MemoryError as problem:
            raise NotUnderstood(
                message("simulink.needs_more_memory", "needs more memory than there is")
            ) from problem
        except (
            ValueError,
            ArithmeticError,
            IndexError,
            TypeError,
            RecursionError,
            np.linalg.LinAlgError,
        ) as problem:
            raised = (
                problem
                if isinstance(problem, NotUnderstood)
                else NotUnderstood(
                    message(
                        "simulink.cannot_be_computed",
                        "cannot be computed: {problem}",
                        problem=problem,
                    )
                )
            )
            raise raised from problem

    def find(self, _: str) -> bool:
        """Tell whether there is a further function of this name, from now on in the algebra."""
        return False

    def _lookup(self, name: str) -> Any:
        return self._outside(name)

    def _of(self, node: Expression) -> Any:
        match node:
            case ("number", (number,)):
                return matrix(number)
            case ("imaginary", (number,)):
                return matrix(number * self._named("1i", ()))
            case ("text" | "string", (text,)):
                return text
            case ("name", (name,)):
                return self._named(name, ())
            case ("end", ()) if self._ends:
                return matrix(self._ends[-1])
            case ("end" | "colon", ()):
                raise NotUnderstood(
                    message("simulink.end_outside_index", "has an 'end' or a ':' outside an index")
                )
        return getattr(self, f"_{node.kind}")(*node.parts)

    def _named(self, name: str, arguments: tuple[Expression, ...]) -> Any:
        try:
            return self._lookup(name)
        except UndefinedVariable:
            if name not in self._algebra and not self.find(name):
                raise
        values = [self._of(argument) for argument in arguments]
        self._budget.spend(check_growth(name, values))
        try:
            found = self._algebra[name](*values)
        except TypeError as problem:
            if values:
                raise
            raise UndefinedVariable(
                name
            ) from problem  # a variable whose name is a function's, too, as tf
        return found if isinstance(found, str | dict | list) else matrix(found)

    def _call(self, target: Expression, arguments: tuple[Expression, ...]) -> Any:
        try:
            value = self._lookup(target.parts[0]) if target.kind == "name" else self._of(target)
        except UndefinedVariable:
            if target.kind != "name":
                raise
            return self._named(target.parts[0], arguments)
        if isinstance(value, str):
            return value
        if callable(value):  # a method of an object
            return value(*map(self._of, arguments))
        if isinstance(value, dict | list):
            several: list[Any] = value if isinstance(value, list) else [value]
            if len(arguments) == 2 and isinstance(several[0], list):
                several, arguments = (
                    several[int(self._index(arguments[0], len(several)).flat[0])],
                    arguments[1:],
                )
            places = [self._index(argument, len(several)) for argument in arguments]
            return several[int(max((place.reshape(-1)[0] for place in places), default=0))]
        return self._indexed(matrix(value), arguments)

    def _indexed(self, array: Vector, arguments: tuple[Expression, ...]) -> Vector:
        if len(arguments) == 1:
            flat = array.reshape(-1, order="F")
            index = self._index(arguments[0], flat.size)
            if arguments[0].kind == "colon":
                return flat.reshape(-1, 1)
            row = (1, -1) if array.shape[0] == 1 else (-1, 1)
            shape = index.shape if 1 not in array.shape or array.size == 1 else row
            return np.asarray(flat[index.reshape(-1, order="F")].reshape(shape, order="F"))
        if len(arguments) != 2:
            raise NotUnderstood(
                message(
                    "simulink.index_dimensions",
                    "has an index of {count} dimensions",
                    count=len(arguments),
                )
            )
        places = [self._index(*one).reshape(-1) for one in zip(arguments, array.shape, strict=True)]
        self._budget.spend(check_size(math.prod(map(len, places))))
        return np.asarray(array[np.ix_(*places)])

    def _index(self, node: Expression, size: int) -> Any:
        if node.kind == "colon":
            return np.arange(size).reshape(1, -1)
        index = self._at(node, size)
        if np.any(index != np.round(index)) or np.any(index < 1) or np.any(index > size):
            raise NotUnderstood(
                message(
                    "simulink.index_out_of_range",
                    "has the index {index:g} of something that has {size} elements",
                    index=index.reshape(-1)[0],
                    size=size,
                )
            )
        return index.astype(int) - 1

    def _at(self, node: Expression, size: int) -> Vector:
        """Return the value of an index of something that has so many elements."""
        self._ends.append(size)
        try:
            return matrix(self._of(node))
        finally:
            self._ends.pop()

    def _field(self, target: Expression, name: str) -> Any:
        try:
            value = self._of(target)
        except UndefinedVariable as problem:
            if problem.name not in self._algebra:
                raise
            value = self._lookup(f"{problem.name}.")  # a structure that has a function's name
        if not isinstance(value, dict):
            raise NotUnderstood(
                message(
                    "simulink.field_of_no_structure",
                    "asks for the field '{name}' of something that is no structure",
                    name=name,
                )
            )
        if name not in value:
            raise UndefinedVariable(f"{written(target)}.{name}")
        return value[name]

    def _range(self, start: Expression, step: Expression | None, stop: Expression) -> Vector:
        first, last, by = (
            1.0 if end is None else float(matrix(self._of(end))[0, 0])
            for end in (start, stop, step)
        )
        steps = np.floor((last - first) / by * (1 + 1e-12) + 1e-9) if by else -1
        if not steps < LARGEST:
            raise NotUnderstood(
                message(
                    "simulink.range_too_large",
                    "makes a range of more than {largest} elements",
                    largest=LARGEST,
                )
            )
        return matrix(first + by * np.arange(max(int(steps) + 1, 0)))

    def _matrix(self, rows: tuple[tuple[Expression, ...], ...]) -> Any:
        if not rows:
            return np.zeros((0, 0))
        values = [[self._of(node) for node in row] for row in rows]
        self._budget.spend(check_growth("horzcat", [value for row in values for value in row]))
        texts = [value for row in values for value in row if isinstance(value, str)]
        if len(texts) == sum(map(len, values)):
            several = len(texts) > 1 and any(node.kind == "string" for row in rows for node in row)
            return texts if several else "".join(texts)
        parts = [[matrix(value) for value in row if matrix(value).size] for row in values]
        lines = [np.concatenate(row, axis=1) for row in parts if row]
        return np.concatenate(lines, axis=0) if lines else np.zeros((0, 0))

    def _cell(self, rows: tuple[tuple[Expression, ...], ...]) -> list[Any]:
        values = [[self._of(node) for node in row] for row in rows]
        self._budget.spend(sum(count_entries(value) for row in values for value in row))
        return (
            values if len(rows) > 1 and len(rows[0]) > 1 else [one for row in values for one in row]
        )

    def _unary(self, operator: str, operand: Expression) -> Vector:
        value = matrix(self._of(operand))
        if operator == "-":
            return -value
        if operator == "~":
            return matrix(self._algebra["=="](value, np.zeros((1, 1))))
        return value.T if operator == "'" else value

    def _binary(self, operator: str, one: Expression, other: Expression) -> Vector:
        left = self._of(one)
        decided = operator in ("&&", "||") and matrix(left).dtype != object
        if decided and bool(np.all(left)) == (operator == "||"):
            return matrix(operator == "||")
        right = self._of(other)
        if operator in ("==", "~=") and (isinstance(left, str) or isinstance(right, str)):
            return matrix((left == right) == (operator == "=="))
        first, second, each = matrix(left), matrix(right), self._algebra
        self._budget.spend(check_growth(operator, [first, second]))
        lone = first.size == 1 or second.size == 1
        if (
            operator == "*"
            and object in (first.dtype, second.dtype)
            and first.size * second.shape[1] > _MOST_SIGNAL_PRODUCTS
        ):
            raise NotUnderstood(
                message(
                    "simulink.too_many_signal_products",
                    "multiplies matrices of signals by more than {most} products",
                    most=_MOST_SIGNAL_PRODUCTS,
                )
            )
        if operator in ("/", "\\"):  # A \\ B is (B' / A')'
            return (
                self._quotient(first, second)
                if operator == "/"
                else self._quotient(second.T, first.T).T
            )
        with np.errstate(all="ignore"):
            if operator in each:
                return matrix(each[operator](first, second))
            if operator == "*":
                return matrix(each[".*"](first, second) if lone else first @ second)
            return matrix(
                each[".^"](first, second)
                if lone
                else np.linalg.matrix_power(first, int(second[0, 0]))
            )

    @np.errstate(all="ignore")
    def _quotient(self, first: Vector, second: Vector) -> Vector:
        if second.size == 1:
            return matrix(self._algebra["./"](first, second))
        if object in (first.dtype, second.dtype):
            return matrix(first @ self._algebra["inv"](second))
        return matrix(np.linalg.solve(second.T, first.T).T)


NUMBERS: Algebra = {
    **FUNCTIONS,
    "+": np.add, "-": np.subtract, ".*": np.multiply, "./": np.divide, ".^": np.power, "<": np.less, ">": np.greater,
    "<=": np.less_equal, ">=": np.greater_equal, "==": np.equal, "~=": np.not_equal,
    **dict.fromkeys(("&", "&&"), np.logical_and), **dict.fromkeys(("|", "||"), np.logical_or),
}  # fmt: skip
