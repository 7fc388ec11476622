"""Running what is taught: what is tried runs from where the robot is, the program from the start.

One thing is run at a time. What is asked for while something runs is done when that has ended; of several the last.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError, Future
from functools import partial
from typing import Any, NamedTuple

from simrob_drake.base.messages import message
from simrob_drake.base.remarks import Remark
from simrob_drake.base.sections import validate_section
from simrob_drake.extensions.pendant.pages.words import JudgedRun, Notice
from simrob_drake.extensions.pendant.program_book import ProgramBook
from simrob_drake.extensions.pendant.run import Kind
from simrob_drake.extensions.pendant.run_client import RunClient, done
from simrob_drake.extensions.pendant.run_pacer import News
from simrob_drake.extensions.pendant.store import Taught, entries_of, with_change
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.moves.wait import WaitMove
from simrob_drake.programs.timeline import GRID, Change

Action = Callable[[], Future[Any]]
Then = Callable[[], object]
MOVE = "move"  # a kind of command: what has the robot move, or stand elsewhere
Tried = tuple[Move, ...]


class Waiting(NamedTuple):
    """A command that is not begun yet, the phases in which it can be, and what it is answered by."""

    begin: Action
    phases: tuple[str, ...]
    answer: Future[Any]


class Commands:
    """What waits, what is under way, and the phase that follows from that, which the client tells.

    Attributes:
        of_run: the phase of the run: ``opening``, ``idle``, ``running``, ``paused`` or ``gone``.
        waiting: what is not begun yet, by its kind.
        under_way: phases, each as long as a command has it: ``rewinding`` and ``saving``.
    """

    def __init__(self, client: RunClient) -> None:
        """Begin with nothing to do."""
        self._client, self.of_run = client, client.phase
        self.waiting: dict[str, Waiting] = {}
        self.under_way: list[str] = []
        self._begins = False

    def queued(self, kind: str, begin: Action, phases: tuple[str, ...] = ("idle",)) -> Future[Any]:
        """Begin a command in one of some phases, at once or later, in place of an older one of its kind that waits.

        Returns:
            its answer; None where it is not done.
        """
        phase = self._client.phase
        if phase in phases or (phase == "gone" and kind != MOVE):  # which tells so
            return begin()
        self.forget(kind)
        answer: Future[Any] = Future()
        self.waiting[kind] = Waiting(begin, phases, answer)
        return answer

    def travel(
        self,
        method: str,
        then: Callable[[Any], Any],
        failed: Then = lambda: None,
        phase: str = "rewinding",
        **arguments: Any,
    ) -> Future[Any]:
        """Ask for another moment of the run, or something else that takes a while; until then nothing is begun."""
        self.under_way.append(phase)
        self._show_phase()

        def over(what: Then) -> Any:
            self.under_way.remove(phase)
            found = what()
            self._show_phase()
            return found

        return self._client.ask(
            method, lambda result: over(lambda: then(result)), lambda: over(failed), **arguments
        )

    def set_phase(self, of_run: str) -> None:
        """Take the phase of the run; one that runs has left the moment that was gone back to."""
        self.of_run = of_run
        self._client.run.rewound &= of_run != "running"
        self._show_phase()

    def _show_phase(self) -> None:
        """Tell what is under way, else the phase of the run; and begin what waits, if it can be."""
        client, waits = self._client, self.waiting
        client.show_phase(next(reversed(self.under_way), self.of_run))
        while not self._begins and (
            fit := [kind for kind, one in waits.items() if client.phase in one.phases]
        ):
            self._begins = True  # each is asked for before the next one
            begun = waits.pop(fit[0])
            try:
                begun.begin().add_done_callback(partial(_pass_on, begun.answer))
            except BaseException as problem:
                _answer(begun.answer, problem)
                raise
            finally:
                self._begins = False

    def forget(self, *kinds: str) -> None:
        """Answer commands of some kinds that wait, of all unless named, by None: they are not done."""
        for kind in self.waiting.keys() & (kinds or {*self.waiting}):
            _answer(self.waiting.pop(kind).answer, None)


class MoveRunner:
    """What is tried, and how the robot gets there and back.

    Attributes:
        commands: what waits and what is under way.
        cut: makes what was stopped at a time [s] what was tried; tells whether it is.
    """

    def __init__(self, client: RunClient, book: ProgramBook) -> None:
        """Begin with nothing run."""
        self._client, self._book, self.commands = client, book, Commands(client)
        self.cut: Callable[[float], bool] = lambda _: False
        client.takes |= {
            "phase": lambda news: self.commands.set_phase(news["phase"]),
            "noted": lambda news: self._noted(news["change"]),
            "ended": self._ended,
            "died": self._died,
        }
        self.begin()

    def begin(self, *, lost: bool = False) -> None:
        """Count nothing as run; what was ``lost`` with its process can be looked at, and no more."""
        self._client.run.at_start(lost=lost)
        self._fell: Then = lambda: None
        self._failed_try: tuple[Tried, Tried] = (), ()  # what was tried when that fell, and before

    # What is tried

    @property
    def without_fallen(self) -> Taught:
        """What is taught without a try that fell; another one takes its place."""
        now, (fell, before) = self._book.history.present, self._failed_try
        return now.replaced(pending=before) if now.pending == fell else now

    def try_moves(self, make: Callable[[], Taught]) -> Future[Any]:
        """Run what is tried from where it is, or from before that with which it goes together."""
        before, tried = self._book.history.present, self._client.or_wrong(make)
        if tried is None:
            return done(None)
        self._book.record(tried)
        count = len(before.pending)
        longer = len(tried.pending) > count and tried.pending[:count] == before.pending
        return self.when_idle(lambda: self._run_tried(before), wait=longer)

    def _run_tried(self, before: Taught) -> Future[Any]:
        """Run what of the tried moves is not done yet; where that cannot be, they are as ``before``."""
        book, run, now = self._book, self._client.run, self._book.history.present
        again = now.pending == before.pending  # the last of them is run once more
        back, kept = run.moves.back_to(now.pending[:-1] if again else now.pending)
        moves = now.pending[kept:]
        if not moves:
            return done()
        if run.rewound and back is None:
            run.moves.append([None], run.start, free=True)  # no more what the program would do
        begin = run.start if back is None else back
        run.moves.append(moves, begin)
        kept_changes = tuple(change for change in now.changes if change.time < begin)
        if kept_changes != now.changes:  # what was changed then is not changed again
            now = now.replaced(changes=kept_changes)
            book.record(now)

        undone = partial(run.moves.back_to, now.pending[:kept])

        def fell() -> None:
            undone()
            new = max(1, len(now.pending) - len(before.pending))
            self._failed_try = now.pending, now.pending[:-new]

        def give_up() -> None:
            undone()
            if book.history.present == now:
                book.history.withdraw()
                book.save()
            else:
                tried = {
                    "pending": before.pending,
                    "joins": before.joins,
                    "changes": before.changes,
                }
                book.record(book.history.present.replaced(**tried))

        def start(_: Any = None) -> Future[Any]:
            run.start = begin
            if (
                MOVE in self.commands.waiting
            ):  # which is newer, and runs what these would, from where these would
                undone()
                run.moves.append([None], begin)
                return done(None)
            return self._do("tried", moves, give_up, fell)

        return start() if back is None else self.show_moment(back, start, give_up)

    def run_free(self, moves: Sequence[Move]) -> Future[Any]:
        """Run what is neither stored nor waits to be."""
        run = self._client.run
        run.moves.append([None] if run.rewound else [], run.start)
        run.moves.append(moves, run.start, free=True)
        return self._do("free", moves)

    def jog(self, targets_deg: Mapping[str, float], duration: float | None = None) -> Future[Any]:
        """Move axes of an arm [deg or m] in a time [s], likewise."""
        self._client.run.moves.append([None], self._client.run.start, free=True)
        return self._start("free", "jog", targets_deg=targets_deg, duration=duration)

    def _do(self, kind: Kind, moves: Sequence[Move], *came_to_nothing: Then) -> Future[Any]:
        """Run moves from where the robot is; those that take no time are followed by a moment, to be seen."""
        if not any(move.takes_time for move in moves):
            moves = [*moves, WaitMove(duration=self._book.program.grid or GRID)]
            self._client.run.moves.in_time = False
        return self._start(kind, "do", *came_to_nothing, moves=entries_of(moves))

    # The way back, and all from the start

    def go_back(self) -> Future[Any]:
        """Show where the robot was before what is not tried any more."""
        run = self._client.run
        back, _ = run.moves.back_to(self._book.history.present.pending)
        if back is None and run.time != run.start:  # a fall is shown
            back = run.start
        return done() if back is None else self.show_moment(back, lambda _: self._stand(back))

    def show_moment(
        self, time: float, then: Callable[[Any], Any], failed: Then = lambda: None
    ) -> Future[Any]:
        """Ask for a moment of the run to be shown [s]."""
        moment = self._client.run.moments.at(time)
        return self.commands.travel("rewind", then, failed, time=time, positions=moment)

    def play(self) -> Future[Any]:
        """Run all that is stored from the start."""
        program = self._book.whole_program()
        self._client.run.moves.restart_with(program.moves)
        return self._start("program", "play", self.begin, self.begin, program=program.text())

    def restart(self) -> Future[Any]:
        """Go back to the start."""
        self.begin()

        def begun(_: Any) -> bool:
            self._client.run.take(0.0, self._client.run.moments.at(0.0), {})
            return self._stand(0.0)

        return self.commands.travel("restart", begun)

    def proceed(self, method: str) -> Future[Any]:
        """Ask for more of a run; in one that was gone back in there is no more but from there."""
        run, idle = self._client.run, self._client.phase == "idle"
        if idle and run.rewound and method == "go_on":
            return self._start(run.kind, method)
        return self._client.ask(method) if idle else self._client.ask(method, self._resumed)

    def _resumed(self, found: Any) -> Any:
        """Take note that the run goes on, though the answer to an earlier way back has come meanwhile."""
        self._client.run.rewound = False
        return True if found is None else found

    def step_to(self, go: Callable[[], object], can: bool) -> bool:
        """Take another step of what is taught, and let robot and station follow; tell whether there is one."""
        if not can:
            return False
        book, run = self._book, self._client.run
        before = book.history.present
        go()
        now = book.history.present
        run.moves.align_with(now.program.moves)
        reopened = now.settings != before.settings
        if reopened:
            book.config = book.loaded(now.settings)
        book.save()
        if reopened:
            self.commands.forget()
            self.reopen()
        elif run.moves.has_others(now.pending):
            self.when_idle(self.go_back)
        return True

    def when_idle(self, action: Action, *, wait: bool = False) -> Future[Any]:
        """Do something once nothing runs; what runs is waited for, or else ended. Of several the last is done."""
        client, commands = self._client, self.commands
        answer = commands.queued(MOVE, action)
        if MOVE in commands.waiting and commands.of_run == "gone":
            self.reopen(lost=client.run.lost)
        elif MOVE in commands.waiting and commands.of_run in ("running", "paused"):
            if wait:
                client.say(Notice("waits"))
            client.ask("go_on", self._resumed) if wait else client.ask("stop")
        return answer

    def reopen(self, failed: Callable[[], object] | None = None, *, lost: bool = False) -> None:
        """Open the station anew in the run; ``failed`` is called if that cannot be."""
        book = self._book

        def gone() -> None:
            self.commands.forget()
            self.commands.set_phase("gone")

        def opened(description: dict[str, Any]) -> None:
            self._client.show_start({**description, "loops": book.loops})
            if self.commands.of_run == "opening":
                self.commands.set_phase("idle")

        self.begin(lost=lost)
        self.commands.set_phase("opening")
        how = {"station": book.station, "settings": book.settings, "robot": book.robot or None}
        self._client.open(opened, failed or gone, **how, allow_code=book.allow_code)

    # How

    def _stand(self, time: float) -> bool:
        """Tell that the robot stands where it was at a time [s]."""
        self._client.run.stand(time)
        self._client.tell("tick")
        return True

    def _start(
        self,
        kind: Kind,
        method: str,
        failed: Then = lambda: None,
        fell: Then = lambda: None,
        **arguments: Any,
    ) -> Future[Any]:
        """Ask for a run; ``failed`` is called if it cannot be, ``fell`` if it came to nothing."""
        run, set_phase = self._client.run, self.commands.set_phase
        run.kind, run.rewound, run.lost, run.shown, self._fell = kind, False, False, None, fell

        def refused() -> None:
            failed()
            set_phase("idle")

        def ran(ended: Any) -> Any:
            if ended is None:  # there was nothing to go on with
                set_phase("idle")
            return True if ended is None else ended

        answer = self._client.ask(method, ran, refused, **arguments)
        if (
            not answer.done()
        ):  # else refused at once; a way back that waits is asked for after this run
            set_phase("running")
        return answer

    # News

    def _died(self, news: News) -> None:
        if self.commands.of_run in ("running", "paused"):
            self._client.run.die()
        self.commands.under_way.clear()
        again = self._client.died(str(news["why"]))
        self.commands.set_phase("gone")
        self.begin(lost=True)
        self.commands.forget()
        if again:
            self.reopen(lost=True)

    def _ended(self, news: News) -> None:
        run, ending = self._client.run, news["ending"]
        jogged, fell, self._fell = run.kind == "free", self._fell, lambda: None
        run.end(news)
        if ending == "stopped":
            if not self.cut(news["time"]):
                run.moves.append([None], news["time"])
            return
        if not news["goes_on"]:
            fell()
        judged = JudgedRun(run.ended[-1].number, dict(self._book.settings))
        self._client.say(_notice_of(news, None if jogged else judged))

    def _noted(self, change: dict[str, Any]) -> None:
        """Put a change of the run into the program, or to what is tried, if its time is theirs."""
        book, run = self._book, self._client.run
        now, made = (
            book.history.present,
            validate_section(Change, change, message("pendant.the_change", "the change")),
        )
        label = " ".join(made.set or ())  # a slider that is moved is one step
        known = run.kind == "program"
        of_program = known or not now.pending
        if not (known or run.moves.is_program(now.program.moves)):
            self._client.say(Notice("not_stored"))
        elif of_program and made not in now.program.changes:
            book.record(now.with_program(changes=with_change(now.program.changes, made)), label)
        elif not of_program and made not in now.changes:
            book.record(now.replaced(changes=with_change(now.changes, made)), label)


def _notice_of(ended: News, judged: JudgedRun | None) -> Notice:
    """Make the notice of how a run ended.

    Args:
        ended: the news of its end.
        judged: the run that its verdict is about. None if the verdict does not count, as that of a jog; then a run that
            went to its end has an empty notice.
    """
    if judged is not None:
        return Notice.of_remarks(ended["remarks"], ended["criteria"], judged)
    if ended["ending"] == "completed":
        return Notice()
    return Notice.of_remarks([Remark(ended["remarks"][0].severity, ended["message"])])


def _pass_on(answer: Future[Any], done: Future[Any]) -> None:
    problem = CancelledError() if done.cancelled() else done.exception()
    _answer(answer, done.result() if problem is None else problem)


def _answer(answer: Future[Any], result: Any) -> None:
    """Answer by a result or a problem, unless who asked has left."""
    if not answer.set_running_or_notify_cancel():
        return
    if isinstance(result, BaseException):
        answer.set_exception(result)
    else:
        answer.set_result(result)
