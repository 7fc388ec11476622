"""Bounds on the size of a MATLAB expression's results, and on the work to compute them.

Models come from anywhere. An expression of a few letters, such as ``kron(ones(1000), ones(1000))``, can ask for more
memory than any machine has. So before a function or an operator is evaluated, a rule bounds the size of its result and
the count of multiplications by the shapes of its arguments.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood

LARGEST = 1_000_000
"""Largest count of elements of a matrix, of letters of a text, and of entries of a cell array."""

MOST_PRODUCTS = 1_000_000_000
"""Largest count of multiplications of one call: about a second."""

MOST_ELEMENTS = 100_000_000
"""Largest count of elements of all results of one evaluation together."""


class MatrixShape(NamedTuple):
    """Counts of rows and columns of a matrix."""

    rows: int
    columns: int

    @property
    def size(self) -> int:
        """Count of elements."""
        return self.rows * self.columns

    @property
    def is_vector(self) -> bool:
        """Whether it is a row, a column or a single number."""
        return self.rows == 1 or self.columns == 1


class CallSize(NamedTuple):
    """Bounds for one call of a function or operator.

    Attributes:
        elements: largest count of elements of its result.
        products: largest count of multiplications; 0 if they take no more time than making the elements.
    """

    elements: int
    products: int = 0


def shape_of(value: Any) -> MatrixShape:
    """Shape of a value in MATLAB. Texts, cell arrays and structures are rows, a single number is a 1-by-1 matrix.

    The columns of an array with more than two dimensions are its last dimension.
    """
    if isinstance(value, str | list | dict):
        return MatrixShape(1, len(value))
    # Plain numbers have the empty shape in NumPy.
    shape = np.shape(value)
    return MatrixShape(math.prod(shape[:-1]), shape[-1]) if shape else MatrixShape(1, 1)


def _elementwise(shapes: Sequence[MatrixShape]) -> CallSize:
    """Bound a function that acts element by element. A row and a column are repeated to a matrix, as in their sum."""
    # Without this, the longest sides below would hide that the result is empty.
    if any(shape.size == 0 for shape in shapes):
        return CallSize(0)
    rows = max(shape.rows for shape in shapes)
    columns = max(shape.columns for shape in shapes)
    return CallSize(rows * columns)


def _diagonal(shapes: Sequence[MatrixShape]) -> CallSize:
    """Bound ``diag``: a square matrix with a vector as its diagonal, or the diagonal of a matrix."""
    longest = max(shapes[0])
    return CallSize(longest**2 if shapes[0].is_vector else longest)


def _pairwise(shapes: Sequence[MatrixShape]) -> CallSize:
    """Bound a function that multiplies each element of one argument with each element of the other."""
    pairs = math.prod(shape.size for shape in shapes)
    return CallSize(pairs, pairs)


def _polynomial(shapes: Sequence[MatrixShape]) -> CallSize:
    """Bound ``polyval(coefficients, points)``: one multiplication for each coefficient at each point."""
    return CallSize(shapes[-1].size, math.prod(shape.size for shape in shapes))


def _matrix_product(shapes: Sequence[MatrixShape]) -> CallSize:
    """Bound a product of two matrices. A single number multiplies every element of the other."""
    first, second = shapes
    if first.size == 1 or second.size == 1:
        return _elementwise(shapes)
    return CallSize(first.rows * second.columns, first.rows * first.columns * second.columns)


def _cubic(shapes: Sequence[MatrixShape]) -> CallSize:
    """Bound an inverse, a determinant, a quotient or a power of matrices: the cube of the longest side.

    For numbers and vectors these are computed element by element.
    """
    if all(shape.is_vector for shape in shapes):
        return _elementwise(shapes)
    longest = max(max(shape) for shape in shapes)
    return CallSize(longest**2, longest**3)


def _concatenation(shapes: Sequence[MatrixShape]) -> CallSize:
    """Bound a matrix or structure that consists of all arguments."""
    return CallSize(sum(shape.size for shape in shapes))


_RULES: dict[str, Callable[[Sequence[MatrixShape]], CallSize]] = {
    "diag": _diagonal,
    "kron": _pairwise,
    "polyval": _polynomial,
    "*": _matrix_product,
    **dict.fromkeys(("/", "\\", "^", "inv", "det", "lqr"), _cubic),
    **dict.fromkeys(("horzcat", "vertcat", "struct"), _concatenation),
}
"""Rules by the name of the function or operator; for all others the rule is `_elementwise`."""


def check_growth(name: str, values: Sequence[Any]) -> int:
    """Check that a call stays within bounds, and return the largest count of elements of its result.

    Args:
        name: name of the function or operator.
        values: values of its arguments; a call without arguments counts as one with a single number.

    Raises:
        NotUnderstood: the call exceeds a bound; the message gives the counts.
    """
    rule = _RULES.get(name, _elementwise)
    call_size = rule([shape_of(value) for value in values] or [MatrixShape(1, 1)])
    if call_size.elements > LARGEST:
        raise NotUnderstood(
            message(
                "simulink.elements_by",
                "makes {elements:.3g} elements by '{name}'; at most {largest} can be",
                elements=call_size.elements,
                name=name,
                largest=LARGEST,
            )
        )
    # A result can be small and still take long, such as an inverse.
    if call_size.products > MOST_PRODUCTS:
        raise NotUnderstood(
            message(
                "simulink.products_by",
                "takes {products:.3g} products by '{name}'; at most {most:.3g} can be",
                products=call_size.products,
                name=name,
                most=MOST_PRODUCTS,
            )
        )
    return call_size.elements


def check_size(elements: int) -> int:
    """Check that a count of elements is at most LARGEST, and return the same count.

    Raises:
        NotUnderstood: there are too many.
    """
    if elements > LARGEST:
        raise NotUnderstood(
            message(
                "simulink.too_many_elements",
                "makes {elements:.3g} elements; at most {largest} can be",
                elements=elements,
                largest=LARGEST,
            )
        )
    return elements


def count_entries(value: Any) -> int:
    """Count a value and everything nested in it, for cell arrays and structures.

    An object that is contained twice counts twice: it is in memory once, but results that are made of the value contain
    it twice.

    Raises:
        NotUnderstood: there are more than `LARGEST` entries.
    """
    # A list of what is left, not a recursion: structures may be nested deeper than Python can call functions.
    values_left = [value]
    count = 0
    while values_left:
        part = values_left.pop()
        count = check_size(count + 1)
        if isinstance(part, dict):
            values_left += part.values()
        elif isinstance(part, list):
            values_left += part
    return count


class Budget:
    """The count of elements that one evaluation may still make in its calls."""

    def __init__(self) -> None:
        """Begin with MOST_ELEMENTS."""
        self._elements_left = MOST_ELEMENTS

    def spend(self, elements: int) -> None:
        """Subtract the elements of a call's result from the budget.

        Raises:
            NotUnderstood: the budget is exceeded.
        """
        self._elements_left -= elements
        if self._elements_left < 0:
            raise NotUnderstood(
                message(
                    "simulink.elements_in_all",
                    "makes more than {most:.3g} elements in all",
                    most=MOST_ELEMENTS,
                )
            )
