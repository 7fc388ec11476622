"""Commands in their order: one at a time, each in the phases that allow it; of those of a kind the newest waits."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from functools import partial
from typing import Any, NamedTuple

from simrob_drake.teach.run_client import RunClient

Action = Callable[[], Future[Any]]
Then = Callable[[], object]
MOVE = "move"
"""A kind of command: what has the robot move, or stand elsewhere."""


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

        return self._client.ask(method, lambda result: over(lambda: then(result)), lambda: over(failed), **arguments)

    def set_phase(self, of_run: str) -> None:
        """Take the phase of the run."""
        self.of_run = of_run
        self._show_phase()

    def _show_phase(self) -> None:
        """Tell what is under way, else the phase of the run; and begin what waits, if it can be."""
        self._client.show_phase(next(reversed(self.under_way), self.of_run))
        while not self._begins and (fits := self._that_fit()):
            self._begins = True  # each is asked for before the next one
            begun = self.waiting.pop(fits[0])
            try:
                begun.begin().add_done_callback(partial(_pass_on, begun.answer))
            except BaseException as problem:
                _answer(begun.answer, problem)
                raise
            finally:
                self._begins = False

    def _that_fit(self) -> list[str]:
        return [kind for kind, one in self.waiting.items() if self._client.phase in one.phases]

    def forget(self, *kinds: str) -> None:
        """Answer commands of some kinds that wait, of all unless named, by None: they are not done."""
        for kind in self.waiting.keys() & (kinds or {*self.waiting}):
            _answer(self.waiting.pop(kind).answer, None)


def _pass_on(answer: Future[Any], done: Future[Any]) -> None:
    if done.cancelled():
        _answer(answer, CancelledError())
    else:
        problem = done.exception()
        _answer(answer, done.result() if problem is None else problem)


def _answer(answer: Future[Any], result: Any) -> None:
    """Answer by a result or a problem, unless who asked has left."""
    if not answer.set_running_or_notify_cancel():
        return
    if isinstance(result, BaseException):
        answer.set_exception(result)
    else:
        answer.set_result(result)
