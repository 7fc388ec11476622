"""The page of an arm, in the order of use: its tool and pieces, jogging, targets, branches, and the program."""

from collections.abc import Callable, Mapping
from typing import Any

from nicegui import ui

from simrob_drake.teach.pages import branch_list, line_list, target_list
from simrob_drake.teach.pages.arm_jogging import Jogging
from simrob_drake.teach.pages.following import follow
from simrob_drake.teach.pages.phrases import Phrases
from simrob_drake.teach.pages.whereabouts import Whereabouts
from simrob_drake.teach.pages.words import Words
from simrob_drake.teach.session import Session


def build(session: Session, t: Words) -> None:
    """Build the page into the present slot; it is there as soon as an arm is."""
    room = ui.column().classes("w-full gap-4")
    shown: list[Any] = []

    def show() -> None:
        robot = session.description.get("robots", {}).get(session.robot, {})
        now = [session.robot, [axis["name"] for axis in robot.get("axes", ())]]
        if robot.get("kind") == "arm" and now != shown:
            shown[:] = now
            room.clear()
            with room:
                _build(session, t, robot["axes"])

    follow(session, show, "description")


def _build(session: Session, t: Words, axes: list[Mapping[str, Any]]) -> None:
    phrases, place = Phrases(t, axes), Whereabouts(session)
    parts: dict[str, Callable[[], object]] = {
        "hand": lambda: _build_hand(session, t, place),
        "jog": lambda: Jogging(session, phrases, axes, place),
        "targets": lambda: target_list.build(session, t, place),
        "postures": lambda: branch_list.build(session, phrases),
        "program": lambda: line_list.build(session, phrases),
    }
    for number, (name, part) in enumerate(parts.items(), 1):
        with ui.element("section").classes("w-full"):
            ui.html(f"{number}  {t(f'arm.{name}')}", tag="h2", sanitize=False).classes("text-base font-medium pb-1")
            part()


def _build_hand(session: Session, t: Words, place: Whereabouts) -> None:
    """Build the choice of the tool, and what takes and leaves pieces."""
    with ui.row().classes("w-full items-center gap-2"):
        tool, taken, left = (
            ui.select([], label=t(f"arm.{name}")).props("dense outlined options-dense").classes("grow")
            for name in ("tool", "piece", "held")
        )
        for field in (tool, taken, left):
            field.style("min-width: 8rem")
        take = ui.button(t("arm.take_piece"), on_click=lambda: session.attach(taken.value)).props("outline no-caps")
        leave = ui.button(t("arm.leave_piece"), on_click=lambda: session.release(left.value)).props("outline no-caps")
    tool.on_value_change(lambda event: event.value not in (None, place.told.get("tool")) and session.tool(event.value))
    for field, button in ((taken, take), (left, leave)):
        field.on_value_change(lambda event, button=button: button.set_enabled(bool(event.value)))
        button.set_enabled(False)

    def show() -> None:
        told = place.told
        tool.set_options(told["tools"], value=told["tool"] if told["tool"] in told["tools"] else None)
        for field, pieces in ((taken, told["around"]), (left, told["carried"])):
            field.set_options(pieces, value=field.value if field.value in pieces else None)

    place.heard(show)
