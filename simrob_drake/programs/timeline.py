"""What happens to a station at moments of its own, whatever its robots are told: settings, pushes, drags, drives.

Runs are cut at a grid of time, and where something happens, so that each can be repeated from any moment of it to the
last bit.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from math import radians
from typing import Annotated, Any, Protocol, Self

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.blocks.references import Reference, later
from simrob_drake.errors import one_of
from simrob_drake.parts.forces import Drag, ForceConfig, Push
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult, joined
from simrob_drake.sections import Duration, Instant, NotNegative, Number, Positive, Strict, Triple
from simrob_drake.simulation import Moment, OnStep, ReferenceLike, Runner, Ticks
from simrob_drake.stations.change_of_kind import settings_with
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import ONLY_ROBOT, with_settings
from simrob_drake.stations.resolve import resolve

GRID = 0.05  # from one moment of the grid to the next, unless told otherwise [s]
_SERVO = "servo."


class PushNow(Strict):
    """A constant force for a while; see :class:`~simrob_drake.parts.forces.Push`."""

    at: str | None = None
    """What is pushed: a robot, link, tool or piece; the only robot unless given."""
    force: Triple
    """Along x, y and z of what is pushed [N]."""
    duration: Duration = 0.1
    """How long it lasts [s]."""


class DragNow(Strict):
    """A spring that pulls a point after a target; see :class:`~simrob_drake.parts.forces.Drag`."""

    at: str | None = None
    """What is pulled: a robot, link, tool or piece; the only robot unless given."""
    point: Triple = (0.0, 0.0, 0.0)
    """Where it pulls, in the frame of that [m]."""
    targets: Annotated[tuple[Triple, ...], Field(min_length=1)]
    """Where to, in the world, one for each step of the program's grid [m]."""
    stiffness: Positive | None = None
    """Of the spring [N/m]; a quarter of a metre pulls with the weight of the robot or piece unless given."""


class DriveNow(Strict):
    """A walk that is driven by hand, in place of what its section says; a station without one does nothing then."""

    at: str | None = None
    """Who walks; the only robot unless given."""
    commands: Annotated[tuple[tuple[NotNegative, Number, Number, Number], ...], Field(min_length=1)]
    """From when on, since the change [s], and how: speeds ahead and to the left [m/s], turn to the left [deg/s]."""


class Change(Strict):
    """Something that happens while a program runs."""

    time: Instant
    """When, from the start of the program [s]; moved to its grid."""
    set: Annotated[dict[str, Any], Field(min_length=1)] | None = None
    """Keys of the station and their new values, such as `{servo.kp: 500}`; they hold from then on."""
    push: PushNow | None = None
    """A push."""
    drag: DragNow | None = None
    """A drag."""
    drive: DriveNow | None = None
    """A drive."""

    @model_validator(mode="after")
    def _one_thing(self) -> Self:
        if sum(thing is not None for thing in (self.set, self.push, self.drag, self.drive)) != 1:
            raise ValueError("a change is one of set, push, drag and drive")
        return self

    def entry(self) -> dict[str, Any]:
        """Return what a program's file has of it, without the values that are as they would be anyway."""
        return self.model_dump(mode="json", exclude_defaults=True)


