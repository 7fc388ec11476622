"""Sliders for gains and other figures of a station, to be turned while a run goes on."""

from collections.abc import Sequence

from nicegui import ui

from simrob_drake.teach.form import Field
from simrob_drake.teach.pages.form_view import Give

_TUNED = ("kp", "ki", "kd", "torque_limit", "gravity", "static", "dynamic")
"""Last parts of the keys that have a slider where they hold one number."""
_DECADES = 1.0  # that a slider goes to each side of the present figure
_DIGITS = 3


def tuners(fields: Sequence[Field], give: Give) -> None:
    """Build a slider for each figure that can be tuned; it acts when it is let go of, or by the arrow keys."""
    for field in fields:
        value = field.value
        if field.key.rpartition(".")[2] in _TUNED and isinstance(value, (int, float)) and value > 0:
            _Tuner(field, float(value), give)


class _Tuner:
    def __init__(self, field: Field, value: float, give: Give) -> None:
        self._field, self._value, self._give = field, value, give
        with ui.row().classes("w-full items-center no-wrap gap-3"):
            ui.label(field.key).classes("text-sm w-32 shrink-0")
            self._slider = ui.slider(min=-_DECADES, max=_DECADES, step=0.01, value=0.0, on_change=self._show)
            self._slider.classes("grow").props(f'aria-label="{field.key}"')
            self._slider.on("change", self._turned, args=[])
            self._label = ui.label().classes("text-sm w-36 shrink-0")
        self._wrong = ui.label().classes("text-xs text-negative")
        self._show()

    @property
    def _now(self) -> float:
        return float(f"{self._value * 10 ** (self._slider.value or 0.0):.{_DIGITS}g}")

    def _show(self) -> None:
        self._label.text = f"{self._now:g} {self._field.unit}"

    async def _turned(self) -> None:
        self._wrong.text = await self._give(self._field.key, self._now)
