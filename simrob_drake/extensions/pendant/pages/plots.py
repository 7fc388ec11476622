"""Live plots: the last values of a run's signals as curves, in degrees where they are angles."""

from __future__ import annotations

from asyncio import wrap_future
from collections.abc import Collection, Iterable, Mapping, Reversible, Sequence
from itertools import takewhile
from math import pi
from typing import Any, NamedTuple

from nicegui import background_tasks, context, ui

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
_FAINT = 0.4  # opacity of the curves of a run that is compared
_CURSOR = "#d5001c"  # colour of the line at the moment that is shown, as in the timeline of moves
_TORQUE = "torque"  # signal whose limits are shown
_REFERENCES = {"position": "reference", "velocity": "reference_velocity"}
"""Signals that others should follow, by the name of the other."""
_SHOWN_LIMIT = 0.1
"""Share of its limit that a curve reaches where the limit is drawn. A limit farther away would flatten the curve."""
_FIRST = ("position", "torque")  # signals that are shown at first


def build(session: Session, t: Words, axes: Collection[str] = ()) -> None:
    """Build plots of the signals that the user chooses, one below the other; at first with the curves of ``axes``."""
    titles = {signal["name"]: _title(t, signal) for signal in session.description["signals"]}
    first = [name for name in titles if name.rpartition(".")[2] in _FIRST]
    choice = ui.select(
        titles, value=first, label=t("plots.signals"), multiple=True, with_input=True
    )
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
    times = {"begun": t.decimals(run.begun, 2), "reached": t.decimals(run.reached, 2)}
    return t("plots.run", number=run.number, kind=t(f"plots.run_{run.kind}"), **times)


