r"""What a policy is to learn: terms of what a robot truly does, each with a weight.

The reward of a control period T is :math:`r = T \sum_j w_j t_j`, with the terms as they are at its end; ``ended``
counts once. Penalties are terms with negative weights, as for a walker those on its height, its drift and how
its torso turns (thesis p. 122).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from pydrake.math import RollPitchYaw, RotationMatrix

from simrob_drake.frames import Vector, transform_from_xyz_quaternion


@dataclass(frozen=True)
class RewardSample:
    """What is true of a robot at the end of a control period.

    Attributes:
        place: of its root link, from where that was at the start: ahead, to the left, up, shape (3,) [m].
        speed: of that, likewise [m/s].
        turned: of its root link from how it stood.
        spin: of its root link, in the world's axes, shape (3,) [rad/s].
        effort: torques as parts of their limits, shape (n,).
        action: what was asked for, shape (m,), and what was asked for before.
        last_action: likewise.
        tool: place of the tool in the world, shape (3,) [m].
        tool_speed: its speed in the world [m/s].
        goal: what is wanted.
        push: force that acts at the tool or the root link, in the world's axes, shape (3,) [N].
        desired_speed: ahead [m/s].
        yields: how fast the tool is to go for a force on it [m/s per N].
        ended: a monitor ended the episode.
    """

    place: Vector
    speed: Vector
    turned: RotationMatrix
    spin: Vector
    effort: Vector
    action: Vector
    last_action: Vector
    tool: Vector = field(default_factory=lambda: np.zeros(3))
    tool_speed: Vector = field(default_factory=lambda: np.zeros(3))
    goal: Vector = field(default_factory=lambda: np.zeros(3))
    push: Vector = field(default_factory=lambda: np.zeros(3))
    desired_speed: float = np.inf
    yields: float = 0.0
    ended: bool = False


def _square(values: Vector) -> float:
    return float(values @ values)


TERMS: dict[str, Callable[[RewardSample], float]] = {
    "ahead": lambda now: min(float(now.speed[0]), now.desired_speed),
    "alive": lambda now: 1.0,
    "height": lambda now: min(float(now.place[2]), 0.0) ** 2,
    "lateral": lambda now: float(now.place[1]) ** 2,
    "rotation": lambda now: _square(RollPitchYaw(now.turned).vector()),
    "spin": lambda now: _square(now.spin),
    "effort": lambda now: float(np.mean(now.effort**2)),
    "haste": lambda now: _square(now.action - now.last_action),
    "distance": lambda now: float(np.linalg.norm(now.tool - now.goal)),
    "yielding": lambda now: _square(now.tool_speed - now.yields * now.push),
    "ended": lambda now: float(now.ended),
}
"""The terms by name: speed ahead, up to the one that is wanted [m/s]; 1; the squares of how
far it sank [m²], went aside [m²] and turned [rad²], of its rates [rad²/s²], of its torques as parts of their limits, of
the change of its action; from the tool to the goal [m]; the square of how far its speed is from what the force on it
asks for [m²/s²]; 1 where a monitor ends the episode."""


def rewards(weights: Mapping[str, float], now: RewardSample, period: float) -> dict[str, float]:
    """Return what each term with a weight adds to the reward of a control period [s]; their sum is the reward."""
    return {name: weight * TERMS[name](now) * (1.0 if name == "ended" else period) for name, weight in weights.items()}


def turned_from(start: Vector, pose: Vector) -> RotationMatrix:
    """Return how a pose (7,) is turned from another."""
    first, now = (transform_from_xyz_quaternion(each).rotation() for each in (start, pose))
    return first.inverse() @ now
