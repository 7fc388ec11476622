"""A station in a process of its own: the pendant's side of it, and what the process does until its parent is gone."""

import multiprocessing
import os
import signal
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from itertools import count
from multiprocessing.connection import Connection
from socket import SHUT_RDWR, socket
from threading import Lock, Thread
from typing import Any

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import compound, message
from simrob_drake.extensions.pendant.bench import ALONE, Bench
from simrob_drake.extensions.pendant.run_pacer import Inbox, News, Rewound, RunLost

_PATIENCE = 2.0  # s that a process has to end by itself


class Live:
    """A station in a process of its own: whatever becomes of it, who asks for something gets an answer."""

    def __init__(self, on_news: Callable[[News], object]) -> None:
        """Start the process; ``on_news`` is called in a thread of its own with what it tells."""
        spawn = multiprocessing.get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=main, args=(theirs,), name="simrob teach", daemon=True)
        self._process.start()
        theirs.close()
        self._on_news, self._numbers, self._lock = on_news, count(), Lock()
        # of its own: answers are taken while something long waits to be read
        self._sending = Lock()
        self._unanswered: dict[int, Future[Any]] = {}
        self._open = True
        Thread(target=self._listen, daemon=True).start()

    @property
    def pid(self) -> int | None:
        """The number of the process."""
        return self._process.pid

    def call(self, method: str, /, **arguments: Any) -> Future[Any]:
        """Ask for something; the future has the result, or a SimrobError."""
        future: Future[Any] = Future()
        with self._lock:
            number = next(self._numbers)
            self._unanswered[number] = future
        try:
            with self._sending:
                self._pipe.send((number, method, arguments))
        except (OSError, ValueError):
            with self._lock:
                unanswered = self._unanswered.pop(number, None)
            if unanswered is not None:
                unanswered.set_exception(RunLost())
        return future

    def close(self) -> None:
        """End the process; who listens closes the pipe, whose number a new one could have by then."""
        self._open = False
        with suppress(OSError), socket(fileno=os.dup(self._pipe.fileno())) as end:
            end.shutdown(SHUT_RDWR)
        Thread(target=self._end, daemon=True).start()

    def _end(self) -> None:
        self._process.join(_PATIENCE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _listen(self) -> None:
        try:
            while True:
                message = self._pipe.recv()
                if "news" in message:
                    self._on_news(message)
                else:
                    self._answer(message)
        except (EOFError, OSError):
            pass
        finally:  # whatever it was, nothing more will be answered
            self._pipe.close()
            self._lost()

    def _answer(self, message: dict[str, Any]) -> None:
        with self._lock:
            future = self._unanswered.pop(message["answer"])
        if message["wrong"] is None:
            future.set_result(message["result"])
        else:
            future.set_exception(SimrobError(message["wrong"]))

    def _lost(self) -> None:
        """Answer all that was asked, and tell why the process ended, unless it was to."""
        with self._lock:
            asked, self._unanswered = self._unanswered, {}
        for future in asked.values():
            future.set_exception(RunLost())
        if self._open:
            self._process.join(_PATIENCE)
            code = self._process.exitcode
            self._on_news(
                {
                    "news": "died",
                    "why": message(
                        "pendant.killed_by_signal", "killed by signal {code}", code=-code
                    )
                    if code and code < 0
                    else message("pendant.exit_code", "code {code}", code=code),
                }
            )


Request = tuple[int, str, dict[str, Any]]


def main(pipe: Connection) -> None:
    """Serve a pipe until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    inbox = Inbox(pipe)
    bench = Bench(inbox, lambda bench: serve(bench, inbox))
    try:
        while True:
            while not (messages := inbox.take()):
                inbox.wait(None)
            for other in messages[1:]:  # a run that the first one begins takes them
                inbox.put_back(other)
            answer(bench, inbox, messages[0])
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


def serve(bench: Bench, inbox: Inbox) -> None:
    """Do what can be done while a station runs; what cannot ends the run, and is done then."""
    messages = inbox.take()
    for place, request in enumerate(messages):
        if bench.pacer.stopping or request[1] in ALONE:
            bench.pacer.stopping = True
            inbox.put_back(request)
            continue
        try:
            answer(bench, inbox, request)
        except Rewound:
            for other in messages[place + 1 :]:
                inbox.put_back(other)
            raise


def answer(bench: Bench, inbox: Inbox, request: Request) -> None:
    """Do what was asked for, and answer with its result or with what is wrong."""
    number, method, arguments = request
    try:
        result = bench.find(method)(**arguments)
    except SimrobError as problem:
        inbox.answer(number, wrong=str(problem))
    except Rewound:
        inbox.answer(number)
        raise
    except Exception as problem:
        inbox.answer(
            number,
            wrong=compound("{name}: {problem}", name=type(problem).__name__, problem=problem),
        )
    else:
        inbox.answer(number, result)
