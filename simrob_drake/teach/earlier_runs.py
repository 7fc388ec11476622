"""Runs that have ended, looked at again: one in place of the present run, and one beside it, as a ghost in the view."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from simrob_drake.errors import InvalidParameter, quoted
from simrob_drake.teach.move_runner import Commands
from simrob_drake.teach.run import EndedRun
from simrob_drake.teach.run_client import RunClient, done


class EarlierRuns:
    """Shows those of ``run.ended``; what is run next is shown in their place."""

    def __init__(self, client: RunClient, commands: Commands, to_present: Callable[[float], Future[Any]]) -> None:
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
        expected = f"one of {', '.join(map(str, known))}" if known else "one that has ended; none has"
        raise InvalidParameter("run", quoted(number), expected)

    def _follow(self, *, anew: bool = False) -> None:
        """Let the ghost be where it was at the moment that is shown; one word at a time is on its way to the view."""
        run = self._client.run
        if self._asked or (run.compared is None and not anew) or self._client.phase in ("opening", "gone"):
            return
        other, time, self._asked = run.compared, run.time, True

        def over(_: object = None) -> None:
            self._asked = False
            if run.compared is not other or run.time != time:
                self._follow(anew=True)

        positions = None if other is None else other.moments.at(other.within(time))
        self._client.ask("compare", over, over, positions=positions)
