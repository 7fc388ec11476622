"""The stored moves as a list, to be edited, put in another order and deleted, and below it the changes of the run."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from nicegui import context, ui

from simrob_drake.programs.timeline import GRID
from simrob_drake.teach.pages.elements import follow, icon_button, set_label
from simrob_drake.teach.pages.move_forms import Read, choices_of, stored_form, yaml_form
from simrob_drake.teach.pages.phrases import Content, Phrases
from simrob_drake.teach.session import Session

_Act = Callable[[int], object]


def build(session: Session, phrases: Phrases, robot: Content) -> None:
    """Build the list of a session's program."""
    t, dialogs = phrases.t, ui.element("div")

    def edit_move(index: int) -> None:
        move = session.program.moves[index].entry()
        choices = choices_of(session, robot)
        form = partial(stored_form, phrases, choices, move)
        _edit(dialogs, session, phrases, form, partial(session.edit, index))

    def edit_change(index: int) -> None:
        change = session.program.changes[index].model_dump(mode="json", exclude_none=True)
        form = partial(yaml_form, t("legs.as_yaml"), change)
        _edit(dialogs, session, phrases, form, partial(session.edit_change, index))

    def earlier(index: int) -> None:
        if index > 0:
            session.move_entry(index, index - 1)
            moves.focus(index - 1, "arrow_upward")

    def later(index: int) -> None:
        if index < len(session.program.moves) - 1:
            session.move_entry(index, index + 1)
            moves.focus(index + 1, "arrow_downward")

    order: dict[str, tuple[str, _Act]] = {
        "arrow_upward": (t("legs.earlier"), earlier),
        "arrow_downward": (t("legs.later"), later),
    }
    moves = _Lines({**order, "edit": (t("legs.edit"), edit_move), "delete": (t("legs.delete"), session.remove)})
    nothing = ui.label(t("legs.no_moves")).classes("opacity-70")
    heading = ui.label(t("legs.changes")).classes("font-bold mt-2")
    changes = _Lines({"edit": (t("legs.edit"), edit_change), "delete": (t("legs.delete"), session.remove_change)})

    def show() -> None:
        program = session.program
        moves.show([phrases.move(move.entry()) for move in program.moves])
        nothing.set_visibility(not program.moves)
        heading.set_visibility(bool(program.changes))
        changes.show([phrases.change(change, program.grid or GRID) for change in program.changes])

    follow(session, show, "program")


class _Lines:
    """Numbered lines with buttons; they stay in place when their texts change, so that the focus stays, too."""

    def __init__(self, acts: dict[str, tuple[str, _Act]]) -> None:
        """Build the place for them; ``acts`` are the buttons by icon, each with what it is called and does."""
        self._acts = acts
        self._rows: list[tuple[ui.row, ui.label, dict[str, ui.button]]] = []
        self._place = ui.column().classes("w-full gap-0").props("role=list")

    def show(self, texts: Sequence[str]) -> None:
        """Show these texts, one a line."""
        while len(self._rows) > len(texts):
            self._rows.pop()[0].delete()
        while len(self._rows) < len(texts):
            self._add(len(self._rows))
        for number, (text, (_, label, buttons)) in enumerate(zip(texts, self._rows, strict=True), 1):
            label.text = f"{number}. {text}"
            for icon, button in buttons.items():
                set_label(button, f"{self._acts[icon][0]}: {label.text}")

    def focus(self, index: int, icon: str) -> None:
        """Put the focus on a button of a line."""
        button = self._rows[index][2][icon]
        context.client.run_javascript(f"getHtmlElement({button.id})?.focus()")

    def _add(self, index: int) -> None:
        with self._place, ui.row().classes("w-full items-center no-wrap gap-1").props("role=listitem") as row:
            label = ui.label().classes("grow min-w-0 break-words")
            buttons = {icon: icon_button(icon, text, partial(act, index)) for icon, (text, act) in self._acts.items()}
        self._rows.append((row, label, buttons))


def _edit(
    place: ui.element, session: Session, phrases: Phrases, form: Callable[[], Read], store: Callable[[Any], bool]
) -> None:
    """Open a form in a window of its own, which closes when what it holds was stored."""
    t = phrases.t
    place.clear()
    with place, ui.dialog() as dialog, ui.card().classes("w-full"):
        ui.html(t("legs.edit"), tag="h2", sanitize=False).classes("text-base font-bold")
        read = form()
        wrong = ui.label().classes("text-negative").props("role=alert")

        def save() -> None:
            content = read()
            if content is not None and store(content):
                dialog.close()
            elif content is not None:
                wrong.text = t.of_engine(str(session.message))

        with ui.row():
            ui.button(t("legs.save"), on_click=save).props("no-caps")
            ui.button(t("legs.cancel"), on_click=dialog.close).props("flat no-caps")
    dialog.open()
