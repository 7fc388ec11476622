"""The pace of a run that somebody watches: it is shown, waits for the clock or for the user, and takes changes.

What is asked for and told goes through a pipe to the pendant's process, as plain data.
"""

from collections.abc import Callable
from multiprocessing.connection import Connection
from time import perf_counter
from typing import Any

import numpy as np

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.programs.timeline import Change, DragNow, DriveNow, Timeline
from simrob_drake.simulation import Moment

_FRAME = 1 / 25  # time on the clock from one picture to the next [s]
PATIENCE = 1.0  # how long a walk goes on without a word of who drives it [s] on the clock


News = dict[str, Any]


class RunLost(SimrobError):
    """What was asked for will not be answered: the process that runs the station has ended."""

    def __init__(self) -> None:
        """Say so."""
        super().__init__(
            message("pendant.process_has_ended", "the process that runs the station has ended")
        )


class Inbox:
    """What was asked for and not answered yet, in its order: a number, a method and its arguments."""

    def __init__(self, pipe: Connection) -> None:
        """Read from a pipe; EOFError there means that the other process is gone, and ends this one."""
        self._pipe = pipe
        self._waiting: list[tuple[int, str, dict[str, Any]]] = []

    def wait(self, timeout: float | None) -> None:
        """Wait for a message, at most so long [s]; for ever if None."""
        if self._pipe.poll(timeout):
            self._waiting.append(self._pipe.recv())

    def take(self) -> list[tuple[int, str, dict[str, Any]]]:
        """Return all that has come, and forget it."""
        while self._pipe.poll(0):
            self._waiting.append(self._pipe.recv())
        taken, self._waiting = self._waiting, []
        return taken

    def put_back(self, message: tuple[int, str, dict[str, Any]]) -> None:
        """Leave a message for later."""
        self._waiting.append(message)

    def answer(self, number: int, result: Any = None, wrong: str | None = None) -> None:
        """Answer what was asked for under a number: by a result, or by what is wrong in words."""
        self._pipe.send({"answer": number, "result": result, "wrong": wrong})

    def tell(self, news: str, **more: Any) -> None:
        """Tell news."""
        self._pipe.send({"news": news, **more})


class Rewound(BaseException):
    """Ends a run that is to be begun anew, perhaps for ``one`` tick; no Exception, for it is no failure of the run."""

    def __init__(self, *, one: bool = False) -> None:
        """End a run."""
        super().__init__()
        self.one = one


