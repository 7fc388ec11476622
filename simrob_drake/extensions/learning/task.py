"""What is to be learnt, as a YAML file says it: a station with a policy's place, rewards, and what is random."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.base.distributions import AnyDistribution
from simrob_drake.base.errors import InvalidConfig, UnknownName, one_of
from simrob_drake.base.files import models_root
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.packages import Border
from simrob_drake.base.sections import (
    Boolean,
    Duration,
    Instant,
    NotNegative,
    Number,
    Positive,
    Strict,
    validate_section,
)
from simrob_drake.base.yaml_files import is_yaml_name, read_yaml
from simrob_drake.extensions.learning.episode import policies_of
from simrob_drake.extensions.learning.rewards import TERMS
from simrob_drake.parts.forces import ForceConfig, Push
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.file_paths import changes_with_absolute_paths, station_with_absolute_path
from simrob_drake.stations.load import load_station

_GOALS = (
    ("distance", (3,), "x y z"),
    ("tracking", (2, 3), "speeds ahead and to the left, and perhaps a rate to the left"),
    ("heading", (3,), "speeds ahead and to the left and a rate to the left"),
)
"""Terms that need a goal: its sizes, and what it is."""
_GROWING = ("rewards", "speed", "yields", "noise_deg", "pushes", "goals")


class Pushes(Strict):
    """A push of random direction in each episode, through the station's push of this name."""

    name: str
    """Of a `push` among the station's `forces` that says no place: it acts at the tool, or at the root link."""
    force: tuple[NotNegative, NotNegative]
    """The least and the largest [N]."""
    start: tuple[Instant, Instant]
    """The earliest and the latest [s]."""
    level: Boolean = True
    """Whether they are horizontal, along x and y of what is pushed."""

    @model_validator(mode="after")
    def _are_ranges(self) -> Self:
        for name, (least, most) in (("force", self.force), ("start", self.start)):
            if least > most:
                raise ValueError(
                    message(
                        "learning.least_to_largest",
                        "{name} is from the least to the largest, and not from {least:g} to {most:g}",
                        name=name,
                        least=least,
                        most=most,
                    )
                )
        return self


class Goals(Strict):
    """A box in which each episode has its goal."""

    low: list[Number]
    high: list[Number]

    @model_validator(mode="after")
    def _is_a_box(self) -> Self:
        if len(self.low) != len(self.high) or not np.all(np.array(self.low) <= np.array(self.high)):
            raise ValueError(
                message(
                    "learning.low_and_high",
                    "low and high are of one size, and low is nowhere above high",
                )
            )
        return self


class Growth(Strict):
    """A key of the task that goes from its first value to its last as the robot learns."""

    first: Number | tuple[Number, ...]
    last: Number | tuple[Number, ...]
    steps: Positive | None = None
    """In so many steps of all robots together."""
    returns: tuple[Number, Number] | None = None
    """While the mean return of the last hundred episodes rises from one of these to the other."""

    @model_validator(mode="after")
    def _goes_by_one(self) -> Self:
        if (self.steps is None) == (self.returns is None):
            raise ValueError(
                message(
                    "learning.grows_with",
                    "it grows with steps or with returns: one of them must be given",
                )
            )
        if self.returns is not None and not self.returns[0] < self.returns[1]:
            raise ValueError(
                message("learning.returns_rise", "returns are from the smaller to the larger")
            )
        if np.shape(self.first) != np.shape(self.last):
            raise ValueError(message("learning.first_and_last", "first and last are of one size"))
        return self

    def at(self, steps: float, returned: float) -> Any:
        """Return the value after so many steps, at a mean return."""
        low, high = (0.0, self.steps) if self.returns is None else self.returns
        assert high is not None
        part = np.clip(
            ((steps if self.returns is None else returned) - low) / (high - low), 0.0, 1.0
        )
        first, last = np.array(self.first), np.array(self.last)
        return (first + part * (last - first)).tolist()


