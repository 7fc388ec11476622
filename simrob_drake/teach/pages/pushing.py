"""A pad of forces: a push along an axis of a body, at a click, while a run goes on."""

from nicegui import ui

from simrob_drake.teach.pages.buttons import told
from simrob_drake.teach.pages.fields import NumberField
from simrob_drake.teach.pages.following import follow
from simrob_drake.teach.pages.words import Words
from simrob_drake.teach.session import Session

_SIDES = tuple((f"{sign}{name}", axis, float(f"{sign}1")) for axis, name in enumerate("xyz") for sign in "-+")
"""Each with its name, its axis and its direction."""
_FORCE, _MOST = 10.0, 10_000.0  # N
_DURATION, _LONGEST = 0.1, 60.0  # s


def build(session: Session, t: Words) -> None:
    """Build the pad; its buttons act while a run goes on."""
    with ui.expansion(t("push.title"), icon="back_hand").classes("w-full").props("dense"):
        with ui.row().classes("w-full items-start gap-2"):
            body = ui.select([], label=t("push.body"), with_input=True).props("dense outlined").classes("w-44")
            force = NumberField(t, t("push.force"), _FORCE, low=0.0, high=_MOST, unit=" N")
            duration = NumberField(t, t("push.duration"), _DURATION, low=0.01, high=_LONGEST, unit=" s", step=0.05)
            for field in (force, duration):
                field.field.classes("w-28")
        with ui.row().classes("w-full items-center gap-1") as pad:
            told(pad.props("role=group"), t("push.pad"))
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
    told(button, t("push.along", side=side))
    return button
