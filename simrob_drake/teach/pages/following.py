"""How a part of a page follows its session: no faster than an eye, and only the latest counts."""

import asyncio
from collections.abc import Callable
from typing import Any

from nicegui import context, core

_PAUSE = 0.05
"""From one look at the session to the next [s]."""


def follow(session: Any, update: Callable[[], object], *topics: str) -> None:
    """Update a part of the present page now, and after changes of some topics as long as the page is there.

    Call it where the part is built: the update may make and change elements as the code there may.

    Args:
        session: what tells of the changes, in the server's thread.
        update: what brings the part up to date; several changes in a twentieth of a second are one to it.
        topics: of the session's; all unless some are named.
    """
    place, client = context.slot.parent, context.client
    waiting = False

    def hear(topic: str) -> None:
        nonlocal waiting
        if not waiting and (not topics or topic in topics):
            waiting = True
            asyncio.get_running_loop().call_later(_PAUSE, look)

    def look() -> None:
        nonlocal waiting
        waiting = False
        if client.is_deleted or place.is_deleted:
            forget()
            return
        with place:
            try:
                update()
            except Exception as problem:  # else nobody hears of it
                core.app.handle_exception(problem)

    forget = session.listen(hear)
    client.on_delete(forget)
    update()
