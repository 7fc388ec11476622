"""The stored moves as a list: run one by one, edited, put in another order, deleted; and the changes of the run."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from nicegui import context, ui

from simrob_drake.extensions.pendant.pages.elements import follow, icon_button, set_keys, set_label
from simrob_drake.extensions.pendant.pages.move_forms import (
    Read,
    choices_of,
    stored_form,
    yaml_form,
)
from simrob_drake.extensions.pendant.pages.words import Content, Phrases, Words
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.timeline import GRID

_Act = Callable[[int], object]


class MoveList:
    """The list of a session's program; moves of an arm can be run one by one, and one of them comes next."""

    def __init__(self, session: Session, phrases: Phrases, robot: Content) -> None:
        """Build it in the present place."""
        t = phrases.t
        self._session, self._phrases, self._robot = session, phrases, robot
        self._dialogs, self._next, self._stepped = ui.element("div"), 0, robot["kind"] == "arm"
        acts: dict[str, tuple[str, _Act]] = {
            "arrow_upward": (
                t("legs.earlier"),
                lambda index: self._move(index, -1, "arrow_upward"),
            ),
            "arrow_downward": (
                t("legs.later"),
                lambda index: self._move(index, 1, "arrow_downward"),
            ),
        }
        change_acts: dict[str, tuple[str, _Act]] = {
            "edit": (t("legs.edit"), self._edit_change),
            "delete": (t("legs.delete"), session.book.remove_change),
        }
        if self._stepped:
            self._build_steps()
            acts = {
                "arrow_right": (t("arm.next"), self._go),
                "play_circle": (t("arm.run_line"), self._run),
                **acts,
            }
        acts |= {
            "edit": (t("legs.edit"), self._edit_move),
            "delete": (t("legs.delete"), session.book.remove),
        }
        self._moves = _Lines(acts)
        self._nothing = ui.label().classes("opacity-70")
        self._heading = ui.label(t("legs.changes")).classes("font-bold mt-2")
        self._changes = _Lines(change_acts)
        follow(session, self._show, "program", "phase")

    def _build_steps(self) -> None:
        """Build what runs all of an arm's moves, and the one that comes next."""
        t = self._phrases.t
        with ui.row().classes("w-full items-center gap-2 pt-2"):
            play = ui.button(t("arm.play"), icon="play_arrow", on_click=self._session.simulate)
            step = ui.button(
                t("arm.step"), icon="skip_next", on_click=lambda: self._run(self._next)
            )
            set_keys(step, "Alt+S")
        self._runs = [button.props("no-caps outline") for button in (play, step)]

    def _nothing_stored(self) -> str:
        """Hint for a program without moves: the step that comes next."""
        t = self._phrases.t
        if not self._stepped:
            return t("legs.no_moves")
        targets = list(self._session.book.targets)
        if not targets:
            return t("arm.no_lines")
        return t("arm.no_line_to", target=targets[-1])

    def _show(self) -> None:
        """Show the program of the session."""
        session = self._session
        program = session.book.program
        self._moves.show(
            [self._phrases.move(move.entry(), session.book.targets) for move in program.moves]
        )
        self._nothing.set_text(self._nothing_stored())
        self._nothing.set_visibility(not program.moves)
        self._heading.set_visibility(bool(program.changes))
        self._changes.show(
            [self._phrases.change(change, program.grid or GRID) for change in program.changes]
        )
        if self._stepped:
            idle = session.phase == "idle"
            for button in (*self._runs, *self._moves.buttons("play_circle")):
                button.set_enabled(idle and bool(program.moves))
            self._go(self._next)

    def _go(self, index: int) -> None:
        """Mark the move that comes next."""
        self._next = index if index < len(self._session.book.program.moves) else 0
        for number, button in enumerate(self._moves.buttons("arrow_right")):
            button.props(f"color={'primary' if number == self._next else 'grey'}")
        self._moves.mark(self._next)

    def _run(self, index: int) -> None:
        self._session.arm.run_line(index)
        self._go(index + 1)

    def _move(self, index: int, by: int, icon: str) -> None:
        if 0 <= index + by < len(self._session.book.program.moves):
            self._session.book.move_entry(index, index + by)
            self._moves.focus(index + by, icon)

    def _edit_move(self, index: int) -> None:
        move, choices = (
            self._session.book.program.moves[index].entry(),
            choices_of(self._session, self._robot),
        )
        self._edit(
            partial(stored_form, self._phrases, choices, move),
            partial(self._session.book.edit, index),
        )

    def _edit_change(self, index: int) -> None:
        change = self._session.book.program.changes[index].model_dump(
            mode="json", exclude_none=True
        )
        form = partial(yaml_form, self._phrases.t, self._phrases.t("legs.as_yaml"), change)
        self._edit(form, partial(self._session.book.edit_change, index))

    def _edit(self, form: Callable[[], Read], store: Callable[[Any], bool]) -> None:
        """Open a form in a window of its own, which closes when what it holds was stored."""
        t = self._phrases.t
        self._dialogs.clear()
        with self._dialogs, ui.dialog(value=True) as dialog, ui.card().classes("w-full"):
            set_label(dialog, t("legs.edit"))
            ui.html(t("legs.edit"), tag="h2", sanitize=False).classes("text-base font-bold")
            read = form()
            wrong = ui.label().classes("text-negative").props("role=alert")

            def save() -> None:
                content = read()
                if content is not None and store(content):
                    dialog.close()
                elif content is not None:
                    wrong.text = t.render(str(self._session.message))

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
        for number, (text, (_, label, buttons)) in enumerate(
            zip(texts, self._rows, strict=True), 1
        ):
            label.text = f"{number}. {text}"
            for icon, button in buttons.items():
                set_label(button, f"{self._acts[icon][0]}: {label.text}")

    def buttons(self, icon: str) -> list[ui.button]:
        """Return the buttons of all lines that have an icon."""
        return [buttons[icon] for _, _, buttons in self._rows]

    def mark(self, marked: int) -> None:
        """Mark the line that comes next by its index, for the eye and for screen readers."""
        for index, (row, _, _) in enumerate(self._rows):
            is_next = index == marked
            row.classes(
                add="pendant-next" if is_next else None, remove=None if is_next else "pendant-next"
            )
            row.props["aria-current"] = "step" if is_next else None
            row.update()

    def focus(self, index: int, icon: str) -> None:
        """Put the focus on a button of a line."""
        context.client.run_javascript(f"getHtmlElement({self.buttons(icon)[index].id})?.focus()")

    def _add(self, index: int) -> None:
        with (
            self._place,
            ui.row().classes("w-full items-center no-wrap gap-1").props("role=listitem") as row,
        ):
            label = ui.label().classes("grow min-w-0 break-words")
            buttons = {
                icon: icon_button(icon, text, partial(act, index))
                for icon, (text, act) in self._acts.items()
            }
        self._rows.append((row, label, buttons))


