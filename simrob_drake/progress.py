"""What long work says of itself, on the error stream and only where somebody watches: a bar, and notes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

REFRESH = 0.1
"""Time between two movements of a bar [s]."""


def note(text: str, *, shown: bool) -> None:
    """Say something in a line, where somebody watches; ``shown`` False keeps silent."""
    console = Console(stderr=True, markup=False, emoji=False, highlight=False)
    if shown and console.is_terminal:
        console.print(text, soft_wrap=True)


@contextmanager
def progress_bar(text: str, total: float, *, shown: bool) -> Iterator[Callable[[float], None] | None]:
    """Show a bar and give a function that moves it to a value; None where nobody watches.

    Args:
        text: what the work is.
        total: the value at its end.
        shown: False keeps silent.
    """
    console = Console(stderr=True)
    if not shown or not console.is_terminal:
        yield None
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(text, total=total)
        last = 0.0

        def move(done: float) -> None:
            nonlocal last
            if monotonic() - last > REFRESH:
                last = monotonic()
                bar.update(task, completed=done)

        yield move
