"""The value of an expression: a matrix of shape (r, c), a text, or a structure (dict). Nothing is executed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.simulink.values.functions import FUNCTIONS, LARGEST, matrix
from simrob_drake.simulink.values.syntax import Expression, NotUnderstood

Lookup = Callable[[str], Any]
"""Returns the value of a variable, or raises `UndefinedVariable`."""


@dataclass(frozen=True)
class Algebra:
    """What an expression is computed with.

    Attributes:
        operators: elementwise, on two matrices.
        functions: by name, on matrices.
    """

    operators: Mapping[str, Callable[[Vector, Vector], Any]]
    functions: Mapping[str, Callable[..., Any]]


class UndefinedVariable(LookupError):
    """A name that no workspace knows.

    Attributes:
        name: it.
        why: what is known about its absence, in words; may be empty.
    """

    def __init__(self, name: str, why: str = "") -> None:
        super().__init__(name)
        self.name, self.why = name, why


def evaluate(node: Expression, lookup: Lookup, algebra: Algebra | None = None) -> Any:
    """Return the value of an expression's tree, of numbers unless another algebra is given.

    Raises:
        UndefinedVariable: a name that is no variable, and no function here.
        NotUnderstood: what cannot be computed.
    """
    try:
        return _Evaluation(lookup, algebra or NUMBERS).value(node)
    except (ValueError, ArithmeticError, IndexError, TypeError, RecursionError, np.linalg.LinAlgError) as problem:
        raise (
            problem if isinstance(problem, NotUnderstood) else NotUnderstood(f"cannot be computed: {problem}")
        ) from problem


class _Evaluation:
    def __init__(self, lookup: Lookup, algebra: Algebra) -> None:
        self._lookup, self._algebra = lookup, algebra
        self._ends: list[int] = []  # what `end` is in the indices around

    def value(self, node: Expression) -> Any:
        return getattr(self, f"_{node.kind}")(*node.parts)

    def _number(self, value: float) -> Vector:
        return matrix(value)

    def _text(self, value: str) -> str:
        return value

    def _name(self, name: str) -> Any:
        return self._named(name, ())

    def _end(self) -> Vector:
        return matrix(self._ends[-1]) if self._ends else self._colon()

    def _colon(self) -> Vector:
        raise NotUnderstood("has an 'end' or a ':' outside an index")

    def _named(self, name: str, arguments: tuple[Expression, ...]) -> Any:
        try:
            return self._lookup(name)
        except UndefinedVariable:
            if name not in self._algebra.functions:
                raise
        found = self._algebra.functions[name](*(self.value(argument) for argument in arguments))
        return found if isinstance(found, str | dict) else matrix(found)

    def _call(self, target: Expression, arguments: tuple[Expression, ...]) -> Any:
        if target.kind == "name":
            try:
                value = self._lookup(target.parts[0])
            except UndefinedVariable:
                return self._named(target.parts[0], arguments)
        else:
            value = self.value(target)
        if isinstance(value, dict | str):
            return value  # of a single structure, (1) is itself
        return self._indexed(matrix(value), arguments)

    def _indexed(self, array: Vector, arguments: tuple[Expression, ...]) -> Vector:
        if len(arguments) == 1:
            flat = array.reshape(-1, order="F")
            index = self._index(arguments[0], flat.size)
            if arguments[0].kind == "colon":
                return flat.reshape(-1, 1)
            shape = index.shape if 1 not in array.shape or array.size == 1 else None
            if shape is None:
                shape = (1, -1) if array.shape[0] == 1 else (-1, 1)
            return np.asarray(flat[index.reshape(-1, order="F")].reshape(shape, order="F"))
        if len(arguments) == 2:
            rows = self._index(arguments[0], array.shape[0]).reshape(-1)
            columns = self._index(arguments[1], array.shape[1]).reshape(-1)
            return np.asarray(array[np.ix_(rows, columns)])
        raise NotUnderstood(f"has an index of {len(arguments)} dimensions")

    def _index(self, node: Expression, size: int) -> Any:
        if node.kind == "colon":
            return np.arange(size).reshape(1, -1)
        self._ends.append(size)
        index = matrix(self.value(node))
        self._ends.pop()
        if np.any(index != np.round(index)) or np.any(index < 1) or np.any(index > size):
            raise NotUnderstood(f"has the index {index.reshape(-1)[0]:g} of something that has {size} elements")
        return index.astype(int) - 1

    def _field(self, target: Expression, name: str) -> Any:
        value = self._lookup(target.parts[0]) if target.kind == "name" else self.value(target)
        if not isinstance(value, dict):
            raise NotUnderstood(f"asks for the field '{name}' of something that is no structure")
        if name not in value:
            raise UndefinedVariable(f"{_written(target)}.{name}")
        return value[name]

    def _range(self, start: Expression, step: Expression | None, stop: Expression) -> Vector:
        first, last = (float(matrix(self.value(end))[0, 0]) for end in (start, stop))
        by = 1.0 if step is None else float(matrix(self.value(step))[0, 0])
        steps = np.floor((last - first) / by * (1 + 1e-12) + 1e-9) if by else -1
        if not steps < LARGEST:
            raise NotUnderstood(f"makes a range of more than {LARGEST} elements")
        return matrix(first + by * np.arange(max(int(steps) + 1, 0)))

    def _matrix(self, rows: tuple[tuple[Expression, ...], ...]) -> Any:
        if not rows:
            return np.zeros((0, 0))
        values = [[self.value(node) for node in row] for row in rows]
        if all(isinstance(value, str) for row in values for value in row):
            return "".join(value for row in values for value in row)
        parts = [[matrix(value) for value in row if matrix(value).size] for row in values]
        lines = [np.concatenate(row, axis=1) for row in parts if row]
        return np.concatenate(lines, axis=0) if lines else np.zeros((0, 0))

    def _unary(self, operator: str, operand: Expression) -> Vector:
        value = matrix(self.value(operand))
        if operator == "-":
            return -value
        if operator == "~":
            return matrix(self._algebra.operators["=="](value, np.zeros((1, 1))))
        return value.T if operator == "'" else value

    def _binary(self, operator: str, one: Expression, other: Expression) -> Vector:
        left, right = self.value(one), self.value(other)
        if operator in ("==", "~=") and (isinstance(left, str) or isinstance(right, str)):
            return matrix((left == right) == (operator == "=="))
        first, second, each = matrix(left), matrix(right), self._algebra.operators
        lone = first.size == 1 or second.size == 1
        with np.errstate(all="ignore"):
            if operator in each:
                return matrix(each[operator](first, second))
            if operator == "*":
                return matrix(each[".*"](first, second) if lone else first @ second)
            if operator == "^":
                return matrix(each[".^"](first, second) if lone else np.linalg.matrix_power(first, int(second[0, 0])))
            if operator == "\\":
                first, second = second.T, first.T  # A \\ B is (B' / A')'
            if second.size == 1:
                quotient = matrix(each["./"](first, second))
            elif first.dtype == object:
                quotient = matrix(first @ np.linalg.inv(second))
            else:
                quotient = matrix(np.linalg.solve(second.T, first.T).T)
        return quotient.T if operator == "\\" else quotient


def _written(node: Expression) -> str:
    """Return a name with its fields as it is written."""
    if node.kind == "field":
        return f"{_written(node.parts[0])}.{node.parts[1]}"
    return str(node.parts[0]) if node.kind == "name" else "(…)"


_EACH: dict[str, Callable[[Vector, Vector], Any]] = {
    "+": np.add,
    "-": np.subtract,
    ".*": np.multiply,
    "./": np.divide,
    ".^": np.power,
    "<": np.less,
    ">": np.greater,
    "<=": np.less_equal,
    ">=": np.greater_equal,
    "&": np.logical_and,
    "|": np.logical_or,
    "&&": np.logical_and,
    "||": np.logical_or,
    "==": np.equal,
    "~=": np.not_equal,
}
NUMBERS = Algebra(_EACH, FUNCTIONS)