_UNKNOWN = 1.0  # width of a block whose move has no known duration yet, as if it took this long [s]


def durations_of(moves: Sequence[Move], ran: Sequence[Mapping[str, Any]]) -> list[float | None]:
    """Find how long the moves of a program take.

    Args:
        moves: the moves.
        ran: moves that the last run of a program did, each ``{entry, begin, end}``, as the run reports them. They
            count up to the first one that differs from the program's.

    Returns:
        the duration of each move [s]: as it was run, else as it is asked for; None if neither is known.
    """
    entries = [move.entry() for move in moves]
    known = [done["entry"] for done in ran]
    same = next(
        (
            count
            for count in range(min(len(known), len(moves)), 0, -1)
            if known[:count] == entries[:count]
        ),
        0,
    )
    run_durations = [done["end"] - done["begin"] for done in ran[:same]]
    asked_durations = [
        getattr(move, "duration", None) if move.takes_time else 0.0 for move in moves[same:]
    ]
    return [*run_durations, *asked_durations]


def position_in(time: float, durations: Sequence[float | None]) -> tuple[int, float] | None:
    """Find the move in which a program is at a time.

    Args:
        time: time since the start of the program [s].
        durations: durations of the moves [s]; None if a duration is not known yet.

    Returns:
        index of the move, and the share of its duration that has passed, 0 in a move of unknown duration. None if all
        moves have ended.
    """
    begin = 0.0
    for index, duration in enumerate(durations):
        if duration is None:
            return index, 0.0
        if time < begin + duration:
            return index, (time - begin) / duration
        begin += duration
    return None


