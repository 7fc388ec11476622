"""Functions of MATLAB's toolboxes that make objects or gains: linear systems, regulators, time series."""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import solve_continuous_are

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message


def _numbers(value: Any) -> Vector:
    return np.atleast_2d(np.asarray(value, dtype=float))


def _regulator(*arguments: Any) -> Vector:
    """Return the gains K of u = -K x with the least ∫ xᵀ Q x + uᵀ R u dt, of a system or its A and B."""
    first, *rest = arguments
    a, b, q, r = map(
        _numbers, (first.get("A"), first.get("B"), *rest) if isinstance(first, dict) else arguments
    )
    return np.asarray(np.linalg.solve(r, b.T @ solve_continuous_are(a, b, q, r)))


def _time_series(values: Any, times: Any) -> dict[str, Vector]:
    data, moments = _numbers(values), _numbers(times).reshape(-1, 1)
    data = data if len(data) == len(moments) else data.T
    if len(data) != len(moments):
        raise ValueError(
            message(
                "simulink.time_series_sizes",
                "a time series of {times} times for {count} values",
                times=len(moments),
                count=len(data),
            )
        )
    return {"Time": moments, "Data": data}


SYSTEMS: dict[str, Callable[..., Any]] = {
    "tf": lambda numerator, denominator: {
        "numerator": _numbers(numerator),
        "denominator": _numbers(denominator),
    },
    "ss": lambda a, b, c, d: dict(zip("ABCD", map(_numbers, (a, b, c, d)), strict=True)),
    "lqr": _regulator,
    "timeseries": _time_series,
}
"""By their names in MATLAB."""
