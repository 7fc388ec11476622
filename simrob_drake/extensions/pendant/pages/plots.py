"""Live plots: the last values of a run's signals as curves, in degrees where they are angles."""

from collections.abc import Collection, Iterable, Mapping, Reversible, Sequence
from itertools import takewhile
from math import pi
from typing import Any

from nicegui import context, ui

from simrob_drake.extensions.pendant.pages.elements import follow
from simrob_drake.extensions.pendant.pages.words import Phrases, Words
from simrob_drake.extensions.pendant.run import EndedRun
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.results.colours import looks

_PAUSE = 0.25  # from one picture to the next [s]: more often costs, and shows no more
_POINTS = 120  # of a curve: more than that does not show in it
POSE = 7  # numbers of a pose: of these the position is drawn
_SAME = 1e-9  # s
_AT_ONCE = 6  # curves of a signal that are drawn until others are chosen
_LINES: dict[str, Any] = {"-": "solid", "--": "dashed", "-.": [6, 3, 1, 3], ":": "dotted"}
"""Kinds of line as ECharts calls them."""
AS_SHOWN = {"rad": ("°", 180 / pi), "rad/s": ("°/s", 180 / pi), "rad/s²": ("°/s²", 180 / pi)}
"""Units that are shown in others, and how many of these one is."""
Row = tuple[float, Any]  # a time [s], and the value of a signal then
_FAINT = 1.0, 0.4  # of a run, and of one that is compared with it
_FIRST = ("position", "torque")  # signals that are shown at first


def build(session: Session, t: Words, axes: Collection[str] = ()) -> None:
    """Build plots of the signals that the user chooses, one below the other; at first with the curves of ``axes``."""
    titles = {signal["name"]: _title(t, signal) for signal in session.description["signals"]}
    first = [name for name in titles if name.rpartition(".")[2] in _FIRST]
    choice = ui.select(titles, value=first, label=t("plots.signals"), multiple=True, with_input=True)
    choice.classes("w-full").props("use-chips")
    _comparison(session, t)
    place = ui.column().classes("w-full gap-2")

    def show() -> None:
        place.clear()
        with place:
            for name in choice.value:
                scope(session, t, name, only=axes)

    choice.on_value_change(show)
    show()


def _comparison(session: Session, t: Words) -> None:
    """Build the choices of two runs that have ended: one to look at, and one beside it, with faint curves."""
    shown, compared = (
        ui.select({}, label=t(f"plots.{key}"), clearable=True).classes("w-full").props("dense")
        for key in ("shown", "compare")
    )
    shown.on_value_change(lambda event: session.earlier.show(event.value))
    compared.on_value_change(lambda event: session.earlier.compare(event.value))

    def show() -> None:
        runs = {run.number: _called(t, run) for run in reversed(session.run.ended)}
        for choice, one in ((shown, session.run.shown), (compared, session.run.compared)):
            choice.set_options(runs, value=one.number if one and one.number in runs else None)

    follow(session, show, "phase", "history")


def _called(t: Words, run: EndedRun) -> str:
    times = {"begun": f"{run.begun:.2f}", "reached": f"{run.reached:.2f}"}
    return t("plots.run", number=run.number, kind=t(f"plots.run_{run.kind}"), **times)


def scope(session: Session, t: Words, signal: str, *, only: str | Collection[str] = ()) -> ui.element:
    """Build the plot of a signal of ``session.description``; it is watched until what is returned is deleted.

    It begins with ``only`` these columns or their axes, with some where none is of these.
    """
    element = _Scope(session, t, signal, only).element
    watch(session, [signal], element)
    return element


def watch(session: Session, signals: Sequence[str], element: ui.element) -> None:
    """Have signals in ``session.run.history`` as long as an element of the present page is there."""
    viewer = f"{context.client.id} {element.id}"

    def hear(_: str) -> None:
        if element.is_deleted:
            forget()
            session.watch((), viewer)

    forget = session.listen(hear)
    session.watch(signals, viewer)