class ProgramTimeline:
    """The moves as blocks in a row: how long each takes, and where a run of them is.

    A block is dragged to put its move elsewhere, by its right edge to let it take another time, and clicked to see
    where it began. Who uses the keys or hears the page has the same in the list.
    """

    def __init__(self, session: Session, t: Words) -> None:
        """Build it; it follows the session."""
        self._session, self._t = session, t
        self._blocks: list[ui.element] = []
        self._durations: list[float | None] = []
        self._ran: Sequence[Mapping[str, Any]] = ()  # moves of the last run of a program
        self._heard: dict[str, Any] | None = None
        self._now: ui.element | None = None
        self._place = ui.element("div").classes("pendant-timeline").props("aria-hidden=true")
        for event in ("dragstart", "dragover"):
            self._place.on(event, js_handler="(event) => window.timeline.drag(event)")
        for event, act, does in (
            ("drop", "drag", session.book.move_entry),
            ("pointerdown", "stretch", self._stretch),
        ):
            handler = f"(event) => window.timeline.{act}(event, emit)"
            self._place.on(event, lambda event, does=does: does(*event.args), js_handler=handler)
        follow(session, self._build, "program", "description")
        follow(session, self._follow, "tick", "phase")

    def _build(self) -> None:
        robots = self._session.description.get("robots", {})
        phrases = Phrases(self._t, robots.get(self._session.book.robot, {}).get("axes", ()))
        moves = self._session.book.program.moves
        self._durations = durations_of(moves, self._ran)
        self._now = None
        self._blocks = []
        self._place.clear()
        self._place.set_visibility(bool(moves))
        with self._place:
            for number, move in enumerate(moves):
                self._block(number, phrases.move(move.entry(), self._session.book.targets))
        self._show_head()

    def _block(self, number: int, text: str) -> None:
        duration = self._durations[number]
        caption = f"{number + 1}. {text}" + (f" · {self._t.figure(duration)} s" if duration else "")
        with (
            ui.element("div")
            .classes("pendant-block")
            .props(f"draggable=true data-move={number}") as block
        ):
            ui.label(caption)
            if (
                asked := getattr(self._session.book.program.moves[number], "duration", None)
            ) is not None:
                ui.element("span").classes("pendant-edge").props(f"data-long={asked}")
        block.props["title"] = caption
        block.style(f"flex-grow: {_UNKNOWN if duration is None else duration:.3f}")
        block.on("click", lambda: self._show_begin(number))
        self._blocks.append(block)

    def _stretch(self, number: int, seconds: float) -> None:
        """Let a move take another time, in steps of the program's grid."""
        book = self._session.book
        grid, move = book.program.grid or GRID, book.program.moves[number]
        duration = round(max(round(seconds / grid), 1) * grid, 9)
        if duration == getattr(move, "duration", None) or not book.edit(
            number, move.model_copy(update={"duration": duration}).entry()
        ):
            self._build()  # as it was before it was dragged

    def _show_begin(self, number: int) -> None:
        """Show the moment in which a move began, if it is known and was run."""
        before = self._durations[:number]
        begin = sum(duration for duration in before if duration is not None)
        if (
            None not in before
            and self._session.run.kind == "program"
            and begin <= self._session.run.reach
        ):
            self._session.rewind(begin)

    def _follow(self) -> None:
        session = self._session
        if (
            session.run.ending is not self._heard
            and session.run.kind == "program"
            and session.phase == "idle"
        ):
            self._heard = session.run.ending
            self._ran = () if self._heard is None else self._heard["moves"]
            self._build()
        self._show_head()

    def _show_head(self) -> None:
        """Show where the run is in the block that it is in."""
        run = self._session.run
        at = position_in(run.time, self._durations) if run.kind == "program" else None
        now = self._blocks[at[0]] if at is not None else None
        if self._now is not None and self._now is not now:
            self._now.classes(remove="now")
        if now is not None and at is not None:
            now.classes(add="now").style(f"--at: {100 * at[1]:.1f}%")
        self._now = now
