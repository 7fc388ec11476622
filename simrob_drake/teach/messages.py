"""What the pendant's process and the one that runs a station tell each other: plain data over a pipe."""

from multiprocessing.connection import Connection
from typing import Any

from simrob_drake.errors import SimrobError

News = dict[str, Any]


class RunLost(SimrobError):
    """What was asked for will not be answered: the process that runs the station has ended."""

    def __init__(self) -> None:
        """Say so."""
        super().__init__("the process that runs the station has ended")


class Inbox:
    """What was asked for and not answered yet, in its order: a number, a method and its arguments."""

    def __init__(self, pipe: Connection) -> None:
        """Read from a pipe; EOFError there means that the other process is gone, and ends this one."""
        self._pipe = pipe
        self._waiting: list[tuple[int, str, dict[str, Any]]] = []

    def wait(self, timeout: float | None) -> None:
        """Wait for a message, at most so long [s]; for ever if None."""
        if self._pipe.poll(timeout):
            self._waiting.append(self._pipe.recv())

    def take(self) -> list[tuple[int, str, dict[str, Any]]]:
        """Return all that has come, and forget it."""
        while self._pipe.poll(0):
            self._waiting.append(self._pipe.recv())
        taken, self._waiting = self._waiting, []
        return taken

    def put_back(self, message: tuple[int, str, dict[str, Any]]) -> None:
        """Leave a message for later."""
        self._waiting.append(message)

    def answer(self, number: int, result: Any = None, wrong: str | None = None) -> None:
        """Answer what was asked for under a number: by a result, or by what is wrong in words."""
        self._pipe.send({"answer": number, "result": result, "wrong": wrong})

    def tell(self, news: str, **more: Any) -> None:
        """Tell news."""
        self._pipe.send({"news": news, **more})
