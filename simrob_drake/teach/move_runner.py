"""Running what is taught: what is tried runs from where the robot is, the program from the start.

One thing is run at a time. What is asked for while something runs is done when that has ended; of several the last.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any

from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.moves.play import PlayMove
from simrob_drake.programs.moves.wait import WaitMove
from simrob_drake.programs.program import Program
from simrob_drake.programs.timeline import GRID, Change
from simrob_drake.sections import validated
from simrob_drake.teach.commands import Action, Commands
from simrob_drake.teach.pages.words import Notice
from simrob_drake.teach.program_editor import ProgramEditor
from simrob_drake.teach.run import Kind
from simrob_drake.teach.run_client import HandOver, MakeLive, done
from simrob_drake.teach.run_pacer import News
from simrob_drake.teach.taught import Taught, entries_of, with_change

Tried = tuple[Move, ...]
Then = Callable[[], object]
_MOVE = "move"
"""A kind of command: what has the robot move, or stand elsewhere."""


class MoveRunner(ProgramEditor):
    """What is tried, and how the robot gets there and back."""

    def undo(self) -> bool:
        """Take back the last change of program, tested moves, targets or settings."""
        return self._stepped(self._history.undo, self.can_undo)

    def redo(self) -> bool:
        """Bring back what :meth:`undo` took."""
        return self._stepped(self._history.redo, self.can_redo)

    def stop(self) -> Future[Any]:
        """End the run where it is."""
        return self._ask("stop")

    def close(self) -> None:
        """End the run and its process."""
        super().close()
        self._commands.forget()

    # How

    def __init__(self, live: MakeLive | None = None, hand_over: HandOver | None = None) -> None:
        """Begin with nothing run."""
        self._commands, self._of_run = Commands(), "opening"
        super().__init__(live, hand_over)
        self._begin()

    def _begin(self, *, lost: bool = False) -> None:
        """Count nothing as run; what was ``lost`` with its process can be looked at, and no more."""
        self.run.at_start(lost=lost)
        self._fell: Then = lambda: None
        self._failed_try: tuple[Tried, Tried] = (), ()  # what was tried when that fell, and before

    def _try_moves(self, moves: Callable[[], Sequence[Move]]) -> Future[Any]:
        return self._try(lambda: self._without_fallen.with_tried(*moves()))

    @property
    def _without_fallen(self) -> Taught:
        """What is taught without a try that fell; another one takes its place."""
        now, (fell, before) = self._history.present, self._failed_try
        return now.replaced(pending=before) if now.pending == fell else now

    def _try(self, make: Callable[[], Taught]) -> Future[Any]:
        """Run what is tried from where it is, or from before that with which it goes together."""
        before, tried = self._history.present, self._or_wrong(make)
        if tried is None:
            return done(None)
        self._record(tried)
        count = len(before.pending)
        longer = len(tried.pending) > count and tried.pending[:count] == before.pending
        return self._when_idle(lambda: self._run_tried(before), wait=longer)

    def _run_tried(self, before: Taught) -> Future[Any]:
        """Run what of the tried moves is not done yet; where that cannot be, they are as ``before``."""
        now = self._history.present
        again = now.pending == before.pending  # the last of them is run once more
        back, kept = self.run.moves.back_to(now.pending[:-1] if again else now.pending)
        moves = now.pending[kept:]
        if not moves:
            return done()
        if self.run.rewound and back is None:
            self.run.moves.append([None], self.run.start, free=True)  # no more what the program would do
        begin = self.run.start if back is None else back
        self.run.moves.append(moves, begin)
        kept_changes = tuple(change for change in now.changes if change.time < begin)
        if kept_changes != now.changes:  # what was changed then is not changed again
            now = now.replaced(changes=kept_changes)
            self._record(now)

        def undone() -> None:
            self.run.moves.back_to(now.pending[:kept])

        def fell() -> None:
            undone()
            new = max(1, len(now.pending) - len(before.pending))
            self._failed_try = now.pending, now.pending[:-new]

        def give_up() -> None:
            undone()
            if self._history.present == now:
                self._history.withdraw()
                self._save()
            else:
                tried = {"pending": before.pending, "joins": before.joins, "changes": before.changes}
                self._record(self._history.present.replaced(**tried))

        def run(_: Any = None) -> Future[Any]:
            self.run.start = begin
            if _MOVE in self._commands.waiting:  # which is newer, and runs what these would, from where these would
                undone()
                self.run.moves.append([None], begin)
                return done(None)
            return self._do("tried", moves, give_up, fell)

        return run() if back is None else self._show_moment(back, run, give_up)

    def _run_free(self, moves: Sequence[Move]) -> Future[Any]:
        """Run what is neither stored nor waits to be."""
        self.run.moves.append([None] if self.run.rewound else [], self.run.start)
        self.run.moves.append(moves, self.run.start, free=True)
        return self._do("free", moves)

    def _do(self, kind: Kind, moves: Sequence[Move], *came_to_nothing: Then) -> Future[Any]:
        """Run moves from where the robot is; those that take no time are followed by a moment, to be seen."""
        if not any(move.takes_time for move in moves):
            moves, self.run.moves.in_time = [*moves, WaitMove(duration=self.program.grid or GRID)], False
        return self._start(kind, "do", *came_to_nothing, moves=entries_of(moves))

    def _go_back(self) -> Future[Any]:
        """Show where the robot was before what is not tried any more."""
        back, _ = self.run.moves.back_to(self._history.present.pending)
        if back is None and self.run.time != self.run.start:  # a fall is shown
            back = self.run.start
        return done() if back is None else self._show_moment(back, lambda _: self._stand(back))

    def _show_moment(self, time: float, then: Callable[[Any], Any], failed: Then = lambda: None) -> Future[Any]:
        """Ask for a moment of the run to be shown [s]."""
        return self._travel("rewind", then, failed, time=time, positions=self.run.moment(time))

    def _play(self) -> Future[Any]:
        program = self._whole_program()
        self.run.moves.restart_with(program.moves)
        return self._start("program", "play", self._begin, self._begin, program=program.text())

    def _whole_program(self) -> Program:
        """Return the program; an empty one leaves the station to the references of its file."""
        if self.program.moves or self.program.references:
            return self.program
        return self.program.added(PlayMove(duration=self.config.duration))

    def _restart(self) -> Future[Any]:
        self._begin()

        def begun(_: Any) -> bool:
            self.run.take(0.0, self.run.moment(0.0), {})
            return self._stand(0.0)

        return self._travel("restart", begun)

    def _stand(self, time: float) -> bool:
        """Tell that the robot stands where it was at a time [s]."""
        self.run.stand(time)
        self._tell("tick")
        return True

    def _travel(
        self,
        method: str,
        then: Callable[[Any], Any],
        failed: Then = lambda: None,
        phase: str = "rewinding",
        **arguments: Any,
    ) -> Future[Any]:
        """Ask for another moment of the run, or something else that takes a while; until then nothing is begun."""
        self._commands.under_way.append(phase)
        self._show_phase()

        def over(what: Then) -> Any:
            self._commands.under_way.remove(phase)
            found = what()
            self._show_phase()
            return found

        return self._ask(method, lambda result: over(lambda: then(result)), lambda: over(failed), **arguments)

    def _start(
        self, kind: Kind, method: str, failed: Then = lambda: None, fell: Then = lambda: None, **arguments: Any
    ) -> Future[Any]:
        """Ask for a run; ``failed`` is called if it cannot be, ``fell`` if it came to nothing."""
        self.run.kind, self.run.rewound, self.run.lost, self._fell = kind, False, False, fell
        self._set_phase("running")

        def refused() -> None:
            failed()
            self._set_phase("idle")

        def ran(ended: Any) -> Any:
            if ended is None:  # there was nothing to go on with
                self._set_phase("idle")
            return True if ended is None else ended

        return self._ask(method, ran, refused, **arguments)

    def _when_idle(self, action: Callable[[], Future[Any]], *, wait: bool = False) -> Future[Any]:
        """Do something once nothing runs; what runs is waited for, or else ended. Of several the last is done."""
        answer = self._queued(_MOVE, action)
        if _MOVE not in self._commands.waiting:
            return answer
        if self._of_run == "gone":
            self._reopen(lost=self.run.lost)
        elif self._of_run in ("running", "paused"):
            if wait:
                self._say(Notice("waits"))
            self._ask("go_on" if wait else "stop")
        return answer

    def _queued(self, kind: str, begin: Action, phases: tuple[str, ...] = ("idle",)) -> Future[Any]:
        """Begin a command in one of some phases, at once or later; of a kind the newest."""
        if self.phase in phases or (self.phase == "gone" and kind != _MOVE):  # which tells so
            return begin()
        return self._commands.wait(kind, begin, phases)

    def _stepped(self, go: Callable[[], None], can: bool) -> bool:
        if not can:
            return False
        before = self._history.present
        go()
        now = self._history.present
        self.run.moves.align_with(now.program.moves)
        reopened = now.settings != before.settings
        if reopened:
            self.config = self._loaded(now.settings)
        self._save()
        if reopened:
            self._commands.forget()
            self._reopen()
        elif self.run.moves.has_others(now.pending):
            self._when_idle(self._go_back)
        return True

    def _set_phase(self, phase: str) -> None:
        self._of_run = phase
        self._show_phase()

    def _show_phase(self) -> None:
        """Tell what is under way, else the phase of the run; and begin what waits, if it can be."""
        super()._set_phase(next(reversed(self._commands.under_way), self._of_run))
        self._commands.begin(lambda: self.phase)

    # News

    def _take(self, news: News) -> None:
        match news["news"]:
            case "noted":
                self._noted(news["change"])
            case "ended":
                self._ended(news)
            case "died":
                self._commands.under_way.clear()
                again = self._died(str(news["why"]))
                self._begin(lost=True)
                self._commands.forget()
                if again:
                    self._reopen(lost=True)
            case _:
                super()._take(news)

    def _ended(self, news: News) -> None:
        jogged = self.run.kind == "free"
        self.run.end(news)
        if news["ending"] == "stopped":
            self.run.moves.append([None], news["time"])
        elif not news["goes_on"]:
            self._fell()
        self._fell = lambda: None
        if news["ending"] != "stopped":
            warnings, well = news["warnings"], news["ending"] == "completed"
            judged = [] if jogged else [news["verdict"], *warnings]
            text = "\n".join([news["message"], *judged])
            wrong = not well or bool(judged and warnings)
            self._say(Notice() if well and jogged else Notice(fills={"text": text}, wrong=wrong))

    def _noted(self, change: dict[str, Any]) -> None:
        """Put a change of the run into the program, or to what is tried, if its time is theirs."""
        now, made = self._history.present, validated(Change, change, "the change")
        label = " ".join(made.set or ())  # a slider that is moved is one step
        known = self.run.kind == "program"
        of_program = known or not now.pending
        if not (known or self.run.moves.is_program(now.program.moves)):
            self._say(Notice("not_stored"))
        elif of_program and made not in now.program.changes:
            self._record(now.with_program(changes=with_change(now.program.changes, made)), label)
        elif not of_program and made not in now.changes:
            self._record(now.replaced(changes=with_change(now.changes, made)), label)

    def _reopen(self, failed: Callable[[], object] | None = None, *, lost: bool = False) -> None:
        """Open the station anew in the run; ``failed`` is called if that cannot be."""

        def gone() -> None:
            self._commands.forget()
            self._set_phase("gone")

        self._begin(lost=lost)
        how = {"station": self.station, "settings": self.settings, "robot": self.robot or None}
        self._open_live(failed or gone, **how, allow_code=self._allow_code)
