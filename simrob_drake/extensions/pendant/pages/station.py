"""The station's page: its blocks and their signals, what may end a run, a form for every key, what a check finds."""

import asyncio
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from nicegui import background_tasks, ui

from simrob_drake.base.messages import number_in_language
from simrob_drake.extensions.pendant.describe import (
    ALL_AXES,
    BlockMeaning,
    axis_setting,
    axis_value,
    block_meaning,
    wire_meaning,
)
from simrob_drake.extensions.pendant.form import Field, form_fields, with_values_in_force
from simrob_drake.extensions.pendant.pages.block_picture import BlockPicture
from simrob_drake.extensions.pendant.pages.elements import card, follow, own_tab_panels
from simrob_drake.extensions.pendant.pages.form_view import (
    FormView,
    Tuner,
    Tuning,
    is_tuned,
    tunings,
)
from simrob_drake.extensions.pendant.pages.key_helps import in_own_language
from simrob_drake.extensions.pendant.pages.plots import AS_SHOWN, POSE, as_list, at, scope, watch
from simrob_drake.extensions.pendant.pages.words import Phrases, Words, value_text
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.programs.timeline import GRID
from simrob_drake.stations.load import station_content
from simrob_drake.stations.schema import station_schema

_MOST_FOUND = 25  # fields that a search shows
_MOST_SCOPES = 3
_FEW = 6  # fields that a block shows unfolded
_MOST_ENDINGS = 10
_SHOWN = 0.25  # from one look at the values on the wires to the next [s]
_PAUSE = 0.3  # from a change to the question what it does [s]: meanwhile others may come, and another tab
_UNTIL_DRAWN = 400  # from new plots until a browser has drawn them [ms]
_TAB = "station"
_COLUMNS = "w-full grid gap-4 items-start grid-cols-[repeat(auto-fit,minmax(min(24rem,100%),1fr))]"


def build(session: Session, t: Words) -> None:
    """Build the page of a session's station in the present place."""
    _Page(session, t)


class _BlockContent(NamedTuple):
    """What is shown of a block. It is built anew if it differs from what is shown.

    Attributes:
        block: name of the block.
        meaning: keys and signals of the block.
        fields: fields of the form for its keys.
        changes: changes of its keys during a run, in words.
        wires: number and name of each of its wires.
        columns: columns of its signals, by the name of the signal.
    """

    block: str
    meaning: BlockMeaning
    fields: tuple[Field, ...]
    changes: tuple[str, ...]
    wires: tuple[tuple[str, str], ...]
    columns: dict[str, tuple[str, ...]]


