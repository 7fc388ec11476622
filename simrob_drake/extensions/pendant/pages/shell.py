"""The page that all tabs share: what is loaded, the view of it, the bar that runs it, and the tabs."""

from asyncio import wrap_future
from collections.abc import Callable
from pathlib import Path

from nicegui import Client, context, ui
from nicegui.language import Language

from simrob_drake.base.errors import SimrobError, shorten
from simrob_drake.base.extension import usable_objects
from simrob_drake.base.messages import compound
from simrob_drake.extensions.pendant.pages import arm, gallery, legs, station, view
from simrob_drake.extensions.pendant.pages.announcements import Announcer
from simrob_drake.extensions.pendant.pages.elements import (
    allow,
    follow,
    icon_button,
    set_keys,
    set_label,
    shortcuts,
)
from simrob_drake.extensions.pendant.pages.messages import Messages
from simrob_drake.extensions.pendant.pages.move_list import ProgramTimeline
from simrob_drake.extensions.pendant.pages.tour import Lessons
from simrob_drake.extensions.pendant.pages.words import Words, languages, words
from simrob_drake.extensions.pendant.pendant import Pendant
from simrob_drake.extensions.pendant.pendant_panel import PendantPanel
from simrob_drake.extensions.pendant.session import Session

TABS: dict[str, Callable[[Session, Words], None]] = {
    "legs": legs.build,
    "arm": arm.build,
    "station": station.build,
}
"""The tabs of this page, by the kind of robot that is taught there; the last is there for all."""
_ALWAYS = "station"
"""The tab that is there for all robots."""
_TAKEN = ("program", "script", "station", "csv", "recording")
_QUASAR: dict[str, Language] = {"en": "en-US", "es": "es"}
_FOLDER = Path(__file__).parent
_LOADED = ("page.css", "page.js", "blocks.js", "drive.js", "timeline.js")
_TEACHING = "teaching"


def install(pendant: Pendant) -> None:
    """Let the server show the page of a pendant."""
    ui.page("/")(lambda: build(pendant))


def build(pendant: Pendant) -> None:
    """Build the page into the present client, in the language that its address names."""
    asked = context.client.request.query_params.get("language", "")
    language = asked if asked in languages() else pendant.language
    session, t = pendant.session, words(language)
    context.client.page.language = _QUASAR.get(language)
    context.client.title = t("shell.title")
    style, *scripts = ((_FOLDER / name).read_text(encoding="utf-8") for name in _LOADED)
    ui.add_head_html(
        f"<style>{style}</style>{''.join(f'<script>{one}</script>' for one in scripts)}"
    )

    def load(subject: str, robot: str | None = None) -> None:
        _open(t, lambda: pendant.load(subject, robot))

    def take(files: gallery.Files) -> None:
        _open(t, lambda: pendant.take(files))

    skip = ui.link(t("shell.skip"), f"#{_TEACHING}").classes("pendant-skip")
    skip.on("click", js_handler=f"() => document.getElementById('{_TEACHING}').focus()")
    with ui.element("header").classes("pendant-bar"):
        ui.html(t("shell.title"), tag="h1", sanitize=False)
        gallery.build(session, t, load, take)
        _loaded(session, t, load)
        with ui.element("div").classes("pendant-tools"):
            lessons = Lessons(pendant, t, language, load)
            _undo(session, t)
            _take_away(session, t)
            lessons.build_menu()
            _looks(pendant, t, language)
            _help(t)
    _conflict(session, t)
    ui.label(t("shell.lost_click")).classes("pendant-lost").props("aria-live=assertive")
    lessons.build_strip()
    with ui.element("div").classes("pendant-main"):
        with ui.element("section").classes("pendant-plate pendant-see"):
            with ui.element("div").classes("pendant-stays"):
                view.build(session, t)
                view.build_bar(session, t)
            Messages(session, t)
            Announcer(session, t)
            ProgramTimeline(session, t)
            view.build_pad(session, t, pendant.push)
        with (
            ui.element("section")
            .classes("pendant-plate")
            .props(f"id={_TEACHING} tabindex=-1") as teaching
        ):
            set_label(teaching, t("shell.teaching"))
            _tabs(pendant, t, language)


def _open(t: Words, load: Callable[[], bool]) -> None:
    """Open something else in all tabs, or tell why it cannot be."""
    try:
        if load():
            for client in list(Client.instances.values()):
                client.run_javascript("location.reload()")
    except SimrobError as problem:
        ui.notify(t.render(str(problem)), type="negative", close_button=True, timeout=0)


def _loaded(session: Session, t: Words, load: Callable[[str, str], None]) -> None:
    """Tell what is taught, and choose which of several robots."""
    text = ui.label().classes("pendant-loaded")
    robots = ui.select([], label=t("shell.robot")).props("dense outlined options-dense")
    robots.on_value_change(
        lambda event: load(session.subject, event.value) if event.value else None
    )

    def show() -> None:
        text.text = t("shell.loaded", station=session.book.station, file=session.book.file)
        several = list(session.description.get("robots", ()))
        robots.set_options(
            several, value=session.book.robot if session.book.robot in several else None
        )
        robots.set_visibility(len(several) > 1)

    follow(session, show, "description", "program")


def _conflict(session: Session, t: Words) -> None:
    """Ask what becomes of the program's file, while another editor's change of it is not to be lost."""
    with ui.element("div").classes("pendant-conflict").props("role=alert") as place:
        text = ui.label()
        for name, choose in (
            ("take_theirs", session.take_theirs),
            ("keep_both", session.keep_both),
        ):
            ui.button(t(f"shell.{name}"), on_click=choose).props("no-caps dense outline")

    def show() -> None:
        text.text = t("notice.conflict", file=session.book.file.name)
        place.set_visibility(session.book.conflict)

    follow(session, show, "program")


