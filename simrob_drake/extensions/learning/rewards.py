r"""What a policy is to learn: terms of what a robot truly does, each with a weight.

The reward of a control period T is :math:`r = T \sum_j w_j t_j`, with the terms as they are at its end; ``ended``
counts once. Penalties are terms with negative weights, as for a walker those on its height, its drift and how
its torso turns (thesis p. 122).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from simrob_drake.base.frames import Vector
from simrob_drake.extensions.learning.policy import observed_of_turn


@dataclass(frozen=True)
class RewardSample:
    """What is true of a robot, or of k robots, at the end of a control period; of k all shapes have that in front."""

    place: Vector  # of its root link, from where that was at the start: ahead, to the left, up, shape (3,) [m]
    speed: Vector  # of that, likewise [m/s]
    turned: Vector  # of its root link from how it stood, angles Rx Ry Rz, shape (3,) [rad]
    spin: Vector  # of its root link, in the world's axes, shape (3,) [rad/s]
    effort: Vector  # torques as parts of their limits, shape (n,)
    action: Vector  # what was asked for, shape (m,), and what was asked for before
    last_action: Vector  # likewise
    # place of the tool in the world, shape (3,) [m]
    tool: Vector = field(default_factory=lambda: np.zeros(3))
    tool_speed: Vector = field(default_factory=lambda: np.zeros(3))  # its speed in the world [m/s]
    goal: Vector = field(default_factory=lambda: np.zeros(3))  # what is wanted
    time: float | Vector = 0.0  # since the start [s]
    # force that acts at the tool or the root link, in the world's axes, shape (3,) [N]
    push: Vector = field(default_factory=lambda: np.zeros(3))
    desired_speed: float = np.inf  # ahead [m/s]
    astray: float = (
        0.4  # by how much speeds differ from the goal where tracking gives 1/e of its most [m/s]
    )
    yields: float = 0.0  # how fast the tool is to go for a force on it [m/s per N]
    ended: bool | npt.NDArray[np.bool_] = False  # whether a monitor ended the episode
    means: Vector | None = None  # of the pace, shape (2,) [m/s]; None: it counts as it is now

    @property
    def pace(self) -> Vector:
        """Speeds ahead and to the left as the robot faces now, shape (2,) [m/s]."""
        cos, sin = np.cos(self.turned[..., 2]), np.sin(self.turned[..., 2])
        x, y = self.speed[..., 0], self.speed[..., 1]
        return np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)

    def averaged(self, before: Vector, period: float, over: float) -> "tuple[RewardSample, Vector]":
        """Return it with the means of its pace over a time constant [s], by those a period [s] before; and these."""
        means = before + (1.0 - np.exp(-period / over) if over > 0 else 1.0) * (self.pace - before)
        return replace(self, means=means), means


@dataclass(frozen=True)
class Origin:
    """Where a root link was at the start, and which way the robot faced: what its way is told from."""

    pose: Vector  # x y z qw qx qy qz, shape (7,)
    facing: float  # counterclockwise from x [rad]

    def sample(self, pose: Vector, velocity: Vector, **others: Any) -> RewardSample:
        """Return what is true by pose (..., 7) and velocity (..., 6) of the root link now, and the other fields."""
        cos, sin = np.cos(self.facing), np.sin(self.facing)
        ahead = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        return RewardSample(
            place=(pose[..., :3] - self.pose[:3]) @ ahead.T,
            speed=velocity[..., :3] @ ahead.T,
            turned=turned_from(self.pose[3:], pose[..., 3:]),
            spin=velocity[..., 3:],
            **others,
        )


_TURNED = 0.5  # by how much it faces elsewhere where heading gives 1/e of its most [rad]


def _square(values: Vector) -> Vector:
    return np.asarray((values * values).sum(axis=-1))


def _astray(now: RewardSample) -> Vector:
    """Return the square of how far the pace, or its means, are from the goal."""
    return _square((now.pace if now.means is None else now.means) - now.goal[..., :2])


def _heading_error(now: RewardSample) -> Vector:
    return observed_of_turn(
        "heading_error", now.turned, now.goal, np.asarray(now.time)[..., np.newaxis]
    )


TERMS: dict[str, Callable[[RewardSample], npt.ArrayLike]] = {
    "ahead": lambda now: np.minimum(now.speed[..., 0], now.desired_speed),
    "tracking": lambda now: np.exp(-_astray(now) / now.astray**2),
    "heading": lambda now: np.exp(-_square(_heading_error(now)) / _TURNED**2),
    "bounce": lambda now: now.speed[..., 2] ** 2,
    "alive": lambda now: np.ones(now.speed.shape[:-1]),
    "height": lambda now: np.minimum(now.place[..., 2], 0.0) ** 2,
    "lateral": lambda now: now.place[..., 1] ** 2,
    "rotation": lambda now: _square(now.turned),
    "lean": lambda now: _square(now.turned[..., :2]),
    "spin": lambda now: _square(now.spin),
    "effort": lambda now: np.mean(now.effort**2, axis=-1),
    "haste": lambda now: _square(now.action - now.last_action),
    "distance": lambda now: np.linalg.norm(now.tool - now.goal, axis=-1),
    "yielding": lambda now: _square(now.tool_speed - now.yields * now.push),
    "ended": lambda now: np.asarray(now.ended, dtype=float),
}
"""The terms by name: speed ahead, up to the one that is wanted [m/s]; exp(-e²/d²), by how far e its speeds ahead and
to the left are from the goal [m/s], and exp(-e²/0.25) by how far its heading is [rad]; the square of its speed upwards
[m²/s²]; 1; the squares of how far it sank [m²], went aside [m²], turned and leans [rad²], of its rates [rad²/s²], of
its torques as parts of their limits, of the change of its action; from the tool to the goal [m]; the square of how far
its speed is from what the force on it asks for [m²/s²]; 1 where a monitor ends the episode."""


def rewards(weights: Mapping[str, float], now: RewardSample, period: float) -> dict[str, Vector]:
    """Return what each term with a weight adds to the reward of a control period [s]; their sum is the reward."""
    return {
        name: np.asarray(
            weight * np.asarray(TERMS[name](now)) * (1.0 if name == "ended" else period)
        )
        for name, weight in weights.items()
    }


def turned_from(start: Vector, now: Vector) -> Vector:
    """Return how orientations (..., 4) qw qx qy qz are turned from others: angles Rx Ry Rz, shape (..., 3) [rad]."""
    (a, b, c, d), (e, f, g, h) = (np.moveaxis(each, -1, 0) for each in (start, now))
    w, x = a * e + b * f + c * g + d * h, a * f - b * e - c * h + d * g
    y, z = a * g + b * h - c * e - d * f, a * h - b * g + c * f - d * e
    size = w * w + x * x + y * y + z * z  # of any length
    pitch = np.arcsin(np.clip(2 * (w * y - z * x) / size, -1.0, 1.0))
    return np.stack(
        [
            np.arctan2(2 * (w * x + y * z), size - 2 * (x * x + y * y)),
            pitch,
            np.arctan2(2 * (w * z + x * y), size - 2 * (y * y + z * z)),
        ],
        axis=-1,
    )