class RunPacer:
    """Takes a run through the ticks of its timeline.

    Attributes:
        line: the timeline.
        factor: how many times as fast as the clock; None: as fast as it can.
        paused: whether it waits for the user.
        runs: whether a run is on its way.
        stopping: whether it is to end at the next tick.
        steered: how a walk is driven: when that was said last, on the clock [s], speeds ahead and to the left [m/s],
            turn to the left [deg/s], and which robot's if there are several; None: nobody drives.
        until: up to when it runs as fast as it can without being shown, since all that was shown before [s].
        at: the number of an earlier moment that is shown; None: the present.
        now: up to when the last run came [s], also one that came to nothing.
    """

    def __init__(
        self, inbox: Inbox, show: Callable[[Vector], object], serve: Callable[[], object]
    ) -> None:
        """Conduct runs.

        ``show`` shows positions of the whole plant, ``serve`` does what was asked for and can be done at a tick.
        """
        self._inbox, self._show, self._serve = inbox, show, serve
        self.line = Timeline()
        self.factor: float | None = 1.0
        self.watched: list[str] = []
        self.at: int | None = None
        self.drag: tuple[str, tuple[float, ...], tuple[float, ...]] | None = None
        self.steered: tuple[float, tuple[float, float, float], str | None] | None = None
        self.requests: list[Change] = []
        self.runs = self.paused = self.stopping = self._one = False
        self.until = 0.0
        self._dragging: int | None = None
        self._driving: int | None = None
        self._shown = 0.0
        self._phase, self._stops_there, self.now = "idle", False, 0.0
        self._last: tuple[float, Vector] | None = None
        self._origin()

    def begin(
        self, line: Timeline, *, until: float = 0.0, stops: bool = False, one: bool = False
    ) -> None:
        """Prepare for a run along a timeline, of which all ``until`` a time [s] was shown before.

        It ends there if it ``stops``; with ``one`` it pauses at the first tick that was not shown before.
        """
        self.line, line.tell = line, self.at_tick
        self.until, self._stops_there = until, stops
        self.paused, self.stopping, self._one, self.runs = False, False, one, True
        self._dragging = self._driving = self.at = self.steered = None
        self.requests.clear()
        self.now, self._last = line.now, None
        self._origin()
        self.phase("running")

    def phase(self, phase: str) -> None:
        """Tell a phase that is new."""
        if phase != self._phase:
            self._phase = phase
            self._inbox.tell("phase", phase=phase)

    def go_on(self, *, one: bool = False) -> None:
        """Go on after a pause; ``one`` tick only."""
        self.paused, self._one = False, one
        self._origin()

    def set_pace(self, factor: float | None) -> None:
        """Run at another pace from now on."""
        self.factor = factor
        self._origin()

    def on_step(self, time: float, positions: Vector) -> None:
        """Show the motion of a step in even pictures, each at its time on the clock."""
        now = self.line.now + time
        last, self._last, self.now = self._last, (now, positions.copy()), now
        if now < self.until or last is None or last[0] >= now:
            return
        while self._next <= now:
            part = (self._next - last[0]) / (now - last[0])
            self._wait_for(self._next)
            if perf_counter() - self._shown >= _FRAME / 2 and part >= 0:
                self._show(last[1] + part * (positions - last[1]))
                self._shown = perf_counter()
            self._next += _FRAME * (self.factor or 1.0)

    def at_tick(self, time: float, moment: Moment) -> bool:
        """Tell of a tick and take what was asked for; True ends the run."""
        number = self.line.steps(time)
        if time < self.until - 1e-9:
            return False
        if self.until:
            self.until = 0.0
            self._origin()
            self.stopping = self._stops_there
        else:
            self.paused, self._one = self.paused or self._one, False
        self._tell_tick(time, moment)
        self._serve()
        while self.paused and not self.stopping:
            self.phase("paused")
            self.show_last()
            self._inbox.wait(None)
            self._serve()
            self._origin()
        if self.stopping:
            return True
        self.phase("running")
        self._take_changes(number)
        return False

    def _tell_tick(self, time: float, moment: Moment) -> None:
        elapsed = perf_counter() - self._began
        ratio = (time - self._zero) / elapsed if elapsed > 0 else 0.0
        values = {name: np.atleast_1d(moment.value(name)).tolist() for name in self.watched}
        self._inbox.tell("tick", time=time, ratio=ratio, positions=self.last, values=values)

    def _take_changes(self, number: int) -> None:
        time, changes = self.line.time_of(number), self.line.changes
        for change in self.requests:
            place = self.line.add(change.model_copy(update={"time": time}))
            self._inbox.tell("noted", change=changes[place].entry())
        self.requests.clear()
        self._take_command(time)
        if self.drag is None:
            self._end_drag()
            return
        at, point, target = self.drag
        if self._dragging is None:
            unchecked: dict[str, Any] = {"at": at, "point": point, "targets": (target,)}
            self._dragging = self.line.add(Change(time=time, drag=DragNow(**unchecked)))
        else:
            old = changes[self._dragging]
            assert old.drag is not None
            drag = old.drag.model_copy(update={"targets": (*old.drag.targets, target)})
            changes[self._dragging] = old.model_copy(update={"drag": drag})

    def _take_command(self, time: float) -> None:
        """Let the walk go as it is steered, and stand where nobody has said so for a while: a hand holds on."""
        if self.steered is None:
            return
        said, command, robot = self.steered
        command = command if perf_counter() - said < PATIENCE else (0.0, 0.0, 0.0)
        changes = self.line.changes
        if self._driving is None:
            self._driving = self.line.add(
                Change(time=time, drive=DriveNow(at=robot, commands=((0.0, *command),)))
            )
            return
        old = changes[self._driving]
        assert old.drive is not None
        known = old.drive.commands
        if known[-1][1:] != command:
            row = round(time - old.time, 9), *command
            changes[self._driving] = old.model_copy(
                update={"drive": old.drive.model_copy(update={"commands": (*known, row)})}
            )

    def show_last(self) -> None:
        """Show the last that was run, unless an earlier moment is; it may have come too quickly to be seen."""
        if self._last is not None and self.at is None:
            self._show(self._last[1])

    def cut(self, time: float, positions: Vector) -> None:
        """Count nothing as run after a time [s], when the plant was at these positions."""
        self.now, self._last = time, (time, positions)

    @property
    def last(self) -> Vector | None:
        """Positions of the plant where the last run ended, which may be between two ticks; None if there are none."""
        return None if self._last is None or not np.isfinite(self._last[1]).all() else self._last[1]

    def end(self) -> None:
        """Take note of the end of a run."""
        self._end_drag()
        self._note(self._driving)
        self.drag, self.until, self.runs = None, 0.0, False
        self.steered = self._driving = None

    def _end_drag(self) -> None:
        self._note(self._dragging)
        self._dragging = None

    def _note(self, place: int | None) -> None:
        if place is not None:
            self._inbox.tell("noted", change=self.line.changes[place].entry())

    def _origin(self) -> None:
        """Count clock and simulated time anew from here."""
        self._zero = self._next = self.now
        self._began, self._shown = perf_counter(), 0.0

    def _wait_for(self, time: float) -> None:
        """Wait until the clock has come to a simulated time [s], and take messages meanwhile."""
        if self.factor is None:
            return
        due = self._began + (time - self._zero) / self.factor
        while (left := due - perf_counter()) > 0 and not self.paused:
            self._inbox.wait(left)
        if left < -_FRAME:  # time that was lost is not made up for
            self._began -= left
