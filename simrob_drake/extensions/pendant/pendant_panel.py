"""Panels: tabs that extensions add to the pendant's page."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from simrob_drake.base.messages import message

if TYPE_CHECKING:  # these import NiceGUI
    from simrob_drake.extensions.pendant.pages.words import Words
    from simrob_drake.extensions.pendant.session import Session


@dataclass(frozen=True, kw_only=True)
class PendantPanel:
    """A tab of the pendant's page, beside those of the robot and of the station.

    Attributes:
        titles: titles of the tab by language, such as ``{"en": "Temperatures", "es": "Temperaturas"}``. English is
            needed; it is shown in languages without a title of their own.
        build: builds the content of the tab with NiceGUI, in the slot that is current when it is called. It takes the
            session (what is loaded, its program and its run) and the words of the page's language.
        robots: kinds of robots that the tab is shown for: ``arm``, ``legs``. It is shown for all if this is empty.
    """

    titles: Mapping[str, str]
    build: "Callable[[Session, Words], None]"
    robots: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        """Check that there is an English title; raises ValueError if not."""
        if not self.titles.get("en"):
            raise ValueError(
                message(
                    "pendant.no_english_title", "titles has no 'en'; a panel needs an English title"
                )
            )

    def title(self, language: str) -> str:
        """Title in a language, or in English if there is none."""
        return self.titles.get(language) or self.titles["en"]
