"""Environments of Gymnasium, made of stations: episodes of a task, with all that is random drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.learning.episode import Episode
from simrob_drake.learning.rewards import rewards
from simrob_drake.learning.task import load_task
from simrob_drake.parts.forces.push import Push

_SEEDS = 2**31


class StationEnvironment(gymnasium.Env[Any, Any]):
    """A task in its station; a step is a control period of the policy.

    Observation and action are those of the station's controller of kind ``policy``; rewards are of what is true.
    """

    def __init__(
        self,
        task: str | Path = "walk",
        *,
        station: str | None = None,
        overrides: Mapping[str, Any] | None = None,
    ) -> None:
        """Build the station.

        Args:
            task: a name of :func:`~simrob_drake.learning.task.task_names`, or a YAML file.
            station: in place of the task's, such as ``zjudancer_dynamic``.
            overrides: what is changed in it, as of :func:`~simrob_drake.load_station`.

        Raises:
            SimrobError: a task or a station that cannot be.
        """
        self.task, path = load_task(task)
        self.config = self.task.config(station, overrides or {}, path)
        self.episode = Episode(self.config)
        policy = self.episode.policy
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (policy.observed,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (policy.acts,), np.float32)
        self._goal = np.array(self.episode.section.goal)

    @property
    def policy_axes(self) -> list[str]:
        """The axes that the policy moves, in the order of its action."""
        return list(self.episode.section.axes(self.episode.robot))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Vector, dict[str, Any]]:
        """Begin an episode; all that is random in it follows from the seed."""
        super().reset(seed=seed)
        task, draw, robot = self.task, self.np_random, self.episode.robot
        seeds = draw.integers(_SEEDS, size=len(self.episode.seeds)).tolist()
        away = task.noise_deg * robot.model.user_units * draw.standard_normal(len(robot.axes))
        if task.goals is not None:
            self._goal = draw.uniform(task.goals.low, task.goals.high)
        seen = self.episode.begin(
            seeds=seeds,
            away=away if task.noise_deg > 0 else None,
            goal=self._goal if task.goals is not None else None,
            forces=self._pushes(),
        )
        return seen.astype(np.float32), {}

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Advance one control period; `info` holds what each term of the reward gave, and where the robot is."""
        episode, task = self.episode, self.task
        seen = episode.advance(np.asarray(action, dtype=float))
        now = episode.moment(
            goal=self._goal, desired_speed=np.inf if task.speed is None else task.speed, yields=task.yields
        )
        parts = {name: float(part) for name, part in rewards(task.rewards, now, episode.period).items()}
        info = {"rewards": parts, "place": now.place, "time": episode.time}
        if episode.ended:
            info["ended"] = episode.ended
        truncated = not episode.ended and episode.time > self.config.duration - episode.period / 2
        return seen.astype(np.float32), sum(parts.values()), bool(episode.ended), truncated, info

    def _pushes(self) -> dict[str, Push]:
        pushes, draw, period = self.task.pushes, self.np_random, self.episode.period
        if pushes is None:
            return {}
        section = self.config.forces[pushes.name]
        assert isinstance(section, Push)  # the task has looked
        direction = draw.standard_normal(3) * [1, 1, 0 if pushes.level else 1]
        force = draw.uniform(*pushes.force) * direction / np.linalg.norm(direction)
        start = period * round(draw.uniform(*pushes.start) / period)
        return {pushes.name: section.model_copy(update={"start": start, "force": tuple(force.tolist())})}
