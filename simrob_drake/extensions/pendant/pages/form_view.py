"""Fields of a station on a page: each with its help below, and in its place what is wrong with what was typed."""

import asyncio
import re
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from math import log10
from typing import Any, NamedTuple

from nicegui import ui

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import number_in_language
from simrob_drake.extensions.pendant.form import Field, as_value
from simrob_drake.extensions.pendant.pages.elements import Slider, name_value_text
from simrob_drake.extensions.pendant.pages.words import Words, value_text

Give = Callable[[str, Any], Awaitable[str]]
"""Takes a key and its new value, and returns what is wrong with it; nothing where it was done."""

_COMMA_NUMBER = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
"""A number with a decimal comma. As YAML, it would be a text."""

_HUGE = 1e6  # bounds from here on are nothing that a user meets


class FormView:
    """A column of fields. Shown anew with the same keys only their values change, so that none loses the focus."""

    def __init__(self, t: Words, give: Give, *, under: str = "") -> None:
        """Make an empty column in the present place.

        ``give`` takes what the user enters; ``under`` is left out of the names of the keys.
        """
        self._t, self._give, self._under = t, give, under
        self._shape: object = None
        self._update: list[Callable[[Field], object]] = []
        self._place = ui.column().classes("station-form w-full gap-1")

    def show(self, fields: Sequence[Field]) -> None:
        """Show fields."""
        shape = [(field.key, field.kind, field.choices) for field in fields]
        if shape != self._shape:
            self._shape = shape
            self._place.clear()
            with self._place:
                self._update = [self._draw(field) for field in fields]
        for update, field in zip(self._update, fields, strict=True):
            update(field)

    def _draw(self, field: Field) -> Callable[[Field], object]:
        draw = {
            "switch": self._switch,
            "section": self._section,
            "choice": self._choice,
            "entries": self._entries,
        }
        return draw.get(field.kind, self._typed)(field)

    def _name(self, field: Field) -> str:
        return field.key.removeprefix(f"{self._under}.")

    def _switch(self, field: Field) -> Callable[[Field], object]:
        return self._switched(field, lambda on: on)

    def _section(self, field: Field) -> Callable[[Field], object]:
        """Draw the heading of a section; one that may be missing has a switch."""
        if field.removable:
            return self._switched(field, lambda on: {} if on else None)
        ui.label(self._name(field)).classes("font-bold pt-2").tooltip(field.help)
        return lambda new: None

    def _switched(self, field: Field, value: Callable[[bool], Any]) -> Callable[[Field], object]:
        """Draw a switch with its help below, or what is wrong."""
        with ui.column().classes("w-full gap-0"):
            switch = (
                ui.switch(self._name(field), value=bool(field.value)).props("dense").classes("pt-2")
            )
            message = ui.label()
        shown = [switch.value]

        def tell(wrong: str) -> None:
            message.text = wrong or field.help
            message.classes(replace=f"text-xs {'text-negative' if wrong else 'opacity-70'}")

        async def changed() -> None:
            if switch.value != shown[0]:
                wrong = await self._give(field.key, value(switch.value))
                tell(wrong)
                if wrong:
                    switch.value = shown[0]

        def update(new: Field) -> None:
            shown[0] = switch.value = bool(new.value)
            tell("")

        tell("")
        switch.on_value_change(changed)
        return update

    def _choice(self, field: Field) -> Callable[[Field], object]:
        select = ui.select(list(field.choices), label=self._name(field), value=field.value)
        select.classes("w-full").props("dense").props["hint"] = field.help
        shown = [field.value]

        async def changed() -> None:
            if select.value != shown[0]:
                select.error = await self._give(field.key, select.value) or None

        def update(new: Field) -> None:
            shown[0] = new.value
            select.value, select.error = new.value, None

        select.on_value_change(changed)
        return update

    def _typed(self, field: Field) -> Callable[[Field], object]:
        box = ui.input(self._name(field), suffix=field.unit or None)
        # The label stays above, so that an empty field shows what holds, and not its own name.
        box.classes("w-full").props("dense stack-label")
        shown = [""]

        async def typed() -> None:
            if (text := box.value or "") == shown[0]:
                box.error = None
                return
            try:
                box.error = (
                    await self._give(field.key, as_value(field, self._as_typed(field, text)))
                    or None
                )
            except SimrobError as problem:
                box.error = self._t.render(str(problem))

        def update(new: Field) -> None:
            # The value in force changes with other keys, such as the torque limit with the motor.
            box.props["placeholder"] = self._shown_if_empty(new)
            box.props["hint"] = self._help(new)
            text = self._shown(new.value)
            if text != shown[0]:
                shown[0] = box.value = text
                box.error = None

        box.on("keydown.enter", typed).on("blur", typed)
        return update

    def _shown(self, value: Any) -> str:
        """Write a value for the user: a number with the decimal sign of the language, other values as YAML."""
        return value_text(value, self._t.language)

    def _shown_if_empty(self, field: Field) -> str:
        """Write the value that holds if the field is empty: the value in force, else the default of the key."""
        value = field.default if field.in_force is None else field.in_force
        return self._shown(value) or self._t("station.not_given")

    def _as_typed(self, field: Field, text: str) -> str:
        """Read a number with either decimal sign. Other values are YAML, in which a comma separates."""
        is_number = field.kind == "number" or (
            field.kind == "value" and _COMMA_NUMBER.fullmatch(text.strip())
        )
        return text.replace(",", ".") if is_number and self._t.has_decimal_comma else text

    def _help(self, field: Field) -> str:
        """Describe a field, with its bounds and its default, or the value in force and its origin."""
        ends = (("≥", field.low), ("≤", field.high))
        bounds = [
            f"{sign} {self._t.figure(bound)}"
            for sign, bound in ends
            if bound is not None and abs(bound) < _HUGE
        ]
        if field.in_force is not None:
            value = self._shown(field.in_force)
            source = self._t(
                "station.in_force", value=value, origin=self._t(f"station.origin_{field.origin}")
            )
        else:
            default = self._shown(field.default)
            source = self._t("station.default", value=default) if default else ""
        hints = [*bounds, source]
        return " · ".join(filter(None, (field.help, *hints)))

    def _entries(self, field: Field) -> Callable[[Field], object]:
        """Draw what puts a new entry into a section of entries: its name, its kind, and its keys as YAML."""
        with ui.row().classes("w-full items-start gap-2"):
            name = ui.input(self._t("station.entry_name")).props("dense").classes("w-32")
            kind = (
                ui.select(list(field.choices), label=self._t("station.entry_kind"))
                .props("dense")
                .classes("w-36")
            )
            kind.set_visibility(bool(field.choices))
            keys = ui.input(self._t("station.entry_keys"), placeholder="{force: [5, 0, 0]}")
            keys.props("dense").classes("grow")

            async def add() -> None:
                try:
                    entry = as_value(
                        Field(f"{field.key}.{name.value}", "value", default={}), keys.value or ""
                    )
                except SimrobError as problem:
                    keys.error = self._t.render(str(problem))
                    return
                chosen = {"kind": kind.value} if kind.value else {}
                whole = {**chosen, **entry} if isinstance(entry, dict) else entry
                keys.error = await self._give(f"{field.key}.{name.value or ''}", whole) or None

            ui.button(self._t("station.entry_add"), icon="add", on_click=add).props("flat dense")
        return lambda new: None


