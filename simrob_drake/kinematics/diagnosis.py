"""Why a search ended away from its target, in words."""

from __future__ import annotations

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.kinematics.chain import Chain

_AT_LIMIT = 1e-9  # rad or m
_SINGULAR = 0.02  # smallest singular value of the Jacobian [m, rad], as where damping begins
_PUSH = 1e-3  # share of the error that must press a joint against its limit to count


def why_unreached(chain: Chain, target: Vector, posture: Vector, error: Vector, weights: Vector) -> str:
    """Tell why no step from a posture leads nearer to a target.

    Args:
        chain: that is to reach it.
        target: shape (4, 4).
        posture: the best found, shape (n,).
        error: from there to the target, shape (6,) [m, rad] about x, y, z of the base; 0 where nothing is asked.
        weights: of its parts, shape (6,).

    Returns:
        "out of reach ...", "joint limit ...", "singular posture ..." or "no solution found ...".
    """
    if chain.order and error[:3].any():
        first = chain.order[0]
        away = float(np.linalg.norm(target[:3, 3] - chain.points[first]))
        if away > chain.reach:
            return (
                f"out of reach: it lies {away:.3g} m from {chain.names[first]}, and the arm is {chain.reach:.3g} m long"
            )
    jacobian = chain.jacobian(posture)[0]
    push = jacobian.T @ (weights * error)
    strong = np.abs(push) > _PUSH * np.linalg.norm(weights * error)
    for held, limits, side in (
        ((posture <= chain.lower + _AT_LIMIT) & (push < 0) & strong, chain.lower, "lower"),
        ((posture >= chain.upper - _AT_LIMIT) & (push > 0) & strong, chain.upper, "upper"),
    ):
        for axis in np.flatnonzero(held):
            return f"joint limit: {chain.names[axis]} stands at its {side} limit {limits[axis]:.4g}"
    rows = jacobian[weights > 0][:, list(chain.order)]
    if rows.size and np.linalg.svd(rows, compute_uv=False)[-1] < _SINGULAR:
        return "singular posture: the arm is stretched or folded there and cannot move the way that is left"
    return "no solution found from this start"
