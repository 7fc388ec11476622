"""How an episode begins: all that a task leaves to chance, and how far its curriculum has come."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.learning.task import Task
from simrob_drake.parts.forces import ForceConfig, Push
from simrob_drake.parts.site import StationRobot

_LAST = 100  # episodes whose mean return a curriculum goes by


@dataclass(frozen=True)
class Beginning:
    """What is drawn for an episode.

    Attributes:
        start: where the axes begin, shape (n,) [rad].
        goal: of the policy; None where the section of the policy says it.
        pushes: in place of those of the station, by name.
    """

    start: Vector
    goal: Vector | None
    pushes: Mapping[str, Push]


def beginning(
    task: Task, draw: np.random.Generator, *, robot: StationRobot, forces: Mapping[str, ForceConfig], period: float
) -> Beginning:
    """Draw what is random in an episode; pushes begin with a control period [s]."""
    away = task.noise_deg * robot.model.user_units * draw.standard_normal(len(robot.axes))
    start = np.clip(robot.initial + away, *robot.model.axis_limits) if task.noise_deg > 0 else robot.initial
    goal = None if task.goals is None else draw.uniform(task.goals.low, task.goals.high)
    pushes, drawn = task.pushes, dict[str, Push]()
    if pushes is not None:
        section = forces[pushes.name]
        assert isinstance(section, Push)  # the task has looked
        direction = draw.standard_normal(3) * [1, 1, 0 if pushes.level else 1]
        force = draw.uniform(*pushes.force) * direction / np.linalg.norm(direction)
        begins = period * round(draw.uniform(*pushes.start) / period)
        drawn[pushes.name] = section.model_copy(update={"start": begins, "force": tuple(force.tolist())})
    return Beginning(start, goal, drawn)


class Curriculum:
    """How far learning has come, by which keys of a task grow."""

    def __init__(self, *, grown: bool = False) -> None:
        """Begin with the first values of all that grows, or with the last ones."""
        self._steps = np.inf if grown else 0.0
        self._returns = deque([np.inf if grown else -np.inf], maxlen=_LAST)

    def count(self, steps: int, returns: list[float]) -> None:
        """Count steps of robots, and the returns of episodes that ended."""
        self._steps += steps
        if np.isneginf(self._returns[0]) and returns:
            self._returns.clear()
        self._returns.extend(returns if np.isfinite(self._steps) else [])

    def of(self, task: Task) -> Task:
        """Return a task as it stands now."""
        return task.at(self._steps, float(np.mean(self._returns))) if task.grows else task
