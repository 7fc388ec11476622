"""The client of the run in a process of its own, and those who listen to it. Nothing here waits."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any, Literal, Protocol, TypeVar

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.remarks import Remark
from simrob_drake.extensions.pendant.pages.words import Notice
from simrob_drake.extensions.pendant.run import TaughtRun
from simrob_drake.extensions.pendant.run_pacer import News, RunLost

Made = TypeVar("Made")
Topic = Literal[
    "program", "phase", "tick", "message", "description", "history", "hand", "inspected"
]
MakeLive = Callable[[Callable[[News], None]], "Running"]
HandOver = Callable[[Callable[[], None]], object]
Viewer = Callable[[str, list[dict[str, Any]]], object]

_DEATHS, _SOON = 3, 60.0  # so many in so many seconds, and it is not started again by itself


class Running(Protocol):
    """A run in a process of its own, as :class:`~simrob_drake.extensions.pendant.live.Live`."""

    def call(self, method: str, /, **arguments: Any) -> Future[Any]:
        """Ask for something; the future has the result, or a SimrobError."""

    def close(self) -> object:
        """End it."""


class RunClient:
    """Asks the run, takes its news, and tells listeners what changed.

    Attributes:
        description: of the station, as ``Live.open`` gives it; empty until it is there. Its ``loops``, ``{name, on}``,
            can be switched.
        phase: ``opening``, ``idle``, ``running``, ``paused``, ``rewinding``, ``saving`` or ``gone``.
        run: what was run since the start of the station, to be looked at.
        pace: asked for; None: as fast as it can.
        message: the last thing to tell; ``str(message)`` is English, ``message.key`` tells pages which.
        takes: what takes news, by their kind; who runs something has its own there.
    """

    def __init__(self, live: MakeLive | None = None, hand_over: HandOver | None = None) -> None:
        """Begin without a run; see :meth:`Session.open` for the arguments."""
        self._make_live = live
        self._live: Running | None = None
        self._generation = 0
        self._deaths: deque[float] = deque(maxlen=_DEATHS)
        self._waiting: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._hand_over = hand_over or self._waiting.put
        self._listeners: list[tuple[Callable[[Topic], object], tuple[Topic, ...]]] = []
        self._viewers: list[Viewer] = []
        self._watched: dict[object, tuple[str, ...]] = {}
        self.takes: dict[str, Callable[[News], object]] = {
            "view": self._viewed,
            "tick": self._ticked,
            "warned": lambda news: self.say(Notice.of_remarks([Remark("warning", news["text"])])),
        }
        self.description: dict[str, Any] = {}
        self.phase, self.run = "opening", TaughtRun()
        self.pace: float | None = 1.0
        self.message = Notice()

    def hear(self, timeout: float = 0.0) -> None:
        """Take the news that have come, waiting for the first so long [s]: for scripts, which hand nothing over."""
        with suppress(Empty):
            news = self._waiting.get(timeout > 0, timeout or None)
            while True:
                news()
                news = self._waiting.get_nowait()

    def close(self) -> None:
        """End the run and its process."""
        self._generation += 1
        live, self._live, self.phase = self._live, None, "gone"
        if live is not None:
            live.close()

    def listen(self, callback: Callable[[Topic], object], *topics: Topic) -> Callable[[], None]:
        """Let something be called after each change with what changed, of some topics or all; returns what ends that.

        ``program``: program, pending, undo, targets; ``description``: description and settings.
        """
        return _enlisted(self._listeners, (callback, topics))

    def listen_to_view(self, callback: Viewer) -> Callable[[], None]:
        """Let something be told of a subject of the view and the commands that show it; returns what ends that."""
        return _enlisted(self._viewers, callback)

    def watch(self, signals: Any, viewer: object = None) -> Future[Any]:
        """Have these signals in ``values`` and ``history``, beside those of other viewers; none ends it for one."""
        self._watched = {**self._watched, viewer: tuple(signals)}
        if not self._watched[viewer]:
            del self._watched[viewer]
        names = list(dict.fromkeys(name for own in self._watched.values() for name in own))
        self.run.watch(names)
        self.tell("history")
        # else it is told these first
        return done() if self._live is None else self.ask("watch", signals=names)

    # The run

    def open(
        self, then: Callable[[dict[str, Any]], Any], failed: Callable[[], object], **how: Any
    ) -> Future[Any]:
        """Open a station in the run, which is started if it is not there.

        ``then`` takes its description, ``failed`` is called if it cannot be opened, ``how`` is for ``Live.open``.
        """
        if self._live is None:
            self._generation += 1
            here = self._generation
            if self._make_live is None:
                # which who brings another run does without
                from simrob_drake.extensions.pendant.live import (
                    Live,
                )

                self._make_live = Live
            self._live = self._make_live(
                lambda news: self._later(
                    lambda: self._take(news) if here == self._generation else None
                )
            )
        opened = self.ask("open", then, failed, **how)
        self.ask("pace", factor=self.pace)
        self.watch(self._watched.get(None, ()))
        return opened

    def show_start(self, description: dict[str, Any]) -> None:
        """Take the description of a station that was opened; it stands at its start."""
        self.description = description
        if self.run.lost:  # it can be looked at all the same
            self.ask("rewind", time=self.run.time, positions=self.run.moments.at(self.run.time))
        else:
            self.run.take(0.0, self.run.moments.at(0.0), {})
        self.tell("description")

    def ask(
        self,
        method: str,
        then: Callable[[Any], Any] = lambda result: True if result is None else result,
        failed: Callable[[], object] = lambda: None,
        **arguments: Any,
    ) -> Future[Any]:
        """Ask the run for something by a method and its arguments.

        ``then`` makes of its result that of the future; a future of its own is waited for. ``failed`` is called where
        something is wrong, after it was told.
        """
        answer: Future[Any] = Future()
        answer.set_running_or_notify_cancel()  # a page that leaves does not take it back: it will be answered
        if self._live is None:
            self.say(Notice("gone", wrong=True))
            failed()
            answer.set_result(None)
            return answer
        asked = self._live.call(method, **arguments)

        def finish() -> None:
            result = None
            try:
                result = then(asked.result())
            except RunLost:
                pass  # of which news come, too
            except SimrobError as problem:
                self.wrong(problem)
                failed()
            finally:  # a fault of ours, too, leaves nobody waiting
                if isinstance(result, Future):
                    result.add_done_callback(lambda done: answer.set_result(done.result()))
                else:
                    answer.set_result(result)

        asked.add_done_callback(lambda _: self._later(finish))
        return answer

    def _later(self, action: Callable[[], None]) -> None:
        with suppress(RuntimeError):  # the page's loop has ended
            self._hand_over(action)

    def _take(self, news: News) -> None:
        if (take := self.takes.get(news["news"])) is not None:
            take(news)

    def _viewed(self, news: News) -> None:
        for viewer in list(self._viewers):
            viewer(news["subject"], news["commands"])

    def _ticked(self, news: News) -> None:
        if not self.run.lost:  # else it is of the next one, which is being opened
            self.run.take(news["time"], news.get("positions"), news["values"], news["ratio"])
            self.tell("tick")

    def died(self, why: str) -> bool:
        """Tell that the run died; return whether it may be started again, for that has helped so far."""
        live, self._live, self.description = self._live, None, {}
        if live is not None:
            live.close()
        now = monotonic()
        often = len(self._deaths) == _DEATHS and now - self._deaths[0] < _SOON
        self._deaths.append(now)
        self.say(Notice("lost" if often else "died", {"why": why}, wrong=True))
        return not often

    # Telling

    def show_phase(self, phase: str) -> None:
        """Tell a phase that is new."""
        if phase != self.phase:
            self.phase = phase
            self.tell("phase")

    def tell(self, topic: Topic) -> None:
        """Let listeners know that something has changed."""
        for callback, topics in list(self._listeners):
            if not topics or topic in topics:
                callback(topic)

    def say(self, notice: Notice) -> None:
        """Tell something in words."""
        self.message = notice
        self.tell("message")

    def or_wrong(self, make: Callable[[], Made]) -> Made | None:
        """Return what is made; None where something is wrong, which is told."""
        try:
            return make()
        except SimrobError as problem:
            self.wrong(problem)
            return None

    def refuse(self, key: str, **fills: Any) -> bool:
        """Tell why something was not done; return False."""
        self.say(Notice(key, fills, wrong=True))
        return False

    def wrong(self, problem: object) -> None:
        """Tell what is wrong."""
        self.say(Notice(fills={"text": str(problem)}, wrong=True))


def done(result: Any = True) -> Future[Any]:
    """Return what is there already; None of what was wrong."""
    future: Future[Any] = Future()
    future.set_result(result)
    return future


def _enlisted(listeners: list[Any], listener: Any) -> Callable[[], None]:
    listeners.append(listener)

    def forget() -> None:
        with suppress(ValueError):
            listeners.remove(listener)

    return forget