_TUNED = ("kp", "ki", "kd", "torque_limit", "gravity", "static", "dynamic")
"""Last parts of the keys that have a slider where they hold one number."""
_DECADES = 1.0  # that a slider goes to each side of its middle
_STEP = 0.01  # of the slider, in decades
_DIGITS = 3
_PAUSE_OF_PRESSES = 0.4
"""Time after the last press of a key until a slider's value counts [s]."""


class Tuning(NamedTuple):
    """A number with a slider.

    Attributes:
        name: what the slider is called: the dotted key that it changes.
        value: the present value.
        unit: unit of the value.
        give: takes a new value, and returns what is wrong with it; an empty text if it was taken.
        middle: value in the middle of the slider, which goes a decade to each side. If it is 0, or the value is beyond
            this range, the value itself is in the middle.
    """

    name: str
    value: float
    unit: str
    give: Callable[[float], Awaitable[str]]
    middle: float = 0.0


def tunings(fields: Sequence[Field], give: Give) -> list[Tuning]:
    """Make a slider for each field with one positive number that is worth tuning."""
    return [
        Tuning(field.key, float(field.value), field.unit, partial(give, field.key))
        for field in fields
        if is_tuned(field.key) and isinstance(field.value, (int, float)) and field.value > 0
    ]


def is_tuned(key: str) -> bool:
    """Check whether a key has a slider if its value is one number, such as ``servo.kp``."""
    return key.rpartition(".")[2] in _TUNED