def scope(
    session: Session, t: Words, signal: str, *, only: str | Collection[str] = ()
) -> ui.element:
    """Build the plot of a signal of ``session.description``; it is watched until what is returned is deleted.

    It begins with ``only`` these columns or their axes, with some where none is of these.
    """
    plot = _Scope(session, t, signal, only)
    watch(session, plot.signals, plot.element)
    return plot.element


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
    """The plot of one signal, and the choice of its curves.

    A plot of positions shows the reference, too, one of torques the limits; a vertical line is at the moment that is
    shown.
    """

    def __init__(
        self, session: Session, t: Words, signal: str, only: str | Collection[str]
    ) -> None:
        self._session, self._t, self._name = session, t, signal
        signals = {one["name"]: one for one in session.description["signals"]}
        about = signals[signal]
        self._columns: list[str] = about["columns"]
        self._reference = signals.get(reference_of(signal), {"name": "", "columns": []})
        title, chosen = _title(t, about), {only} if isinstance(only, str) else set(only)
        unit, self._factor = AS_SHOWN.get(about["unit"], (about["unit"], 1.0))
        self._limits: list[float] = []  # of each column; empty for signals without limits
        self._drawn: object = None
        names = dict(enumerate(map(Phrases(t, ()).axis, short(about["columns"]))))
        columns = enumerate(about["columns"])
        first = [
            number for number, column in columns if {column, column.rpartition(".")[2]} & chosen
        ] or list(names)
        first = first[: 3 if len(names) == POSE else _AT_ONCE]
        with ui.column().classes("w-full gap-1") as self.element:
            with ui.row().classes("w-full items-center justify-between"):
                ui.label(f"{title}{f' [{unit}]' if unit else ''}").classes("font-bold")
                self._choice = ui.select(names, value=first, label=t("plots.curves"), multiple=True)
                self._choice.props("dense outlined options-dense").classes("w-40").set_visibility(
                    len(names) > 1
                )
            self._legend = ui.row().classes("w-full gap-x-4 gap-y-0 text-sm")
            self._chart = ui.echart({}, renderer="svg").classes("w-full h-56 simrob-plot")
            self._chart.props(f'role=img aria-label="{title}"')
            ui.timer(_PAUSE, self._look)
            if (
                signal.rpartition(".")[2] == _TORQUE
                and session.description.get("mode") == "dynamic"
            ):
                follow(session, self._ask_limits, "program", "description", "phase")
        self._choice.on_value_change(self._choose)
        self._choose()

    @property
    def signals(self) -> list[str]:
        """Signals of which the plot needs the values."""
        return [name for name in (self._name, self._reference["name"]) if name]

    def _ask_limits(self) -> None:
        """Ask for the limits of the torques, which change with the settings, also while a run goes on."""
        if self._session.phase in ("idle", "running", "paused"):
            background_tasks.create(self._asked_limits())

    async def _asked_limits(self) -> None:
        whose = self._name.rpartition(".")[0]
        limits = await wrap_future(self._session.client.ask("torque_limits", robot=whose or None))
        if isinstance(limits, list) and limits != self._limits and not self.element.is_deleted:
            self._limits = limits
            self._choose()

    def _choose(self) -> None:
        """Take the curves that are chosen, name them in the legend, and draw them from now on."""
        chosen = self._choice.value
        self._choice.props["display-value"] = f"{len(chosen)} / {len(self._choice.options)}"
        self._legend.clear()
        with self._legend:
            for column in chosen:
                colour, line = _style(column)
                limit = f" (± {self._t.figure(self._limits[column])})" if self._limits else ""
                _legend_entry(
                    colour,
                    "dashed" if line == "-." else _LINES[line],
                    self._choice.options[column] + limit,
                )
            if self._reference["name"]:
                _legend_entry("currentColor", "dashed", Phrases(self._t, ()).name("reference"))
            if self._limits:
                _legend_entry("currentColor", "dotted", self._t("plots.limit"))
        self._drawn = None

    def _look(self) -> None:
        """Draw the plot anew if there are new values, or another moment is shown."""
        run = self._session.run
        ring = run.history_of(self._name)
        other = run.compared
        cursor = run.time if ring else None
        seen = (len(ring), ring[0][0], ring[-1], other, cursor) if ring else (other,)
        if seen == self._drawn:
            return
        self._drawn = seen
        chosen: list[int] = sorted(self._choice.value)
        styles = [_style(column) for column in chosen]
        names = [self._choice.options[column] for column in chosen]
        rows = self._rows(ring, chosen)
        layers = [Layer(names, styles, rows)]
        if self._reference["name"]:
            layers.append(self._reference_layer(chosen, names))
        if other is not None:
            layers.append(
                Layer(names, styles, self._rows(other.history(self._name), chosen), opacity=_FAINT)
            )
        if self._limits and rows:
            layers.append(self._limit_layer(chosen, rows))
        self._chart.props["options"] = _picture(
            layers, cursor, has_decimal_comma=self._t.has_decimal_comma
        )

    def _rows(self, history: Iterable[Row], chosen: Sequence[int]) -> list[list[float]]:
        """Return times of a history and the chosen columns of its values, as they are drawn.

        Values of another width, of a run in which the signal had other columns, are left out.
        """
        rows = thinned(
            [row for row in history if len(as_list(row[1])) == len(self._columns)], _POINTS
        )
        return [[time, *(as_list(value)[i] * self._factor for i in chosen)] for time, value in rows]

    def _reference_layer(self, chosen: Sequence[int], names: Sequence[str]) -> Layer:
        """Make the dashed curves of the reference of the chosen columns.

        A column and its reference have the same axis, which is the last part of their names. Columns without a
        reference are left out.

        Args:
            chosen: numbers of the chosen columns of the signal.
            names: what these are called in the legend.
        """
        columns_of_reference = {
            _axis_of(column): place for place, column in enumerate(self._reference["columns"])
        }
        known_names, styles, places = [], [], []
        for number, name in zip(chosen, names, strict=True):
            place = columns_of_reference.get(_axis_of(self._columns[number]))
            if place is not None:
                known_names.append(name)
                styles.append((_style(number)[0], "--"))
                places.append(place)

        history = thinned(list(self._session.run.history_of(self._reference["name"])), _POINTS)
        rows = [
            [time, *(as_list(value)[place] * self._factor for place in places)]
            for time, value in history
        ]
        return Layer(known_names, styles, rows)

    def _limit_layer(self, chosen: Sequence[int], rows: Sequence[Sequence[float]]) -> Layer:
        """Horizontal lines at the limits of the chosen columns, dotted, on the sides to which the curves go.

        Limits far beyond a curve are left out, since they would flatten it; the legend names all of them.
        """
        ends = rows[0][0], rows[-1][0]
        lines: list[float] = []
        styles: list[tuple[str, str]] = []
        for place, column in enumerate(chosen, 1):
            limit = self._limits[column] * self._factor
            values = [row[place] for row in rows]
            for side in (-1.0, 1.0):
                if max(side * value for value in values) >= _SHOWN_LIMIT * limit:
                    lines.append(side * limit)
                    styles.append((_style(column)[0], ":"))
        return Layer(
            [self._t("plots.limit")] * len(lines), styles, [[time, *lines] for time in ends]
        )


