"""The functions that expressions may call, each on matrices of shape (r, c)."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.simulink.values.syntax import NotUnderstood

LARGEST = 1_000_000
"""Elements of a matrix."""


def matrix(value: Any) -> Vector:
    """Return a value as a matrix of shape (r, c).

    Raises:
        NotUnderstood: it is no number, or too large.
    """
    if isinstance(value, str):
        raise NotUnderstood(f"uses the text '{value[:20]}' as a number")
    if isinstance(value, dict):
        raise NotUnderstood("uses a structure as a number")
    symbolic = isinstance(value, np.ndarray) and value.dtype == object and all(map(_is_value, value.flat))
    array = np.atleast_2d(value if symbolic else np.asarray(value, dtype=float))
    if array.size > LARGEST:
        raise NotUnderstood(f"makes a matrix of more than {LARGEST} elements")
    return array


def _is_value(element: Any) -> bool:
    """Tell whether an element is a number, or stands for one that only a run of the model has."""
    return isinstance(element, int | float) or hasattr(element, "terms")


def count(value: Any) -> int:
    """Return a whole number that is not negative."""
    number = float(matrix(value).reshape(-1)[0]) if matrix(value).size else -1.0
    if not 0 <= number <= LARGEST or number != int(number):
        raise NotUnderstood(f"needs a whole number of at most {LARGEST}, not {number:g}")
    return int(number)


def _shape(arguments: tuple[Any, ...]) -> tuple[int, int]:
    sizes = [count(number) for argument in arguments for number in matrix(argument).reshape(-1)]
    if not sizes:
        return 1, 1
    rows, columns = sizes[0], math.prod(sizes[1:]) if sizes[1:] else sizes[0]  # further dimensions lie side by side
    if rows * columns > LARGEST:
        raise NotUnderstood(f"makes a matrix of more than {LARGEST} elements")
    return rows, columns


def _eye(*arguments: Any) -> Vector:
    rows, columns = _shape(arguments)
    return np.eye(rows, columns)


def _along(reduce: Callable[..., Vector]) -> Callable[..., Vector]:
    """Let a reduction go down the columns, or along the only row, as MATLAB does."""

    def reduced(value: Any, axis: Any = None) -> Vector:
        array = matrix(value)
        chosen = count(axis) - 1 if axis is not None else (1 if array.shape[0] == 1 else 0)
        return matrix(reduce(array, axis=chosen, keepdims=True))

    return reduced


def _extreme(pairwise: Callable[..., Vector], reduce: Callable[..., Vector]) -> Callable[..., Vector]:
    def chosen(first: Any, second: Any = None) -> Vector:
        return _along(reduce)(first) if second is None else matrix(pairwise(matrix(first), matrix(second)))

    return chosen


def _cumulative(value: Any) -> Vector:
    array = matrix(value)
    return np.asarray(np.cumsum(array, axis=1 if array.shape[0] == 1 else 0))


def _diag(value: Any) -> Vector:
    array = matrix(value)
    return np.diag(array.reshape(-1)) if 1 in array.shape else matrix(np.diag(array)).T


def _linspace(start: Any, stop: Any, number: Any = 100) -> Vector:
    return matrix(np.linspace(matrix(start)[0, 0], matrix(stop)[0, 0], count(number)))


def _repmat(value: Any, *times: Any) -> Vector:
    rows, columns = _shape(times)
    array = matrix(value)
    if array.size * rows * columns > LARGEST:
        raise NotUnderstood(f"makes a matrix of more than {LARGEST} elements")
    return np.tile(array, (rows, columns))


def _reshape(value: Any, *sizes: Any) -> Vector:
    return matrix(value).reshape(_shape(sizes), order="F")


def _size(value: Any, axis: Any = None) -> Vector:
    shape = matrix(value).shape
    return matrix(shape if axis is None else shape[count(axis) - 1])


def _joined(axis: int) -> Callable[..., Vector]:
    def joined(*parts: Any) -> Vector:
        return np.concatenate([matrix(part) for part in parts if matrix(part).size], axis=axis)

    return joined


def _elementwise(function: Callable[..., Any]) -> Callable[..., Vector]:
    def applied(*values: Any) -> Vector:
        with np.errstate(all="ignore"):
            return matrix(function(*(matrix(value) for value in values)))

    return applied


def _degrees(function: Callable[[Vector], Vector]) -> Callable[[Vector], Vector]:
    return lambda angle: function(np.deg2rad(angle))


_EACH: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "exp", "sqrt", "log", "log10", "log2", "abs")},
    **{name: getattr(np, name) for name in ("floor", "ceil", "sign", "sinh", "cosh", "tanh", "deg2rad", "rad2deg")},
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "hypot": np.hypot,
    "sind": _degrees(np.sin),
    "cosd": _degrees(np.cos),
    "tand": _degrees(np.tan),
    "asind": lambda value: np.rad2deg(np.arcsin(value)),
    "acosd": lambda value: np.rad2deg(np.arccos(value)),
    "atand": lambda value: np.rad2deg(np.arctan(value)),
    "atan2d": lambda y, x: np.rad2deg(np.arctan2(y, x)),
    "round": lambda value: np.sign(value) * np.floor(np.abs(value) + 0.5),
    "fix": np.trunc,
    "mod": np.mod,
    "rem": np.fmod,
    "double": lambda value: value,
    "single": lambda value: value,
    "logical": lambda value: value != 0,
    "not": lambda value: value == 0,
    "isnan": np.isnan,
}

FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: _elementwise(function) for name, function in _EACH.items()},
    "pi": lambda: np.pi,
    "inf": lambda: np.inf,
    "Inf": lambda: np.inf,
    "nan": lambda: np.nan,
    "NaN": lambda: np.nan,
    "eps": lambda: np.finfo(float).eps,
    "true": lambda: 1.0,
    "false": lambda: 0.0,
    "zeros": lambda *sizes: np.zeros(_shape(sizes)),
    "ones": lambda *sizes: np.ones(_shape(sizes)),
    "eye": _eye,
    "diag": _diag,
    "sum": _along(np.sum),
    "prod": _along(np.prod),
    "mean": _along(np.mean),
    "any": _along(np.any),
    "all": _along(np.all),
    "min": _extreme(np.minimum, np.min),
    "max": _extreme(np.maximum, np.max),
    "cumsum": _cumulative,
    "norm": lambda value: np.linalg.norm(matrix(value), None if 1 in matrix(value).shape else 2),
    "dot": lambda a, b: np.dot(matrix(a).reshape(-1), matrix(b).reshape(-1)),
    "cross": lambda a, b: np.cross(matrix(a).reshape(-1), matrix(b).reshape(-1)).reshape(matrix(a).shape),
    "kron": lambda a, b: np.kron(matrix(a), matrix(b)),
    "det": lambda value: np.linalg.det(matrix(value)),
    "inv": lambda value: np.linalg.inv(matrix(value)),
    "trace": lambda value: np.trace(matrix(value)),
    "transpose": lambda value: matrix(value).T,
    "linspace": _linspace,
    "repmat": _repmat,
    "reshape": _reshape,
    "size": _size,
    "numel": lambda value: matrix(value).size,
    "length": lambda value: max(matrix(value).shape) if matrix(value).size else 0,
    "isempty": lambda value: float(matrix(value).size == 0),
    "fliplr": lambda value: matrix(value)[:, ::-1],
    "flipud": lambda value: matrix(value)[::-1],
    "horzcat": _joined(1),
    "vertcat": _joined(0),
    "strcmp": lambda first, second: float(isinstance(first, str) and first == second),
    "strcmpi": lambda first, second: float(str(first).lower() == str(second).lower()),
}
"""By their names in MATLAB."""
