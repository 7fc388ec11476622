"""The pendant's side of the process in which a station runs."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from concurrent.futures import Future
from itertools import count
from threading import Lock, Thread
from typing import Any

from simrob_drake.errors import SimrobError
from simrob_drake.teach.messages import News, RunLost
from simrob_drake.teach.worker import main

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
        self._asked: dict[int, Future[Any]] = {}
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
            self._asked[number] = future
            try:
                self._pipe.send((number, method, arguments))
            except (OSError, ValueError):
                self._asked.pop(number)
                future.set_exception(RunLost())
        return future

    def close(self) -> None:
        """End the process."""
        self._open = False
        self._pipe.close()
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
        except (EOFError, OSError, TypeError):  # TypeError: the pipe was closed while it was read
            self._lost()

    def _answer(self, message: dict[str, Any]) -> None:
        with self._lock:
            future = self._asked.pop(message["answer"])
        if message["wrong"] is None:
            future.set_result(message["result"])
        else:
            future.set_exception(SimrobError(message["wrong"]))

    def _lost(self) -> None:
        """Answer all that was asked, and tell why the process ended, unless it was to."""
        with self._lock:
            asked, self._asked = self._asked, {}
        for future in asked.values():
            future.set_exception(RunLost())
        if self._open:
            self._process.join(_PATIENCE)
            code = self._process.exitcode
            self._on_news({"news": "died", "why": f"killed by signal {-code}" if code and code < 0 else f"code {code}"})
