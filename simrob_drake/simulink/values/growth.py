"""How large the result of a function or an operator becomes, and how much work it is: known before it is computed.

Models come from anywhere. An expression of a few letters, such as ``kron(ones(1000), ones(1000))``, can ask for more
memory than any machine has, so every call is bounded here before it allocates anything.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.simulink.values.syntax import NotUnderstood

LARGEST = 1_000_000
"""Most elements of a matrix, letters of a text and entries of a cell array."""

MOST_PRODUCTS = 1_000_000_000
"""Most multiplications of one call: about a second."""

MOST_ELEMENTS = 100_000_000
"""Most elements of all results of one evaluation together."""

Shape = tuple[int, int]


class CallSize(NamedTuple):
    """What a call comes to.

    Attributes:
        elements: of its result.
        products: multiplications that it takes.
    """

    elements: int
    products: int = 0


def shape_of(value: Any) -> Shape:
    """Return the shape of a value as MATLAB sees it; texts and cell arrays are rows."""
    if isinstance(value, str | list | dict):
        return 1, len(value)
    shape = np.shape(value)
    return (math.prod(shape[:-1]), shape[-1]) if shape else (1, 1)


def _size(shape: Shape) -> int:
    """Number of elements of a shape."""
    return shape[0] * shape[1]


def _elementwise(shapes: Sequence[Shape]) -> CallSize:
    """Bound what spreads over rows and columns, as a row plus a column does."""
    if any(_size(shape) == 0 for shape in shapes):
        return CallSize(0)
    rows = max(shape[0] for shape in shapes)
    columns = max(shape[1] for shape in shapes)
    return CallSize(rows * columns)


def _diagonal(shapes: Sequence[Shape]) -> CallSize:
    """Bound a matrix made of its diagonal, or a diagonal taken from a matrix."""
    longest = max(shapes[0])
    return CallSize(longest**2 if 1 in shapes[0] else longest)


def _pairwise(shapes: Sequence[Shape]) -> CallSize:
    """Bound what combines each element of one argument with each of the other."""
    product = math.prod(map(_size, shapes))
    return CallSize(product, product)


def _polynomial(shapes: Sequence[Shape]) -> CallSize:
    """Bound a polynomial at many places: a product for each coefficient at each place."""
    return CallSize(_size(shapes[-1]), math.prod(map(_size, shapes)))


def _product(shapes: Sequence[Shape]) -> CallSize:
    """Bound a product of matrices; a number multiplies every element."""
    first, second = shapes
    if _size(first) == 1 or _size(second) == 1:
        return _elementwise(shapes)
    return CallSize(first[0] * second[1], first[0] * first[1] * second[1])


def _solved(shapes: Sequence[Shape]) -> CallSize:
    """Bound an inverse, a determinant, a quotient or a power of matrices: the cube of the longest side."""
    longest = max((side for shape in shapes for side in shape), default=0)
    if all(_size(shape) == 1 or 1 in shape for shape in shapes):
        return _elementwise(shapes)
    return CallSize(longest**2, longest**3)


def _side_by_side(shapes: Sequence[Shape]) -> CallSize:
    """Bound what is put together of its arguments."""
    return CallSize(sum(map(_size, shapes)))


_RULES: dict[str, Callable[[Sequence[Shape]], CallSize]] = {
    "diag": _diagonal,
    "kron": _pairwise,
    "polyval": _polynomial,
    "*": _product,
    **dict.fromkeys(("/", "\\", "^", "inv", "det", "lqr"), _solved),
    **dict.fromkeys(("horzcat", "vertcat", "struct"), _side_by_side),
}
"""How functions and operators grow; all others as their arguments, element by element."""


def check_growth(name: str, values: Sequence[Any]) -> int:
    """Check that a call stays within bounds, and return the most elements that its result can have.

    Args:
        name: of the function, or the operator.
        values: its arguments.

    Raises:
        NotUnderstood: it does not; with what it would take.
    """
    growth = _RULES.get(name, _elementwise)([shape_of(value) for value in values] or [(1, 1)])
    if growth.elements > LARGEST:
        raise NotUnderstood(f"makes {growth.elements:.3g} elements by '{name}'; at most {LARGEST} can be")
    if growth.products > MOST_PRODUCTS:
        raise NotUnderstood(f"takes {growth.products:.3g} products by '{name}'; at most {MOST_PRODUCTS:.3g} can be")
    return growth.elements


def check_size(elements: int) -> int:
    """Check that something of so many elements can be, and return the number.

    Raises:
        NotUnderstood: there are too many.
    """
    if elements > LARGEST:
        raise NotUnderstood(f"makes {elements:.3g} elements; at most {LARGEST} can be")
    return elements


def count_entries(value: Any) -> int:
    """Count a value and everything nested in it, for cell arrays and structures.

    A part that is contained twice counts twice: the object in memory may be small, but what is made of it is not.

    Raises:
        NotUnderstood: there are more than `LARGEST` entries.
    """
    waiting = [value]
    entries = 0
    while waiting:
        part = waiting.pop()
        entries = check_size(entries + 1)
        if isinstance(part, dict):
            waiting += part.values()
        elif isinstance(part, list):
            waiting += part
    return entries


class Budget:
    """The elements that one evaluation may make, over all of its calls."""

    def __init__(self) -> None:
        """Begin with all of them."""
        self._left = MOST_ELEMENTS

    def spend(self, elements: int) -> None:
        """Take elements from the budget.

        Raises:
            NotUnderstood: it is used up.
        """
        self._left -= elements
        if self._left < 0:
            raise NotUnderstood(f"makes more than {MOST_ELEMENTS:.3g} elements in all")