def _undo(session: Session, t: Words) -> None:
    undo = icon_button("undo", t("shell.undo"), session.undo, keys="Control+Z", t=t)
    redo = icon_button("redo", t("shell.redo"), session.redo, keys="Control+Shift+Z", t=t)

    def show() -> None:
        allow(undo, "" if session.book.history.can_undo else t("why.no_undo"))
        allow(redo, "" if session.book.history.can_redo else t("why.no_redo"))

    follow(session, show, "program", "description")


def _take_away(session: Session, t: Words) -> None:
    async def take(kind: str) -> None:
        file = await wrap_future(getattr(session.exports, kind)())
        if file is not None:
            ui.download.file(file)

    with icon_button("download", t("shell.take_away"), keys="Shift+E", t=t), ui.menu():
        for kind in _TAKEN:
            ui.menu_item(t(f"shell.export_{kind}"), lambda kind=kind: take(kind))


def _looks(pendant: Pendant, t: Words, spoken: str) -> None:
    """Build what changes the language of this tab, and light to dark for those that come, too."""
    dark = ui.dark_mode(pendant.dark)

    def shade() -> None:
        pendant.dark = dark.value = not dark.value

    for language in languages():
        button = ui.button(language.upper()).props("flat dense")
        button.on("click", js_handler=f"() => location.search = 'language={language}'")
        set_label(button, t(f"shell.language_{language}"))
        button.props["aria-pressed"] = "true" if language == spoken else "false"
    icon_button("contrast", t("shell.shade"), shade, keys="Shift+L", t=t)


def _help(t: Words) -> None:
    with ui.dialog() as dialog, ui.card():
        set_label(dialog, t("shell.help"))
        ui.html(t("shell.help"), tag="h2", sanitize=False).classes("pendant-heading")
        keys = ui.element("dl").classes("pendant-keys")
        ui.label(t("shell.help_keys"))
        ui.label(t("shell.help_drag"))
        ui.button(t("shell.close"), on_click=dialog.close)

    def show() -> None:
        keys.clear()
        with keys:
            for key, text in shortcuts(t):
                with ui.element("dt"):
                    ui.label(key)
                with ui.element("dd"):
                    ui.label(text)
        dialog.open()

    icon_button("help_outline", t("shell.help"), show, keys="?", t=t)


def _tabs(pendant: Pendant, t: Words, language: str) -> None:
    """Build the tabs that teach: those of this page, then the panels of extensions.

    A tab that does not serve the kind of robot that is taught is hidden. The user's tab stays in front until a robot of
    another kind is loaded, also when the station or the page is loaded again.
    """
    session = pendant.session
    panels = _own_panels(t)
    for name, panel in usable_objects("panels", PendantPanel).items():
        panels[f"extension_{name}"] = panel  # so that no name of ours is replaced
    with ui.tabs().classes("w-full") as tabs:
        heads = {name: ui.tab(name, label=panel.title(language)) for name, panel in panels.items()}
        for number, head in enumerate(heads.values(), 1):
            set_keys(head, f"Alt+{number}")
    first_tab = pendant.tab if pendant.tab in panels else _ALWAYS
    with ui.tab_panels(tabs, value=first_tab, animated=False, keep_alive=True).classes(
        "w-full pendant-panels"
    ):
        for name, panel in panels.items():
            with ui.tab_panel(name):
                _build_panel(name, panel, session, t)

    def keep() -> None:
        """Keep the tab in front for a page that is loaded again."""
        pendant.tab = str(tabs.value)

    def show() -> None:
        """Show the tabs for the kind of robot, and put its own in front if the kind is another one than before."""
        kind = session.description.get("robots", {}).get(session.book.robot, {}).get("kind", "")
        for name, head in heads.items():
            robots = panels[name].robots
            head.set_visibility(not robots or kind in robots)
        fitting = kind if kind in TABS else _ALWAYS
        if session.description and fitting != pendant.tab_kind:
            pendant.tab_kind = fitting
            tabs.set_value(fitting)

    tabs.on_value_change(keep)
    follow(session, show, "description")


def _own_panels(t: Words) -> dict[str, PendantPanel]:
    """Describe the tabs of this page as panels, by name, as extensions do with theirs.

    Args:
        t: texts in the language of the page.
    """
    panels = {}
    for name, build_tab in TABS.items():
        # The title is already in the language of the page. As the "English" one it is shown in every language.
        title = t(f"shell.{name}_tab")
        # The name of a tab is the kind of robot for which it is shown. No kinds mean all robots.
        robots = () if name == _ALWAYS else (name,)
        panels[name] = PendantPanel(titles={"en": title}, build=build_tab, robots=robots)
    return panels


def _build_panel(name: str, panel: PendantPanel, session: Session, t: Words) -> None:
    """Build the content of a tab. If a panel of an extension fails, its tab shows the reason.

    Args:
        name: name of the tab.
        panel: the panel that builds it.
        session: the session of the page's user.
        t: texts in the language of the page.
    """
    if name in TABS:  # a tab of this page: an error in it must not be hidden
        panel.build(session, t)
        return
    try:
        panel.build(session, t)
    except Exception as problem:  # code of somebody else must not take the page away
        reason = shorten(
            compound("{name}: {problem}", name=type(problem).__name__, problem=problem), 300
        )
        ui.label(t("shell.broken_panel", reason=reason)).props("role=alert")
