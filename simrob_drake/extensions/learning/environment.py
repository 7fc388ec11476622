"""Environments of Gymnasium, made of stations: episodes of a task, with all that is random drawn from a seed."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from simrob_drake.base.errors import one_of
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.learning.episode import Episode
from simrob_drake.extensions.learning.rewards import rewards
from simrob_drake.extensions.learning.sensing import spaces
from simrob_drake.extensions.learning.task import Curriculum, beginning, load_task
from simrob_drake.results.animation.pictures import Still
from simrob_drake.stations.config import StationConfig

with importing_extra("learning", "rl"):
    import gymnasium

_SEEDS = 2**31
RENDER_MODES = ["rgb_array"]


class StationEnvironment(gymnasium.Env[Any, Any]):
    """A task in its station; a step is a control period of the policy.

    Observation and action are those of the station's controller of kind ``policy``; rewards are of what is true.
    """

    metadata: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": 50}  # noqa: RUF012  # as Gymnasium has it

    def __init__(
        self,
        task: str | Path = "walk",
        *,
        station: str | None = None,
        overrides: Mapping[str, Any] | None = None,
        engine: Literal["drake", "mujoco"] = "drake",
        grown: bool = False,
        render_mode: Literal["rgb_array"] | None = None,
    ) -> None:
        """Build the station.

        Args:
            task: a name of :func:`~simrob_drake.extensions.learning.task.task_names`, or a YAML file.
            station: in place of the task's, such as ``zjudancer_dynamic``.
            overrides: what is changed in it, as of :func:`~simrob_drake.load_station`.
            engine: ``mujoco`` steps the station in MuJoCo, at 2 ms unless ``solver`` is changed.
            grown: begin with the last values of what grows in the task.
            render_mode: ``rgb_array`` lets :meth:`render` give pictures.

        Raises:
            SimrobError: a task or a station that cannot be.
        """
        self.render_mode = render_mode
        self.task, path = load_task(task)
        in_mujoco = (
            one_of(message("learning.engine", "engine"), engine, ("drake", "mujoco")) == "mujoco"
        )
        self._source = (
            station,
            {**({"solver": {"kind": "mujoco"}} if in_mujoco else {}), **(overrides or {})},
            path,
        )
        self.config = self._drawn({})
        self.episode = Episode(self.config)
        policy = self.episode.policy
        self.observation_space, self.action_space = spaces(
            self.episode.section, self.episode.robot, policy.sizes
        )
        self.metadata = {**self.metadata, "render_fps": self.episode.section.rate}
        self._goal = np.array(self.episode.section.goal)
        self._curriculum, self._return = Curriculum(grown=grown), 0.0
        self._still: Still | None = None

    @property
    def policy_axes(self) -> list[str]:
        """The axes that the policy moves, in the order of its action."""
        return list(self.episode.section.axes(self.episode.robot))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Begin an episode; all that is random in it follows from the seed.

        A task whose station is random, too, has it built anew each time.
        """
        super().reset(seed=seed)
        draw = self.np_random
        if self.task.random:
            self.episode = Episode(self._drawn(self.task.drawn(draw.random(len(self.task.random)))))
        episode = self.episode
        seeds = draw.integers(_SEEDS, size=len(episode.seeds)).tolist()
        task = self._curriculum.of(self.task)
        begun = beginning(
            task, draw, robot=episode.robot, forces=self.config.forces, period=episode.period
        )
        if begun.goal is not None:
            self._goal = begun.goal
        self._return, self._means = 0.0, np.zeros(2)
        return self._observed(
            episode.begin(seeds=seeds, start=begun.start, goal=begun.goal, forces=begun.pushes)
        ), {}

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Advance one control period; `info` holds what each term of the reward gave, and where the robot is."""
        episode, task = self.episode, self._curriculum.of(self.task)
        seen = episode.advance(np.asarray(action, dtype=float))
        now = episode.moment(goal=self._goal, **task.targets)
        now, self._means = now.averaged(self._means, episode.period, task.averaged)
        parts = {
            name: float(part) for name, part in rewards(task.rewards, now, episode.period).items()
        }
        reward = sum(parts.values())
        info = {"rewards": parts, "place": now.place, "time": episode.time}
        if episode.ended:
            info["ended"] = episode.ended
        truncated = not episode.ended and episode.time > self.config.duration - episode.period / 2
        self._return += reward
        self._curriculum.count(1, [self._return] if episode.ended or truncated else [])
        return self._observed(seen), reward, bool(episode.ended), truncated, info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return a picture of the robot now, shape (360, 480, 3), drawn without a display; None without a mode."""
        if self.render_mode is None:
            return None
        self._still = self._still or Still(self.config)
        return self._still.image(self.episode.positions)

    def _drawn(self, values: Mapping[str, Any]) -> StationConfig:
        """Return the station with some keys drawn."""
        station, overrides, path = self._source
        return self.task.config(station, {**overrides, **values}, path)

    def _observed(self, seen: Vector) -> Vector:
        space = self.observation_space
        assert isinstance(space, gymnasium.spaces.Box)
        return np.clip(seen, space.low, space.high).astype(np.float32)