class Tuner:
    """The slider of a number, whose value is written in a language. It acts when it is released, or by the arrow keys.

    Attributes:
        tuning: the number as the slider was built for it.
    """

    def __init__(self, tuning: Tuning, t: Words) -> None:
        """Build the slider, its value in words, and a line for what is wrong with it."""
        self.tuning = tuning
        self._t = t
        # The range stays while the slider is built anew with another value: its thumb would jump back to the middle. At
        # an end of the range the value comes to the middle, so that the user can go on.
        self._middle = tuning.middle or tuning.value
        if not self._is_inside(tuning.value):
            self._middle = tuning.value
        # What the station has by now or will have: values that were given, the last one at the end.
        self._expected = [tuning.value]
        self._presses = 0
        self._is_giving = False
        with ui.element("div").classes("pendant-tuner w-full"):
            ui.label(tuning.name).classes("text-sm w-32 shrink-0").style("overflow-wrap: anywhere")
            exponent = log10(tuning.value / self._middle)
            self._slider = Slider(min=-_DECADES, max=_DECADES, step=_STEP, value=exponent)
            self._slider.classes("grow").props(f'aria-label="{tuning.name}"')
            self._label = ui.label().classes("text-sm w-36 shrink-0")
        # The slider itself has the exponent of its value: screen readers read the text of the label instead.
        name_value_text(self._slider, self._label)
        self._wrong = ui.label().classes("text-xs text-negative")
        self._slider.on_value_change(lambda: self._show(self._slider.value))
        self._slider.on("change", lambda event: self._give_after_pause(event.args))
        self._show(exponent)

    def holds(self, tuning: Tuning) -> bool:
        """Check whether the slider may stay for a number as it is now.

        It may while the user moves it: built anew it would lose the keys that are pressed in between. It may if the
        station has a value that it gave, even one before the last: the station is drawn some time after it was changed.
        """
        kept = self.tuning
        if (tuning.name, tuning.unit, tuning.middle) != (kept.name, kept.unit, kept.middle):
            return False
        if tuning.value in self._expected:
            del self._expected[: self._expected.index(tuning.value)]
            return self._is_giving or self._is_inside(tuning.value)
        return self._is_giving

    def _is_inside(self, value: float) -> bool:
        """Check whether a value is within the range of the slider, not at an end."""
        return abs(log10(value / self._middle)) <= _DECADES - _STEP / 2

    def _value_at(self, exponent: float | None) -> float:
        """Value of the number where the slider is at an exponent. None, which a browser may send, counts as 0."""
        return float(f"{self._middle * 10 ** (exponent or 0.0):.{_DIGITS}g}")

    def _show(self, exponent: float | None) -> None:
        """Write the value of the number where the slider is at an exponent."""
        number = number_in_language(f"{self._value_at(exponent):g}", self._t.language)
        self._label.text = f"{number} {self.tuning.unit}"

    async def _give_after_pause(self, exponent: float | None) -> None:
        """Give the value, unless another press or release follows soon: each change loads the station anew.

        Args:
            exponent: where the slider is, as the event of the press has it. The property of the slider is set by
                another event, which may arrive long after this one.
        """
        self._presses += 1
        this_press = self._presses
        self._is_giving = True
        await asyncio.sleep(_PAUSE_OF_PRESSES)
        if this_press != self._presses:
            return
        value = self._value_at(exponent)
        self._expected.append(value)
        self._wrong.text = await self.tuning.give(value)
        if this_press == self._presses:
            self._is_giving = False
