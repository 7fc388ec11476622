"""What long work says of itself, on the error stream and only where somebody watches: a bar, and notes."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rich.console import Console  # it is loaded where something is said

REFRESH = 0.1  # time between two movements of a bar [s]
SELDOM = 60.0  # time between two remarks where there is no bar, as in a log [s]


def note(text: str, *, shown: bool) -> None:
    """Say something in a line, where somebody watches; ``shown`` False keeps silent."""
    if shown and (console := _console()).is_terminal:
        console.print(text, soft_wrap=True)


def _console() -> "Console":
    from rich.console import Console

    return Console(stderr=True, markup=False, emoji=False, highlight=False)


class Advance(Protocol):
    """What moves a bar."""

    def __call__(self, done: float, remark: str = "", /) -> None:
        """Move the bar to a value, and put a remark on the work beside it."""


@contextmanager
def progress_bar(text: str, total: float, *, shown: bool) -> Iterator[Advance | None]:
    """Show a bar up to ``total`` and give what moves it, None unless ``shown``; off a terminal, tell remarks."""
    if not shown:
        yield None
        return
    console = _console()
    if not console.is_terminal:
        said, unsaid = monotonic(), ""

        def remark_seldom(_: float, remark: str = "") -> None:
            nonlocal said, unsaid
            unsaid = remark
            if remark and monotonic() - said >= SELDOM:
                said, unsaid = monotonic(), ""
                console.print(f"{text}: {remark}", soft_wrap=True)

        try:
            yield remark_seldom
        finally:
            if unsaid:
                console.print(f"{text}: {unsaid}", soft_wrap=True)
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(text, total=total)
        last = 0.0

        def move(done: float, remark: str = "") -> None:
            nonlocal last
            if monotonic() - last > REFRESH:
                last = monotonic()
                bar.update(task, completed=done, description=f"{text}: {remark}" if remark else text)

        yield move
