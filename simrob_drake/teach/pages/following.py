"""How a part of a page follows its session: in the page's loop, no faster than an eye, and only the latest counts."""

from collections.abc import Callable
from typing import Protocol

from nicegui import context, core

_PAUSE = 0.05
"""From one look at the session to the next [s]."""


class Telling(Protocol):
    """What tells listeners, in any thread, of which topic something has changed."""

    def listen(self, callback: Callable[[str], None]) -> Callable[[], None]:
        """Call a function with each topic from now on, until what is returned is called."""


def follow(telling: Telling, update: Callable[[], object], *topics: str) -> None:
    """Let a part of the present page be updated after changes of some topics, as long as the page is there.

    Call it where the part is built: the update may make and change elements as the code there may.

    Args:
        telling: what tells of the changes, such as the session.
        update: what brings the part up to date; several changes in a twentieth of a second are one to it.
        topics: all unless some are named.
    """
    place, client, loop = context.slot.parent, context.client, core.loop
    waiting = False

    def hear(topic: str) -> None:  # in the session's thread
        if loop is not None and not loop.is_closed() and (not topics or topic in topics):
            loop.call_soon_threadsafe(wait)

    def wait() -> None:
        nonlocal waiting
        if not waiting and loop is not None:
            waiting = True
            loop.call_later(_PAUSE, look)

    def look() -> None:
        nonlocal waiting
        waiting = False
        if client.is_deleted or place.is_deleted:
            forget()
            return
        with place:
            try:
                update()
            except Exception as problem:
                core.app.handle_exception(problem)

    forget = telling.listen(hear)
    client.on_delete(forget)
