"""The messages of a session below the view: each line in the colour of its severity, and remedies with a button."""

from collections.abc import Sequence

from nicegui import ui

from simrob_drake.base.remarks import SEVERITY_WORDS, Remedy, Severity
from simrob_drake.extensions.pendant.form import as_text
from simrob_drake.extensions.pendant.pages.elements import allow, follow, set_label
from simrob_drake.extensions.pendant.pages.words import JudgedRun, Notice, Words
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.results.verdict.verdict import TABLE_HEADINGS, CriterionRow
from simrob_drake.results.verdict.words import capitalize

_ICONS: dict[Severity, str] = {
    "success": "check_circle",
    "note": "info",
    "warning": "warning",
    "failure": "error",
}
"""Icon of each severity, for users who do not tell the colours apart."""


class Messages:
    """The last message of a session, or the verdict on its last run.

    A verdict is a sentence, a line for each warning with its remedy, and the table of criteria. A remedy that is a key
    of the station has a button that sets the key; Undo takes that back.
    """

    def __init__(self, session: Session, t: Words) -> None:
        """Build the place for messages below the bar of the run. It follows the session."""
        self._session, self._t = session, t
        self._buttons: list[ui.button] = []
        self._judged: JudgedRun | None = None
        self._age: ui.label | None = None
        self._place = ui.element("div").classes("pendant-message")
        set_label(self._place.props("role=region"), t("run.messages"))
        follow(session, self._show, "message")
        follow(session, self._follow_run, "phase", "program", "description")

    def _show(self) -> None:
        """Show the last message in place of the one before."""
        notice = self._session.message
        self._buttons = []
        self._judged = notice.judged
        self._place.clear()
        with self._place:
            self._age = None
            if notice.judged is not None:
                text = self._t("run.old_verdict", number=notice.judged.number)
                self._age = ui.label(text).classes("pendant-age")
            # A notice is a text of its own (with a key in the words, or an error), remarks about a run, or both.
            if notice.key or not notice.remarks:
                self._build_line(notice.severity, self._text_of(notice))
            for remark, text in zip(notice.remarks, notice.lines(self._t.render), strict=True):
                self._build_line(remark.severity, text)
                if remark.remedy is not None:
                    self._build_remedy(remark.remedy)
            # The verdict of a run that failed has no criteria.
            if notice.criteria:
                self._build_table(notice.criteria, is_open=notice.severity == "warning")
        self._follow_run()

    def _follow_run(self) -> None:
        """Allow the buttons, and mark a verdict as old once another run has begun or the station has changed."""
        self._allow()
        is_old = self._judged is not None and (
            self._session.phase in ("running", "paused")
            or self._session.book.settings != self._judged.settings
        )
        if self._age is not None:
            self._age.set_visibility(is_old)
        self._place.classes(
            add="pendant-old" if is_old else None, remove=None if is_old else "pendant-old"
        )

    def _text_of(self, notice: Notice) -> str:
        """Text of a notice above its remarks, in the language of the page."""
        return (
            self._t(f"notice.{notice.key}", **notice.fills)
            if notice.key
            else self._t.render(str(notice))
        )

    def _build_line(self, severity: Severity, text: str) -> None:
        """Build a line in the colour of its severity. An empty text has no line."""
        if not text:
            return
        word = self._t.render(SEVERITY_WORDS[severity])
        with ui.row().classes(f"pendant-remark pendant-{severity}"):
            ui.icon(_ICONS[severity]).props(f'role=img aria-label="{word}"')
            ui.label(text)

    def _build_remedy(self, remedy: Remedy) -> None:
        """Build the line of a remedy, with a button if it sets a key of the station."""
        with ui.row().classes("pendant-remark pendant-remedy"):
            ui.icon("arrow_forward").props("aria-hidden=true")
            ui.label(capitalize(self._t.render(remedy.text)))
        if not remedy.changes:
            return
        # Under the sentence, for which a button beside it would leave a narrow column.
        with ui.row().classes("pendant-remark pendant-remedy-button"):
            shown = ", ".join(f"{key} = {as_text(value)}" for key, value in remedy.changes.items())
            text = self._t("run.apply", setting=shown)
            button = ui.button(text, on_click=lambda: self._session.setup.set_all(remedy.changes))
            self._buttons.append(button.props("dense no-caps outline"))

    def _build_table(self, criteria: Sequence[CriterionRow], *, is_open: bool) -> None:
        """Build the table of criteria, unfolded if ``is_open``."""
        t = self._t.render
        fold = (
            ui.expansion(self._t("run.criteria"), value=is_open)
            .props("dense")
            .classes("pendant-criteria")
        )
        with fold, ui.element("table"):
            _build_row("th", [t(heading) for heading in TABLE_HEADINGS])
            for row in criteria:
                cells = (
                    SEVERITY_WORDS[row.severity],
                    row.criterion,
                    row.value,
                    row.bound,
                    row.worst,
                )
                _build_row("td", [t(cell) for cell in cells]).classes(f"pendant-{row.severity}")

    def _allow(self) -> None:
        """Let the buttons of remedies act while nothing runs, since they load the station anew."""
        why = "" if self._session.phase == "idle" else self._t("why.not_idle")
        for button in self._buttons:
            allow(button, why)


def _build_row(tag: str, cells: Sequence[str]) -> ui.element:
    """Build a row of a table, with cells of a tag, ``th`` or ``td``, and return it."""
    with ui.element("tr") as row:
        for text in cells:
            with ui.element(tag):
                ui.label(text)
    return row