class _Scope:
    """The plot of one signal, and the choice of its curves."""

    def __init__(self, session: Session, t: Words, signal: str, only: str | Collection[str]) -> None:
        self._session, self._name = session, signal
        about = next(one for one in session.description["signals"] if one["name"] == signal)
        title, chosen = _title(t, about), {only} if isinstance(only, str) else set(only)
        unit, self._factor = AS_SHOWN.get(about["unit"], (about["unit"], 1.0))
        self._drawn: object = None
        names = dict(enumerate(map(Phrases(t, ()).axis, short(about["columns"]))))
        columns = enumerate(about["columns"])
        first = [number for number, column in columns if {column, column.rpartition(".")[2]} & chosen] or list(names)
        first = first[: 3 if len(names) == POSE else _AT_ONCE]
        with ui.column().classes("w-full gap-1") as self.element:
            with ui.row().classes("w-full items-center justify-between"):
                ui.label(f"{title}{f' [{unit}]' if unit else ''}").classes("font-bold")
                self._choice = ui.select(names, value=first, label=t("plots.curves"), multiple=True)
                self._choice.props("dense outlined options-dense").classes("w-40").set_visibility(len(names) > 1)
            self._legend = ui.row().classes("w-full gap-x-4 gap-y-0 text-sm")
            self._chart = ui.echart({}, renderer="svg").classes("w-full h-56 simrob-plot")
            self._chart.props(f'role=img aria-label="{title}"')
            ui.timer(_PAUSE, self._look)
        self._choice.on_value_change(self._choose)
        self._choose()

    def _choose(self) -> None:
        """Tell which curves are chosen, and draw these from now on."""
        chosen = self._choice.value
        self._choice.props["display-value"] = f"{len(chosen)} / {len(self._choice.options)}"
        self._legend.clear()
        with self._legend:
            for column in chosen:
                with ui.row().classes("items-center gap-1 no-wrap"):
                    colour, line = _style(column)
                    kind = "dashed" if line == "-." else _LINES[line]
                    ui.element("span").style(f"width: 1.4em; border-top: 3px {kind} {colour}")
                    ui.label(self._choice.options[column])
        self._drawn = None

    def _look(self) -> None:
        """Draw what has come since the last look."""
        ring = self._session.run.history_of(self._name)
        other = self._session.run.compared
        seen = (len(ring), ring[0][0], ring[-1], other) if ring else (other,)
        if seen == self._drawn:
            return
        self._drawn = seen
        chosen: list[int] = sorted(self._choice.value)
        names = [self._choice.options[column] for column in chosen]
        histories = [ring, *([other.history(self._name)] if other else [])]
        sources = [self._rows(history, chosen) for history in histories]
        self._chart.props["options"] = _picture(names, [_style(column) for column in chosen], sources)

    def _rows(self, history: Iterable[Row], chosen: Sequence[int]) -> list[list[float]]:
        """Return times of a history and the chosen columns of its values, as they are drawn."""
        rows = thinned(list(history), _POINTS)
        return [[time, *(as_list(value)[i] * self._factor for i in chosen)] for time, value in rows]


def _title(t: Words, signal: Mapping[str, Any]) -> str:
    """Return what a signal is called; as the station calls it where there are no words for it."""
    whose, _, name = signal["name"].rpartition(".")
    words = Phrases(t, ()).name(name, signal["title"])
    return f"{whose}: {words}" if whose and words != signal["title"] else words


def _style(column: int) -> tuple[str, str]:
    return looks(column + 1)[column]


def short(names: Sequence[str]) -> list[str]:
    """Return names of columns without the parts that all begin with: of ``q.knee`` and ``q.hip`` the second."""
    parts = [name.split(".") for name in names]
    levels = zip(*(part[:-1] for part in parts), strict=False)
    common = sum(1 for _ in takewhile(lambda level: len(set(level)) == 1, levels))
    return [".".join(part[common:]) for part in parts]


def at(ring: Reversible[Row], time: float) -> Any:
    """Return the value at a time [s], or the last one before it; None before all."""
    return next((value for when, value in reversed(ring) if when <= time + _SAME), None)


def as_list(value: Any) -> Sequence[float]:
    """Return the numbers of a signal's value."""
    return [value] if isinstance(value, (int, float)) else value


def thinned(rows: list[Row], count: int) -> list[Row]:
    """Return so many rows at most, evenly spread, with the first and the last."""
    if len(rows) <= count:
        return rows
    return [rows[round(number * (len(rows) - 1) / (count - 1))] for number in range(count)]


def _picture(
    names: Sequence[str], shown: Sequence[tuple[str, str]], sources: Sequence[Sequence[Sequence[float]]]
) -> dict[str, Any]:
    """Return what ECharts draws: a curve for each column of the rows behind the first, which is the time [s].

    The second of the sources is of a run that is compared: its curves are faint.
    """
    faint = {"splitLine": {"lineStyle": {"color": "#8884"}}, "axisLine": {"lineStyle": {"color": "#888"}}}
    ends = {"axisLabel": {"showMinLabel": False, "showMaxLabel": False, "hideOverlap": True}}
    name = {"name": "t [s]", "nameLocation": "middle", "nameGap": 22}
    look = {"type": "line", "showSymbol": False, "silent": True}
    return {
        "animation": False,
        "grid": {"left": 56, "right": 12, "top": 12, "bottom": 40},
        "xAxis": {"type": "value", "min": "dataMin", "max": "dataMax", **name, **faint, **ends},
        "yAxis": {"type": "value", "scale": True, **faint},
        "dataset": [{"source": source} for source in sources],
        "series": [
            {
                **look,
                "name": name,
                "datasetIndex": index,
                "color": colour,
                "encode": {"x": 0, "y": row + 1},
                "lineStyle": {"type": _LINES[line], "opacity": _FAINT[index]},
            }
            for index in range(len(sources))
            for row, (name, (colour, line)) in enumerate(zip(names, shown, strict=True))
        ],
    }
