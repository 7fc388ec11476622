"""Functions of MATLAB's toolboxes that make objects or gains: linear systems, regulators, time series."""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import solve_continuous_are

from simrob_drake.frames import Vector


def _regulator(*arguments: Any) -> Vector:
    """Return the gains K of u = -K x with the least ∫ xᵀ Q x + uᵀ R u dt, of a system or its A and B."""
    first, *rest = arguments
    a, b, q, r = (first["A"], first["B"], *rest) if isinstance(first, dict) else arguments
    return np.asarray(np.linalg.solve(r, np.transpose(b) @ solve_continuous_are(a, b, q, r)))


def _time_series(values: Vector, times: Vector) -> dict[str, Vector]:
    data = values if len(values) == np.size(times) else values.T
    return {"Time": times.reshape(-1, 1), "Data": data}


SYSTEMS: dict[str, Callable[..., Any]] = {
    "tf": lambda numerator, denominator: {"numerator": numerator, "denominator": denominator},
    "ss": lambda a, b, c, d: dict(zip("ABCD", (a, b, c, d), strict=True)),
    "lqr": _regulator,
    "timeseries": _time_series,
}
"""By their names in MATLAB; they take matrices, and systems as structures."""
