"""Progress bars and notes about long work, on the error stream.

A terminal shows a bar. Other streams, such as a log file, get a line with the last remark now and then.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    # Rich takes long to load, so it is imported by the functions that need it.
    from rich.console import Console

REFRESH = 0.1
"""Least time between two changes of a bar [s]."""

SELDOM = 60.0
"""Least time between two lines of a log [s]."""


def note(text: str, *, shown: bool) -> None:
    """Write a line on the terminal. Nothing is written if the error stream is no terminal.

    Args:
        text: the line.
        shown: whether to write at all.
    """
    if not shown:
        return
    console = _console()
    if console.is_terminal:
        # With soft wrapping the terminal breaks a long line, so that a path in it can be copied as a whole.
        console.print(text, soft_wrap=True)


def _console() -> "Console":
    """Console of the error stream. It writes texts without markup and colours."""
    from rich.console import Console

    return Console(stderr=True, markup=False, emoji=False, highlight=False)


class Advance(Protocol):
    """Function that moves a progress bar."""

    def __call__(self, done: float, remark: str = "", /) -> None:
        """Move the bar to a value, and show a remark about the work next to it. An empty remark shows none."""


@contextmanager
def progress_bar(text: str, total: float, *, shown: bool) -> Iterator[Advance | None]:
    """Context manager that shows a progress bar, or writes remarks to a log, until its body is done.

    Args:
        text: name of the work.
        total: value at which the work is done.
        shown: whether anything is shown.

    Yields:
        the function that moves the bar; None if ``shown`` is False.
    """
    if not shown:
        yield None
        return
    console = _console()
    if console.is_terminal:
        with _bar_on_terminal(text, total, console) as advance:
            yield advance
    else:
        with _lines_of_log(text, console) as advance:
            yield advance


@contextmanager
def _bar_on_terminal(text: str, total: float, console: "Console") -> Iterator[Advance]:
    """Context manager that shows a bar on a terminal. Yields the function that moves it."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(text, total=total)
        last_change = 0.0  # of the monotonic clock [s]

        def move(done: float, remark: str = "") -> None:
            """Move the bar, unless it was moved a moment ago."""
            nonlocal last_change
            # Formatting the bar takes longer than a step of a small station.
            if monotonic() - last_change > REFRESH:
                last_change = monotonic()
                description = f"{text}: {remark}" if remark else text
                bar.update(task, completed=done, description=description)

        yield move


@contextmanager
def _lines_of_log(text: str, console: "Console") -> Iterator[Advance]:
    """Context manager that writes remarks to a log now and then. Yields the function that takes them.

    At the end of the body, the last remark is written if it was not written before.
    """
    last_line = monotonic()  # time of the last line [s]
    waiting_remark = ""  # the last remark, if it was not written yet

    def take(_: float, remark: str = "") -> None:
        """Write a remark, unless a line was written a short time ago."""
        nonlocal last_line, waiting_remark
        waiting_remark = remark
        if remark and monotonic() - last_line >= SELDOM:
            last_line = monotonic()
            waiting_remark = ""
            console.print(f"{text}: {remark}", soft_wrap=True)

    try:
        yield take
    finally:
        if waiting_remark:
            console.print(f"{text}: {waiting_remark}", soft_wrap=True)
