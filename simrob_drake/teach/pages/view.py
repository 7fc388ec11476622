"""The view in three dimensions: Meshcat's page in a frame, where bodies can be dragged; pictures without WebGL."""

from nicegui import ui

from simrob_drake.teach.pages.buttons import icon_button, told
from simrob_drake.teach.pages.words import Words

_FRAME = "view-frame"


def build(t: Words) -> None:
    """Build the view."""
    with ui.element("div").classes("pendant-view") as place:
        pass

    async def show() -> None:
        can = await ui.run_javascript("window.hasWebGL()", timeout=10.0)
        with place:
            _frame(t) if can else _stills(t)

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


def _stills(t: Words) -> None:
    with ui.element("div").classes("pendant-still") as stills:
        ui.label(t("shell.no_webgl"))
    told(stills, t("shell.view"))