class Timeline:
    """The grid of a station's runs, and what happens at its moments.

    Attributes:
        grid: from one moment to the next [s]; None: runs go through, and nothing happens.
        changes: what happens, in order of time.
        now: time of the station since the timeline began [s].
        tell: is told of each moment while a station runs, with the time since the timeline began; it may add changes
            for it. True ends what runs.
    """

    def __init__(self, grid: float | None = None, changes: Sequence[Change] = ()) -> None:
        """Begin a timeline; changes without a grid are made on the usual one."""
        self.grid = GRID if grid is None and changes else grid
        self.changes = sorted(changes, key=lambda change: change.time)
        self.now = 0.0
        self.tell: Callable[[float, Moment], bool] = lambda time, moment: False

    def steps(self, time: float) -> int:
        """Return the number of the moment of the grid that is nearest to a time [s]."""
        return int(np.rint(time / self._step))

    def whole(self, duration: float) -> float:
        """Return a duration [s] as long or longer that ends on the grid."""
        return self.time_of(int(np.ceil(duration / self._step - 1e-6)))

    def time_of(self, number: int) -> float:
        """Return the time of a moment of the grid [s]."""
        return round(number * self._step, 12)

    def part(self, end: float) -> float:
        """Return how long nothing changes from now on [s], up to ``end`` of the timeline."""
        now = self.steps(self.now)
        later = (number for change in self.changes if (number := self.steps(change.time)) > now)
        return self.time_of(min(next(later, self.steps(end)), self.steps(end)) - now)

    def add(self, change: Change) -> int:
        """Put a change among the others, behind those of the same time; return its place."""
        place = bisect_right(self.changes, change.time, key=lambda one: one.time)
        self.changes.insert(place, change)
        return place

    def settings(self) -> dict[str, Any]:
        """Return the settings that changes have made up to now, by key; later changes override earlier ones.

        Keys that no change has set are missing: they have the station's own values.
        """
        now = self.steps(self.now)
        settings: dict[str, Any] = {}
        for change in self.changes:
            if change.set and self.steps(change.time) <= now:
                settings = settings_with(settings, change.set)
        return settings

    def station(self, config: StationConfig, duration: float) -> StationConfig:
        """Return a station as it is for a time [s] without changes from now on; raises InvalidConfig: a wrong key."""
        settings = _for_robots(self.settings(), config)
        changed = with_settings(config, settings, "changes of the program") if settings else config
        forces = {**changed.forces, **self.forces(duration)}
        return changed.model_copy(update={"forces": forces})

    def check(self, config: StationConfig) -> None:
        """Check that all can happen to a station; raises SimrobError: names the change of what is not there."""
        for number, change in enumerate(self.changes):
            where = f"changes[{number}]"
            if change.drive is not None and change.drive.at is not None:
                one_of(f"robot of {where}.drive", change.drive.at, config.robots)
            if change.set is not None:
                with_settings(config, _for_robots(change.set, config), where)
        if forces := self.forces(self.changes[-1].time + 1.0 if self.changes else 0.0):
            station = resolve(config)
            for name, force in forces.items():
                force.check(f"changes[{name.rpartition('_')[2]}].{force.kind}", station)

    def forces(self, duration: float) -> dict[str, ForceConfig]:
        """Return the pushes and drags that act from now on for a time [s], by name, in a run that begins now."""
        first, last = self.steps(self.now), self.steps(self.now + duration)
        found = dict[str, ForceConfig]()
        for number, change in enumerate(self.changes):
            begin = self.steps(change.time)
            if change.push is not None and begin < last:
                push = change.push
                left = self.time_of(begin - first) + push.duration
                start = max(self.time_of(begin - first), 0.0)
                if left > start:
                    place = {"at": push.at, "force": push.force}
                    found[f"push_{number}"] = Push(kind="push", start=start, duration=left - start, **place)
            if change.drag is not None and begin < last and begin + len(change.drag.targets) > first:
                drag = change.drag
                found[f"drag_{number}"] = Drag(
                    kind="drag",
                    at=drag.at,
                    point=drag.point,
                    start=max(self.time_of(begin - first), 0.0),
                    targets=drag.targets[max(first - begin, 0) :],
                    each=self._step,
                    stiffness=drag.stiffness,
                )
        return found

    def hands(self, config: StationConfig) -> dict[str, Callable[[float], tuple[float, float, float] | None]]:
        """Return who drives the walks of a station in a run that begins now, as ``Runner.run`` takes them by name."""
        if not any(change.drive for change in self.changes):
            return {}
        begun, walks = self.now, [(name, one) for name, one in config.controllers.items() if one.kind == "walk"]
        return {
            name: partial(self._driven, walk.robot or config.only_robot, config.only_robot, begun)
            for name, walk in walks
        }

    def _driven(
        self, robot: str | None, only: str | None, begun: float, time: float
    ) -> tuple[float, float, float] | None:
        """Return how a robot is driven at a time of a run [s]: each command holds from after its moment on."""
        rows = [
            (change.time + since, ahead, left, turn)
            for change in self.changes
            if change.drive is not None and (change.drive.at or only) == robot
            for since, ahead, left, turn in change.drive.commands
        ]
        known = [row for row in rows if row[0] < begun + time - _END]
        return (known[-1][1], known[-1][2], radians(known[-1][3])) if known else None

    @property
    def _step(self) -> float:
        return GRID if self.grid is None else self.grid


