"""Changes that happen to a station while a program runs: new settings, pushes, drags, and commands to walks.

The changes of a program are on a timeline, which has a grid: equally spaced moments, at which changes happen. A run is
cut into pieces at each change, and restarts its solver at each moment of the grid. So it can be repeated from any
moment of the grid, with equal results to the last bit.

A *setting* is a key of the station with its value. A *push* is a constant force for a while, a *drag* a spring that
pulls a point of a body after a target. A change *drives* a robot if it gives commands to its walk.
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

from simrob_drake.base.errors import one_of
from simrob_drake.base.messages import message
from simrob_drake.base.sections import (
    Duration,
    Instant,
    NotNegative,
    Number,
    Positive,
    Strict,
    Triple,
)
from simrob_drake.blocks.references import Reference, later
from simrob_drake.parts.controllers.section import commanded_sections
from simrob_drake.parts.forces import Drag, ForceConfig, Push
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult, join_runs
from simrob_drake.simulation import Moment, OnStep, ReferenceLike, Runner, Ticks
from simrob_drake.stations.change_of_kind import settings_with
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import ONLY_ROBOT, with_settings
from simrob_drake.stations.resolve import resolve

GRID = 0.05  # default time between two moments of the grid [s]
_SERVO = "servo."  # prefix of the keys of the servos' settings
_GRID_ROUNDING = 1e-6  # part of a step of the grid that is due to rounding
# Numbers of a command that a change `drive` sets [m/s, m/s, rad/s].
_DRIVE_NUMBERS = ("ahead", "left", "turn")
_TIME_ROUNDING = 1e-9  # times that differ by less are equal [s]

Drive = tuple[float, ...]
"""Command to a controller: for a walk, speeds ahead and to the left [m/s], and turn to the left [rad/s]."""
Driver = Callable[[float], Drive | None]
"""Gives the command to a controller at a time of a run [s]; None if the controller's own section gives it."""


class PushNow(Strict):
    """A constant force for a while; see :class:`~simrob_drake.parts.forces.Push`."""

    at: str | None = None
    """Body that is pushed: a robot, link, tool or piece. If it is not set, the only robot."""
    force: Triple
    """Force along x, y and z of that body [N]."""
    duration: Duration = 0.1
    """Duration of the push [s]."""


class DragNow(Strict):
    """A spring that pulls a point after a target; see :class:`~simrob_drake.parts.forces.Drag`."""

    at: str | None = None
    """Body that is pulled: a robot, link, tool or piece. If it is not set, the only robot."""
    point: Triple = (0.0, 0.0, 0.0)
    """Point of the body that is pulled, in the body's frame [m]."""
    targets: Annotated[tuple[Triple, ...], Field(min_length=1)]
    """Positions in the world to which the point is pulled, one for each step of the program's grid [m]."""
    stiffness: Positive | None = None
    """Stiffness of the spring [N/m]. If it is not set, a spring that is longer by a quarter of a metre pulls with the
    weight of the robot or piece."""


class DriveNow(Strict):
    """Commands to a walk in place of those of its section. They have no effect if no robot walks.

    Other controllers that take commands of ``ahead``, ``left`` or ``turn`` get them as well.
    """

    at: str | None = None
    """Robot that walks. If it is not set, the only robot."""
    commands: Annotated[tuple[tuple[NotNegative, Number, Number, Number], ...], Field(min_length=1)]
    """Commands of four numbers: the time since the change from which the command holds [s], the speeds ahead and to the
    left [m/s], and the turning speed to the left [deg/s]."""


class Change(Strict):
    """A change that happens while a program runs."""

    time: Instant
    """Time of the change since the start of the program [s]. It is rounded to the program's grid."""
    set: Annotated[dict[str, Any], Field(min_length=1)] | None = None
    """Keys of the station and their new values, such as `{servo.kp: 500}`. They hold from the change on."""
    push: PushNow | None = None
    """A push."""
    drag: DragNow | None = None
    """A drag."""
    drive: DriveNow | None = None
    """Commands to a walk."""

    @model_validator(mode="after")
    def _one_thing(self) -> Self:
        """Check that exactly one kind of change is given."""
        kinds = [
            thing for thing in (self.set, self.push, self.drag, self.drive) if thing is not None
        ]
        if len(kinds) != 1:
            raise ValueError(
                message(
                    "programs.one_of_changes",
                    "exactly one of set, push, drag and drive must be set",
                )
            )
        return self

    def entry(self) -> dict[str, Any]:
        """Keys and values of the change in a program's file, without those that equal their defaults."""
        return self.model_dump(mode="json", exclude_defaults=True)


