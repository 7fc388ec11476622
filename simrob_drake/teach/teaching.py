"""Teaching a program: moves are tried, stored and run. It knows no arm's lines, and no page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Any, cast

from simrob_drake.programs.legged_gait import step_moves
from simrob_drake.programs.moves import (
    MOVE_TIME,
    Act,
    ActMove,
    Attach,
    AttachMove,
    JointMove,
    Release,
    ReleaseMove,
    Walk,
    WalkMove,
    checked,
    move_of,
)
from simrob_drake.teach.notices import Notice
from simrob_drake.teach.taught import Taught, entry_of
from simrob_drake.teach.trying import Trying


class Teaching(Trying):
    """What the thesis's console does: Test, Add, Simulate, Discard, Reset, Step and Walk."""

    def test(self, targets_deg: Mapping[str, float], duration: float | None = None) -> Future[Any]:
        """Try a move of axes [deg or m], together with those tested before it since the last :meth:`add`.

        All go together, in the same time [s], from where the robot was before the first; that of the last test unless
        given. Nothing is stored.
        """
        now = self._history.present
        before = cast(JointMove, now.pending[-1]).duration if now.joins else MOVE_TIME

        def tested() -> Taught:
            move = move_of(targets_deg, before if duration is None else duration)
            self._looked_at(move)
            return now.with_tested(move)

        return self._try(tested)

    def step(self) -> Future[Any]:
        """Try one step (Paso): it waits for :meth:`add` or :meth:`discard`, as a tested move."""
        return self._try_moves(lambda: step_moves(self.model, self._worn_feet))

    def walk(self, steps: int, amplitude: float = 1.0, gait: str | None = None, **changes: Any) -> Future[Any]:
        """Try to walk, likewise."""
        walk = {"steps": steps, "amplitude": amplitude, "gait": gait, **changes}
        return self._try_moves(lambda: [WalkMove(walk=checked(Walk, **walk))])

    def act(self, name: str, **changes: Any) -> Future[Any]:
        """Try an act, likewise."""
        return self._try_moves(lambda: [ActMove(act=checked(Act, name=name, **changes))])

    def wait(self, seconds: float) -> Future[Any]:
        """Try to stand still for a time [s], likewise."""
        return self._try_moves(lambda: [entry_of({"wait": seconds})])

    def play(self, seconds: float) -> Future[Any]:
        """Try what the station's own references do for a time [s], likewise."""
        return self._try_moves(lambda: [entry_of({"play": seconds})])

    def attach(
        self, piece: str, tool: str | None = None, *, pose: Sequence[float] | None = None, robot: str | None = None
    ) -> Future[Any]:
        """Take a piece, likewise; ``pose`` [x y z Rz Ry Rx] puts it into the hand."""
        whose = robot or (self.robot if len(self.config.robots) > 1 else None)
        content = {"piece": piece, "tool": tool, "pose": pose, "robot": whose}
        return self._try_moves(lambda: [AttachMove(attach=checked(Attach, **content))])

    def release(self, piece: str, parent: str = "world", *, fixed: bool = False) -> Future[Any]:
        """Let go of a piece, likewise."""
        content = {"piece": piece, "parent": parent, "fixed": fixed}
        return self._try_moves(lambda: [ReleaseMove(release=checked(Release, **content))])

    def add(self) -> bool:
        """Store what was tested."""
        if not self._history.present.pending:
            return self._refused("nothing_tested")
        self._record(self._history.present.added())
        self._course.settled()
        return True

    def discard(self) -> Future[Any]:
        """Forget what was tested, and go back to before it."""
        self._record(self._history.present.discarded())
        return self._idly(self._go_back)

    def simulate(self) -> Future[Any]:
        """Run all that is stored from the start; of an empty program what the station's file asks for."""
        return self._idly(self._play)

    def reset(self) -> Future[Any]:
        """Erase the program and go back to the start; :meth:`undo` brings it back."""
        self._record(self._history.present.discarded().but(program=Taught().program))
        self._say(Notice("reset"))
        return self.restart()

    def restart(self) -> Future[Any]:
        """Go back to the start; the program stays."""
        return self._idly(self._restart)

    @property
    def _worn_feet(self) -> str | None:
        return self.config.robots[self.robot].feet or (self.model.feet.default if self.model.feet else None)