class _Page:
    def __init__(self, session: Session, t: Words) -> None:
        self._session, self._t = session, t
        self._fields: list[Field] = []
        self._content: dict[str, Any] = {}
        self._endings: list[str] = []
        self._heard = session.run.ending
        self._sections: dict[str, Callable[[list[Field]], None]] = {}
        self._panels = own_tab_panels()
        self._asked = True
        self._content_of_block: _BlockContent | None = None  # None if no block is shown
        # Values in the middle of the sliders of the chosen block, by the name of the slider: those at its first choice.
        self._slider_middles = dict[str, float]()
        self._tuners: list[Tuner] = []  # the sliders of the chosen block
        self._plotted: list[str] = []  # signals of which the chosen block or line shows plots
        self._wires, self._shown_values = dict[str, BlockMeaning](), dict[str, str]()
        with card(t("station.blocks"), about=t("station.blocks_help")):
            self._wrong_picture = ui.label().classes("text-negative")
            self._picture = BlockPicture(
                t, self._show_block, self._show_wire, self._ask_for_picture, self._look_at_choice
            )
            self._values = ui.switch(
                t("station.values"), value=True, on_change=self._watch_wires
            ).props("dense")
            self._watching = ui.element("div")
        with card(t("station.block")):
            # Enter on a block in the picture goes here, and Escape goes back.
            self._block = ui.column().classes("w-full gap-2").props("tabindex=-1")
            self._block.on("keydown", js_handler="(event) => window.blocks.back(event)")
        with card(t("station.stops")):
            self._stops = ui.column().classes("w-full gap-1")
        with ui.element("div").classes(_COLUMNS):
            with card(t("station.check")):
                self._findings = ui.column().classes("w-full gap-1")
            with card(t("station.keys"), about=t("station.keys_help")):
                self._changed = ui.row().classes("gap-2 items-center")
                self._sought = ui.input(t("station.search"), on_change=self._search)
                self._sought.props("clearable dense").classes("w-full")
                self._found = FormView(t, self._give)
                self._form = ui.column().classes("w-full gap-0")
        if self._panels is not None:
            self._panels.on_value_change(self._ask_if_seen)
        follow(session, self._refresh, "description")
        follow(session, self._hear, "message")
        follow(session, self._mark_changes, "program")
        ui.timer(_SHOWN, self._show_values)

    async def _give(self, key: str, value: Any) -> str:
        """Change a key of the station, while a run goes on that of the run; return what is wrong with it."""
        session = self._session
        if session.phase in ("running", "paused"):
            done = await asyncio.wrap_future(session.change(key, value)) is not None
        elif value is None and key in session.book.settings:
            done = session.setup.unset(key)  # which may have brought it
        else:
            done = session.setup.set(key, value)
        return "" if done else self._t.render(str(session.message))

    def _refresh(self) -> None:
        """Show the station as it is now."""
        session = self._session
        if not session.description:
            return
        self._content = station_content(session.book.config)
        fields = with_values_in_force(
            form_fields(station_schema(), self._content), session.description.get("in_force", {})
        )
        self._fields = in_own_language(fields, self._t.language)
        self._show_form()
        self._search()
        self._show_changed()
        self._show_stops()
        self._show_block(self._picture.chosen)
        self._asked = False
        self._ask_if_seen()

    def _ask_if_seen(self) -> None:
        if not self._asked:
            background_tasks.create(self._ask())

    async def _ask(self) -> None:
        """Ask the run's process for the picture and for what a check finds, unless another tab is in front."""
        await asyncio.sleep(_PAUSE)
        if self._asked or (self._panels is not None and self._panels.value != _TAB):
            return
        self._asked = True
        await self._ask_for_picture()
        findings = await asyncio.wrap_future(self._session.setup.check())
        if self._findings.is_deleted:
            return
        self._findings.clear()
        with self._findings:
            self._show_findings(
                findings
                or [{"level": "warning", "subject": "", "text": str(self._session.message)}]
            )

    async def _ask_for_picture(self) -> None:
        picture = await asyncio.wrap_future(
            self._session.setup.picture(self._picture.folded, self._t.language)
        )
        self._wrong_picture.text = "" if picture else self._t.render(str(self._session.message))
        if picture:
            self._picture.show(picture)
            self._watch_wires()
            self._mark_changes()

    def _meaning(self, block: str) -> BlockMeaning:
        return block_meaning(block, self._content, list(self._columns))

    @property
    def _columns(self) -> dict[str, list[str]]:
        return {
            signal["name"]: signal["columns"]
            for signal in self._session.description.get("signals", ())
        }

    def _watch_wires(self) -> None:
        """Have the signals of the wires as long as their values are to be shown."""
        names, ends = list(self._columns), self._picture.wires.items() if self._values.value else ()
        self._wires = {number: wire_meaning(*end, self._content, names) for number, end in ends}
        self._shown_values = dict.fromkeys(self._picture.wires, "")
        self._picture.tell(self._shown_values)
        self._watching.clear()
        with self._watching:
            signals = {name for wire in self._wires.values() for name in wire.signals[:1]}
            watch(self._session, sorted(signals), ui.element("div"))

    def _show_values(self) -> None:
        """Write on the wires what their signals are at the moment that is shown."""
        if self._panels is not None and self._panels.value != _TAB:
            return
        run, values = self._session.run, dict[str, str]()
        about = {signal["name"]: signal for signal in self._session.description.get("signals", ())}
        for number, wire in self._wires.items():
            name = next(iter(wire.signals), "")
            value = at(run.history_of(name), run.time)
            if value is not None and name in about:
                brief = in_brief(as_list(value), about[name], wire.axis)
                values[number] = number_in_language(brief, self._t.language)
        if values.items() - self._shown_values.items():
            self._shown_values |= values
            self._picture.tell(values)

    def _mark_changes(self) -> None:
        """Mark the blocks of which something was changed while they ran."""
        keys = {key for change in self._session.book.changes for key in change.set or ()}
        self._picture.mark({block for key in keys for block in self._made_by(key)})

    def _made_by(self, key: str) -> list[str]:
        """Return the blocks that a key makes: those that show it, where some do."""
        labels, name = self._picture.labels, key.rpartition(".")[2]
        meanings = {block: self._meaning(block) for block in labels}
        holding = [block for block, meaning in meanings.items() if meaning.holds(key)]
        of_axis = [block for block in holding if meanings[block].axis == name]
        if of_axis:  # a key such as servo.kp.joint_2
            holding, name = of_axis, key.split(".")[-2]
        return [block for block in holding if name in re.findall(r"\w+", labels[block])] or holding

    def _look_at_choice(self, by_key: bool) -> None:
        """Bring the plots of what the user has chosen into view, and note that the user looks at them.

        Args:
            by_key: whether it was chosen by a key, which then has its focus there.
        """
        if by_key:
            self._block.client.run_javascript(
                f"setTimeout(() => getHtmlElement({self._block.id})?.focus(), {_UNTIL_DRAWN})"
            )
        if not self._plotted:
            return
        # The plots get their size in the browser a moment after they are sent.
        scroll = (
            f"document.getElementById('c{self._block.id}')?.scrollIntoView({{block: 'nearest'}})"
        )
        self._block.client.run_javascript(f"setTimeout(() => {scroll}, {_UNTIL_DRAWN})")
        self._session.inspect(self._plotted)

    def _show_wire(self, number: str) -> None:
        """Show what goes along a wire."""
        source, targets = self._picture.wires[number]
        wire = wire_meaning(source, targets, self._content, list(self._columns))
        self._content_of_block = None
        self._block.clear()
        with self._block:
            ui.label(self._wire_name(number)).classes("font-bold")
            self._scopes(wire)

    def _wire_name(self, number: str) -> str:
        """Name of a wire by its number: the blocks at its ends."""
        source, targets = self._picture.wires[number]
        names = [
            self._picture.labels.get(block, block).partition("\n")[0]
            for block in (source, *targets)
        ]
        return f"{names[0]} → {', '.join(names[1:])}"

    def _build_wires(self, wires: Sequence[tuple[str, str]]) -> None:
        """Build a button for each wire of a block: the wires in the picture cannot be reached by keys.

        Args:
            wires: number and name of each wire.
        """
        with ui.expansion(self._t("station.wires_of_block")).classes("w-full").props("dense"):
            for number, name in wires:
                show = partial(self._picture.choose_wire, number)
                ui.button(name, on_click=show).props("flat dense no-caps")

    def _scopes(self, meaning: BlockMeaning) -> None:
        """Show the plots of a block or a line."""
        self._plotted = list(meaning.signals[:_MOST_SCOPES])
        for name in self._plotted:
            own = (
                column
                for column in self._columns[name]
                if meaning.axis and column.endswith(f".{meaning.axis}")
            )
            scope(self._session, self._t, name, only=next(own, ""))

    def _show_findings(self, findings: Sequence[Mapping[str, str]]) -> None:
        """Show the warnings, and behind them, folded, what is in order."""
        own = self._t.render
        findings = [
            {**one, "subject": own(one["subject"]), "text": own(one["text"])} for one in findings
        ]
        fine = [finding for finding in findings if finding["level"] != "warning"]
        for finding in findings:
            if finding not in fine:
                _show_finding(finding, "warning", self._t("station.warning"))
        with (
            ui.expansion(self._t("station.in_order", count=len(fine)))
            .classes("w-full")
            .props("dense")
        ):
            for finding in fine:
                _show_finding(finding, "check_circle", self._t("station.ok"))

    def _show_form(self) -> None:
        """Show the keys, section by section; a section is built when it is opened for the first time."""
        tops: dict[str, list[Field]] = {}
        for field in self._fields:
            alone = field.kind != "section" and "." not in field.key and field.kind != "entries"
            tops.setdefault("" if alone else field.top, []).append(field)
        if list(tops) != list(self._sections):
            self._form.clear()
            with self._form:
                title = self._t("station.general")
                self._sections = {top: self._section(top, top or title) for top in tops}
        for top, fields in tops.items():
            self._sections[top](fields)

    def _section(self, top: str, title: str) -> Callable[[list[Field]], None]:
        """Make a section of the form, folded, and return what shows fields in it."""
        shown, views = list[Field](), list[FormView]()

        def fill() -> None:
            if fold.value and not views:
                with fold:
                    views.append(FormView(self._t, self._give, under=top))
            for view in views if fold.value else ():
                view.show(shown)

        def show(fields: list[Field]) -> None:
            shown[:] = fields
            fill()

        fold = ui.expansion(title, on_value_change=fill).classes("w-full").props("dense")
        return show

    def _search(self) -> None:
        """Show the fields whose key or help has all the words that are sought, in place of the sections."""
        words = (self._sought.value or "").lower().split()
        found = [
            f
            for f in self._fields
            if words and all(w in f"{f.key} {f.help}".lower() for w in words)
        ]
        self._found.show(found[:_MOST_FOUND])
        self._form.set_visibility(not words)

    def _show_changed(self) -> None:
        """Show what is changed of the station, each to be taken back."""
        self._changed.clear()
        with self._changed:
            for key, value in self._session.book.settings.items():
                chip = ui.chip(
                    f"{key}: {value_text(value, self._t.language) or '–'}",
                    removable=True,
                    icon="tune",
                ).props("outline")
                chip.on_value_change(lambda key=key: self._session.setup.unset(key))

    def _show_stops(self) -> None:
        """Say what may end a run, and what did."""
        self._stops.clear()
        with self._stops:
            monitors = [
                field
                for field in self._fields
                if field.top == "monitors" and field.key.count(".") == 1
            ]
            for monitor in monitors:
                inner = [field for field in self._fields if field.key.startswith(f"{monitor.key}.")]
                changed = [
                    _field_text(field, self._t.language)
                    for field in inner
                    if field.value not in (None, field.default)
                ]
                name = monitor.key.partition(".")[2] + (
                    f" ({', '.join(changed)})" if changed else ""
                )
                ui.label(f"{name}: {monitor.help}").classes("text-sm")
            if not monitors:
                ui.label(self._t("station.no_monitors")).classes("text-sm opacity-70")
            for ending in self._endings:
                with ui.row().classes("no-wrap items-start gap-2"):
                    ui.icon("flag")
                    ui.label(ending).classes("text-sm font-bold min-w-0")

    def _hear(self) -> None:
        """Keep what ended a run, unless that was its own end or the user."""
        ending = self._session.run.ending
        if ending is None or ending is self._heard:
            return
        self._heard = ending
        if ending["ending"] not in ("completed", "stopped"):
            line = (
                f"{self._t.decimals(ending['reached'], 2)} s: {self._t.render(ending['message'])}"
            )
            self._endings = [line, *self._endings][:_MOST_ENDINGS]
            self._show_stops()

    def _show_block(self, block: str) -> None:
        """Show the parameters and the signals of a block. An empty name shows that no block is chosen."""
        if not block:
            self._content_of_block = None
            self._plotted = []
            self._block.clear()
            with self._block:
                ui.label(self._t("station.choose_block")).classes("opacity-70")
            return
        content = self._find_content(block)
        if content == self._content_of_block:
            # The label of the block is no part of the content, and may have changed.
            self._block_title.text = self._picture.labels.get(block, block)
            return
        before = self._content_of_block
        self._content_of_block = content
        if before is None or content.block != before.block:
            self._slider_middles.clear()
            self._tuners = []
            self._build_block()
        self._fill_block(content)

    def _find_content(self, block: str) -> "_BlockContent":
        """Find what is shown of a block."""
        meaning = self._meaning(block)
        grid = self._session.book.program.grid or GRID
        return _BlockContent(
            block=block,
            meaning=meaning,
            fields=tuple(field for field in self._fields if meaning.holds(field.key)),
            changes=tuple(
                Phrases(self._t, ()).change(change, grid)
                for change in self._session.book.changes
                if any(map(meaning.holds, change.set or ()))
            ),
            wires=tuple(
                (number, self._wire_name(number)) for number in self._picture.wires_of(block)
            ),
            columns={name: tuple(self._columns[name]) for name in meaning.signals},
        )

    def _build_block(self) -> None:
        """Make places for the parameters and the signals of a block instead of what was shown before."""
        self._block.clear()
        with self._block:
            self._block_head = ui.column().classes("w-full gap-2")
            self._block_sliders = ui.column().classes("w-full gap-2")
            self._block_rest = ui.column().classes("w-full gap-2")

    def _fill_block(self, content: "_BlockContent") -> None:
        """Show the parameters and the signals of a block."""
        self._plotted = []
        self._block_head.clear()
        with self._block_head:
            title = self._picture.labels.get(content.block, content.block)
            self._block_title = ui.label(title).classes("font-bold whitespace-pre-line")
            for change in content.changes:
                ui.label(change).classes("text-sm block-change")
            self._scopes(content.meaning)
        self._fill_sliders(content.meaning, content.fields)
        self._block_rest.clear()
        with self._block_rest:
            is_open = len(content.fields) <= _FEW
            with ui.expansion(self._t("station.parameters"), value=is_open).classes("w-full"):
                FormView(self._t, self._give).show(content.fields)
            self._build_wires(content.wires)

    def _fill_sliders(self, meaning: BlockMeaning, fields: Sequence[Field]) -> None:
        """Build the sliders of a block, unless those that are there may stay.

        A note says whether they change one joint or all; other blocks have none. Sliders of a joint's block change this
        joint alone.

        Args:
            meaning: what the block stands for.
            fields: fields of the form for the keys of the block.
        """
        axes = self._axes_of(meaning.robot)
        if meaning.axis in axes:
            tuned = [self._axis_tuning(meaning, field, axes) for field in fields]
            tuned_numbers = [tuning for tuning in tuned if tuning is not None]
            note = self._t("station.tunes_one", axis=meaning.axis)
        else:
            tuned_numbers = tunings(fields, self._give)
            note = self._t("station.tunes_all") if meaning.axis == ALL_AXES else ""
        # The middle of a slider stays where it was when the block was chosen.
        tuned_numbers = [
            tuning._replace(middle=self._slider_middles.setdefault(tuning.name, tuning.value))
            for tuning in tuned_numbers
        ]
        may_stay = len(self._tuners) == len(tuned_numbers) and all(
            tuner.holds(tuning) for tuner, tuning in zip(self._tuners, tuned_numbers, strict=True)
        )
        if may_stay:
            return
        self._block_sliders.clear()
        with self._block_sliders:
            if tuned_numbers and note:
                ui.label(note).classes("text-sm")
            self._tuners = [Tuner(tuning, self._t) for tuning in tuned_numbers]

    def _axis_tuning(
        self, meaning: BlockMeaning, field: Field, axes: Sequence[str]
    ) -> Tuning | None:
        """Make the slider with which a field of a joint's block changes this joint. Returns None if it has none."""
        value = axis_value(field.value, meaning.axis, axes)
        if not is_tuned(field.key) or value is None or value <= 0:
            return None

        async def give(new: float) -> str:
            return await self._give(*axis_setting(meaning, field.key, new, self._content, axes))

        return Tuning(f"{field.key}.{meaning.axis}", value, field.unit, give)

    def _axes_of(self, robot: str) -> list[str]:
        """Names of the axes of a robot of the station, or of its only robot if none is named."""
        robots = self._session.description.get("robots", {})
        found = robots.get(robot or next(iter(robots), ""), {})
        return [axis["name"] for axis in found.get("axes", ())]