class Task(Strict):
    """What is to be learnt."""

    station: str
    """A name of `simrob list`, or a YAML file."""
    overrides: dict[str, Any] = Field(default_factory=dict)
    """What is changed in it: sensors, and the controller of kind `policy` that is to learn."""
    duration: Duration = 10.0
    """The longest that an episode takes [s], unless overrides say another `duration`."""
    rewards: dict[str, Number] = Field(min_length=1)
    """Weights of the terms of the reward, by name."""
    speed: Positive | None = None
    """How fast ahead is fast enough [m/s]; the faster the better unless given."""
    astray: Positive = 0.4
    """How far speeds are from the goal where `tracking` gives 1/e of its most [m/s]."""
    averaged: NotNegative = 0.0
    """Time constant over which these speeds are averaged, so that the sway of steps counts less [s]."""
    yields: NotNegative = 0.0
    """How fast a tool is to go for a force on it [m/s per N]."""
    noise_deg: NotNegative = 0.0
    """Standard deviation of where each axis begins [deg, or m]."""
    pushes: Pushes | None = None
    """A push in each episode."""
    goals: Goals | None = None
    """Where the goals lie."""
    random: dict[str, AnyDistribution] = Field(default_factory=dict)
    """Keys of the station that are others in each episode, such as `contact.friction` or `pieces.load.mass`."""
    grows: dict[str, Growth] = Field(default_factory=dict)
    """Keys of this task that grow as the robot learns, such as `pushes.force` or `rewards.effort`."""

    @model_validator(mode="after")
    def _knows_its_terms(self) -> Self:
        for name in self.rewards:
            one_of(message("learning.term_of_rewards", "term of rewards"), name, TERMS)
        return self

    @model_validator(mode="after")
    def _can_grow(self) -> Self:
        for key in self.grows:
            self._find(key)
        for steps in (-np.inf, np.inf) if self.grows else ():
            content = self.at(steps, steps).model_dump(exclude_unset=True)
            type(self).model_validate({**content, "grows": {}})
        return self

    def _find(self, key: str) -> None:
        """Check that there is a key that can grow."""
        section: Any = self
        for number, name in enumerate(key.split(".")):
            known = (
                section if isinstance(section, dict) else getattr(type(section), "model_fields", {})
            )
            one_of(
                message("learning.key_for_grows", "key of the task, for grows.{key}", key=key),
                name,
                known if number else _GROWING,
            )
            section = section[name] if isinstance(section, dict) else getattr(section, name)

    @property
    def targets(self) -> dict[str, float]:
        """What terms of the reward are measured by, as samples of it have it."""
        return {"desired_speed": self.speed or np.inf, "yields": self.yields, "astray": self.astray}

    def at(self, steps: float, returned: float) -> "Task":
        """Return the task as it stands after so many steps, at a mean return."""
        task = self
        for key, growth in self.grows.items():
            task = _changed(task, key.split("."), growth.at(steps, returned))
        return task

    def drawn(self, parts: Vector) -> dict[str, Any]:
        """Return values of the random keys of the station, by parts 0 to 1 of all draws, shape (k,)."""
        found = dict[str, Any]()
        for (key, distribution), part in zip(self.random.items(), parts.tolist(), strict=True):
            if distribution.applies(found):
                found[key] = distribution.quantile(part)
        return found

    def config(
        self, station: str | None, overrides: Mapping[str, Any], where: Path | str
    ) -> StationConfig:
        """Return the station in which this is learnt.

        Raises:
            SimrobError: there is no such station, or it has no place for a policy, or several.
        """
        config = load_station(
            station or self.station, {"duration": self.duration, **self.overrides, **overrides}
        )
        if len(found := policies_of(config)) != 1:
            expected = message(
                "learning.one_policy",
                "hold {count} controllers of kind policy; it must be one, that is to learn",
                count=len(found),
            )
            raise InvalidConfig(where, "overrides.controllers", expected)
        (policy,) = found.values()
        self._check_goals(len(policy.goal), where)
        if self.pushes is not None:
            pushes = [
                name
                for name, force in config.forces.items()
                if isinstance(force, Push) and force.at is None
            ]
            one_of(
                message(
                    "learning.push_of_station",
                    "push of the station, without a place of its own, for pushes.name",
                ),
                self.pushes.name,
                pushes,
            )
        return config

    def _check_goals(self, size: int, where: Path | str) -> None:
        """Check that the goal of the policy, of ``size`` figures, fits the reward terms and the box of goals.

        Raises:
            InvalidConfig: it does not; ``where`` is the file that is named.
        """
        for term, sizes, names in _GOALS:
            if term in self.rewards and size not in sizes:
                expected = message(
                    "learning.goal_of_policy",
                    "needs a goal of the policy of {names}, not of {size} figures",
                    names=names,
                    size=size,
                )
                raise InvalidConfig(where, f"rewards.{term}", expected)
        if self.goals is not None and len(self.goals.low) != size:
            expected = message(
                "learning.box_of_goals",
                "is a box of {count} figures; the policy's goal has {size}",
                count=len(self.goals.low),
                size=size,
            )
            raise InvalidConfig(where, "goals", expected)


