"""Panel of the pendant: how many moves of each kind the program has."""

from collections import Counter

from nicegui import ui

from simrob_drake.extensions.pendant.pages.elements import follow
from simrob_drake.extensions.pendant.pages.words import Words
from simrob_drake.extensions.pendant.pendant_panel import PendantPanel
from simrob_drake.extensions.pendant.session import Session

_COLUMNS = {"en": ("move", "count"), "es": ("movimiento", "cantidad")}


def _build(session: Session, words: Words) -> None:
    """Build a table of the kinds of moves, which follows the program."""
    table = ui.table(rows=[], columns=[]).props("flat dense")

    def show() -> None:
        counts = Counter(move.key for move in session.book.program.moves)
        table.rows = [{"kind": kind, "count": count} for kind, count in counts.most_common()]
        table.update()

    kind_title, count_title = _COLUMNS["es" if words.language == "es" else "en"]
    table.columns = [
        {"name": "kind", "field": "kind", "label": kind_title, "align": "left"},
        {"name": "count", "field": "count", "label": count_title},
    ]
    follow(session, show, "program")


MOVE_COUNTS = PendantPanel(titles={"en": "Moves", "es": "Movimientos"}, build=_build)
