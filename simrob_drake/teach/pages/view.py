"""The view in three dimensions, where bodies can be dragged, pictures without WebGL; and a pad that pushes bodies."""

from asyncio import wrap_future
from base64 import b64encode
from pathlib import Path

from nicegui import background_tasks, ui

from simrob_drake.teach.pages.elements import NumberField, follow, icon_button, set_label
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
    frame = ui.element("iframe").props(f"id={_FRAME} src=view/")
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


_SIDES = tuple((f"{sign}{name}", axis, float(f"{sign}1")) for axis, name in enumerate("xyz") for sign in "-+")
"""Each with its name, its axis and its direction."""
_FORCE, _MOST = 10.0, 10_000.0  # N
_DURATION, _LONGEST = 0.1, 60.0  # s


def build_pad(session: Session, t: Words) -> None:
    """Build the pad; its buttons act while a run goes on."""
    with ui.expansion(t("push.title"), icon="back_hand").classes("w-full").props("dense"):
        with ui.row().classes("w-full items-start gap-2"):
            body = ui.select([], label=t("push.body"), with_input=True).props("dense outlined").classes("w-44")
            force = NumberField(t, t("push.force"), _FORCE, low=0.0, high=_MOST, unit=" N")
            duration = NumberField(t, t("push.duration"), _DURATION, low=0.01, high=_LONGEST, unit=" s", step=0.05)
            for field in (force, duration):
                field.field.classes("w-28")
        with ui.row().classes("w-full items-center gap-1") as pad:
            set_label(pad.props("role=group"), t("push.pad"))
            buttons = [_button(t, name) for name, _, _ in _SIDES]
        ui.label(t("push.hint")).classes("text-xs opacity-70")

    def push(axis: int, direction: float) -> None:
        size, seconds = force.needed(), duration.needed()
        if size is not None and seconds is not None and body.value:
            session.push(body.value, [direction * size if axis == one else 0.0 for one in range(3)], seconds)

    for button, (_, axis, direction) in zip(buttons, _SIDES, strict=True):
        button.on_click(lambda axis=axis, direction=direction: push(axis, direction))

    def show_bodies() -> None:
        bodies = list(session.description.get("bodies", ()))
        if bodies != body.options:
            first = session.robot if session.robot in bodies else next(iter(bodies), None)
            body.set_options(bodies, value=body.value if body.value in bodies else first)

    def show_phase() -> None:
        for button in buttons:
            button.set_enabled(session.phase in ("running", "paused"))

    follow(session, show_bodies, "description")
    follow(session, show_phase, "phase")


def _button(t: Words, side: str) -> ui.button:
    button = ui.button(side).props("outline no-caps dense").classes("w-10")
    set_label(button, t("push.along", side=side))
    return button
