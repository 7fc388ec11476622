"""Running what is taught: what is tried runs from where the robot is, the program from the start.

One thing is run at a time. What is asked for while something runs is done when that has ended; of several the last.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, Literal

from simrob_drake.errors import SimrobError
from simrob_drake.programs.arm_moves import ToolMove
from simrob_drake.programs.moves import AttachMove, PlayMove, ReleaseMove, WaitMove
from simrob_drake.programs.program import AnyMove, Program
from simrob_drake.programs.timeline import GRID, Change
from simrob_drake.stations.load import load_station
from simrob_drake.teach.course import Course
from simrob_drake.teach.hub import HandOver, MakeLive, News, done
from simrob_drake.teach.keeping import Keeping
from simrob_drake.teach.notices import Notice
from simrob_drake.teach.taught import Taught, told, with_change
from simrob_drake.yaml_files import validated

Kind = Literal["", "program", "tried", "free"]
"""What is run: the program, what is tried, or something that is neither stored nor waits to be."""


class Trying(Keeping):
    """What is tried, and how the robot gets there and back."""

    ending: News | None = None
    """How the last run ended, as its news told; None before."""
    _next: tuple[Callable[[], Future[Any]], Future[Any]] | None = None

    def undo(self) -> bool:
        """Take back the last change of program, tested moves, targets or settings."""
        return self._went(self._history.undo, self.can_undo)

    def redo(self) -> bool:
        """Bring back what :meth:`undo` took."""
        return self._went(self._history.redo, self.can_redo)

    def stop(self) -> Future[Any]:
        """End the run where it is."""
        return self._ask("stop")

    def close(self) -> None:
        """End the run and its process."""
        super().close()
        self._forget_next()

    # How

    def __init__(self, live: MakeLive | None = None, hand_over: HandOver | None = None) -> None:
        """Begin with nothing run."""
        super().__init__(live, hand_over)
        self._begin()

    def _begin(self) -> None:
        """Count nothing as run."""
        self._course = Course()
        self._kind: Kind = ""
        self._failed: Callable[[], object] = lambda: None
        self._kind_seen: Kind = ""
        self._rewound = False

    def _try_moves(self, moves: Callable[[], Sequence[AnyMove]]) -> Future[Any]:
        return self._try(lambda: self._history.present.with_tried(*moves()))

    def _try(self, make: Callable[[], Taught]) -> Future[Any]:
        """Run what is tried from where it is, or from before that with which it goes together."""
        before = self._history.present
        try:
            tried = make()
        except SimrobError as problem:
            self._wrong(problem)
            return done(None)
        self._record(tried)
        count = len(before.pending)
        longer = len(tried.pending) > count and tried.pending[:count] == before.pending
        return self._idly(lambda: self._run_tried(before), wait=longer)

    def _run_tried(self, before: Taught) -> Future[Any]:
        """Run what of the tried moves is not done yet; where that cannot be, they are as ``before``."""
        now = self._history.present
        again = now.pending == before.pending  # the last of them is run once more
        back, kept = self._course.back_to(now.pending[:-1] if again else now.pending)
        moves = now.pending[kept:]
        if not moves:
            return done()
        if self._rewound and back is None:
            self._course.went_on([None], self.time, free=True)  # no more what the program would do
        begin = self.time if back is None else back
        self._course.went_on(moves, begin)
        if back is not None:  # what was changed then is not changed again
            now = now.but(changes=tuple(change for change in now.changes if change.time < begin))
            self._record(now)

        def give_up() -> None:
            self._course.back_to(now.pending[:kept])
            if self._history.present == now:
                self._history.withdraw()
                self._save()
            else:
                kept_changes = {"pending": before.pending, "joins": before.joins, "changes": before.changes}
                self._record(self._history.present.but(**kept_changes))

        def run(_: Any = None) -> Future[Any]:
            return self._do("tried", moves, give_up)

        return run() if back is None else self._ask("rewind", run, give_up, time=back)

    def _run_free(self, moves: Sequence[AnyMove]) -> Future[Any]:
        """Run what is neither stored nor waits to be."""
        self._course.went_on([None] if self._rewound else [], self.time)
        self._course.went_on(moves, self.time, free=True)
        return self._do("free", moves)

    def _do(self, kind: Kind, moves: Sequence[AnyMove], failed: Callable[[], object] = lambda: None) -> Future[Any]:
        """Run moves from where the robot is; those that take no time are followed by a moment, to be seen."""
        if all(isinstance(move, AttachMove | ReleaseMove | ToolMove) for move in moves):
            moves, self._course.in_time = [*moves, WaitMove(wait=self.program.grid or GRID)], False
        return self._start(kind, "do", failed, moves=told(moves))

    def _go_back(self) -> Future[Any]:
        """Show where the robot was before what is not tried any more."""
        back, _ = self._course.back_to(self._history.present.pending)
        return done() if back is None else self._ask("rewind", lambda _: self._stand(back), time=back)

    def _play(self) -> Future[Any]:
        program = self._whole_program()
        self._course.played(program.moves)
        return self._start("program", "play", self._begin, program=program.text())

    def _whole_program(self) -> Program:
        """Return the program; an empty one leaves the station to the references of its file."""
        if self.program.moves or self.program.references:
            return self.program
        return self.program.added(PlayMove(play=self.config.duration))

    def _restart(self) -> Future[Any]:
        self._begin()
        return self._ask("restart", lambda _: self._stand(0.0))

    def _stand(self, time: float) -> bool:
        """Tell that the robot stands where it was at a time [s]."""
        self.time, self._rewound = time, False
        self._tell("tick")
        return True

    def _start(
        self, kind: Kind, method: str, failed: Callable[[], object] = lambda: None, **arguments: Any
    ) -> Future[Any]:
        """Ask for a run; ``failed`` is called if it cannot be, or came to nothing."""
        self._kind, self._failed, self._rewound = kind, failed, False
        self._set_phase("running")

        def refused() -> None:
            failed()
            self._set_phase("idle")

        return self._ask(method, failed=refused, **arguments)

    def _idly(self, action: Callable[[], Future[Any]], *, wait: bool = False) -> Future[Any]:
        """Do something once nothing runs; what runs is waited for, or else ended. Of several the last is done."""
        if self.phase == "idle":
            return action()
        answer: Future[Any] = Future()
        self._forget_next()
        self._next = action, answer
        if self.phase == "gone":
            self._reopen()
        elif wait:
            self._say(Notice("waits"))
            self._ask("go_on")
        elif self.phase != "opening":
            self.stop()
        return answer

    def _went(self, go: Callable[[], None], can: bool) -> bool:
        if not can:
            return False
        before = self._history.present
        go()
        now = self._history.present
        self._course.align(now.program.moves)
        if now.settings != before.settings:
            self.config = load_station(self.station, now.settings)
        self._save()
        if now.settings != before.settings:
            self._forget_next()
            self._reopen()
        elif self._course.has_others(now.pending):
            self._idly(self._go_back)
        return True

    def _forget_next(self) -> None:
        if self._next is not None:
            self._next[1].set_result(None)
        self._next = None

    def _set_phase(self, phase: str) -> None:
        super()._set_phase(phase)
        if phase == "idle" and self._next is not None:
            (action, answer), self._next = self._next, None
            action().add_done_callback(lambda one: answer.set_result(one.result()))

    # News

    def _ended(self, news: News) -> None:
        self.ending, jogged = news, self._kind == "free"
        if not self._rewound:
            self.time = news["time"]
        if news["ending"] == "stopped":
            self._course.went_on([None], news["time"])
        elif not news["goes_on"]:
            self._failed()
        self._kind, self._failed, self._kind_seen = "", lambda: None, self._kind
        if news["ending"] != "stopped":
            well = news["ending"] == "completed"
            self._say(Notice() if well and jogged else Notice(fills={"text": news["message"]}, wrong=not well))

    def _noted(self, change: dict[str, Any]) -> None:
        """Put a change of the run into the program, or to what is tried, if its time is theirs."""
        now, made = self._history.present, validated(Change, change, "the change")
        label = " ".join(made.set or ())  # a slider that is moved is one step
        of_program = self._kind == "program" or not now.pending
        known = of_program and self._kind == "program"
        if not (known or self._course.at_start() or self._course.stands_behind(now.program.moves)):
            self._say(Notice("not_stored"))
        elif of_program and made not in now.program.changes:
            self._record(now.with_program(changes=with_change(now.program.changes, made)), label)
        elif not of_program and made not in now.changes:
            self._record(now.but(changes=with_change(now.changes, made)), label)

    def _revive(self, *, often: bool) -> None:
        self._begin()
        self._forget_next()
        if not often:
            self._reopen()

    def _reopen(self, failed: Callable[[], object] | None = None) -> None:
        """Open the station anew in the run; ``failed`` is called if that cannot be."""
        self._begin()
        how = {"station": self.station, "settings": self.settings, "robot": self.robot or None}
        self._open_live(failed or (lambda: self._set_phase("gone")), **how)
