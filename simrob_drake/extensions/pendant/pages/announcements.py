"""Announcements for screen readers: what a user without sight would otherwise have to search for on the page."""

from nicegui import ui

from simrob_drake.extensions.pendant.pages.elements import follow
from simrob_drake.extensions.pendant.pages.words import Notice, Words
from simrob_drake.extensions.pendant.session import Session

_ANNOUNCED_PHASES = ("opening", "running", "paused")
"""Phases that are announced when they begin. The end of a run is announced by its message, which says more."""


def first_sentence(notice: Notice, t: Words) -> str:
    """Text of a message that is announced: its own text, or the sentence that sums up a verdict.

    Args:
        notice: the message.
        t: texts in the language of the page.
    """
    if notice.key:
        return t(f"notice.{notice.key}", **notice.fills)
    if notice.remarks:
        return notice.lines(t.render)[0]
    return t.render(str(notice))


class Announcer:
    """An invisible text that screen readers read aloud when it changes, without moving the focus.

    Browsers read a live region again when its text changes. The messages below the view are not such a region: a
    verdict would be read with its whole table of criteria.
    """

    def __init__(self, session: Session, t: Words) -> None:
        """Build the text in the present place. It follows the session."""
        self._session = session
        self._t = t
        self._phase = session.phase
        self._text = ui.label().classes("pendant-unseen").props("role=status aria-live=polite")
        follow(session, self._announce_phase, "phase")
        follow(session, self._announce_message, "message")

    def _announce_phase(self) -> None:
        """Announce that a run begins or pauses, or that a station is loaded; then the message about it."""
        phase = self._session.phase
        if phase != self._phase:
            if phase in _ANNOUNCED_PHASES:
                self._text.text = self._t(f"phase.{phase}")
            else:
                self._announce_message()
        self._phase = phase

    def _announce_message(self) -> None:
        """Announce the last message of the session."""
        self._text.text = first_sentence(self._session.message, self._t)
