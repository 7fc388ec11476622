"""Work that writes files, done on another core while this process goes on."""

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def in_background(work: Callable[[], object]) -> Iterator[None]:
    """Do work in a copy of this process while the body of a ``with`` statement runs; after it, where none can be made.

    Only the files that the work writes remain of it. Work that fails is done again here, where its errors are told; if
    the body fails, the work is broken off.
    """
    if not _can_copy():
        yield
        work()
        return
    copy = os.fork()
    if not copy:
        _work_and_leave(work)
    try:
        yield
        failed = os.waitpid(copy, 0)[1] != 0
    except BaseException:
        os.kill(copy, signal.SIGKILL)
        os.waitpid(copy, 0)
        raise
    if failed:
        work()


def _work_and_leave(work: Callable[[], object]) -> None:
    code = 1
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is the other's business
        gc.freeze()  # what came with it is no rubbish, nor to be copied by looking at it
        work()
        code = 0
    finally:
        os._exit(code)  # without what the other has still to write, or to tidy up


def _can_copy() -> bool:
    """Tell whether there is a second core, and no thread that a copy would lack, such as a notebook's."""
    return sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1 and len(os.listdir("/proc/self/task")) == 1
