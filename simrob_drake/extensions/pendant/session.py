"""What a page can do: teach a program, run it, change it while it runs, and take it away. It knows no page."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self, cast

import numpy as np

from simrob_drake.base.arguments import plain
from simrob_drake.base.errors import InvalidParameter, quote_value
from simrob_drake.base.folders import alone_in, writing
from simrob_drake.base.messages import message
from simrob_drake.base.packages import granting, package_root
from simrob_drake.base.sections import validate_section
from simrob_drake.extensions.pendant.exports import Exports
from simrob_drake.extensions.pendant.hand import Hand
from simrob_drake.extensions.pendant.jogging import Driving, Jogging
from simrob_drake.extensions.pendant.move_runner import Commands, MoveRunner
from simrob_drake.extensions.pendant.pages.words import Notice
from simrob_drake.extensions.pendant.program_book import ProgramBook
from simrob_drake.extensions.pendant.run import EndedRun, TaughtRun
from simrob_drake.extensions.pendant.run_client import HandOver, MakeLive, RunClient, Topic, done
from simrob_drake.extensions.pendant.setup import Setup
from simrob_drake.extensions.pendant.store import Taught
from simrob_drake.extensions.pendant.subjects import program_of, station_for
from simrob_drake.importer.robot_files import is_robot_file, robot_file
from simrob_drake.programs.moves.joints import JointMove, move_of, targets_on
from simrob_drake.programs.moves.move import MOVE_TIME
from simrob_drake.programs.stages import step_moves
from simrob_drake.programs.suggested_duration import suggest_duration
from simrob_drake.programs.timeline import GRID, Change
from simrob_drake.stations.resolve import resolve

__all__ = ["Session", "Topic"]

SLOWEST, FASTEST = 0.1, 4.0  # simulated time over the clock's that can be asked for
_PROGRAM = "program.yaml"
_ANY = "idle", "running", "paused"  # phases in which a run can be gone on with, and back in


class EarlierRuns:
    """Shows those of ``run.ended``; what is run next is shown in their place."""

    def __init__(
        self, client: RunClient, commands: Commands, to_present: Callable[[float], Future[Any]]
    ) -> None:
        """Show none; ``to_present`` shows a moment of the present run [s]."""
        self._client, self._commands, self._to_present = client, commands, to_present
        self._asked = False  # a ghost to the view
        client.listen(lambda _: self._follow(), "tick", "phase")
        client.listen(lambda _: self._follow(anew=True), "description")

    def show(self, number: int | None) -> Future[Any]:
        """Look at one, by its number, as soon as nothing runs, in place of the present run; None: at that again."""
        run, found = self._client.run, self._client.or_wrong(lambda: self._of(number))
        if found is run.shown or (found is None and number is not None):
            return done(None)

        def begin() -> Future[Any]:
            run.shown = found
            self._client.tell("phase")
            self._client.tell("history")
            if found is None:
                return self._to_present(run.start if run.rewound else run.reach)
            return self.rewind(run.time)

        return self._commands.queued("look", begin)

    def compare(self, number: int | None) -> bool:
        """Show one beside what is looked at, by its number: its curves, and itself as a ghost; None ends that."""
        found = self._client.or_wrong(lambda: self._of(number))
        if found is None and number is not None:
            return False
        self._client.run.compared = found
        self._client.tell("history")
        self._follow(anew=True)
        return True

    def rewind(self, time: float) -> Future[Any]:
        """Show the moment of the one that is looked at that is next to a time [s]."""
        run = self._client.run
        assert run.shown is not None
        run.time = run.shown.within(time)
        self._client.tell("tick")
        return self._client.ask("look", positions=run.shown.moments.at(run.time))

    def _of(self, number: int | None) -> EndedRun | None:
        known = {ended.number: ended for ended in self._client.run.ended}
        if number is None or number in known:
            return known.get(number or 0)
        expected = (
            message("pendant.one_of", "one of {known}", known=", ".join(map(str, known)))
            if known
            else message("pendant.none_has_ended", "one that has ended; none has")
        )
        raise InvalidParameter("run", quote_value(number), expected)

    def _follow(self, *, anew: bool = False) -> None:
        """Let the ghost be where it was at the moment that is shown; one word at a time is on its way to the view."""
        run = self._client.run
        if (
            self._asked
            or (run.compared is None and not anew)
            or self._client.phase in ("opening", "gone")
        ):
            return
        other, time, self._asked = run.ghost, run.time, True

        def over(_: object = None) -> None:
            self._asked = False
            if run.ghost is not other or run.time != time:
                self._follow(anew=True)

        positions = None if other is None else other.moments.at(other.within(time))
        self._client.ask("compare", over, over, positions=positions)


class Session:
    """One robot or station being taught; tabs share it. All calls come from one thread, and none waits.

    It does itself what the thesis's console does (Test, Add, Simulate, Discard, Reset, Step), and what the bar of a run
    does; for the rest it has parts.

    Nothing raises because of what a user does: what is wrong becomes :attr:`message`. Methods that need the run give a
    :class:`concurrent.futures.Future` (``await asyncio.wrap_future(...)``), which never raises and can be ignored: its
    result is None where something was wrong, else True or what was asked for. The others tell by True or False whether
    it was done. Every change of the program is in its file when the method returns.

    Attributes:
        subject: what was opened, as given.
        folder: of the program's file and of what is taken away; this subject's own.
        client: of the run, which is in a process of its own; its news, and who listens to them.
        book: the program and what else is taught, kept in its file.
        setup: the station with its settings.
        arm: what a pendant of an arm does.
        hand: what is moved in the view.
        driving: a walk that is driven by hand.
        exports: what is taken away.
        earlier: runs that have ended, looked at again.
        inspected: signals at which the user has looked by a block or a line of the picture, in the order of the clicks.
        hear, listen, listen_to_view, watch: those of the client.
    """

    def __init__(self, live: MakeLive | None = None, hand_over: HandOver | None = None) -> None:
        """Begin empty; :meth:`open` makes one that can be used."""
        self.subject, self.folder = "", Path()
        self.client = client = RunClient(live, hand_over)
        self.book = book = ProgramBook(client)
        self._runner = runner = MoveRunner(client, book)
        self.setup = Setup(client, book, runner)
        self.arm = Jogging(client, book, runner)
        self.hand = Hand(client, book, self.arm, self.setup)
        self.driving = Driving(client, book, runner)
        self.exports = Exports(client, book, runner.commands)
        self.earlier = EarlierRuns(client, runner.commands, self.rewind)
        self.hear, self.watch = client.hear, client.watch
        self.listen, self.listen_to_view = client.listen, client.listen_to_view
        self.inspected: list[str] = []
        self._held = ExitStack()

    def inspect(self, signals: Iterable[str]) -> None:
        """Note that the user looks at the plots of signals, which a step of a lesson may ask."""
        self.inspected.extend(signals)
        self.client.tell("inspected")

    @classmethod
    def open(
        cls,
        subject: str | Path,
        folder: str | Path,
        *,
        program: str | Path | None = None,
        robot: str | None = None,
        allow_code: bool = False,
        live: MakeLive | None = None,
        hand_over: HandOver | None = None,
    ) -> Self:
        """Open a robot, a station or a file; the description comes later, with the topic of its name.

        Args:
            subject: a robot's or a station's name, or the file of a robot, a station or a program.
            folder: for what is taught; made where it is missing.
            program: a file to begin with; the one that was taught last unless given.
            robot: which robot of the station; its first unless given.
            allow_code: whether the station may name Python code that is run with it.
            live: makes the run from what takes its news; :class:`.live.Live` unless given.
            hand_over: calls a function in the thread of all other calls, as ``loop.call_soon_threadsafe`` does. Without
                it news wait for :meth:`hear`.

        Raises:
            SimrobError: no such robot, station or file; a folder that cannot be written, or in which another process
                teaches.
        """
        if program is None and (found := program_of(subject)) is not None:
            program, subject = found
        session = cls(live, hand_over)
        session.subject, book = str(subject), session.book
        with ExitStack() as held:
            if is_robot_file(
                str(subject)
            ):  # which somebody names here, so that its package may be read
                held.enter_context(granting([package_root(robot_file(subject, "subject"))]))
            name, station = station_for(subject, Path(folder))
            book.use(station, robot, allow_code=allow_code)
            session.folder = (Path(folder) / name).absolute()
            with writing(session.folder):
                session.folder.mkdir(parents=True, exist_ok=True)
            held.enter_context(alone_in(session.folder))
            own = f"{book.robot}.yaml" if book.one_of_several else _PROGRAM
            book.load(
                Path(program).absolute() if program is not None else session.folder / own,
                session.folder,
            )
            session._held = held.pop_all()
        session._runner.reopen()
        return session

    def close(self) -> None:
        """End the run and its process; another one may teach in the folder then."""
        self.client.close()
        self._runner.commands.forget()
        self._held.close()

    # What pages read most

    @property
    def description(self) -> dict[str, Any]:
        """Of the station; see :class:`RunClient`."""
        return self.client.description

    @property
    def phase(self) -> str:
        """What is under way, likewise."""
        return self.client.phase

    @property
    def run(self) -> TaughtRun:
        """What was run, likewise."""
        return self.client.run

    @property
    def message(self) -> Notice:
        """The last thing to tell, likewise."""
        return self.client.message

    # What is tried, stored and run

    def test(self, targets_deg: Mapping[str, float], duration: float | None = None) -> Future[Any]:
        """Try a move of axes [deg or m], together with those tested before it since the last :meth:`add`.

        All go together, in the same time [s], from where the robot was before the first; that of the last test unless
        given. Nothing is stored. What falls stays tested, until something else is tried in its place.
        """
        now = self.book.history.present
        before = cast(JointMove, now.pending[-1]).duration if now.joins else MOVE_TIME

        def tested() -> Taught:
            move = move_of(targets_deg, before if duration is None else duration)
            self.book.within_limits(move)
            return (now if now.joins else self._runner.without_fallen).with_tested(move)

        return self._runner.try_moves(tested)

    def suggest_duration(
        self, targets_deg: Mapping[str, float], start: Sequence[float] | None = None
    ) -> float:
        """Suggest a duration [s] for a move of axes that their servos can follow.

        Args:
            targets_deg: targets by axis [deg or m]. The other axes stay.
            start: positions of all axes before the move, shape (n,) [rad or m]; those of the station's start if None.

        Raises:
            SimrobError: there is no such axis, or a target is beyond its limits.
        """
        config = self.book.config
        robot = resolve(config).robots[self.book.robot]
        before = np.array(robot.initial if start is None else start, dtype=float)
        target = before.copy()
        named = message("pendant.the_move", "the move")
        for index, position in targets_on(robot.model, targets_deg, named).items():
            target[index] = position
        return suggest_duration(config, robot, before, target)

    def step(self) -> Future[Any]:
        """Try one step (Paso): it waits for :meth:`add` or :meth:`discard`, as a tested move."""

        def stepped() -> Taught:
            model, own = self.book.model, self.book.config.robots[self.book.robot].feet
            feet = own or (model.feet.default if model.feet else None)
            return self._runner.without_fallen.with_tried(*step_moves(model, feet))

        return self._runner.try_moves(stepped)

    def try_move(self, move: Mapping[str, Any]) -> Future[Any]:
        """Try any move, as a program's file has it, likewise."""
        return self._runner.try_moves(
            lambda: self._runner.without_fallen.with_tried(self.book.checked(move))
        )

    def add(self) -> bool:
        """Store what was tested."""
        now = self.book.history.present
        if not now.pending:
            return self.client.refuse("nothing_tested")
        self.book.record(now.added())
        self.run.moves.mark_stored()
        return True

    def discard(self) -> Future[Any]:
        """Forget what was tested, and go back to before it."""
        self.book.record(self.book.history.present.discarded())
        return self._runner.when_idle(self._runner.go_back)

    def simulate(self) -> Future[Any]:
        """Run all that is stored from the start; of an empty program what the station's file asks for."""
        return self._runner.when_idle(self._runner.play)

    def reset(self) -> Future[Any]:
        """Erase the program and go back to the start; :meth:`undo` brings it back."""
        self.book.record(self.book.history.present.discarded().replaced(program=Taught().program))
        self.client.say(Notice("reset"))
        return self.restart()

    def restart(self) -> Future[Any]:
        """Go back to the start; the program stays."""
        return self._runner.when_idle(self._runner.restart)

    def undo(self) -> bool:
        """Take back the last change of program, tested moves, targets or settings."""
        return self._runner.step_to(self.book.history.undo, self.book.history.can_undo)

    def redo(self) -> bool:
        """Bring back what :meth:`undo` took."""
        return self._runner.step_to(self.book.history.redo, self.book.history.can_redo)

    def take_theirs(self) -> bool:
        """Take the file as another editor has left it; :meth:`undo` brings back what was taught here."""
        return self._runner.step_to(
            lambda: self.book.load(self.book.file, self.folder), self.book.conflict
        )

    def keep_both(self) -> bool:
        """Leave that file as it is; what is taught goes to another one."""
        return self.book.keep_both(self.folder)

    # While it runs

    def pause(self) -> Future[Any]:
        """Pause at the next tick of the grid."""
        return self.client.ask("pause")

    def go_on(self) -> Future[Any]:
        """Go on after a pause, or from a moment that was gone back to; what came after that is forgotten."""
        return self._queued("go on", lambda: self._runner.proceed("go_on"))

    def one_tick(self) -> Future[Any]:
        """Go on for one tick of the grid after a pause."""
        return self._queued("go on", lambda: self._runner.proceed("one_tick"))

    def stop(self) -> Future[Any]:
        """End the run where it is."""
        return self.client.ask("stop")

    def set_pace(self, factor: float | None) -> Future[Any]:
        """Run so many times as fast as the clock, 0.1 to 4; None: as fast as it can."""
        known = isinstance(factor, (int, float)) and SLOWEST <= factor <= FASTEST
        if factor is not None and not known:
            expected = message(
                "pendant.pace_range",
                "{slowest:g} to {fastest:g} times as fast as the clock, or None: as fast as it can",
                slowest=SLOWEST,
                fastest=FASTEST,
            )
            self.client.wrong(InvalidParameter("pace", quote_value(factor), expected))
            return done(None)
        self.client.pace = factor
        self.client.tell("phase")
        return self.client.ask("pace", factor=factor)

    def rewind(self, time: float) -> Future[Any]:
        """Show a moment of what was run [s]; one less than a tick of the grid behind the last is the last."""
        if self.run.shown is not None:
            return self.earlier.rewind(float(time))
        over = float(time) - self.run.reach
        moment = self.run.reach if 0 < over <= (self.book.program.grid or GRID) else float(time)

        def shown(goes_on: Any) -> bool:
            self.run.time = moment
            if goes_on:
                self.run.start, self.run.rewound = self.run.time, True
            self.client.tell("tick")
            return True

        return self._queued("rewind", lambda: self._runner.show_moment(moment, shown))

    def change(self, key: str, value: Any) -> Future[Any]:
        """Change the running station by a dotted key, such as ``servo.kp``; it goes into the program with its time."""
        return self._changed("change", {"set": {key: value}}, settings={key: value})

    def push(self, at: str, force: Sequence[float], duration: float = 0.1) -> Future[Any]:
        """Push a body with a force [N] for a time [s]; it goes into the program, too."""
        push = {"at": at, "force": force, "duration": duration}
        return self._changed("push", {"push": push}, **push)

    def drag(self, at: str, point: Sequence[float], target: Sequence[float] | None) -> Future[Any]:
        """Pull a point of a body [m] to a place in the world [m] by a spring, or let go of it; likewise."""
        drag = {"at": at, "point": point, "targets": [[0, 0, 0] if target is None else target]}
        return self._changed("drag", {"drag": drag}, at=at, point=point, target=target)

    def _changed(self, method: str, change: dict[str, Any], **arguments: Any) -> Future[Any]:
        """Ask for a change, if a program's file could have it."""
        could_be = self.client.or_wrong(
            lambda: validate_section(
                Change, {"time": 0.0, **plain(change)}, message("pendant.the_change", "the change")
            )
        )
        return self.client.ask(method, **plain(arguments)) if could_be else done(None)

    def _queued(self, kind: str, begin: Callable[[], Future[Any]]) -> Future[Any]:
        return self._runner.commands.queued(kind, begin, _ANY)