def reference_of(signal: str) -> str:
    """Name of the signal that a signal should follow, such as ``reference`` for ``position``; empty if there is none.

    A robot's name before a dot is kept.
    """
    whose, dot, name = signal.rpartition(".")
    return f"{whose}{dot}{_REFERENCES[name]}" if name in _REFERENCES else ""


def _legend_entry(colour: str, line: str, text: str) -> None:
    with ui.row().classes("items-center gap-1 no-wrap"):
        ui.element("span").style(f"width: 1.4em; border-top: 3px {line} {colour}")
        ui.label(text)


def _title(t: Words, signal: Mapping[str, Any]) -> str:
    """Return what a signal is called; as the station calls it where there are no words for it."""
    whose, _, name = signal["name"].rpartition(".")
    words = Phrases(t, ()).name(name, signal["title"])
    return f"{whose}: {words}" if whose and words != signal["title"] else words


def _axis_of(column: str) -> str:
    """Return the axis of a column, such as ``joint_1`` of ``left.joint_1``."""
    return column.rpartition(".")[2]


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


class Layer(NamedTuple):
    """Curves that are drawn in the same way.

    Attributes:
        names: what the curves are called.
        styles: colour and kind of line of each curve, as :func:`simrob_drake.results.colours.looks` gives them.
        rows: time [s] and the value of each curve, at each moment.
        opacity: of the curves, 0 to 1.
    """

    names: Sequence[str]
    styles: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[float]]
    opacity: float = 1.0


_WITH_COMMA = "(value) => String(value).replace('.', ',')"
"""Function of JavaScript with which ECharts writes numbers at its axes with a decimal comma."""


def _picture(
    layers: Sequence[Layer], cursor: float | None, *, has_decimal_comma: bool = False
) -> dict[str, Any]:
    """Make the options with which ECharts draws a plot.

    Args:
        layers: the curves.
        cursor: time at which a vertical line stands [s]; None for no line.
        has_decimal_comma: whether the numbers at the axes have a decimal comma.
    """
    labels: dict[str, Any] = {":formatter": _WITH_COMMA} if has_decimal_comma else {}
    faint = {
        "splitLine": {"lineStyle": {"color": "#8884"}},
        "axisLine": {"lineStyle": {"color": "#888"}},
    }
    ends = {
        "axisLabel": {"showMinLabel": False, "showMaxLabel": False, "hideOverlap": True, **labels}
    }
    time_axis = {"name": "t [s]", "nameLocation": "middle", "nameGap": 22}
    series = [
        {
            "type": "line",
            "showSymbol": False,
            "silent": True,
            "name": name,
            "datasetIndex": index,
            "color": colour,
            "encode": {"x": 0, "y": column + 1},
            "lineStyle": {"type": _LINES[line], "opacity": layer.opacity},
        }
        for index, layer in enumerate(layers)
        for column, (name, (colour, line)) in enumerate(zip(layer.names, layer.styles, strict=True))
    ]
    if series and cursor is not None:
        series[0]["markLine"] = {
            "silent": True,
            "symbol": "none",
            "label": {"show": False},
            "lineStyle": {"color": _CURSOR, "type": "solid"},
            "data": [{"xAxis": cursor}],
        }
    return {
        "animation": False,
        "grid": {"left": 56, "right": 12, "top": 12, "bottom": 40},
        "xAxis": {
            "type": "value",
            "min": "dataMin",
            "max": "dataMax",
            **time_axis,
            **faint,
            **ends,
        },
        "yAxis": {"type": "value", "scale": True, "axisLabel": labels, **faint},
        "dataset": [{"source": list(layer.rows)} for layer in layers],
        "series": series,
    }