def _changed(section: Any, keys: list[str], value: Any) -> Any:
    """Return a section, a mapping or a value, in which what the keys name is another."""
    if not keys:
        return tuple(value) if isinstance(section, tuple) else value
    key, *rest = keys
    if isinstance(section, dict):
        return {**section, key: _changed(section[key], rest, value)}
    return section.model_copy(update={key: _changed(getattr(section, key), rest, value)})


def task_names() -> list[str]:
    """Return the names of the tasks that come with the package."""
    return sorted(file.stem for file in (models_root() / "tasks").glob("*.yaml"))


def load_task(name_or_path: str | Path) -> tuple[Task, Path]:
    """Return a task and its file, by name or file; raises UnknownName: no such task; InvalidConfig: no task."""
    if str(name_or_path) in task_names():
        path = models_root() / "tasks" / f"{name_or_path}.yaml"
    else:
        path = Path(name_or_path)
        if not is_yaml_name(path):
            raise UnknownName(message("learning.task", "task"), str(name_or_path), task_names())
    task, folder = validate_section(Task, read_yaml(path), path), path.absolute().parent
    changes = changes_with_absolute_paths(task.overrides, folder, Border(path))
    return task.model_copy(
        update={"station": station_with_absolute_path(task.station, path), "overrides": changes}
    ), path


_LAST = 100  # episodes whose mean return a curriculum goes by


@dataclass(frozen=True)
class Beginning:
    """What is drawn for an episode."""

    start: Vector  # where the axes begin, shape (n,) [rad]
    goal: Vector | None  # of the policy; None where the section of the policy says it
    pushes: Mapping[str, Push]  # in place of those of the station, by name


def beginning(
    task: Task,
    draw: np.random.Generator,
    *,
    robot: StationRobot,
    forces: Mapping[str, ForceConfig],
    period: float,
) -> Beginning:
    """Draw what is random in an episode; pushes begin with a control period [s]."""
    away = task.noise_deg * robot.model.user_units * draw.standard_normal(len(robot.axes))
    start = (
        np.clip(robot.initial + away, *robot.model.axis_limits)
        if task.noise_deg > 0
        else robot.initial
    )
    goal = None if task.goals is None else draw.uniform(task.goals.low, task.goals.high)
    pushes, drawn = task.pushes, dict[str, Push]()
    if pushes is not None:
        section = forces[pushes.name]
        assert isinstance(section, Push)  # the task has looked
        direction = draw.standard_normal(3) * [1, 1, 0 if pushes.level else 1]
        force = draw.uniform(*pushes.force) * direction / np.linalg.norm(direction)
        begins = period * round(draw.uniform(*pushes.start) / period)
        drawn[pushes.name] = section.model_copy(
            update={"start": begins, "force": tuple(force.tolist())}
        )
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
