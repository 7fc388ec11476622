"""The page of an arm, in the order of use: its tool and pieces, jogging, targets, branches, and the program."""

from collections.abc import Callable, Mapping
from typing import Any

from nicegui import ui

from simrob_drake.programs.moves.kinds import KINDS
from simrob_drake.programs.moves.move import Move
from simrob_drake.teach.pages import line_list, target_list
from simrob_drake.teach.pages.arm_jogging import ArmState, Jogging
from simrob_drake.teach.pages.elements import follow
from simrob_drake.teach.pages.move_forms import choices_of, offers
from simrob_drake.teach.pages.phrases import Phrases
from simrob_drake.teach.pages.words import Words
from simrob_drake.teach.session import Session

_PIECES, _TOOLS = "pieces", "tools"
"""What the forms of moves ask for that change what is in the arm's hand."""


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
                _build(session, t, robot)

    follow(session, show, "description")


def _build(session: Session, t: Words, robot: Mapping[str, Any]) -> None:
    axes = robot["axes"]
    phrases, place = Phrases(t, axes), ArmState(session)
    others = [kind for kind in KINDS.values() if kind.of_arms and not {_PIECES, _TOOLS} & {*kind.form.values()}]
    parts: dict[str, Callable[[], object]] = {
        "hand": lambda: _build_hand(session, t, place),
        "jog": lambda: Jogging(session, phrases, axes, place),
        "targets": lambda: target_list.build_targets(session, t, place),
        "postures": lambda: target_list.build_branches(session, phrases),
        "other": lambda: offers(session, phrases, choices_of(session, robot), others),
        "program": lambda: line_list.build(session, phrases),
    }
    for number, (name, part) in enumerate(parts.items(), 1):
        with ui.element("section").classes("w-full"):
            ui.html(f"{number}  {t(f'arm.{name}')}", tag="h2", sanitize=False).classes("text-base font-medium pb-1")
            part()


def _build_hand(session: Session, t: Words, place: ArmState) -> None:
    """Build the choice of the tool, and a choice of pieces for each kind of move that takes or leaves one."""
    pieces: list[tuple[str, ui.select]] = []
    with ui.row().classes("w-full items-center gap-2"):
        tool = _choice(t("arm.tool"))
        for kind in (kind for kind in KINDS.values() if kind.of_arms and _PIECES in kind.form.values()):
            takes = _TOOLS in kind.form.values()
            piece = _choice(t("arm.piece" if takes else "arm.held"))
            pieces.append(("around" if takes else "carried", piece))
            _put(session, t("arm.take_piece" if takes else "arm.leave_piece"), kind, piece)
    tool.on_value_change(lambda event: event.value not in (None, place.values.get("tool")) and session.tool(tool.value))

    def show() -> None:
        values = place.values
        tool.set_options(values["tools"], value=values["tool"] if values["tool"] in values["tools"] else None)
        for where, field in pieces:
            field.set_options(values[where], value=field.value if field.value in values[where] else None)

    place.subscribe(show)


def _choice(label: str) -> ui.select:
    field = ui.select([], label=label).props("dense outlined options-dense").classes("grow")
    return field.style("min-width: 8rem")


def _put(session: Session, text: str, kind: type[Move], piece: ui.select) -> None:
    """Build the button that does a kind of move with the piece that is chosen."""
    name = next(name for name, asked in kind.form.items() if asked == _PIECES)
    button = ui.button(text, on_click=lambda: session.try_move({kind.key: {name: piece.value}})).props(
        "outline no-caps"
    )
    piece.on_value_change(lambda event: button.set_enabled(bool(event.value)))
    button.set_enabled(False)
