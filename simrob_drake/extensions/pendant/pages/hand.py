"""What is done in the view with the pointer: bodies that are pulled, and a hand that moves and turns things."""

from collections.abc import Callable
from json import dumps

from nicegui import ui

from simrob_drake.extensions.pendant.pages.elements import icon_button, set_label
from simrob_drake.extensions.pendant.pages.words import Words
from simrob_drake.extensions.pendant.session import Session

FRAME = "view-frame"
_STEPS = {"": (0, 0), "1": (1, 1), "5": (5, 5), "10": (10, 15), "50": (50, 45)}
"""What is moved and turned by steps of [mm, deg], by the choice of it; freely by the first."""


def build(session: Session, t: Words) -> Callable[[], None]:
    """Build the buttons that begin both, and the hand's settings, which are there while it is on.

    Returns:
        what tells the view of these, once it is loaded.
    """
    pull = icon_button("pan_tool_alt", t("shell.drag"), keys="D", t=t).classes(
        "pendant-drag pendant-mood"
    )
    hand = icon_button("open_with", t("hand.begin"), keys="G", t=t).classes(
        "pendant-hand pendant-mood"
    )
    with ui.element("div").classes("pendant-grip").props("role=group") as settings:
        set_label(settings, t("hand.settings"))
        own = ui.toggle({False: t("hand.world"), True: t("hand.own")}, value=False).props(
            "dense no-caps"
        )
        names = {
            key: t("hand.step", mm=mm, deg=deg) if mm else t("hand.free")
            for key, (mm, deg) in _STEPS.items()
        }
        step = ui.select(names, value="", label=t("hand.steps")).props(
            "dense options-dense outlined"
        )
        ui.label(t("hand.hint")).classes("pendant-grip-hint")
    moods = {"pull": pull, "on": hand}
    on = ""

    def tell() -> None:
        move, turn = _STEPS[step.value]
        state = {
            **{name: name == on for name in moods},
            "own": own.value,
            "step": move,
            "turn": turn,
        }
        for name, button in moods.items():
            button.props["aria-pressed"] = "true" if name == on else "false"
            button.update()
        settings.set_visibility(on == "on")
        ui.run_javascript(
            f"document.getElementById('{FRAME}').contentWindow.setHand?.({dumps(state)})"
        )

    def choose(name: str) -> None:
        nonlocal on
        on = "" if name == on else name
        if on == "on":
            session.hand.open()
        tell()

    for name, button in moods.items():
        button.props["aria-pressed"] = "false"
        button.on_click(lambda name=name: choose(name))
    for field in (own, step):
        field.on_value_change(tell)
    settings.set_visibility(False)
    return tell
