"""The page of an arm, in the order of use: tool and pieces, jogging, targets, postures for a pose, and its lines."""

from asyncio import wrap_future
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from nicegui import ui

from simrob_drake.extensions.pendant.move_labels import labels_of
from simrob_drake.extensions.pendant.pages.arm_jogging import ArmState, Jogging
from simrob_drake.extensions.pendant.pages.elements import (
    card,
    follow,
    icon_button,
    own_tab_panels,
    rebuild,
    set_keys,
    set_label,
)
from simrob_drake.extensions.pendant.pages.move_forms import choices_of, offers, speed_field
from simrob_drake.extensions.pendant.pages.move_list import MoveList
from simrob_drake.extensions.pendant.pages.words import (
    MILLI,
    WORLD,
    Phrases,
    Words,
    frame_words,
    joint_words,
    motions,
    pose_words,
    work_objects,
)
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.programs.moves.kinds import KINDS
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.moves.move_j import MoveJ

_PIECES, _TOOLS = (
    "pieces",
    "tools",
)  # what the forms of moves ask for that change what is in the arm's hand
_TAB = "arm"  # name of the tab
_ARROW_KEYS = """(event) => {
  const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!by) return;
  event.preventDefault(); // else the list scrolls
  emit(by);
}"""
"""Emits 1 or -1 for the arrow keys down and up, in the browser."""
_IN_ORDER = 2  # parts of the page that are used one after the other


def build(session: Session, t: Words) -> None:
    """Build the page into the present slot; it is there as soon as an arm is."""

    def robot() -> Mapping[str, Any]:
        found: Mapping[str, Any] = session.description.get("robots", {}).get(session.book.robot, {})
        return found

    def state() -> list[Any]:
        return [
            session.book.robot,
            robot().get("kind"),
            [axis["name"] for axis in robot().get("axes", ())],
        ]

    def show() -> None:
        if robot().get("kind") == "arm":
            _build(session, t, robot())

    def forget_postures(value: str) -> None:
        if value != _TAB and session.arm.ghosts:
            session.arm.hide_ghosts()

    rebuild(session, state, show, "description")
    panels = own_tab_panels()
    if panels is not None:
        panels.on_value_change(lambda event: forget_postures(event.value))


