"""The view in three dimensions: Meshcat's page in a frame, where bodies can be dragged; pictures without WebGL."""

from asyncio import wrap_future
from base64 import b64encode
from pathlib import Path

from nicegui import background_tasks, ui

from simrob_drake.teach.pages.buttons import icon_button
from simrob_drake.teach.pages.following import follow
from simrob_drake.teach.pages.words import Words
from simrob_drake.teach.session import Session

_FRAME = "view-frame"


def build(session: Session, t: Words) -> None:
    """Build the view of a session's run."""
    place = ui.element("div").classes("pendant-view")

    async def show() -> None:
        can = await ui.run_javascript("window.hasWebGL()", timeout=10.0)
        with place:
            _frame(t) if can else _stills(session, t)

    ui.timer(0.0, show, once=True)


def _frame(t: Words) -> None:
    frame = ui.element("iframe").props(f"id={_FRAME} src=/view/")
    frame.props["title"] = t("shell.view")
    frame.on("load", js_handler="(event) => window.viewShown(event.target)")
    drag = icon_button("pan_tool_alt", t("shell.drag"), keys="D").classes("pendant-drag").props("aria-pressed=false")

    def toggle() -> None:
        on = drag.props["aria-pressed"] != "true"
        drag.props["aria-pressed"] = "true" if on else "false"
        drag.update()
        ui.run_javascript(f"document.getElementById('{_FRAME}').contentWindow.dragging = {str(on).lower()}")

    drag.on_click(toggle)


def _stills(session: Session, t: Words) -> None:
    """Show each run as a strip of pictures when it has ended, and why."""
    with ui.element("div").classes("pendant-still"):
        ui.label(t("shell.no_webgl"))
        strip = ui.element("img")
        strip.props["alt"] = t("shell.view")

    async def draw() -> None:
        file = await wrap_future(session.film_strip())
        if file is not None:
            strip.props["src"] = f"data:image/png;base64,{b64encode(Path(file).read_bytes()).decode()}"

    def show() -> None:
        if session.phase == "idle" and session.time > 0.0:
            background_tasks.create(draw())

    follow(session, show, "phase")
