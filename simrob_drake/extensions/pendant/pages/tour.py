"""A lesson in the page: what to do next, and whether it is done."""

import re
from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from simrob_drake.base.files import text_of
from simrob_drake.extensions.pendant.pages.elements import follow, icon_button, set_label
from simrob_drake.extensions.pendant.pages.plots import watch
from simrob_drake.extensions.pendant.pages.words import Words
from simrob_drake.extensions.pendant.pendant import Pendant
from simrob_drake.extensions.pendant.tours import Tour, TourProgress, page_of, spoken

_ROOT = Path(__file__).parents[4]
"""Folder of the project, in which a checkout has its pages."""


class Lessons:
    """The menu of the lessons, and the strip of the one that is under way."""

    def __init__(
        self, pendant: Pendant, t: Words, language: str, load: Callable[[str], object]
    ) -> None:
        """Prepare; ``load`` opens another robot or station."""
        self._pendant, self._t, self._language, self._load = pendant, t, language, load
        self._session, self._shown = pendant.session, list[object]()

    def build_menu(self) -> None:
        """Build the button that begins a lesson."""
        with icon_button("school", self._t("tour.lessons"), keys="Alt+L", t=self._t), ui.menu():
            for tour in self._pendant.tours:
                ui.menu_item(
                    spoken(tour.title, self._language), lambda tour=tour: self._begin(tour)
                )

    def build_strip(self) -> None:
        """Build the strip of the lesson, which is hidden while there is none."""
        label = self._t("tour.lesson")
        self._place = ui.element("section").classes("pendant-tour").props(f'aria-label="{label}"')
        self._show()

    def _begin(self, tour: Tour | None) -> None:
        self._pendant.tour = TourProgress(tour) if tour else None
        self._go(0)

    def _go(self, by: int) -> None:
        tour = self._pendant.tour
        if tour is not None:
            tour.go(by)
            if tour.subject not in (self._session.subject, self._session.book.station):
                self._load(tour.subject)
        self._show()

    def _show(self) -> None:
        tour = self._pendant.tour
        done = tour is not None and tour.look(self._session)
        now = None if tour is None else (tour, tour.number, tuple(tour.done))
        if self._shown == [now]:
            return
        self._shown = [now]
        self._place.clear()
        self._place.set_visibility(tour is not None)
        if tour is not None:
            with (
                self._place,
                ui.element("div").classes("contents"),
            ):  # with which it ends that its step is looked at
                self._show_step(tour, done)
                follow(
                    self._session,
                    self._show,
                    "description",
                    "program",
                    "phase",
                    "message",
                    "tick",
                    "inspected",
                )

    def _show_step(self, tour: TourProgress, done: bool) -> None:
        t, count = self._t, len(tour.tour.steps)
        watch(
            self._session,
            [check.signal for check in tour.step.checks if check.signal],
            ui.element("div"),
        )
        with ui.row().classes("w-full items-center gap-2 no-wrap"):
            title = spoken(tour.tour.title, self._language)
            ui.label(f"{title} · {t('tour.step', number=tour.number + 1, count=count)}").classes(
                "font-bold grow"
            )
            icon_button("arrow_back", t("tour.back"), lambda: self._go(-1)).set_enabled(
                tour.number > 0
            )
            icon_button("close", t("tour.end"), lambda: self._begin(None))
        ui.markdown(spoken(tour.step.text, self._language)).classes("min-w-0")
        with ui.row().classes("items-center gap-2").props("role=status aria-live=polite"):
            for one in tour.done:
                ui.icon(
                    "check_circle" if one else "radio_button_unchecked",
                    color="positive" if one else "grey",
                )
            if tour.done:
                ui.label(t("tour.done" if done else "tour.open"))
            look = "no-caps dense" + " outline" * (not done)
            if tour.number < count - 1:
                ui.button(
                    t("tour.next" if done else "tour.skip"), on_click=lambda: self._go(1)
                ).props(look)
            else:
                self._build_page_link(page_of(tour.tour, self._language))
                ui.button(t("tour.end"), on_click=lambda: self._begin(None)).props(look)

    def _build_page_link(self, page: str) -> None:
        """Build what opens the page that tells more: an address in another tab, a file of this package in a dialog.

        A file that is not there, as the pages are not in an installed package, is named.
        """
        if not page:
            return
        if page.startswith(("http://", "https://")):
            ui.link(self._t("tour.page"), page, new_tab=True)
            return
        file = _ROOT / page
        if not file.is_file():
            ui.label(self._t("tour.page_named", page=page))
            return
        with (
            ui.dialog().props("full-width") as dialog,
            ui.card().classes("w-full pendant-lesson-page"),
        ):
            set_label(dialog, self._t("tour.page"))
            ui.markdown(plain_links(text_of(file)), extras=["fenced-code-blocks", "tables"])
            ui.button(self._t("shell.close"), on_click=dialog.close)
        ui.button(self._t("tour.page"), icon="menu_book", on_click=dialog.open).props(
            "no-caps dense flat"
        )


def plain_links(text: str) -> str:
    """Replace links and pictures of a Markdown text that lead to other files, which the dialog cannot show."""
    without_pictures = re.sub(r"!\[[^\]]*\]\((?!https?:)[^)]*\)\n*", "", text)
    return re.sub(r"\[([^\]]*)\]\((?!https?:)[^)]*\)", r"\1", without_pictures)
