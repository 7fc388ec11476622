"""The stored moves as a list: run one by one, edited, put in another order, deleted; and the changes of the run."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from nicegui import context, ui

from simrob_drake.programs.timeline import GRID
from simrob_drake.teach.pages.elements import KEYS, follow, icon_button, set_label
from simrob_drake.teach.pages.move_forms import Read, choices_of, stored_form, yaml_form
from simrob_drake.teach.pages.phrases import Content, Phrases
from simrob_drake.teach.session import Session

_Act = Callable[[int], object]


class MoveList:
    """The list of a session's program; moves of an arm can be run one by one, and one of them comes next."""

    def __init__(self, session: Session, phrases: Phrases, robot: Content) -> None:
        """Build it in the present place."""
        t = phrases.t
        self._session, self._phrases, self._robot = session, phrases, robot
        self._dialogs, self._next, self._stepped = ui.element("div"), 0, robot["kind"] == "arm"
        acts: dict[str, tuple[str, _Act]] = {
            "arrow_upward": (t("legs.earlier"), lambda index: self._move(index, -1, "arrow_upward")),
            "arrow_downward": (t("legs.later"), lambda index: self._move(index, 1, "arrow_downward")),
        }
        change_acts: dict[str, tuple[str, _Act]] = {
            "edit": (t("legs.edit"), self._edit_change),
            "delete": (t("legs.delete"), session.book.remove_change),
        }
        if self._stepped:
            self._build_steps()
            acts = {"arrow_right": (t("arm.next"), self._go), "play_arrow": (t("arm.run_line"), self._run), **acts}
        acts |= {"edit": (t("legs.edit"), self._edit_move), "delete": (t("legs.delete"), session.book.remove)}
        self._moves = _Lines(acts)
        self._nothing = ui.label(t("arm.no_lines" if self._stepped else "legs.no_moves")).classes("opacity-70")
        self._heading = ui.label(t("legs.changes")).classes("font-bold mt-2")
        self._changes = _Lines(change_acts)
        follow(session, self._show, "program", "phase")

    def _build_steps(self) -> None:
        """Build what runs all of an arm's moves, and the one that comes next."""
        t = self._phrases.t
        with ui.row().classes("w-full items-center gap-2 pt-2"):
            play = ui.button(t("arm.play"), icon="play_arrow", on_click=self._session.simulate)
            step = ui.button(t("arm.step"), icon="skip_next", on_click=lambda: self._run(self._next))
            step.props[KEYS] = "Alt+S"
        self._runs = [button.props("no-caps outline") for button in (play, step)]

    def _show(self) -> None:
        program, session = self._session.book.program, self._session
        self._moves.show([self._phrases.move(move.entry(), session.book.targets) for move in program.moves])
        self._nothing.set_visibility(not program.moves)
        self._heading.set_visibility(bool(program.changes))
        self._changes.show([self._phrases.change(change, program.grid or GRID) for change in program.changes])
        if self._stepped:
            idle = session.phase == "idle"
            for button in (*self._runs, *self._moves.buttons("play_arrow")):
                button.set_enabled(idle and bool(program.moves))
            self._go(self._next)

    def _go(self, index: int) -> None:
        """Mark the move that comes next."""
        self._next = index if index < len(self._session.book.program.moves) else 0
        for number, button in enumerate(self._moves.buttons("arrow_right")):
            button.props(f"color={'primary' if number == self._next else 'grey'}")

    def _run(self, index: int) -> None:
        self._session.arm.run_line(index)
        self._go(index + 1)

    def _move(self, index: int, by: int, icon: str) -> None:
        if 0 <= index + by < len(self._session.book.program.moves):
            self._session.book.move_entry(index, index + by)
            self._moves.focus(index + by, icon)

    def _edit_move(self, index: int) -> None:
        move, choices = self._session.book.program.moves[index].entry(), choices_of(self._session, self._robot)
        self._edit(partial(stored_form, self._phrases, choices, move), partial(self._session.book.edit, index))

    def _edit_change(self, index: int) -> None:
        change = self._session.book.program.changes[index].model_dump(mode="json", exclude_none=True)
        form = partial(yaml_form, self._phrases.t("legs.as_yaml"), change)
        self._edit(form, partial(self._session.book.edit_change, index))

    def _edit(self, form: Callable[[], Read], store: Callable[[Any], bool]) -> None:
        """Open a form in a window of its own, which closes when what it holds was stored."""
        t = self._phrases.t
        self._dialogs.clear()
        with self._dialogs, ui.dialog(value=True) as dialog, ui.card().classes("w-full"):
            ui.html(t("legs.edit"), tag="h2", sanitize=False).classes("text-base font-bold")
            read = form()
            wrong = ui.label().classes("text-negative").props("role=alert")

            def save() -> None:
                content = read()
                if content is not None and store(content):
                    dialog.close()
                elif content is not None:
                    wrong.text = t.of_engine(str(self._session.message))

            with ui.row():
                ui.button(t("legs.save"), on_click=save).props("no-caps")
                ui.button(t("legs.cancel"), on_click=dialog.close).props("flat no-caps")


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

    def buttons(self, icon: str) -> list[ui.button]:
        """Return the buttons of all lines that have an icon."""
        return [buttons[icon] for _, _, buttons in self._rows]

    def focus(self, index: int, icon: str) -> None:
        """Put the focus on a button of a line."""
        context.client.run_javascript(f"getHtmlElement({self.buttons(icon)[index].id})?.focus()")

    def _add(self, index: int) -> None:
        with self._place, ui.row().classes("w-full items-center no-wrap gap-1").props("role=listitem") as row:
            label = ui.label().classes("grow min-w-0 break-words")
            buttons = {icon: icon_button(icon, text, partial(act, index)) for icon, (text, act) in self._acts.items()}
        self._rows.append((row, label, buttons))