class Timeline:
    """The grid of a station's runs, and the changes at its moments.

    The moments of the grid are numbered from 0, and the time between two of them is a step.

    Attributes:
        grid: time of a step [s]. If it is None, there are no changes, and runs are not cut.
        changes: the changes, in order of time.
        now: time of the station since the timeline began [s].
        tell: callback for each moment while a station runs. It gets the time since the timeline began [s] and the
            station at this moment, and may add changes for this moment. Return True to end the run.
    """

    def __init__(self, grid: float | None = None, changes: Sequence[Change] = ()) -> None:
        """Begin a timeline. If there are changes but no grid, the grid has the default step :data:`GRID`."""
        self.grid = GRID if grid is None and changes else grid
        self.changes = sorted(changes, key=lambda change: change.time)
        self.now = 0.0
        self.tell: Callable[[float, Moment], bool] = lambda time, moment: False

    def steps(self, time: float) -> int:
        """Number of the moment of the grid that is nearest to a time [s]; also the count of steps nearest to it."""
        return int(np.rint(time / self._step))

    def rounded_up(self, duration: float) -> float:
        """Shortest duration [s] of whole steps that is as long as a given one [s], or longer."""
        return self.time_of(int(np.ceil(duration / self._step - _GRID_ROUNDING)))

    def time_of(self, number: int) -> float:
        """Time of the moment of the grid with a number [s]; also the duration of so many steps."""
        # Multiples of a step such as 0.05 have rounding errors, which would show in times of signals.
        return round(number * self._step, 12)

    def time_to_next_change(self, end: float) -> float:
        """Time from now to the next change, or to an end of the run if that is earlier [s].

        Args:
            end: the end of the run, since the timeline began [s].
        """
        # Changes of the present moment have happened already.
        now = self.steps(self.now)
        numbers = [self.steps(change.time) for change in self.changes]
        later_numbers = [number for number in numbers if number > now]
        # Changes are in order of time, so the first later one is the next. There may be none.
        next_number = min([*later_numbers[:1], self.steps(end)])
        return self.time_of(next_number - now)

    def add(self, change: Change) -> int:
        """Insert a change in order of time, after those of the same time; return its index."""
        index = bisect_right(self.changes, change.time, key=lambda other: other.time)
        self.changes.insert(index, change)
        return index

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
        """Configuration of a station for a run that begins now: with the settings that changes have made until now.

        Args:
            config: the station without changes.
            duration: duration of the run [s]. The station gets the pushes and drags that act in this time.

        Raises:
            InvalidConfig: a change sets a wrong key or value.
        """
        settings = _for_robots(self.settings(), config)
        changed = (
            with_settings(
                config, settings, message("programs.changes_of_program", "changes of the program")
            )
            if settings
            else config
        )
        forces = {**changed.forces, **self.forces(duration)}
        return changed.model_copy(update={"forces": forces})

    def check(self, config: StationConfig) -> None:
        """Check that all changes can happen to a station.

        Raises:
            SimrobError: a robot, body or key of a change does not exist, or a value is wrong; names the change.
        """
        for number, change in enumerate(self.changes):
            where = f"changes[{number}]"
            if change.drive is not None and change.drive.at is not None:
                one_of(
                    message("programs.robot_of_drive", "robot of {where}.drive", where=where),
                    change.drive.at,
                    config.robots,
                )
            if change.set is not None:
                # Called for its errors only.
                with_settings(config, _for_robots(change.set, config), where)
        # From now to a time after the last change, every push and drag begins, so that all of them are checked.
        until_all_begin = self.changes[-1].time + 1.0 if self.changes else 0.0
        forces = self.forces(until_all_begin)
        if forces:
            station = resolve(config)
            for name, force in forces.items():
                _, _, number_text = name.rpartition("_")  # the number of the change, see `forces`
                force.check(f"changes[{number_text}].{force.kind}", station)

    def forces(self, duration: float) -> dict[str, ForceConfig]:
        """Pushes and drags that act in a run that begins now, with times since its beginning.

        Of those that have begun earlier, only the rest is returned: a shorter push, and the remaining targets of a
        drag. A force that acts longer than the run is not cut at its end.

        Args:
            duration: duration of the run [s].

        Returns:
            The forces by their names: ``push_`` or ``drag_`` with the index of the change.
        """
        # Numbers of the moments at which the run begins and ends.
        first = self.steps(self.now)
        last = self.steps(self.now + duration)
        forces = dict[str, ForceConfig]()
        for number, change in enumerate(self.changes):
            begin = self.steps(change.time)
            # The change comes at the end of this run or later.
            if begin >= last:
                continue
            # Time since the run began. It is negative for an earlier change, which may still act.
            begin_time = self.time_of(begin - first)
            start = max(begin_time, 0.0)
            if change.push is not None:
                push = change.push
                push_end = begin_time + push.duration
                if push_end > start:
                    forces[f"push_{number}"] = Push(
                        kind="push",
                        start=start,
                        duration=push_end - start,
                        at=push.at,
                        force=push.force,
                    )
            # A drag has one target for each step: it acts for as many steps, from its change on.
            if change.drag is not None and begin + len(change.drag.targets) > first:
                drag = change.drag
                forces[f"drag_{number}"] = Drag(
                    kind="drag",
                    at=drag.at,
                    point=drag.point,
                    start=start,
                    # Without the targets of steps before the run.
                    targets=drag.targets[max(first - begin, 0) :],
                    each=self._step,
                    stiffness=drag.stiffness,
                )
        return forces

    def walk_drivers(self, config: StationConfig) -> dict[str, Driver]:
        """Functions that give the commands of changes to controllers, by the controller's name.

        The controllers are the walks of a station, and others whose commands have no other numbers than ``ahead``,
        ``left`` and ``turn``. The functions are made for a run that begins now, and take the time since then.

        ``Runner.run`` takes them as its commands. There are none if no change drives a robot.

        Args:
            config: the station, for its controllers.
        """
        if not any(change.drive for change in self.changes):
            return {}
        drivers = dict[str, Driver]()
        for name, section in commanded_sections(config.controllers).items():
            numbers = [part.name for part in section.command_parts]
            if set(numbers) <= set(_DRIVE_NUMBERS):
                # A controller that names no robot belongs to the only one.
                robot = section.robot_name or config.only_robot
                drivers[name] = partial(self._drive, robot, config.only_robot, numbers, self.now)
        return drivers

    def _drive(
        self,
        robot: str | None,
        only_robot: str | None,
        numbers: Sequence[str],
        begin: float,
        time: float,
    ) -> Drive | None:
        """Command of the changes to a robot's controller at a time of a run. Each holds for times after its own time.

        Args:
            robot: name of the robot. It is None if the controller names none and the station has several robots.
            only_robot: name of the station's robot if it has one only, which changes need not name; else None.
            numbers: names of the numbers of the controller's command, in order. Others of the change have no effect.
            begin: time at which the run began, since the timeline began [s].
            time: time since the run began [s].

        Returns:
            the last command before this time, with its numbers in the order of `numbers` [m/s or rad/s]; None if there
            is none.
        """
        drive: Drive | None = None
        # Changes are in order of time, and a later one replaces the commands of those before.
        for change in self.changes:
            if change.drive is None or (change.drive.at or only_robot) != robot:
                continue
            for since, ahead, left, turn_deg in change.drive.commands:
                # A command holds from the sample after its time on. Rounding must not decide whether it holds at its
                # own time.
                if change.time + since < begin + time - _TIME_ROUNDING:
                    values = {"ahead": ahead, "left": left, "turn": radians(turn_deg)}
                    drive = tuple(values[number] for number in numbers)
        return drive

    @property
    def _step(self) -> float:
        """Time of a step of the grid [s]."""
        return GRID if self.grid is None else self.grid


