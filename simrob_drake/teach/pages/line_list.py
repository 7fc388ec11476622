"""The program of an arm: lines that go to taught targets; to be run one by one, put in order and changed."""

from collections.abc import Callable, Mapping
from typing import Any

from nicegui import context, ui

from simrob_drake.programs.moves.move_j import MoveJ
from simrob_drake.teach.form import content_of
from simrob_drake.teach.pages.elements import KEYS, follow, icon_button
from simrob_drake.teach.pages.phrases import MILLI, Phrases, line_words, motions
from simrob_drake.teach.session import Session

SPEED = 200.0
"""Of the tool unless another one is asked for [mm/s]; v200 of RAPID."""

_FASTEST = 5000.0  # mm/s


def build(session: Session, phrases: Phrases) -> None:
    """Build what adds lines, and the list of them."""
    _build_adding(session, phrases)
    _Lines(session, phrases)


def _build_adding(session: Session, phrases: Phrases) -> None:
    t = phrases.t
    with ui.row().classes("w-full items-start gap-2"):
        kinds = motions()
        titles = {key: phrases.title(kind) for key, kind in kinds.items()}
        kind = ui.select(titles, value=MoveJ.key, label=t("arm.move")).classes("w-32")
        via = ui.select([], label=t("arm.via")).classes("w-24")
        target = ui.select([], label=t("arm.target")).classes("w-24")
        speed = ui.number(t("arm.speed"), value=SPEED, min=1, max=_FASTEST, step=10, suffix="mm/s").classes("w-32")
        for field in (kind, via, target, speed):
            field.props("dense outlined options-dense")
        add = ui.button(t("arm.add_line"), icon="playlist_add").props("no-caps")
        add.props[KEYS] = "Alt+A"

    def goes_via() -> bool:
        return "via" in kinds[kind.value].model_fields

    def adapt() -> None:
        via.set_visibility(goes_via())
        add.set_enabled(bool(target.value and (not goes_via() or via.value)))

    def store() -> None:
        through = {"via": via.value} if goes_via() else {}
        how = {"speed": speed.value * MILLI} if speed.value else {}
        session.add_line(kind.value, target.value, **through, **how)

    def targets() -> None:
        names = list(session.targets)
        new = names != target.options
        for field in (target, via):
            chosen = field.value if field.value in names else None
            field.set_options(names, value=chosen)
        if new and names:
            target.value = names[-1]  # the one that was taught last
        adapt()

    add.on_click(store)
    for field in (kind, via, target):
        field.on_value_change(adapt)
    follow(session, targets, "program", "description")


class _Lines:
    """The list of the lines, with one that comes next."""

    def __init__(self, session: Session, phrases: Phrases) -> None:
        self._session, self._phrases, self._t = session, phrases, phrases.t
        self._next = 0
        self._shown: Any = None
        self._room = context.slot.parent
        with ui.row().classes("w-full items-center gap-2 pt-2"):
            self._play = ui.button(self._t("arm.play"), icon="play_arrow", on_click=session.simulate)
            self._step = ui.button(self._t("arm.step"), icon="skip_next", on_click=lambda: self._run(self._next))
            self._step.props[KEYS] = "Alt+S"
            for button in (self._play, self._step):
                button.props("no-caps outline")
        self._pending = ui.row().classes("w-full items-center gap-2")
        self._list = ui.element("ol").classes("w-full p-0 m-0").style("list-style: none")
        follow(session, self._show, "program", "phase", "description")

    def _go(self, number: int) -> None:
        self._next = number if number < len(self._session.program.moves) else 0
        self._show()

    def _show(self) -> None:
        session = self._session
        moves = [move.entry() for move in session.program.moves]
        self._next = self._next if self._next < len(moves) else 0
        idle = session.phase == "idle"
        for button in (self._play, self._step):
            button.set_enabled(idle and bool(moves))
        shown = (moves, session.pending, self._next, idle, list(session.targets))
        if shown == self._shown:
            return
        self._shown = shown
        self._list.clear()
        with self._list:
            for number, move in enumerate(moves):
                self._line(number, move, len(moves), idle)
            if not moves:
                ui.label(self._t("arm.no_lines")).classes("opacity-70 py-1")
        self._pending.clear()
        with self._pending:
            self._tried()

    def _line(self, number: int, move: Mapping[str, Any], count: int, idle: bool) -> None:
        t, session, text = self._t, self._session, line_words(self._phrases, move, self._session.targets)
        comes = number == self._next
        with ui.element("li").classes("w-full"), ui.row().classes("w-full items-center gap-1 no-wrap") as row:
            row.classes("bg-primary/15 rounded" if comes else "")
            ui.icon("arrow_right" if comes else "", size="1.4rem").props(f'aria-hidden="{str(not comes).lower()}"')
            ui.label(f"{number + 1}  {text}").classes("grow").style("overflow-wrap: anywhere")
            icon_button("play_arrow", t("arm.run_line", number=number + 1), lambda: self._run(number)).set_enabled(idle)
            with icon_button("more_vert", t("arm.change_line", number=number + 1)), ui.menu():
                if next(iter(move)) in motions():
                    ui.menu_item(t("arm.edit"), lambda: self._edit(number, move))
                if number:
                    ui.menu_item(t("arm.up"), lambda: session.move_entry(number, number - 1))
                if number < count - 1:
                    ui.menu_item(t("arm.down"), lambda: session.move_entry(number, number + 1))
                ui.menu_item(t("arm.next"), lambda: self._go(number))
                ui.menu_item(t("arm.delete"), lambda: session.remove(number))

    def _run(self, number: int) -> None:
        self._session.run_line(number)
        self._go(number + 1)

    def _tried(self) -> None:
        """Show what was tried and is not stored, with what becomes of it."""
        if not self._session.pending:
            return
        what = "; ".join(line_words(self._phrases, move, self._session.targets) for move in self._session.pending)
        ui.label(self._t("arm.tried", what=what)).classes("grow")
        ui.button(self._t("arm.keep"), on_click=self._session.add).props("dense no-caps")
        ui.button(self._t("arm.discard"), on_click=self._session.discard).props("dense flat no-caps")

    def _edit(self, number: int, move: Mapping[str, Any]) -> None:
        """Let the user change the speed of a line, or the time that it takes."""
        kind = next(iter(move))
        said = content_of(motions()[kind], move)
        mm_s = said["speed"] / MILLI if said.get("speed") else None

        def store() -> None:
            rest = {key: value for key, value in said.items() if key not in ("speed", "duration", "times")}
            how = {"duration": time.value} if time.value else {"speed": speed.value * MILLI} if speed.value else {}
            if self._session.edit(number, {kind: {**rest, **how}}):
                dialog.close()

        with self._room, ui.dialog(value=True) as dialog, ui.card():
            ui.label(self._t("arm.change_line", number=number + 1)).classes("font-medium")
            speed = ui.number(self._t("arm.speed"), value=mm_s, min=1, max=_FASTEST, suffix="mm/s")
            time = ui.number(self._t("arm.duration"), value=said.get("duration"), min=0.05, step=0.1, suffix="s")
            for field, other in ((speed, time), (time, speed)):
                field.props("dense outlined").on_value_change(_clearing(other))
            with ui.row():
                ui.button(self._t("arm.take"), on_click=store).props("no-caps")
                ui.button(self._t("arm.leave"), on_click=dialog.close).props("flat no-caps")


def _clearing(other: ui.number) -> Callable[[Any], None]:
    """Return what empties a field when another is filled: a line has a speed or a duration."""

    def clear(event: Any) -> None:
        if event.value is not None:
            other.value = None

    return clear
