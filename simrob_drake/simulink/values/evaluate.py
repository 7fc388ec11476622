"""The value of an expression: a matrix of shape (r, c), a text, or a structure (dict). Nothing is executed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.simulink.values import syntax
from simrob_drake.simulink.values.functions import FUNCTIONS, LARGEST, matrix
from simrob_drake.simulink.values.syntax import NotUnderstood

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


_Composed = syntax.Call | syntax.FieldOf | syntax.Unary | syntax.Binary | syntax.RangeOf | syntax.Matrix


class UndefinedVariable(LookupError):
    """A name that no workspace knows.

    Attributes:
        name: it.
        why: what is known about its absence, in words; may be empty.
    """

    def __init__(self, name: str, why: str = "") -> None:
        """Say which."""
        super().__init__(name)
        self.name, self.why = name, why


def evaluate(node: syntax.Node, lookup: Lookup, algebra: Algebra | None = None) -> Any:
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
    """One walk over a tree."""

    def __init__(self, lookup: Lookup, algebra: Algebra) -> None:
        self._lookup, self._algebra = lookup, algebra
        self._ends: list[int] = []  # what `end` is in the indices around

    def value(self, node: syntax.Node) -> Any:
        return self._of_parts(node) if isinstance(node, _Composed) else self._of_word(node)

    def _of_word(self, node: syntax.Node) -> Any:
        match node:
            case syntax.Number(number):
                return matrix(number)
            case syntax.Text(text):
                return text
            case syntax.Name(name):
                return self._named(name, ())
            case syntax.EndIndex() if self._ends:
                return matrix(self._ends[-1])
        raise NotUnderstood("has an 'end' or a ':' outside an index")

    def _of_parts(self, node: syntax.Node) -> Any:
        match node:
            case syntax.Call(target, arguments):
                found = self._called(target, arguments)
            case syntax.FieldOf(target, name):
                found = self._field(target, name)
            case syntax.Unary(operator, operand):
                found = self._unary(operator, matrix(self.value(operand)))
            case syntax.Binary(operator, left, right):
                found = self._binary(operator, self.value(left), self.value(right))
            case syntax.RangeOf(start, step, stop):
                found = self._range(start, step, stop)
            case syntax.Matrix(rows):
                found = self._matrix(rows)
        return found

    def _named(self, name: str, arguments: tuple[syntax.Node, ...]) -> Any:
        try:
            return self._lookup(name)
        except UndefinedVariable:
            if name not in self._algebra.functions:
                raise
        found = self._algebra.functions[name](*(self.value(argument) for argument in arguments))
        return found if isinstance(found, str | dict) else matrix(found)

    def _called(self, target: syntax.Node, arguments: tuple[syntax.Node, ...]) -> Any:
        if isinstance(target, syntax.Name):
            try:
                value = self._lookup(target.name)
            except UndefinedVariable:
                return self._named(target.name, arguments)
        else:
            value = self.value(target)
        if isinstance(value, dict | str):
            return value  # of a single structure, (1) is itself
        return self._indexed(matrix(value), arguments)

    def _indexed(self, array: Vector, arguments: tuple[syntax.Node, ...]) -> Vector:
        if len(arguments) == 1:
            flat = array.reshape(-1, order="F")
            index = self._index(arguments[0], flat.size)
            if isinstance(arguments[0], syntax.Colon):
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

    def _index(self, node: syntax.Node, size: int) -> Any:
        if isinstance(node, syntax.Colon):
            return np.arange(size).reshape(1, -1)
        self._ends.append(size)
        index = matrix(self.value(node))
        self._ends.pop()
        if np.any(index != np.round(index)) or np.any(index < 1) or np.any(index > size):
            raise NotUnderstood(f"has the index {index.reshape(-1)[0]:g} of something that has {size} elements")
        return index.astype(int) - 1

    def _field(self, target: syntax.Node, name: str) -> Any:
        value = self._lookup(target.name) if isinstance(target, syntax.Name) else self.value(target)
        if not isinstance(value, dict):
            raise NotUnderstood(f"asks for the field '{name}' of something that is no structure")
        if name not in value:
            raise UndefinedVariable(f"{_written(target)}.{name}")
        return value[name]

    def _range(self, start: syntax.Node, step: syntax.Node | None, stop: syntax.Node) -> Vector:
        first, last = (float(matrix(self.value(end))[0, 0]) for end in (start, stop))
        by = 1.0 if step is None else float(matrix(self.value(step))[0, 0])
        steps = np.floor((last - first) / by * (1 + 1e-12) + 1e-9) if by else -1
        if not steps < LARGEST:
            raise NotUnderstood(f"makes a range of more than {LARGEST} elements")
        return matrix(first + by * np.arange(max(int(steps) + 1, 0)))

    def _matrix(self, rows: tuple[tuple[syntax.Node, ...], ...]) -> Any:
        if not rows:
            return np.zeros((0, 0))
        values = [[self.value(node) for node in row] for row in rows]
        if all(isinstance(value, str) for row in values for value in row):
            return "".join(value for row in values for value in row)
        parts = [[matrix(value) for value in row if matrix(value).size] for row in values]
        lines = [np.concatenate(row, axis=1) for row in parts if row]
        return np.concatenate(lines, axis=0) if lines else np.zeros((0, 0))

    def _unary(self, operator: str, value: Vector) -> Vector:
        if operator == "-":
            return -value
        if operator == "~":
            return matrix(self._algebra.operators["=="](value, np.zeros((1, 1))))
        return value.T if operator == "'" else value

    def _binary(self, operator: str, left: Any, right: Any) -> Vector:
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


def _written(node: syntax.Node) -> str:
    """Return a name with its fields as it is written."""
    if isinstance(node, syntax.FieldOf):
        return f"{_written(node.target)}.{node.name}"
    return node.name if isinstance(node, syntax.Name) else "(…)"


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