@contextmanager
def following(
    holder: Any, grid: float | None, changes: Sequence[Change], *, strict: bool = False
) -> Iterator[None]:
    """Give a station the timeline of a program within a ``with`` block.

    A station that follows a timeline with a grid already keeps it: a program that another program runs has no timeline
    of its own.

    Args:
        holder: the station, with the attributes ``timeline``, ``strict`` and ``config``.
        grid: time of a step of the program's grid [s]; None if the program has none.
        changes: changes of the program.
        strict: whether warnings of a run are errors; a station that is strict already stays so.

    Raises:
        SimrobError: a change cannot happen to the station; the station stays as it is.
    """
    old_timeline = holder.timeline
    was_strict = holder.strict
    new_timeline = old_timeline
    if old_timeline.grid is None:
        new_timeline = Timeline(grid, changes)
        # Checked before the station is changed: an error here leaves it as it is.
        new_timeline.check(holder.config)
    holder.timeline = new_timeline
    holder.strict = was_strict or strict
    try:
        yield
    finally:
        holder.timeline = old_timeline
        holder.strict = was_strict


def _for_robots(settings: Mapping[str, Any], config: StationConfig) -> dict[str, Any]:
    """Extend settings of the station's servos to robots that have servo settings of their own.

    Otherwise these robots would not follow a change such as ``servo.kp``. A setting that names the robot itself
    overrides that of the station.

    Args:
        settings: values of keys of the station, which are also in the result.
        config: the station without these settings.
    """
    extended = dict(settings)
    # A station's file may have `robot:` instead of `robots:`. Then its keys begin with this name.
    has_single_section = list(config.robots) == [ONLY_ROBOT]
    for robot, entry in config.robots.items():
        section = ONLY_ROBOT if has_single_section else f"robots.{robot}"
        if entry.servo is not None:
            own_settings = {
                f"{section}.{key}": value
                for key, value in settings.items()
                if key.startswith(_SERVO)
            }
            extended = {**own_settings, **extended}
    return extended


