"""What all walks share: places on the way, and how steps grow and shrink."""

from __future__ import annotations

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector

FEWEST_STEPS = 2
"""Of a gait that ends as it begins: the last step brings the feet together."""


def check_steps(steps: int, fewest: int = FEWEST_STEPS) -> None:
    """Check that a gait goes enough steps.

    Raises:
        InvalidParameter: it does not.
    """
    if steps < fewest:
        raise InvalidParameter("steps", steps, f"at least {fewest}")


def on_path(pose: Vector, ahead: float = 0.0, left: float = 0.0, turn: float = 0.0) -> Vector:
    """Return the pose (x, y, turn) that is ahead, to the left and turned from another, shape (3,) [m, rad]."""
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(pose + np.array([cosine * ahead - sine * left, sine * ahead + cosine * left, turn]))


def ramp_shares(steps: int, ramp_steps: int) -> Vector:
    """Return how much of the full step each step goes ahead, shape (steps,): rising, level, falling, the last one 0."""
    number = np.arange(steps, dtype=float)
    rising = (number + 1) / (ramp_steps + 1)
    falling = (steps - 1 - number) / (ramp_steps + 1)
    return np.minimum(1.0, np.minimum(rising, falling))