def _build(session: Session, t: Words, robot: Mapping[str, Any]) -> None:
    axes = robot["axes"]
    phrases, place = Phrases(t, axes), ArmState(session)
    others = [
        kind
        for kind in KINDS.values()
        if kind.of_arms and not {_PIECES, _TOOLS} & _asked_things(kind)
    ]
    parts: dict[str, Callable[[], object]] = {
        "jog": lambda: Jogging(session, phrases, axes, place),
        "program": lambda: _build_program(session, phrases, robot, place),
        "targets": lambda: build_targets(session, t),
        "hand": lambda: _build_hand(session, t, place),
        "postures": lambda: build_branches(session, phrases),
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
        for kind in KINDS.values():
            if not kind.of_arms or _PIECES not in _asked_things(kind):
                continue
            takes = _TOOLS in _asked_things(kind)
            piece = _choice(t("arm.piece" if takes else "arm.held"))
            pieces.append(("around" if takes else "carried", piece))
            _put(session, t("arm.take_piece" if takes else "arm.leave_piece"), kind, piece)
    tool.on_value_change(
        lambda event: (
            event.value not in (None, place.values.get("tool")) and session.arm.tool(tool.value)
        )
    )

    def show() -> None:
        values = place.values
        tool.set_options(
            values["tools"], value=values["tool"] if values["tool"] in values["tools"] else None
        )
        for where, field in pieces:
            field.set_options(
                values[where], value=field.value if field.value in values[where] else None
            )

    place.subscribe(show)


def _asked_things(kind: type[Move]) -> set[str | float | None]:
    """Things that the form of a kind of move lets the user choose among, such as ``pieces``."""
    return set(labels_of(kind).form.values())


def _choice(label: str, options: Any = None, value: Any = None) -> ui.select:
    field = (
        ui.select(options or [], label=label, value=value)
        .props("dense outlined options-dense")
        .classes("grow")
    )
    return field.style("min-width: 7rem; flex-basis: 7rem")


def _put(session: Session, text: str, kind: type[Move], piece: ui.select) -> None:
    """Build the button that does a kind of move with the piece that is chosen."""
    name = next(name for name, asked in labels_of(kind).form.items() if asked == _PIECES)
    button = ui.button(
        text, on_click=lambda: session.try_move({kind.key: {name: piece.value}})
    ).props("outline no-caps")
    piece.on_value_change(lambda event: button.set_enabled(bool(event.value)))
    button.set_enabled(False)


def _build_program(
    session: Session, phrases: Phrases, robot: Mapping[str, Any], place: ArmState
) -> None:
    """Build what teaches a target, adds a line that goes there, the list of them, and what was tried and not stored."""
    t, kinds = phrases.t, motions()
    build_teaching(session, t, place)

    def tried() -> None:
        if session.book.pending:
            what = "; ".join(
                phrases.move(move, session.book.targets) for move in session.book.pending
            )
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
        set_keys(add, "Alt+A")

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


def build_teaching(session: Session, t: Words, place: ArmState) -> None:
    """Build what teaches a target where the arm is."""

    async def teach() -> None:
        """Teach the target, and say its name: on a phone the list of targets is out of sight."""
        asked = (name.value or "").strip() or None
        name.value = ""
        taught = await wrap_future(session.arm.teach_target(asked, frame.value or WORLD))
        if taught is not None and not name.is_deleted:
            with name:
                ui.notify(t("arm.taught", name=taught), type="positive", position="bottom")

    def frames() -> None:
        known = work_objects(place.values["frames"])
        frame.set_options(
            frame_words(t, known), value=frame.value if frame.value in known else WORLD
        )

    with ui.row().classes("w-full items-center gap-2"):
        name = (
            ui.input(t("arm.name"))
            .props("dense outlined clearable")
            .classes("grow")
            .style("min-width: 7rem")
        )
        name.on("keydown.enter", teach)
        frame = ui.select(
            {WORLD: t("arm.frame_world")}, value=WORLD, label=t("arm.goes_with"), with_input=True
        )
        frame.props("dense outlined options-dense").classes("grow").style("min-width: 8rem")
        set_keys(
            ui.button(t("arm.teach"), icon="add_location", on_click=teach).props("no-caps"), "Alt+T"
        )
    place.subscribe(frames)


def build_targets(session: Session, t: Words) -> None:
    """Build the list of targets."""

    def show() -> None:
        with ui.element("ul").classes("w-full p-0 m-0").style("list-style: none"):
            for target, taught in session.book.targets.items():
                _target(session, t, target, taught)
        if not session.book.targets:
            ui.label(t("arm.no_targets")).classes("opacity-70 py-1")

    rebuild(session, lambda: dict(session.book.targets), show, "program")


def _target(session: Session, t: Words, name: str, taught: Mapping[str, Any]) -> None:
    frame = taught["frame"]
    parts = [
        pose_words(t, taught["pose"]),
        "" if frame == WORLD else t("arm.in_frame", frame=frame),
        taught["tool"],
    ]
    with ui.element("li").classes("w-full"), ui.row().classes("w-full items-center gap-2 no-wrap"):
        ui.label(name).classes("font-medium").style("min-width: 3rem; overflow-wrap: anywhere")
        ui.label(" · ".join(filter(None, parts))).classes("grow text-sm")
        icon_button(
            "near_me", t("arm.go_to", name=name), partial(session.arm.jog_axes, taught["axes"])
        )
        icon_button(
            "call_split", t("arm.branches_of", name=name), partial(session.arm.branches, name)
        )
        icon_button("delete", t("arm.forget", name=name), partial(session.arm.remove_target, name))


def build_branches(session: Session, phrases: Phrases) -> None:
    """Build the list of the branches that the session found last: the postures that reach a pose.

    The view draws one of them as a ghost. Its entry is marked, and the arrow keys choose another.
    """
    t = phrases.t
    with ui.row().classes("w-full items-center gap-2"):
        ui.button(
            t("arm.branches"), icon="call_split", on_click=partial(session.arm.branches, None)
        ).props("no-caps")
        hide = ui.button(t("arm.hide"), on_click=session.arm.hide_ghosts).props("flat no-caps")

    hint = ui.label(t("arm.step_postures")).classes("text-sm opacity-70")
    entries: list[ui.element] = []

    def step(by: int) -> None:
        shown = session.arm.shown_ghost
        session.arm.show_branch(0 if shown is None else shown + by)

    def show() -> None:
        entries.clear()
        hide.set_visibility(bool(session.arm.ghosts))
        hint.set_visibility(len(session.arm.ghosts) > 1)
        if not session.arm.ghosts:
            return
        with ui.element("ol").classes("w-full p-0 m-0").props("tabindex=0") as listing:
            listing.style("list-style: none; max-height: 22rem; overflow-y: auto")
            set_label(listing, t("arm.postures"))
            listing.on("keydown", lambda event: step(event.args), js_handler=_ARROW_KEYS)
            for number, branch in enumerate(session.arm.ghosts):
                entries.append(_branch(session, phrases, number, branch))

    def mark_shown() -> None:
        for number, entry in enumerate(entries):
            is_shown = number == session.arm.shown_ghost
            entry.classes(
                add="pendant-shown" if is_shown else "", remove="" if is_shown else "pendant-shown"
            )
            entry.props["aria-current"] = "true" if is_shown else None
            entry.update()
            if is_shown:
                entry.client.run_javascript(
                    f"getHtmlElement({entry.id})?.scrollIntoView({{block: 'nearest'}})"
                )

    # First the entries, then the mark of one of them.
    rebuild(session, lambda: list(session.arm.ghosts), show, "program")
    follow(session, mark_shown, "program")


def _branch(
    session: Session, phrases: Phrases, number: int, branch: Mapping[str, Any]
) -> ui.element:
    """Build the entry of one, with the reason why it is impossible if it is, and return it."""
    t, usable = phrases.t, branch["usable"]
    icon, colour = ("check", "positive") if usable else ("block", "negative")
    with (
        ui.element("li")
        .classes("w-full py-1 px-1")
        .style("border-top: 1px solid var(--line)") as entry
    ):
        for event in ("mouseenter", "click"):
            entry.on(event, partial(session.arm.show_branch, number))
        with ui.row().classes("w-full items-center gap-2 no-wrap"):
            ui.icon(icon, color=colour, size="1.4rem").props("aria-hidden=true")
            ui.label(f"{number + 1}").classes("font-medium")
            axes = "  ".join(
                _position(phrases, axis, value) for axis, value in branch["axes"].items()
            )
            ui.label(axes).classes("grow tabular-nums")
            button = ui.button(t("arm.choose"), on_click=partial(session.arm.choose_branch, number))
            button.props(
                f'outline dense no-caps aria-label="{t("arm.choose_branch", number=number + 1)}"'
            )
            button.set_enabled(usable)
        if not usable:
            reasons = "; ".join(_reasons(phrases, branch))
            ui.label(t("arm.not_usable", why=reasons)).classes("text-sm pendant-off red")
        parts = (_load(phrases, branch), _room(phrases, branch), _gap(phrases, branch))
        ui.label(" · ".join(parts)).classes("text-sm")
    return entry


def _reasons(phrases: Phrases, branch: Mapping[str, Any]) -> list[str]:
    """List why an arm cannot stand in a posture: a limit that it exceeds, a torque that it lacks, a collision."""
    reasons = []
    if branch["room"]["left"] < 0:
        reasons.append(_room(phrases, branch))
    if branch["load"]["share"] > 1:
        reasons.append(
            phrases.t("arm.too_heavy", axis=joint_words(phrases, branch["load"]["axis"]))
        )
    if branch["collision"]:
        first, _, other = branch["collision"].partition(" in ")
        things = {"first": first.replace("_", " "), "other": other.replace("_", " ")}
        reasons.append(phrases.t("arm.collides", **things))
    return reasons


def _load(phrases: Phrases, branch: Mapping[str, Any]) -> str:
    axis = branch["load"]["axis"]
    share, torque, limit = (
        100 * branch["load"]["share"],
        abs(branch["torque"][axis]),
        branch["limit"][axis],
    )
    numbers = {
        "share": f"{share:.0f}",
        "torque": phrases.t.figure(round(torque, 2)),
        "limit": phrases.t.figure(limit),
    }
    return phrases.t("arm.load", axis=joint_words(phrases, axis), **numbers)


def _room(phrases: Phrases, branch: Mapping[str, Any]) -> str:
    left, axis = branch["room"]["left"], branch["room"]["axis"]
    key = "arm.room" if left >= 0 else "arm.beyond_by"
    return phrases.t(key, left=_position(phrases, axis, abs(left)), axis=joint_words(phrases, axis))


def _gap(phrases: Phrases, branch: Mapping[str, Any]) -> str:
    if branch["gap"] is None:
        return phrases.t("arm.no_gap")
    (first, second), distance = branch["gap"]["between"], round(branch["gap"]["distance"] / MILLI)
    key = "arm.inside" if distance < 0 else "arm.gap"
    things = {"first": first.replace("_", " "), "other": second.replace("_", " ")}
    return phrases.t(
        key, distance=phrases.t.figure(distance), depth=phrases.t.figure(-distance), **things
    )


def _position(phrases: Phrases, axis: str, value: float) -> str:
    digits = 1 if phrases.unit(axis) == "°" else 3
    return f"{phrases.t.figure(round(value, digits))}{phrases.unit(axis)}"
