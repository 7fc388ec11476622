"""Where an arm is, as its page knows it: asked again whenever something may have moved."""

from asyncio import wrap_future
from collections.abc import Callable
from typing import Any

from nicegui import background_tasks, context

from simrob_drake.teach.pages.following import follow
from simrob_drake.teach.session import Session


class Whereabouts:
    """What :func:`simrob_drake.teach.arm_questions.where` says of the arm that is taught.

    Attributes:
        frame: in which the page wants its tool's pose.
        told: the last answer; empty until there is one.
    """

    def __init__(self, session: Session) -> None:
        """Ask, now and after each run."""
        self.frame = "base"
        self.told: dict[str, Any] = {}
        self._session, self._client = session, context.client
        self._hearers: list[Callable[[], object]] = []
        self._asking = self._again = False
        follow(session, self.ask, "phase", "description")

    def heard(self, hearer: Callable[[], object]) -> None:
        """Call something after each answer, which may have moved on since."""
        self._hearers.append(hearer)

    def ask(self) -> None:
        """Ask, or once more after the answer that is awaited."""
        self._again = self._asking
        if not self._asking and self._session.phase == "idle":
            background_tasks.create(self.asked())

    async def asked(self) -> None:
        """Ask, and wait until all who are to hear the answer have."""
        self._asking = True
        try:
            told = await wrap_future(self._session.where(self.frame))
        finally:
            self._asking = False
        if self._client.is_deleted:
            return
        if told:
            self.told = told
            for hearer in self._hearers:
                hearer()
        if self._again:
            self.ask()
