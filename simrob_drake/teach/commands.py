"""Commands in their order: one at a time, each in the phases that allow it; of those of a kind the newest waits."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from functools import partial
from typing import Any, NamedTuple

Action = Callable[[], Future[Any]]


class Waiting(NamedTuple):
    """A command that is not begun yet, the phases in which it can be, and what it is answered by."""

    begin: Action
    phases: tuple[str, ...]
    answer: Future[Any]


class Commands:
    """What waits, and what is under way without a run.

    Attributes:
        waiting: what is not begun yet, by its kind.
        under_way: phases, each as long as a command has it: ``rewinding`` and ``saving``.
    """

    def __init__(self) -> None:
        """Begin with nothing to do."""
        self.waiting: dict[str, Waiting] = {}
        self.under_way: list[str] = []
        self._begins = False

    def wait(self, kind: str, begin: Action, phases: tuple[str, ...]) -> Future[Any]:
        """Let a command wait, in place of an older one of its kind, whose future gives None."""
        self.forget(kind)
        answer: Future[Any] = Future()
        self.waiting[kind] = Waiting(begin, phases, answer)
        return answer

    def begin(self, phase: Callable[[], str]) -> None:
        """Begin what waits, in its order, as far as the phase allows it; each is asked for before the next one."""
        while not self._begins and (fits := [kind for kind, one in self.waiting.items() if phase() in one.phases]):
            self._begins = True
            begun = self.waiting.pop(fits[0])
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
