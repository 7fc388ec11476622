"""Ctrl-C while a library works that would swallow it."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from typing import Any


@contextmanager
def heard_afterwards() -> Iterator[None]:
    """Let an interrupt by the user wait until short work of a library is done that takes any exception for its own.

    trimesh goes on after ``except BaseException``, also while it loads what it might need, and an interrupt in the
    loading of compiled modules may come as any error.
    """
    hear: Any = signal.getsignal(signal.SIGINT)
    if current_thread() is not main_thread() or not callable(hear):  # nobody interrupts threads, or it is ignored
        yield
        return
    pressed: list[tuple[Any, ...]] = []
    signal.signal(signal.SIGINT, lambda *arguments: pressed.append(arguments))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, hear)
        if pressed:
            hear(*pressed[0])
