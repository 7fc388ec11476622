"""What pages are built of: buttons, fields and sliders, for keyboards and screen readers, too, and how they follow."""

import asyncio
from collections.abc import Callable
from math import inf, isfinite
from typing import Any

from nicegui import ElementFilter, context, core, ui

from simrob_drake.teach.pages.phrases import figure
from simrob_drake.teach.pages.words import Words

_SLACK = 1e-6
"""How far beyond a limit a number may be that was made of another one."""


class NumberField:
    """A field for a number.

    Attributes:
        field: as the page has it.
    """

    def __init__(
        self,
        t: Words,
        label: str,
        value: float | None,
        *,
        low: float = -inf,
        high: float = inf,
        unit: str = "",
        step: float = 1.0,
        whole: bool = False,
        titled: bool = True,
    ) -> None:
        """Build it in the present place; it shows its label if it is titled, and the unit behind the number."""
        self._t, self._low, self._high, self._unit, self._whole = t, low, high, unit, whole
        self.field = ui.number(label if titled else None, value=value, step=step, suffix=unit.strip() or None)
        self.field.props("dense outlined hide-bottom-space no-error-icon").validation = self.problem
        set_label(self.field, label)

    @property
    def value(self) -> float | None:
        """What it holds; None where that is nothing or refused, as it says in the field."""
        value = self.field.value
        if value is None or self.problem(value) is not None:
            return None
        return int(value) if self._whole else float(value)

    def needed(self) -> float | None:
        """Return what it holds; where that is nothing or refused, None, and the user is taken there."""
        if self.value is None:
            self.field.error = self.problem(self.field.value) or self._t("legs.number_needed")
            self.field.run_method("focus")
        return self.value

    def problem(self, value: Any) -> str | None:
        """Return what is wrong with a value, if anything is."""
        within = value is None or self._low - _SLACK <= value <= self._high + _SLACK
        if within and not (self._whole and value is not None and value % 1):
            return None
        low, high = (f"{figure(limit)}{self._unit}" for limit in (self._low, self._high))
        return self._t("legs.whole_limits" if self._whole else "legs.limits", low=low, high=high)


_DEBOUNCE = 600
"""After the last key until a typed number counts, unless the user ends it with Enter [ms]."""
_DIGITS = 3  # behind the point
_LABEL = "min-width: 3.4rem; white-space: nowrap"


class Slider(ui.slider):
    """A slider that moves in the browser alone: what comes back late from here would take back what was done since."""

    LOOPBACK = False


class Dial:
    """A number, and a slider between two values; both show the same, and only what can be is taken.

    Limits count as they are shown, and what is set never lies beyond them.
    """

    def __init__(
        self, name: str, *, low: float, high: float, step: float, unit: str, wrong: str, moved: Callable[[], object]
    ) -> None:
        """Build it, at 0.

        Args:
            name: what it is called.
            low: the smallest value.
            high: the largest one.
            step: of its arrow keys.
            unit: that stands behind the number.
            wrong: what is said of a number beyond them, with ``{low}`` and ``{high}``.
            moved: called after each change by the user to a value that can be.
        """
        self._value, self._moved, self._wrong, self._unit, self._quiet = 0.0, moved, wrong, unit, False
        with ui.row().classes("w-full items-center gap-x-3 gap-y-0"):
            ui.label(name).classes("grow").style("flex-basis: 5rem; min-width: 4rem")
            self._field = ui.number(value=0, step=step, suffix=unit, validation=self._problem)
            self._field.props(f'dense outlined hide-bottom-space debounce={_DEBOUNCE} aria-label="{name}"')
            self._field.classes("w-28").on_value_change(lambda event: self._set(event.value))
            with ui.row().classes("grow items-center gap-2 no-wrap").style("flex-basis: 13rem"):
                self._from = ui.label().classes("text-xs opacity-70 text-right").style(_LABEL)
                self._slider = Slider(min=low, max=high, step=step, value=0).props(f'dense aria-label="{name}"')
                self._slider.on_value_change(lambda event: self._set(event.value))
                self._to = ui.label().classes("text-xs opacity-70").style(_LABEL)
        self.between(low, high)

    @property
    def value(self) -> float:
        """What it is set to."""
        return min(max(self._value, self._low), self._high)

    def between(self, low: float, high: float) -> None:
        """Let it go between other values."""
        self._low, self._high = low, high
        self._slider.props["min"], self._slider.props["max"] = round(low, _DIGITS), round(high, _DIGITS)
        self._slider.update()
        self._from.text, self._to.text = self._with_unit(low), self._with_unit(high)

    def show(self, value: float) -> None:
        """Show a value, without moving anything."""
        self._quiet = True
        self._value = round(value, _DIGITS) + 0.0
        self._field.value = self._slider.value = self._value
        self._quiet = False

    def _set(self, value: float | None) -> None:
        if not self._quiet and value is not None and self._problem(value) is None and value != self._value:
            self.show(value)
            self._moved()

    def _problem(self, value: Any) -> str | None:
        if value is None or round(self._low, _DIGITS) <= value <= round(self._high, _DIGITS):
            return None
        return self._wrong.format(low=self._with_unit(self._low), high=self._with_unit(self._high))

    def _with_unit(self, value: float) -> str:
        return f"{figure(value)} {self._unit}".replace(" °", "°") if isfinite(value) else ""


KEYS = "aria-keyshortcuts"


def icon_button(icon: str, text: str, on_click: Callable[[], Any] | None = None, *, keys: str = "") -> ui.button:
    """Make a button that shows an icon, and tells in words what it does.

    ``keys`` press it, such as ``Space`` or ``Control+Z``; any button may have them, in :data:`KEYS`.
    """
    button = ui.button(icon=icon, on_click=on_click).props("flat round dense")
    set_label(button, text)
    if keys:
        button.props[KEYS] = keys
    with button:
        ui.tooltip(f"{text} ({keys})" if keys else text)
    return button


def set_label(element: ui.element, text: str) -> None:
    """Let an element be called by a text, for who does not see it."""
    element.props["aria-label"] = text
    element.update()


def shortcuts() -> list[tuple[str, str]]:
    """Return all keys of the present page, and what they do."""
    found = [element.props for element in ElementFilter(local_scope=False, only_visible=True) if KEYS in element.props]
    return [(props[KEYS], props.get("aria-label") or props.get("label", "")) for props in found]


_PAUSE = 0.05
"""From one look at the session to the next [s]."""


def follow(session: Any, update: Callable[[], object], *topics: str) -> None:
    """Update a part of the present page now, and after changes of some topics as long as the page is there.

    Call it where the part is built: the update may make and change elements as the code there may.

    Args:
        session: what tells of the changes, in the server's thread.
        update: what brings the part up to date; several changes in a twentieth of a second are one to it.
        topics: of the session's; all unless some are named.
    """
    place, client = context.slot.parent, context.client
    waiting = False

    def hear(topic: str) -> None:
        nonlocal waiting
        if not waiting and (not topics or topic in topics):
            waiting = True
            asyncio.get_running_loop().call_later(_PAUSE, look)

    def look() -> None:
        nonlocal waiting
        waiting = False
        if client.is_deleted or place.is_deleted:
            forget()
            return
        with place:
            try:
                update()
            except Exception as problem:  # else nobody hears of it
                core.app.handle_exception(problem)

    forget = session.listen(hear)
    client.on_delete(forget)
    update()