def in_brief(value: Sequence[float], about: Mapping[str, Any], axis: str = "") -> str:
    """Return the value of a signal as it stands on a wire: that of an axis, a place, or the largest of several."""
    unit, factor = AS_SHOWN.get(about["unit"], (about["unit"], 1.0))
    own = (
        number
        for number, column in enumerate(about["columns"])
        if axis and column.endswith(f".{axis}")
    )
    if (number := next(own, None)) is not None:
        return _short(value[number] * factor)
    if len(value) == POSE:
        return f"{' '.join(f'{one:.2f}' for one in value[:3])} {unit}"
    largest = _short(max(value, key=abs, default=0.0) * factor)
    return f"{'max ' if len(value) > 1 else ''}{largest} {unit}".strip()


def _short(value: float) -> str:
    return f"{round(value, 3) + 0.0:.3g}"


def _show_finding(finding: Mapping[str, str], icon: str, called: str) -> None:
    with ui.row().classes("w-full no-wrap items-start gap-2"):
        ui.icon(
            icon, color={"ok": "positive", "note": "info"}.get(finding["level"], "warning")
        ).props(f'role=img aria-label="{called}"')
        ui.label(": ".join(filter(None, (finding["subject"], finding["text"])))).classes(
            "text-sm min-w-0"
        )


def _field_text(field: Field, language: str) -> str:
    """Name, value and unit of a field, in a language."""
    name = field.key.rpartition(".")[2].removesuffix("_deg").replace("_", " ")
    return f"{name} {value_text(field.value, language)} {field.unit}".strip()
