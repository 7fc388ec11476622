"""A number with a slider, by which something is moved at once."""

from collections.abc import Callable
from math import isfinite
from typing import Any

from nicegui import ui

from simrob_drake.teach.pages.phrases import figure

_PAUSE = 600
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
            self._field.props(f'dense outlined hide-bottom-space debounce={_PAUSE} aria-label="{name}"')
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
        self._from.text, self._to.text = self._told(low), self._told(high)

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
        return self._wrong.format(low=self._told(self._low), high=self._told(self._high))

    def _told(self, value: float) -> str:
        return f"{figure(value)} {self._unit}".replace(" °", "°") if isfinite(value) else ""
