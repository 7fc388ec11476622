"""Interrupts by the user (Ctrl-C) while a library works that would swallow them."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from typing import Any


@contextmanager
def heard_afterwards() -> Iterator[None]:
    """Context manager that handles an interrupt only after its body, which should be short.

    It is for libraries that take an interrupt for an error of their own: trimesh catches every exception while it loads
    optional packages and continues, and an interrupt while compiled modules are loaded may arrive as any error.
    """
    handler: Any = signal.getsignal(signal.SIGINT)
    # Python delivers interrupts to the main thread. The handler is no function if interrupts are ignored.
    if current_thread() is not main_thread() or not callable(handler):
        yield
        return
    # Several interrupts in the body count as one: the user presses the keys again because nothing seems to happen.
    interrupts: list[tuple[Any, ...]] = []  # arguments of the handler for each interrupt
    signal.signal(signal.SIGINT, lambda *arguments: interrupts.append(arguments))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if interrupts:
            handler(*interrupts[0])
