"""Teaching a program: moves are tried, stored and run, and a run is paused, gone back in, changed, pushed and pulled.

It knows no arm's lines, and no page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Any, cast

from simrob_drake.arguments import plain
from simrob_drake.errors import InvalidParameter, quoted
from simrob_drake.programs.moves.joints import JointMove, move_of
from simrob_drake.programs.moves.move import MOVE_TIME
from simrob_drake.programs.stages import step_moves
from simrob_drake.programs.timeline import GRID, Change
from simrob_drake.sections import validated
from simrob_drake.teach.move_runner import MoveRunner
from simrob_drake.teach.pages.words import Notice
from simrob_drake.teach.run_client import done
from simrob_drake.teach.taught import Taught

SLOWEST, FASTEST = 0.1, 4.0
"""Simulated time over the clock's that can be asked for."""
_ANY = "idle", "running", "paused"  # phases in which a run can be gone on with, and back in


class Teaching(MoveRunner):
    """What the thesis's console does: Test, Add, Simulate, Discard, Reset, Step and Walk; and the bar of a run."""

    def test(self, targets_deg: Mapping[str, float], duration: float | None = None) -> Future[Any]:
        """Try a move of axes [deg or m], together with those tested before it since the last :meth:`add`.

        All go together, in the same time [s], from where the robot was before the first; that of the last test unless
        given. Nothing is stored. What falls stays tested, until something else is tried in its place.
        """
        now = self._history.present
        before = cast(JointMove, now.pending[-1]).duration if now.joins else MOVE_TIME

        def tested() -> Taught:
            move = move_of(targets_deg, before if duration is None else duration)
            self._within_limits(move)
            return (now if now.joins else self._without_fallen).with_tested(move)

        return self._try(tested)

    def step(self) -> Future[Any]:
        """Try one step (Paso): it waits for :meth:`add` or :meth:`discard`, as a tested move."""
        return self._try_moves(lambda: step_moves(self.model, self._worn_feet))

    def try_move(self, move: Mapping[str, Any]) -> Future[Any]:
        """Try any move, as a program's file has it, likewise."""
        return self._try_moves(lambda: [self._checked(move)])

    def add(self) -> bool:
        """Store what was tested."""
        if not self._history.present.pending:
            return self._refused("nothing_tested")
        self._record(self._history.present.added())
        self.run.moves.mark_stored()
        return True

    def discard(self) -> Future[Any]:
        """Forget what was tested, and go back to before it."""
        self._record(self._history.present.discarded())
        return self._when_idle(self._go_back)

    def simulate(self) -> Future[Any]:
        """Run all that is stored from the start; of an empty program what the station's file asks for."""
        return self._when_idle(self._play)

    def reset(self) -> Future[Any]:
        """Erase the program and go back to the start; :meth:`undo` brings it back."""
        self._record(self._history.present.discarded().replaced(program=Taught().program))
        self._say(Notice("reset"))
        return self.restart()

    def restart(self) -> Future[Any]:
        """Go back to the start; the program stays."""
        return self._when_idle(self._restart)

    # While it runs

    def pause(self) -> Future[Any]:
        """Pause at the next tick of the grid."""
        return self._ask("pause")

    def go_on(self) -> Future[Any]:
        """Go on after a pause, or from a moment that was gone back to; what came after that is forgotten."""
        return self._queued("go on", lambda: self._proceed("go_on"), _ANY)

    def one_tick(self) -> Future[Any]:
        """Go on for one tick of the grid after a pause."""
        return self._queued("go on", lambda: self._proceed("one_tick"), _ANY)

    def _proceed(self, method: str) -> Future[Any]:
        """Ask for more of a run; in one that was gone back in there is no more but from there."""
        if self.phase == "idle" and self.run.rewound and method == "go_on":
            return self._start(self.run.kind, method)
        self.run.rewound = self.run.rewound and self.phase == "idle"
        return self._ask(method)

    def set_pace(self, factor: float | None) -> Future[Any]:
        """Run so many times as fast as the clock, 0.1 to 4; None: as fast as it can."""
        known = isinstance(factor, (int, float)) and SLOWEST <= factor <= FASTEST
        if factor is not None and not known:
            expected = f"{SLOWEST:g} to {FASTEST:g} times as fast as the clock, or None: as fast as it can"
            self._wrong(InvalidParameter("pace", quoted(factor), expected))
            return done(None)
        self.pace = factor
        self._tell("phase")
        return self._ask("pace", factor=factor)

    def rewind(self, time: float) -> Future[Any]:
        """Show a moment of what was run [s]; one less than a tick of the grid behind the last is the last."""
        over = float(time) - self.run.reach
        moment = self.run.reach if 0 < over <= (self.program.grid or GRID) else float(time)

        def shown(goes_on: Any) -> bool:
            self.run.time = moment
            if goes_on:
                self.run.start, self.run.rewound = self.run.time, True
            self._tell("tick")
            return True

        return self._queued("rewind", lambda: self._show_moment(moment, shown), _ANY)

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
        could_be = self._or_wrong(lambda: validated(Change, {"time": 0.0, **plain(change)}, "the change"))
        return self._ask(method, **plain(arguments)) if could_be else done(None)

    @property
    def _worn_feet(self) -> str | None:
        return self.config.robots[self.robot].feet or (self.model.feet.default if self.model.feet else None)
