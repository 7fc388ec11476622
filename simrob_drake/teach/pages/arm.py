"""The page of an arm, in the order of use: its tool and pieces, jogging, targets, branches, and its lines to them."""

from collections.abc import Callable, Mapping
from typing import Any

from nicegui import ui

from simrob_drake.programs.moves.kinds import KINDS
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.moves.move_j import MoveJ
from simrob_drake.teach.pages import target_list
from simrob_drake.teach.pages.arm_jogging import ArmState, Jogging
from simrob_drake.teach.pages.elements import KEYS, card, follow, rebuild
from simrob_drake.teach.pages.move_forms import choices_of, offers, speed_field
from simrob_drake.teach.pages.move_list import MoveList
from simrob_drake.teach.pages.words import MILLI, Phrases, Words, motions
from simrob_drake.teach.session import Session

_PIECES, _TOOLS = "pieces", "tools"
"""What the forms of moves ask for that change what is in the arm's hand."""
_IN_ORDER = 2  # parts of the page that are used one after the other


def build(session: Session, t: Words) -> None:
    """Build the page into the present slot; it is there as soon as an arm is."""

    def robot() -> Mapping[str, Any]:
        found: Mapping[str, Any] = session.description.get("robots", {}).get(session.book.robot, {})
        return found

    def state() -> list[Any]:
        return [session.book.robot, robot().get("kind"), [axis["name"] for axis in robot().get("axes", ())]]

    def show() -> None:
        if robot().get("kind") == "arm":
            _build(session, t, robot())

    rebuild(session, state, show, "description")


def _build(session: Session, t: Words, robot: Mapping[str, Any]) -> None:
    axes = robot["axes"]
    phrases, place = Phrases(t, axes), ArmState(session)
    others = [kind for kind in KINDS.values() if kind.of_arms and not {_PIECES, _TOOLS} & {*kind.form.values()}]
    parts: dict[str, Callable[[], object]] = {
        "jog": lambda: Jogging(session, phrases, axes, place),
        "program": lambda: _build_program(session, phrases, robot, place),
        "targets": lambda: target_list.build_targets(session, t),
        "hand": lambda: _build_hand(session, t, place),
        "postures": lambda: target_list.build_branches(session, phrases),
        "other": lambda: offers(session, phrases, choices_of(session, robot), others),
    }
    for number, (name, part) in enumerate(parts.items(), 1):
        with card(t(f"arm.{name}"), number if number <= _IN_ORDER else 0):
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
    tool.on_value_change(
        lambda event: event.value not in (None, place.values.get("tool")) and session.arm.tool(tool.value)
    )

    def show() -> None:
        values = place.values
        tool.set_options(values["tools"], value=values["tool"] if values["tool"] in values["tools"] else None)
        for where, field in pieces:
            field.set_options(values[where], value=field.value if field.value in values[where] else None)

    place.subscribe(show)


def _choice(label: str, options: Any = None, value: Any = None) -> ui.select:
    field = ui.select(options or [], label=label, value=value).props("dense outlined options-dense").classes("grow")
    return field.style("min-width: 7rem; flex-basis: 7rem")


def _put(session: Session, text: str, kind: type[Move], piece: ui.select) -> None:
    """Build the button that does a kind of move with the piece that is chosen."""
    name = next(name for name, asked in kind.form.items() if asked == _PIECES)
    button = ui.button(text, on_click=lambda: session.try_move({kind.key: {name: piece.value}})).props(
        "outline no-caps"
    )
    piece.on_value_change(lambda event: button.set_enabled(bool(event.value)))
    button.set_enabled(False)


def _build_program(session: Session, phrases: Phrases, robot: Mapping[str, Any], place: ArmState) -> None:
    """Build what teaches a target, adds a line that goes there, the list of them, and what was tried and not stored."""
    t, kinds = phrases.t, motions()
    target_list.build_teaching(session, t, place)

    def tried() -> None:
        if session.book.pending:
            what = "; ".join(phrases.move(move, session.book.targets) for move in session.book.pending)
            with ui.row().classes("w-full items-center gap-2"):
                ui.label(t("arm.tried", what=what)).classes("grow")
                ui.button(t("legs.add"), on_click=session.add).props("dense no-caps")
                ui.button(t("arm.discard"), on_click=session.discard).props("dense flat no-caps")

    with ui.row().classes("w-full items-start gap-2"):
        titles = {key: phrases.title(kind) for key, kind in kinds.items()}
        kind = _choice(t("arm.move"), titles, MoveJ.key)
        via, target, speed = _choice(t("arm.via")), _choice(t("arm.target")), speed_field(t)
        speed.field.classes("w-28")
        add = ui.button(t("arm.add_line"), icon="playlist_add").props("no-caps")
        add.props[KEYS] = "Alt+A"

    def goes_via() -> bool:
        return "via" in kinds[kind.value].model_fields

    def adapt() -> None:
        via.set_visibility(goes_via())
        add.set_enabled(bool(target.value and (not goes_via() or via.value)))

    def store() -> None:
        how: dict[str, Any] = {"speed": speed.value * MILLI} if speed.value else {}
        session.arm.add_line(kind.value, target.value, via=via.value if goes_via() else None, **how)

    def targets() -> None:
        names = list(session.book.targets)
        new = names != target.options
        for field in (target, via):
            field.set_options(names, value=field.value if field.value in names else None)
        if new and names:
            target.value = names[-1]  # the one that was taught last
        adapt()

    add.on_click(store)
    for field in (kind, via, target):
        field.on_value_change(adapt)
    follow(session, targets, "program", "description")
    MoveList(session, phrases, robot)
    rebuild(session, lambda: (session.book.pending, dict(session.book.targets)), tried, "program")