@contextmanager
def following(holder: Any, grid: float | None, changes: Sequence[Change], *, strict: bool = False) -> Iterator[None]:
    """Let a station follow the timeline of a program meanwhile, unless it follows one already; and be ``strict``."""
    before, was_strict = holder.timeline, holder.strict
    holder.strict = was_strict or strict
    if before.grid is None:
        holder.timeline = Timeline(grid, changes)
        holder.timeline.check(holder.config)
    try:
        yield
    finally:
        holder.timeline, holder.strict = before, was_strict


def _for_robots(settings: Mapping[str, Any], config: StationConfig) -> dict[str, Any]:
    """Return settings; those of the station's servos are meant for robots with servos of their own, too."""
    found = dict(settings)
    alone = list(config.robots) == [ONLY_ROBOT]
    for robot, entry in config.robots.items():
        section = ONLY_ROBOT if alone else f"robots.{robot}"
        if entry.servo is not None:
            own = {f"{section}.{key}": value for key, value in settings.items() if key.startswith(_SERVO)}
            found = {**own, **found}
    return found


USER = "user"  # who stops a run that its timeline ends
_END = 1e-9  # s


class Timed(Protocol):
    """A station that goes on from its state, along a timeline."""

    config: StationConfig
    state: State | None
    timeline: Timeline

    def runner_of(self, config: StationConfig) -> Runner:
        """Return what runs the station as a configuration of it says."""

    @property
    def on_step(self) -> OnStep | None:
        """What is told of each step of a run."""


def run_timed(cell: Timed, references: Mapping[str, ReferenceLike], duration: float) -> SimulationResult:
    """Run references on a station whose timeline has a grid, from the state that it is in.

    The run ends on the grid, not before ``duration`` [s]. The station's state and time stay as they are. Raises
    SimrobError: a change that cannot be.
    """
    line, runs = cell.timeline, list[SimulationResult]()
    begun, state, left = line.now, cell.state, False
    end = line.whole(line.whole(begun) + duration)
    played: dict[str, Reference] = {}
    since, of_runner = begun, dict[str, Any](run="none yet")

    def tell(moment: Moment) -> bool:
        nonlocal left
        known, now = len(line.changes), line.now
        ended = line.tell(now + moment.time, moment)
        moment.play_forces(line.forces(end - now))
        left = left or ended
        return left or len(line.changes) != known

    try:
        while not runs or (not left and end - line.now > _END):
            part = line.part(end)
            station = line.station(cell.config, part)
            runner = cell.runner_of(station)
            settings = {key: value for key, value in line.settings().items() if "reference" in key.split(".")}
            if settings != of_runner:
                played, since, of_runner = runner.references(references, state), line.now, settings
            rest = {robot: later(reference, line.now - since) for robot, reference in played.items()}
            how: dict[str, Any] = {"ticks": Ticks(line.grid or part, tell), "on_step": cell.on_step}
            run = runner.run(reference=rest, duration=part, start=state, commands=line.hands(station), **how)
            forces = {**run.config.forces, **line.forces(run.stop_time)}  # drags have grown
            runs.append(replace(run, config=run.config.model_copy(update={"forces": forces})))
            line.now = line.time_of(line.steps(line.now + run.stop_time))
            if run.ending == "completed" and left:
                message = f"stopped by the user at {line.now - begun:.6g} s"
                runs[-1] = replace(runs[-1], ending="monitor", stopped_by=USER, message=message)
            if runs[-1].ending != "completed":
                break
            state = run.final_state
    finally:
        line.now = begun
    return runs[0] if len(runs) == 1 else joined(runs)
