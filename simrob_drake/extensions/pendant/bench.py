"""The station that is taught, in a process of its own: run, shown, asked about."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from contextvars import copy_context
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, TextIO

import numpy as np

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import (
    SOURCE_LANGUAGE,
    compound,
    message,
    message_of,
    set_output_language,
)
from simrob_drake.base.sections import validate_section
from simrob_drake.extensions.pendant import arm_questions
from simrob_drake.extensions.pendant.describe import description
from simrob_drake.extensions.pendant.handles import NO_HANDLES, handles, reached
from simrob_drake.extensions.pendant.run_pacer import Inbox, Rewound, RunPacer
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.program import Program
from simrob_drake.programs.timeline import GRID, USER, Change, DriveNow, PushNow, Timeline
from simrob_drake.programs.whole_program import perform
from simrob_drake.results.animation.camera import PANE_ASPECT
from simrob_drake.results.animation.drawn import Command, compared_ghost, ghosts
from simrob_drake.results.animation.live import StationView
from simrob_drake.results.animation.pictures import save_film_strip
from simrob_drake.results.block_diagram.picture import loop_svg, station_svg
from simrob_drake.results.files import write_table
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station
from simrob_drake.stations.resolve import resolve


class Checkpoint(NamedTuple):
    """State of the station when a program was begun, to which it can be put back.

    Attributes:
        time: when the program began, since the start of the station [s].
        config: the station then.
        state: its state then.
        program: the program that was begun.
    """

    time: float
    config: StationConfig
    state: State | None
    program: Program


_ROWS = 2400  # of a run that are told when it has ended
ALONE = ("open", "restart", "play", "do", "jog", "resume")
"""What ends a run where it is asked for; all else is answered between two ticks."""


class Bench:
    """A station and what is done with it; the methods are what the pendant asks for, by their names.

    Arguments and results are plain data. Times count from the start of the station [s].
    """

    def __init__(self, inbox: Inbox, serve: Callable[[Bench], object]) -> None:
        """Make a bench without a station, :meth:`open` gives it one.

        News go to the inbox; ``serve`` does what is asked for at a tick.
        """
        self._inbox = inbox
        self._view = StationView(self._tell_view, PANE_ASPECT)
        self.pacer = RunPacer(inbox, self._view.show, lambda: serve(self))
        self._cell: Workcell | None = None
        self._columns = dict[str, list[str]]()  # columns of the station's outputs, by their names
        self._former_signals = set[str]()  # names of the outputs of all stations that were open
        self._requested_signals: list[str] = []
        self._robot = ""
        self._checkpoints: list[Checkpoint] = []
        self._result: SimulationResult | None = None
        self._fell = False  # the last run came to nothing: the station is where that began

    # Idle

    def open(
        self,
        station: str,
        settings: dict[str, Any],
        robot: str | None = None,
        *,
        allow_code: bool = False,
    ) -> dict[str, Any]:
        """Take a station, by name or file, with settings, and tell what it is."""
        config = load_station(station, settings, allow_code=allow_code)
        # those of the station before are not where the new ones will be
        self._tell_view("handles", [NO_HANDLES])
        self._cell = cell = Workcell(config)
        self._robot = (
            "" if not config.robots else cell.robot_name(robot or next(iter(config.robots)))
        )
        self._start = config
        cell.watcher = self.pacer.on_step
        self._view.scene = None
        self._former_signals |= self._columns.keys()
        self._columns = {}
        self._bodies = list[str]()
        self.restart()
        content = description(cell)
        self._columns = {signal["name"]: signal["columns"] for signal in content["signals"]}
        self._watch_known_signals()
        self._bodies = content["bodies"]
        return content

    def restart(self) -> None:
        """Put the station back to its start."""
        cell = self.cell
        cell.change(self._start)
        cell.state = State.at_start_of(self._start)
        self._checkpoints, self._result, self.pacer.at, self._fell = [], None, None, False
        self.pacer.requests.clear()
        self._new_line(GRID)
        positions = self._view.draw(cell.config, cell.state)
        self._inbox.tell("tick", time=0.0, ratio=0.0, positions=positions, values={})

    def play(self, program: str) -> dict[str, Any]:
        """Run a program, in YAML, from the start."""
        checked = Program.of_text(program).model_copy(update={"robot": self._robot or None})
        self.restart()
        self._new_line(checked.grid or GRID, checked.changes)
        self.cell.timeline.check(self.cell.config)
        return self._begin(checked)

    def do(self, moves: Sequence[dict[str, Any]]) -> dict[str, Any]:
        """Run moves, as a program's file has them, from where the station is or what is shown."""
        program = validate_section(
            Program, {"moves": list(moves)}, message("pendant.the_moves", "the moves")
        )
        program = program.model_copy(update={"robot": self._robot or None})
        self._settle()
        return self._begin(program)

    def jog(self, targets_deg: dict[str, float], duration: float | None = None) -> dict[str, Any]:
        """Move the arm's axes from where its reference is; a newer jog takes its place."""
        return self.do([self.find("jog_move")(targets_deg, duration)])

    def resume(self) -> dict[str, Any]:
        """Go on from the moment that is shown, as what was run there went on."""
        if self.pacer.at is None:
            raise InvalidParameter(
                "resume",
                message("pendant.asked_in_present", "asked for in the present"),
                message("pendant.asked_after_going_back", "asked for after going back"),
            )
        place, time = self._back_to(self.pacer.at)
        return self._begin(place.program, until=time)

    # At any time

    def pause(self) -> None:
        """Pause at the next tick."""
        self.pacer.paused = True

    def go_on(self) -> dict[str, Any] | None:
        """Go on after a pause, or from the moment that is shown."""
        if self.pacer.at is not None:
            if self.pacer.runs:
                raise Rewound
            return self.resume()
        self.pacer.go_on()
        return None

    def one_tick(self) -> None:
        """Go on for one tick, after a pause or from the moment that is shown."""
        if self.pacer.at is not None and self.pacer.runs:
            raise Rewound(one=True)
        self.pacer.go_on(one=True)

    def stop(self) -> None:
        """End the run at the next tick."""
        self.pacer.stopping = self.pacer.runs

    def pace(self, factor: float | None) -> None:
        """Run so many times as fast as the clock; None: as fast as it can."""
        self.pacer.set_pace(factor)

    def rewind(self, time: float, positions: Vector | None = None) -> bool:
        """Show a moment [s] by the positions of the plant then, or where something began at it; pause what runs.

        Returns:
            whether what is asked for next goes on from there: it was run here.
        """
        pacer, steps = self.pacer, self.pacer.line.steps
        number = steps(time)
        before = [
            place for place in self._checkpoints if steps(place.time) <= number <= steps(pacer.now)
        ]
        if positions is not None:
            self._view.show(positions)
        elif not before:
            raise InvalidParameter(
                "time",
                compound("{time:g} s", time=time),
                message("pendant.time_that_was_run", "a time that was run, not too long ago"),
            )
        elif steps(before[-1].time) == number:
            self._view.draw(before[-1].config, before[-1].state)
        if before:
            pacer.at, pacer.paused = number, pacer.paused or pacer.runs
        return bool(before)

    def look(self, positions: Vector | None) -> None:
        """Show positions of the plant, of a run that is over; the station stays where it is."""
        if positions is None or not self._fits(positions):
            raise InvalidParameter(
                "run",
                message("pendant.moment_not_kept", "a moment that is not kept"),
                message("pendant.moment_of_station", "one of the station as it is now"),
            )
        self._view.show(positions)

    def compare(self, positions: Vector | None) -> None:
        """Show, as a ghost, all that moves at positions of the plant in a run that is over; None takes it away."""
        if self._view.scene is not None:
            shown = positions if positions is not None and self._fits(positions) else None
            self._tell_view("compared", compared_ghost(self._view.scene, shown))

    def change(self, settings: dict[str, Any]) -> None:
        """Change settings of the running station by their keys, from the next tick on."""
        self._ask(Change(time=0.0, set=settings))

    def push(self, force: Sequence[float], at: str | None = None, duration: float = 0.1) -> None:
        """Push with a force [N] for a time [s], from the next tick on."""
        push = validate_section(
            PushNow,
            {"at": at, "force": list(force), "duration": duration},
            message("pendant.the_push", "the push"),
        )
        self._ask(Change(time=0.0, push=push))

    def drag(self, at: str, point: Sequence[float], target: Sequence[float] | None) -> None:
        """Pull a point of a body, in its own frame, to a place in the world, or let it go."""
        one_of(message("pendant.body", "body"), at, self._bodies)
        if at in self.cell.config.pieces:  # forces on pieces count from their tool centre point
            model = self.cell.model
            point = (
                model.pose(model.piece_frame(at)).inverse()
                @ model.pose(model.piece_origin(at))
                @ np.array(point)
            )
        held = (at, tuple(point), tuple(target)) if target is not None else None
        self.pacer.drag = held if self.pacer.runs else None

    def steer(
        self, ahead: float, sideways: float, turn_deg: float, robot: str | None = None
    ) -> None:
        """Drive a walk from the next tick on: ahead, to the left [m/s], turn to the left [deg/s].

        Nothing goes on that is not said again within a second on the clock.
        """
        command = DriveNow(at=robot, commands=((0.0, ahead, sideways, turn_deg),)).commands[0][1:]
        self.pacer.steered = (perf_counter(), command, robot) if self.pacer.runs else None

    def watch(self, signals: Sequence[str]) -> None:
        """Report the values of these outputs of the station at each tick.

        Outputs that only a former station had are left out: plots may still show those of a loop that was switched off.
        They come back with the loop.

        Raises:
            UnknownName: no station that was open has such an output; proposes the nearest name.
        """
        known = self._former_signals | self._columns.keys()
        self._requested_signals = [
            one_of(message("pendant.signal", "signal"), name, known) for name in signals
        ]
        self._watch_known_signals()

    def _watch_known_signals(self) -> None:
        """Watch those requested signals that the present station has."""
        self.pacer.watched = [name for name in self._requested_signals if name in self._columns]

    # Questions

    def posture(self, robot: str | None = None) -> dict[str, float]:
        """Tell where a robot's axes are [deg or m]."""
        name = robot or self._robot
        own = self.cell.robot(name)
        return dict(
            zip(own.axes, (self.cell.position(name) / own.model.user_units).tolist(), strict=True)
        )

    def torque_limits(self, robot: str | None = None) -> list[float]:
        """Return the torque limits of a robot's servos [N·m or N], one each axis, with what was changed since.

        Args:
            robot: name of the robot; the taught one unless given.
        """
        cell, name = self.cell, robot or self._robot
        changed = cell.timeline.settings()
        now = (
            resolve(cell.timeline.station(cell.config, GRID)).robots[name]
            if changed
            else cell.robot(name)
        )
        limits: list[float] = now.gains.torque_limit.tolist()
        return limits

    def ghosts(
        self, postures: Sequence[dict[str, float]], good: Sequence[bool], marked: int | None = None
    ) -> None:
        """Show the robot translucent, some axes at [deg or m], the others where they are; no posture: none is shown."""
        own, now = self.cell.robot(self._robot), self.posture()
        at = [
            np.array([*{**now, **posture}.values()]) * own.model.user_units for posture in postures
        ]
        if self._view.scene is not None:
            self._tell_view("ghosts", ghosts(self._view.scene, self._robot, at, good, marked))

    def handles(self, targets: dict[str, dict[str, Any]], near: dict[str, float]) -> None:
        """Tell the view what can be taken by hand, with some axes elsewhere [deg or m]."""
        self._tell_view(
            "handles", [{"type": "handles", **handles(self.cell, self._robot, targets, near)}]
        )

    def reach(
        self, limb: str, pose: Sequence[float], near: dict[str, float], *, turned: bool
    ) -> dict[str, float]:
        """Tell the axes that bring the end of a limb to a pose; see :func:`.handles.reached`."""
        return reached(self.cell, self._robot, limb, pose, near, turned=turned)

    def check(self) -> list[dict[str, str]]:
        """Tell what `simrob check` says of the station."""
        return [
            {"level": one.level, "subject": one.subject, "text": one.text}
            for one in check_station(self._start)
        ]

    def picture(self, folded: Sequence[str] = (), language: str = SOURCE_LANGUAGE) -> str:
        """Draw the block picture as SVG, in a language, with the subsystems of some blocks folded."""
        return _in_output_language(
            language, lambda: station_svg(self._start, live=True, folded=folded)
        )

    def loop_picture(
        self,
        station: str,
        settings: dict[str, Any],
        name: str,
        *,
        allow_code: bool = False,
        language: str = SOURCE_LANGUAGE,
    ) -> str:
        """Draw what a loop reads and moves, as SVG in a language, in a station with settings that have the loop."""
        config = load_station(station, settings, allow_code=allow_code)
        return _in_output_language(language, lambda: loop_svg(config, name))

    def save(self, what: str, file: str) -> str:
        """Write the last run: its ``signals``, a ``page`` that plays, or a ``strip`` of pictures."""
        if self._result is None:
            raise InvalidParameter(
                message("pendant.last_run", "the last run"),
                message("pendant.none_yet", "none yet"),
                message("pendant.run_what_is_stored", "one: simulate() runs what is stored"),
            )
        if what == "signals":
            write_table(Path(file), self._result.names, self._result.times, self._result.values)
            return file
        return str(
            self._result.film(file) if what == "page" else save_film_strip(self._result, Path(file))
        )

    # How

    @property
    def cell(self) -> Workcell:
        """The station; raises InvalidParameter: nothing was opened."""
        if self._cell is None:
            raise InvalidParameter(
                "station",
                message("pendant.not_opened", "not opened"),
                message("pendant.one_that_was_opened", "one that was opened"),
            )
        return self._cell

    def find(self, method: str) -> Callable[..., Any]:
        """Return what does what is asked for: a method of this, or what answers a question about its arm."""
        if hasattr(self, method):
            found: Callable[..., Any] = getattr(self, method)
            return found
        return partial(getattr(arm_questions, method), self.cell.arm(self._robot or None))

    def _tell_view(self, subject: str, commands: Sequence[Command]) -> None:
        self._inbox.tell("view", subject=subject, commands=list(commands))

    def _tell_warning(
        self,
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        """Tell the page of a warning. The arguments are those of :func:`warnings.showwarning`, which it replaces."""
        del category, filename, lineno, file, line
        text = message_of(message) if isinstance(message, Warning) else message
        self._inbox.tell("warned", text=text)

    def _fits(self, positions: Vector) -> bool:
        """Tell whether positions are of this plant: what stands in the station may have been changed since."""
        scene = self._view.scene
        return scene is not None and len(positions) == scene.plant.num_positions()

    def _ask(self, change: Change) -> None:
        if not self.pacer.runs:
            raise InvalidParameter(
                "change",
                message("pendant.asked_while_nothing_runs", "asked for while nothing runs"),
                message("pendant.asked_while_something_runs", "asked for while something does"),
            )
        Timeline(GRID, [change]).check(self.cell.config)
        self.pacer.requests.append(change)

    def _begin(self, program: Program, *, until: float = 0.0) -> dict[str, Any]:
        """Run a program from where the station is, and again whenever it is gone back to and on from there.

        Args:
            program: the program.
            until: up to when the run is the same as one that was shown before [s].

        Returns:
            how the run ended, as the page is told of it.
        """
        cell, line = self.cell, self.cell.timeline
        self._checkpoints.append(Checkpoint(line.now, cell.config, cell.state, program))
        one = False
        while True:
            begun = line.now
            self.pacer.begin(line, until=until, one=one)
            try:
                with warnings.catch_warnings():
                    warnings.showwarning = self._tell_warning
                    result = perform(cell, program)
                break
            except Rewound as asked:
                assert self.pacer.at is not None
                one = asked.one
                place, until = self._back_to(self.pacer.at)
                program = place.program
                self._checkpoints.append(place)
            finally:
                self.pacer.end()
        end = begun + float(result.times[-1])
        if (
            result.ending == "monitor" and end < self.pacer.now
        ):  # which was seen at the end of a step
            self.pacer.cut(end, result.positions_at(result.times[-1:])[0])
        self._result, self._fell = result, line.now <= begun
        self.pacer.show_last()
        ended = {
            "ending": "stopped" if result.stopped_by == USER else result.ending,
            "message": result.end_in_words,
            "stopped_by": result.stopped_by,
            "remarks": result.remarks,
            "criteria": result.verdict.table,
            "goes_on": not self._fell,
            "begun": begun,
            "time": line.now,
            "reached": max(line.now, round(self.pacer.now, 9)),
            "moves": _moves_of(program, result, begun),
        }
        signals = self._signals(result, begun)
        self._inbox.tell("ended", **ended, positions=self.pacer.last, signals=signals)
        self.pacer.phase("idle")
        return ended

    def _signals(self, result: SimulationResult, begun: float) -> dict[str, tuple[Vector, Vector]]:
        """Return of each signal of a run its times [s], shape (m,), and its values, shape (m, n), m bounded."""
        rows = (
            np.linspace(0, len(result.times) - 1, min(len(result.times), _ROWS)).round().astype(int)
        )
        times, places = (
            begun + result.times[rows],
            {name: place for place, name in enumerate(result.names)},
        )
        return {
            signal: (
                times,
                result.values[rows][:, [places[name] for name in columns]].astype(np.float32),
            )
            for signal, columns in self._columns.items()
            if places.keys() >= set(columns)
        }

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
        if place.config is not cell.config:
            cell.change(place.config)
        cell.state, cell.timeline.now, pacer.at = place.state, place.time, None
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
                perform(self.cell, place.program)
            finally:
                self.pacer.end()
        self._fell = False
        line.changes[:] = [
            change for change in line.changes if line.steps(change.time) < line.steps(line.now)
        ]

    def _new_line(self, grid: float, changes: Sequence[Change] = ()) -> None:
        self.cell.timeline = self.pacer.line = Timeline(grid, changes)


def _in_output_language(language: str, draw: Callable[[], str]) -> str:
    """Draw a picture in a language. The output of this process stays in its own language.

    Args:
        language: code of the language, such as ``es``.
        draw: draws the picture.
    """
    context = copy_context()
    context.run(set_output_language, language)
    return context.run(draw)


def _moves_of(program: Program, result: SimulationResult, begun: float) -> list[dict[str, Any]]:
    """List the moves of a program that were begun in a run: each ``{entry, begin, end}``.

    Args:
        program: the program.
        result: its run, which knows when each move began and ended.
        begun: when the run began, since the start of the station [s]. So do the times of the list count.
    """
    return [
        {
            "entry": program.moves[span.index].entry(),
            "begin": begun + span.begin,
            "end": begun + span.end,
        }
        for span in result.move_spans
    ]
