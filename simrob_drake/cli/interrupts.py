"""What an interrupt by the user, Ctrl-C, does while files are written: they are finished first."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread

from simrob_drake.cli.screen import tell


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
