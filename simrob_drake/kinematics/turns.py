"""Whole turns: the same posture with a joint's angle 2π further on, where the limits allow it."""

from __future__ import annotations

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.kinematics.chain import Chain

TURN = 2.0 * np.pi
_SLACK = 1e-9  # rad beyond a limit that is rounding, and clipped


def nearest_turns(chain: Chain, positions: Vector, reference: Vector) -> tuple[Vector, Vector]:
    """Turn revolute joints by whole turns, into their limits and as near to a reference as these allow.

    Args:
        chain: whose limits count.
        positions: shape (..., n).
        reference: shape (..., n), such as the current posture.

    Returns:
        the positions, within the limits or as near to them as whole turns come, and how far each then lies beyond a
        limit (0 within), both of shape (..., n).
    """
    lower, upper = chain.lower - _SLACK, chain.upper + _SLACK
    turns = np.where(chain.revolute, TURN, 0.0)
    near = positions - turns * np.round((positions - reference) / TURN)
    down = near - turns * np.ceil(np.maximum(near - upper, 0.0) / TURN)
    up = near + turns * np.ceil(np.maximum(lower - near, 0.0) / TURN)
    best = np.where(near > upper, down, up)
    other = np.where(near > upper, near, down)  # the last turn on the far side, for limits less than a turn apart
    beyond, other_beyond = _beyond(chain, best), _beyond(chain, other)
    swap = other_beyond < beyond
    best = np.where(swap, other, best)
    beyond = np.where(swap, other_beyond, beyond)
    return np.where(beyond > 0.0, best, np.clip(best, chain.lower, chain.upper)), beyond


def _beyond(chain: Chain, positions: Vector) -> Vector:
    over = np.maximum(positions - chain.upper, chain.lower - positions)
    return np.where(over > _SLACK, over, 0.0)
