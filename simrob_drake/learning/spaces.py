"""What a policy may observe and ask for, as spaces of Gymnasium with finite bounds."""

from __future__ import annotations

from collections.abc import Mapping

import gymnasium
import numpy as np

from simrob_drake.parts.controllers.policy import Policy
from simrob_drake.parts.site import StationRobot

_FAR = 1e4
"""Beyond any rate, goal or force that a robot bears [rad/s, m, N]."""


def spaces(
    section: Policy, robot: StationRobot, sizes: Mapping[str, int]
) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Return the spaces of observations and of actions of one robot.

    Positions lie within the axes' limits, which a robot may pass by π; what lies beyond a bound is seen as the bound.

    Args:
        section: of the policy.
        robot: that it moves.
        sizes: of all that is observed, by name, and of the action.
    """
    lower, upper = robot.model.axis_limits
    bounds = {name: (np.full(size, -_FAR), np.full(size, _FAR)) for name, size in sizes.items()}
    for name, most in (("attitude", np.pi * np.array([1.0, 0.5, 1.0])), ("action", 1.0), ("clock", 1.0)):
        if name in bounds:
            bounds[name] = (0 * bounds[name][0] - most, 0 * bounds[name][1] + most)
    low, high = (np.clip(limit - robot.initial, -_FAR, _FAR) for limit in (lower, upper))
    bounds["position"] = (low - np.pi, high + np.pi)
    least, most = (np.concatenate([bounds[name][end] for name in section.observes]) for end in (0, 1))
    observations = gymnasium.spaces.Box(least.astype(np.float32), most.astype(np.float32), dtype=np.float32)
    return observations, gymnasium.spaces.Box(-1.0, 1.0, (sizes["action"],), np.float32)
