"""The page that all tabs share: what is loaded, the view of it, the bar that runs it, and the tabs."""

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from nicegui import Client, context, ui
from nicegui.language import Language

from simrob_drake.errors import SimrobError
from simrob_drake.teach.pages import choosing, runbar, view
from simrob_drake.teach.pages.buttons import icon_button, shortcuts
from simrob_drake.teach.pages.following import follow
from simrob_drake.teach.pages.words import Words, languages
from simrob_drake.teach.pendant import Pendant
from simrob_drake.teach.session import Session

_FOLDER = Path(__file__).parent
TABS = {"legs": "legs", "arm": "arm", "station": ""}
"""The tabs, and of which kind a robot is that needs one; the last is there always."""
_MODULES = {name: f"simrob_drake.teach.pages.{name}" for name in TABS}
BUILDERS = {name: import_module(module).build for name, module in _MODULES.items() if find_spec(module)}
_QUASAR: dict[str, Language] = {"en": "en-US", "es": "es"}


def install(pendant: Pendant) -> None:
    """Let the server show the page of a pendant."""
    ui.page("/")(lambda: build(pendant))


def build(pendant: Pendant) -> None:
    """Build the page into the present client."""
    session, t = pendant.session, pendant.t
    context.client.page.language = _QUASAR.get(pendant.language)
    context.client.title = t("shell.title")
    style, script = ((_FOLDER / name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    ui.add_head_html(f"<style>{style}</style><script>{script}</script>")
    dark = ui.dark_mode(pendant.dark)

    def load(subject: str | Path) -> None:
        try:
            pendant.load(subject)
        except SimrobError as problem:
            ui.notify(str(problem), type="negative", close_button=True, timeout=0)
        else:
            _reload_all()

    def speak(language: str) -> None:
        pendant.speak(language)
        _reload_all()

    def shade() -> None:
        dark.value = pendant.dark = not dark.value

    with ui.element("header").classes("pendant-bar"):
        _header(session, t, speak, shade)
    choosing.build(session, t, load)
    with ui.element("main").classes("pendant-main"):
        with ui.element("section").classes("pendant-plate pendant-see"):
            view.build(t)
            runbar.build(pendant)
        with ui.element("section").classes("pendant-plate"):
            _tabs(session, t)


def _reload_all() -> None:
    for client in list(Client.instances.values()):
        client.run_javascript("location.reload()")


def _header(session: Session, t: Words, speak: Callable[[str], None], shade: Callable[[], None]) -> None:
    ui.html(t("shell.title"), tag="h1", sanitize=False)
    loaded = ui.label().classes("pendant-loaded")
    ui.element("span").classes("pendant-grow")
    undo = icon_button("undo", t("shell.undo"), session.undo, keys="Control+Z")
    redo = icon_button("redo", t("shell.redo"), session.redo, keys="Control+Shift+Z")
    _take_away(session, t)
    for language in languages():
        ui.button(language.upper(), on_click=lambda _, to=language: speak(to)).props("flat dense")
    icon_button("contrast", t("shell.shade"), shade, keys="Alt+D")
    _help(t)

    def show() -> None:
        undo.set_enabled(session.can_undo)
        redo.set_enabled(session.can_redo)
        loaded.text = t("shell.loaded", station=session.station, file=session.file.name)

    follow(session, show, "program", "description")


def _take_away(session: Session, t: Words) -> None:
    async def take(kind: str) -> None:
        from asyncio import wrap_future

        file = await wrap_future(getattr(session, f"export_{kind}")())
        if file is not None:
            ui.download.file(file)

    with icon_button("download", t("shell.take_away"), keys="Shift+E"), ui.menu():
        for kind in ("program", "script", "station", "csv", "recording"):
            ui.menu_item(t(f"shell.export_{kind}"), lambda kind=kind: take(kind))


def _help(t: Words) -> None:
    with ui.dialog() as dialog, ui.card():
        ui.html(t("shell.help"), tag="h2", sanitize=False).style("font-size: 1.1rem; font-weight: 600")
        keys = ui.element("dl").classes("pendant-keys")
        ui.label(t("shell.help_drag"))
        ui.button(t("shell.close"), on_click=dialog.close)

    def show() -> None:
        keys.clear()
        with keys:
            for key, text in shortcuts():
                ui.html(key, tag="dt", sanitize=False)
                ui.html(text, tag="dd", sanitize=False)
        dialog.open()

    icon_button("help_outline", t("shell.help"), show, keys="?")


def _tabs(session: Session, t: Words) -> None:
    with ui.tabs().classes("w-full") as tabs:
        heads = {name: ui.tab(name, label=t(f"shell.{name}_tab")) for name in TABS}
        for number, head in enumerate(heads.values(), 1):
            head.props["aria-keyshortcuts"] = f"Alt+{number}"
    with (
        ui.tab_panels(tabs, value="station", animated=False, keep_alive=True)
        .classes("w-full")
        .style("background: transparent")
    ):
        for name in TABS:
            with ui.tab_panel(name):
                if name in BUILDERS:
                    BUILDERS[name](session, t)
    shown: list[Any] = []

    def show() -> None:
        kinds = {robot["kind"] for robot in session.description.get("robots", {}).values()}
        for name, kind in TABS.items():
            heads[name].set_visibility(not kind or kind in kinds)
        first = next((name for name, kind in TABS.items() if kind in kinds), "station")
        if session.description and shown != [first]:
            shown[:] = [first]
            tabs.set_value(first)

    follow(session, show, "description")
