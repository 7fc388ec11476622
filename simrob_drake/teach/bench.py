"""The station that is taught, in a process of its own: run, shown, asked about."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter, one_of
from simrob_drake.programs.arm import Arm, Workcell
from simrob_drake.programs.program import Program
from simrob_drake.programs.timeline import GRID, USER, Change, PushNow, Timeline
from simrob_drake.programs.whole_program import perform
from simrob_drake.results.animation.drawn import ghosts
from simrob_drake.results.animation.live import StationView
from simrob_drake.results.animation.pictures import save_film_strip
from simrob_drake.results.block_diagram.picture import station_svg
from simrob_drake.results.files import write_table
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.sections import validated
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station
from simrob_drake.teach import arm_questions
from simrob_drake.teach.describe import description
from simrob_drake.teach.messages import Inbox, at_any_time
from simrob_drake.teach.run_pacer import Rewound, RunPacer


@dataclass(frozen=True)
class Checkpoint:
    """Where a station can be gone back to: how it was when something began to be run."""

    time: float
    config: StationConfig
    state: State | None
    run: Callable[[], SimulationResult]


class Bench:
    """A station and what is done with it; the methods are what the pendant asks for, by their names.

    Arguments and results are plain data. Times count from the start of the station [s].
    """

    def __init__(self, inbox: Inbox, serve: Callable[[Bench], object]) -> None:
        """Make a bench without a station, :meth:`open` gives it one.

        News go to the inbox; ``serve`` does what is asked for at a tick.
        """
        self._inbox = inbox
        self._view = StationView(lambda subject, commands: inbox.tell("view", subject=subject, commands=list(commands)))
        self.pacer = RunPacer(inbox, self._view.show, lambda: serve(self))
        self._cell: Workcell | None = None
        self._robot = ""
        self._checkpoints: list[Checkpoint] = []
        self._result: SimulationResult | None = None
        self._fell = False  # the last run came to nothing: the station is where that began

    # Idle

    def open(
        self, station: str, settings: dict[str, Any], robot: str | None = None, *, allow_code: bool = False
    ) -> dict[str, Any]:
        """Take a station, by name or file, with settings, and tell what it is."""
        config = load_station(station, settings, allow_code=allow_code)
        self._cell = cell = Workcell(config)
        self._robot = "" if not config.robots else cell.robot_name(robot or next(iter(config.robots)))
        self._start = config
        cell.watcher = self.pacer.on_step
        self._view.scene = None
        self._outputs, self._bodies = list[str](), list[str]()
        self.restart()
        content = description(cell)
        self._outputs, self._bodies = [signal["name"] for signal in content["signals"]], content["bodies"]
        return content

    def restart(self) -> None:
        """Put the station back to its start."""
        cell = self.cell
        cell.change(self._start)
        cell.state = State.at_start_of(self._start)
        self._checkpoints, self._result, self.pacer.at, self._fell = [], None, None, False
        self.pacer.seen.clear()
        self.pacer.requests.clear()
        self._new_line(GRID)
        self._view.draw(cell.config, cell.state)
        self._inbox.tell("tick", time=0.0, ratio=0.0, phase="idle", values={})

    def play(self, program: str) -> dict[str, Any]:
        """Run a program, in YAML, from the start."""
        checked = Program.of_text(program).model_copy(update={"robot": self._robot or None})
        self.restart()
        self._new_line(checked.grid or GRID, checked.changes)
        self.cell.timeline.check(self.cell.config)
        return self._begin(lambda: perform(self.cell, checked))

    def do(self, moves: Sequence[dict[str, Any]]) -> dict[str, Any]:
        """Run moves, as a program's file has them, from where the station is or what is shown."""
        program = validated(Program, {"moves": list(moves)}, "the moves")
        program = program.model_copy(update={"robot": self._robot or None})
        self._settle()
        return self._begin(lambda: perform(self.cell, program))

    def jog(self, targets_deg: dict[str, float], duration: float | None = None) -> dict[str, Any]:
        """Move the arm's axes from where its reference is; a newer jog takes its place."""
        return self.do([arm_questions.jog(self._arm(), targets_deg, duration)])

    def resume(self) -> dict[str, Any]:
        """Go on from the moment that is shown, as what was run there went on."""
        if self.pacer.at is None:
            raise InvalidParameter("resume", "asked for in the present", "asked for after going back")
        place, time = self._back_to(self.pacer.at)
        return self._begin(place.run, until=time)

    # At any time

    @at_any_time
    def pause(self) -> None:
        """Pause at the next tick."""
        self.pacer.paused = True

    @at_any_time
    def go_on(self) -> dict[str, Any] | None:
        """Go on after a pause, or from the moment that is shown."""
        if self.pacer.at is not None:
            if self._is_running:
                raise Rewound
            return self.resume()
        self.pacer.go_on()
        return None

    @at_any_time
    def one_tick(self) -> None:
        """Go on for one tick, after a pause or from the moment that is shown."""
        if self.pacer.at is not None and self._is_running:
            raise Rewound(one=True)
        self.pacer.go_on(one=True)

    @at_any_time
    def stop(self) -> None:
        """End the run at the next tick."""
        self.pacer.stopping = self._is_running

    @at_any_time
    def pace(self, factor: float | None) -> None:
        """Run so many times as fast as the clock; None: as fast as it can."""
        self.pacer.set_pace(factor)

    @at_any_time
    def rewind(self, time: float) -> None:
        """Show a moment of what was run; what is asked for next goes on from there."""
        number, pacer = self.pacer.line.steps(time), self.pacer
        if number in pacer.seen:
            self._view.show(pacer.seen[number])
        elif number == 0 and self._checkpoints:
            self._view.draw(self._checkpoints[0].config, self._checkpoints[0].state)
        else:
            raise InvalidParameter("time", f"{time:g} s", "a time that was run, not too long ago")
        pacer.at, pacer.paused = number, pacer.paused or self._is_running

    @at_any_time
    def change(self, settings: dict[str, Any]) -> None:
        """Change settings of the running station by their keys, from the next tick on."""
        self._ask(Change(time=0.0, set=settings))

    @at_any_time
    def push(self, force: Sequence[float], at: str | None = None, duration: float = 0.1) -> None:
        """Push with a force [N] for a time [s], from the next tick on."""
        push = validated(PushNow, {"at": at, "force": list(force), "duration": duration}, "the push")
        self._ask(Change(time=0.0, push=push))

    @at_any_time
    def drag(self, at: str, point: Sequence[float], target: Sequence[float] | None) -> None:
        """Pull a point of a body, in its own frame, to a place in the world, or let it go."""
        one_of("body", at, self._bodies)
        if at in self.cell.config.pieces:  # forces on pieces count from their tool centre point
            model = self.cell.model
            point = model.pose(model.piece_frame(at)).inverse() @ model.pose(model.piece_origin(at)) @ np.array(point)
        held = (at, tuple(point), tuple(target)) if target is not None else None
        self.pacer.drag = held if self._is_running else None

    @at_any_time
    def watch(self, signals: Sequence[str]) -> None:
        """Tell the values of these outputs of the station at each tick."""
        self.pacer.watched = [one_of("signal", name, self._outputs) for name in signals]

    # Questions

    @at_any_time
    def posture(self, robot: str | None = None) -> dict[str, float]:
        """Tell where a robot's axes are [deg or m]."""
        name = robot or self._robot
        own = self.cell.robot(name)
        return dict(zip(own.axes, (self.cell.position(name) / own.model.user_units).tolist(), strict=True))

    @at_any_time
    def where(self, frame: str = arm_questions.BASE) -> dict[str, Any]:
        """Tell where the arm is, its tool in a frame, and what is around it."""
        return arm_questions.where(self._arm(), frame)

    @at_any_time
    def jogged(
        self, delta: Sequence[float], frame: str = arm_questions.BASE, start: Sequence[float] | None = None
    ) -> dict[str, float]:
        """Tell the axes for a pose that lies by ``delta`` [m, deg] along the axes of a frame."""
        arm = self._arm()
        return arm_questions.inverse(arm, arm_questions.jogged(arm, delta, frame, start))

    @at_any_time
    def inverse(self, pose: Sequence[float], frame: str = arm_questions.BASE) -> dict[str, float]:
        """Tell the axes for a pose of the tool."""
        return arm_questions.inverse(self._arm(), pose, frame)

    @at_any_time
    def branches(
        self, pose: Sequence[float] | None = None, frame: str = arm_questions.BASE, tool: str = ""
    ) -> list[dict[str, Any]]:
        """Tell all postures that reach a pose, that of the tool unless given, and what each means."""
        return arm_questions.branches(self._arm(), pose, frame, tool)

    @at_any_time
    def ghosts(self, postures: Sequence[dict[str, float]], good: Sequence[bool], marked: int | None = None) -> None:
        """Show the arm translucent at postures [deg or m]; none takes all away."""
        own = self.cell.robot(self._robot)
        at = [np.array([posture[axis] for axis in own.axes]) * own.model.user_units for posture in postures]
        if self._view.scene is not None:
            commands = ghosts(self._view.scene, self._robot, at, good, marked)
            self._inbox.tell("view", subject="ghosts", commands=commands)

    @at_any_time
    def check(self) -> list[dict[str, str]]:
        """Tell what `simrob check` says of the station."""
        return [{"level": one.level, "subject": one.subject, "text": one.text} for one in check_station(self._start)]

    @at_any_time
    def picture(self) -> str:
        """Return the block picture as SVG."""
        return station_svg(self._start)

    # What was run

    @at_any_time
    def signals_csv(self, file: str) -> str:
        """Write the signals of the last run."""
        result = self._last_run()
        write_table(Path(file), result.names, result.times, result.values)
        return file

    @at_any_time
    def recording(self, file: str) -> str:
        """Write the last run as a page that plays."""
        return str(self._last_run().film(file))

    @at_any_time
    def film_strip(self, file: str) -> str:
        """Draw the last run as a strip of pictures."""
        return str(save_film_strip(self._last_run(), Path(file)))

    # How

    @property
    def cell(self) -> Workcell:
        """The station.

        Raises:
            InvalidParameter: nothing was opened.
        """
        if self._cell is None:
            raise InvalidParameter("station", "not opened", "one that was opened")
        return self._cell

    @property
    def _is_running(self) -> bool:
        return self.pacer.runs

    def _last_run(self) -> SimulationResult:
        if self._result is None:
            raise InvalidParameter("the last run", "none yet", "one: simulate() runs what is stored")
        return self._result

    def _arm(self) -> Arm:
        return self.cell.arm(self._robot or None)

    def _ask(self, change: Change) -> None:
        if not self._is_running:
            raise InvalidParameter("change", "asked for while nothing runs", "asked for while something does")
        Timeline(GRID, [change]).check(self.cell.config)
        self.pacer.requests.append(change)

    def _begin(self, doing: Callable[[], SimulationResult], *, until: float = 0.0) -> dict[str, Any]:
        """Run something from where the station is, and again whenever it is gone back to and on from there."""
        cell, line = self.cell, self.cell.timeline
        self._checkpoints.append(Checkpoint(line.now, cell.config, cell.state, doing))
        one = False
        while True:
            begun = line.now
            self.pacer.begin(line, until=until, one=one)
            try:
                with warnings.catch_warnings():
                    warnings.showwarning = lambda message, *_, **__: self._inbox.tell("warned", text=str(message))
                    result = doing()
                break
            except Rewound as asked:
                assert self.pacer.at is not None
                one = asked.one
                place, until = self._back_to(self.pacer.at)
                doing = place.run
                self._checkpoints.append(place)
            finally:
                self.pacer.end()
        self._result, self._fell = result, line.now <= begun
        self.pacer.keep_last()
        if self.pacer.at is None:
            self.pacer.show_last()
        ending = "stopped" if result.stopped_by == USER else result.ending
        outcome = {"ending": ending, "message": result.message, "stopped_by": result.stopped_by}
        judged = {"verdict": str(result.verdict), "warnings": result.warnings}
        ended = {**outcome, **judged, "goes_on": not self._fell, "time": line.now}
        ended["reached"] = max(line.now, round(self.pacer.now, 9))
        self._inbox.tell("ended", **ended)
        self.pacer.phase("idle")
        return ended

    def _back_to(self, number: int) -> tuple[Checkpoint, float]:
        """Put the station back to where something began that was run at a moment, or ended with it.

        Returns:
            that place, which is none to go back to any more, and until when it is to be run again; 0 if the station is
            at the moment.
        """
        steps, pacer = self.pacer.line.steps, self.pacer
        exact = [place for place in self._checkpoints if steps(place.time) == number]
        self._checkpoints = [place for place in self._checkpoints if steps(place.time) < number]
        place = exact[0] if exact else self._checkpoints.pop()
        cell = self.cell
        cell.change(place.config)
        cell.state, cell.timeline.now, pacer.at = place.state, place.time, None
        pacer.forget_after(number)
        return place, 0.0 if exact else pacer.line.time_of(number)

    def _settle(self) -> None:
        """Be at the moment that is shown, or before what came to nothing, and forget what came after that."""
        line, at = self.cell.timeline, self.pacer.at
        if at is None and not self._fell:
            return
        place, until = self._back_to(line.steps(line.now) if at is None else at)
        if until:
            self._checkpoints.append(place)
            self.pacer.begin(line, until=until, stops=True)
            try:
                place.run()
            finally:
                self.pacer.end()
        self._fell = False
        line.changes[:] = [change for change in line.changes if line.steps(change.time) < line.steps(line.now)]

    def _new_line(self, grid: float, changes: Sequence[Change] = ()) -> None:
        self.cell.timeline = self.pacer.line = Timeline(grid, changes)