USER = "user"  # name of the monitor that stops a run which its timeline has ended


class Timed(Protocol):
    """A station whose runs continue from its state, along a timeline."""

    config: StationConfig
    state: State | None
    timeline: Timeline

    def runner_of(self, config: StationConfig) -> Runner:
        """Make the object that runs the station, with a configuration of it."""

    @property
    def on_step(self) -> OnStep | None:
        """Callback for each step of a run, or None."""


def run_timed(
    cell: Timed, references: Mapping[str, ReferenceLike], duration: float
) -> SimulationResult:
    """Run references on a station whose timeline has a grid, from the present state of the station.

    The run is a sequence of runs, each from one change to the next, whose results are joined. The attributes of the
    station are the same afterwards, with its state and the time of its timeline: the caller takes over the final state.
    Only the timeline may have further changes, which its callback `tell` added.

    Args:
        cell: the station.
        references: references of its robots, by name.
        duration: least duration of the run [s]; the run ends at a moment of the grid.

    Returns:
        The result. If the callback of the timeline ended the run, its ending is `monitor`, stopped by :data:`USER`.

    Raises:
        SimrobError: a change is not possible.
    """
    line = cell.timeline
    begin = line.now
    # Begin and end are moments of the grid, so that a later run can continue from there.
    end = line.rounded_up(line.rounded_up(begin) + duration)
    state = cell.state
    runs = list[SimulationResult]()
    is_ended_by_timeline = False
    # The references are made again when their settings change. Then they begin at the time of the change.
    made_references: dict[str, Reference] = {}
    reference_settings: dict[str, Any] | None = None
    reference_begin = begin

    def at_moment(moment: Moment) -> bool:
        """Call the timeline's callback for a moment, and apply the forces. Returns whether the present run is to end.

        It ends if the callback asks for it, or has added a change, for which the loop below starts another run.
        """
        nonlocal is_ended_by_timeline
        change_count = len(line.changes)
        run_begin = line.now
        # `moment.time` is the time since the present run began.
        if line.tell(run_begin + moment.time, moment):
            is_ended_by_timeline = True
        moment.play_forces(line.forces(end - run_begin))  # the callback may have changed them
        return is_ended_by_timeline or len(line.changes) != change_count

    try:
        # Even a duration of 0 needs one run, which gives the result.
        while not runs or (not is_ended_by_timeline and end - line.now > _TIME_ROUNDING):
            part = line.time_to_next_change(end)  # duration of this run [s]
            station = line.station(cell.config, part)
            runner = cell.runner_of(station)
            # The references are made in the first round, and when settings of references have changed, such as
            # `reference.duration`.
            settings = {
                key: value
                for key, value in line.settings().items()
                if "reference" in key.split(".")
            }
            if settings != reference_settings:
                made_references = runner.references(references, state)
                reference_settings = settings
                reference_begin = line.now
            # References go on over a cut: the next run begins in their middle.
            elapsed = line.now - reference_begin
            run = runner.run(
                reference={
                    robot: later(reference, elapsed) for robot, reference in made_references.items()
                },
                duration=part,
                start=state,
                commands=line.walk_drivers(station),
                # The solver restarts, and the function is called, at each moment of the grid.
                ticks=Ticks(line.grid or part, at_moment),
                on_step=cell.on_step,
            )
            # The callback may have added targets to drags during the run.
            forces = {**run.config.forces, **line.forces(run.stop_time)}
            run = replace(run, config=run.config.model_copy(update={"forces": forces}))
            # Back to a moment of the grid exactly: sums of times would drift.
            line.now = line.time_of(line.steps(line.now + run.stop_time))
            if run.ending == "completed" and is_ended_by_timeline:
                text = message(
                    "programs.stopped_by_user",
                    "stopped by the user at {time:.6g} s",
                    time=line.now - begin,
                )
                run = replace(run, ending="monitor", stopped_by=USER, message=text)
            runs.append(run)
            if run.ending != "completed":
                break
            state = run.final_state
    finally:
        line.now = begin
    return runs[0] if len(runs) == 1 else join_runs(_marked_as_cut(runs))


def _marked_as_cut(runs: Sequence[SimulationResult]) -> list[SimulationResult]:
    """Make copies of runs that are marked as parts of one motion.

    Otherwise their verdicts would take the ends and starts between them for the end and the start of the motion, at
    which the robot has to rest.
    """
    last = len(runs) - 1
    return [
        replace(run, is_continued=index < last, continues=index > 0)
        for index, run in enumerate(runs)
    ]
