"""The stored moves as a timeline below the view: how long each takes, and where a run of them is.

A block is dragged to put its move elsewhere, and clicked to see where it began. Who uses the keys or hears the page has
the same in the list of moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nicegui import ui

from simrob_drake.programs.moves.move import Move
from simrob_drake.teach.pages.elements import follow
from simrob_drake.teach.pages.phrases import Phrases, figure
from simrob_drake.teach.pages.words import Words
from simrob_drake.teach.session import Session

_UNKNOWN = 1.0  # s that a block stands for whose move takes nobody knows how long
_DRAGGED = """(event) => {
    const block = event.target.closest('[data-move]');
    if (!block) return;
    if (event.type === 'dragstart') event.dataTransfer.setData('simrob/move', block.dataset.move);
    else if (event.dataTransfer.types.includes('simrob/move')) event.preventDefault();
    if (event.type === 'drop') emit([event.dataTransfer.getData('simrob/move'), block.dataset.move].map(Number));
}"""


def lengths(moves: Sequence[Move], ending: dict[str, Any] | None, ran: Sequence[Move]) -> list[float | None]:
    """Return how long moves take [s]; None where that is not known before they are run.

    Args:
        moves: of the program.
        ending: how its last run ended, as the news tell it.
        ran: the moves of that run.
    """
    parts = iter(ending["parts"] if ending is not None and list(ran) == list(moves) else ())
    return [next(parts, getattr(move, "duration", None)) if move.takes_time else 0.0 for move in moves]


def place_of(time: float, long: Sequence[float | None]) -> tuple[int, float] | None:
    """Return in which move a program is at a time [s], and which part of it is done; None behind the last.

    In a move of unknown length it is at the beginning, for as long as nothing else is known.
    """
    begin = 0.0
    for number, length in enumerate(long):
        if length is None:
            return number, 0.0
        if time < begin + length:
            return number, (time - begin) / length
        begin += length
    return None


class ProgramTimeline:
    """Blocks in a row, in the place where it is built."""

    def __init__(self, session: Session, t: Words) -> None:
        """Build it; it follows the session."""
        self._session, self._t = session, t
        self._blocks: list[ui.element] = []
        self._long: list[float | None] = []
        self._heard, self._ran = session.run.ending, list[Move]()
        self._now: ui.element | None = None
        self._place = ui.element("div").classes("pendant-timeline pendant-more").props("aria-hidden=true")
        for event in ("dragstart", "dragover"):
            self._place.on(event, js_handler=_DRAGGED)
        self._place.on("drop", lambda event: session.book.move_entry(*event.args), js_handler=_DRAGGED)
        follow(session, self._build, "program", "description")
        follow(session, self._follow, "tick", "phase")

    def _build(self) -> None:
        robots = self._session.description.get("robots", {})
        phrases = Phrases(self._t, robots.get(self._session.book.robot, {}).get("axes", ()))
        moves = self._session.book.program.moves
        self._long, self._now, self._blocks = lengths(moves, self._heard, self._ran), None, []
        self._place.clear()
        self._place.set_visibility(bool(moves))
        with self._place:
            for number, move in enumerate(moves):
                self._block(number, phrases.move(move.entry(), self._session.book.targets))
        self._show_head()

    def _block(self, number: int, text: str) -> None:
        length = self._long[number]
        caption = f"{number + 1}. {text}" + (f" · {figure(length)} s" if length else "")
        with ui.element("div").classes("pendant-block").props(f"draggable=true data-move={number}") as block:
            ui.label(caption)
        block.props["title"] = caption
        block.style(f"flex-grow: {_UNKNOWN if length is None else length:.3f}")
        block.on("click", lambda: self._show_begin(number))
        self._blocks.append(block)

    def _show_begin(self, number: int) -> None:
        """Show the moment in which a move began, if it is known and was run."""
        before = self._long[:number]
        begin = sum(length for length in before if length is not None)
        if None not in before and self._session.run.kind == "program" and begin <= self._session.run.reach:
            self._session.rewind(begin)

    def _follow(self) -> None:
        session = self._session
        if session.run.ending is not self._heard and session.run.kind == "program" and session.phase == "idle":
            self._heard, self._ran = session.run.ending, list(session.book.program.moves)
            self._build()
        self._show_head()

    def _show_head(self) -> None:
        """Show where the run is in the block that it is in."""
        run = self._session.run
        at = place_of(run.time, self._long) if run.kind == "program" else None
        now = self._blocks[at[0]] if at is not None else None
        if self._now is not None and self._now is not now:
            self._now.classes(remove="now")
        if now is not None and at is not None:
            now.classes(add="now").style(f"--at: {100 * at[1]:.1f}%")
        self._now = now
