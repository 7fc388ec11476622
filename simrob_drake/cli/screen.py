"""Where the commands write to, and what an interrupt by the user, Ctrl-C, does while files are written."""

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import current_thread, main_thread

from rich.console import Console
from rich.table import Table
from rich.text import Text

from simrob_drake.base.errors import shortened

_LONGEST = 2000
console = Console(markup=False, emoji=False, width=None if sys.stdout.isatty() else 160)
errors = Console(markup=False, emoji=False, stderr=True, soft_wrap=True)


def say(text: str | Text) -> None:
    """Write a line as it is, however long."""
    console.print(text, soft_wrap=True, highlight=False)


def table(headings: Sequence[str], *rows: Sequence[str | Text], title: str = "", numbers: bool = True) -> Table:
    """Return rows of cells below their headings; of ``numbers`` all columns but the first are to the right."""
    found = Table(box=None, pad_edge=False, title=title or None)
    for place, heading in enumerate(headings):
        found.add_column(Text(heading), justify="right" if numbers and place else "left")  # as text [s] is no mark-up
    for row in rows:
        found.add_row(*row)
    return found


def tell(text: str) -> None:
    """Say something on the error stream, in one line."""
    print(f"simrob: {shortened(text, _LONGEST)}", file=sys.stderr, flush=True)


class Interrupted(Exception):
    """The user interrupted a command; the text says what became of its work, and no command catches it."""


@contextmanager
def finished_first(work: str) -> Iterator[Callable[[], bool]]:
    """Let ``work`` be finished though the user interrupts it; yields what tells whether he did.

    Raises Interrupted: he did so twice; the work is then not done.
    """
    times = 0

    def hear(*_: object) -> None:
        nonlocal times
        times += 1
        if times == 1:
            tell(f"interrupted; {work} are being finished, interrupt again to abandon them")
        elif times == 2:  # what comes then must not keep it from tidying up
            raise KeyboardInterrupt

    if current_thread() is not main_thread() or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield lambda: False
        return
    signal.signal(signal.SIGINT, hear)
    try:
        yield lambda: times > 0
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted; {work} are abandoned, nothing was saved") from None
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
