"""The joints of a robot: to be found by name, and each with a field and a slider for where it is to go."""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import Any

from nicegui import ui

from simrob_drake.teach.pages.phrases import Content, Phrases, figure, matches

_SIDE = {"deg": 180.0, "m": 1.0}
"""How far a slider goes to either side where an axis has no limit."""
_STEP = {"deg": 1.0, "m": 0.01}
_SET = "bg-primary/15 rounded"  # how a joint looks that was set
_DIGITS = 3  # behind the point, of a joint that was not set


class Joints:
    """A list of joints in which targets are set."""

    def __init__(
        self, phrases: Phrases, axes: Sequence[Content], *, changed: Callable[[], None], entered: Callable[[], object]
    ) -> None:
        """Build the list.

        Args:
            phrases: what the axes are called.
            axes: of the robot's description.
            changed: called after each change of a target.
            entered: called when the user ends a number with the key Enter.
        """
        t = phrases.t
        self._search = ui.input(t("legs.search"), on_change=self._find).props("clearable dense outlined type=search")
        self._search.classes("w-full")
        with ui.column().classes("w-full gap-1 overflow-y-auto flex-nowrap").style("max-height: 24rem"):
            self._rows = [_Row(phrases, axis, changed, entered) for axis in axes]
            self._nothing = ui.label(t("legs.no_joint"))
        self._find()

    @property
    def targets(self) -> dict[str, float]:
        """Where joints are to go that were set, and can [deg or m], by axis."""
        return {row.name: row.value for row in self._rows if row.is_set and not row.wrong}

    def refuse_wrong(self) -> bool:
        """Tell whether a target cannot be, and take the user to the first."""
        wrong = next((row for row in self._rows if row.wrong), None)
        if wrong is not None:
            self._search.value = ""
            wrong.field.run_method("focus")
        return wrong is not None

    def settle(self) -> None:
        """Count no joint as set any more; each shows the number that it has."""
        for row in self._rows:
            row.settle(row.value if row.is_set and not row.wrong else None)

    def follow(self, values: Mapping[str, float]) -> None:
        """Show where joints are [deg or m] that are not set."""
        for row in self._rows:
            if not row.is_set and row.name in values:
                row.settle(values[row.name])

    def _find(self) -> None:
        shown = [matches(self._search.value or "", row.called) for row in self._rows]
        for row, visible in zip(self._rows, shown, strict=True):
            row.element.set_visibility(visible)
        self._nothing.set_visibility(not any(shown))


class _Row:
    """One joint: a number that is refused beyond the limits, and a slider between them."""

    def __init__(
        self, phrases: Phrases, axis: Content, changed: Callable[[], None], entered: Callable[[], object]
    ) -> None:
        self.name: str = axis["name"]
        self.is_set = self._quiet = False
        self._t, self._unit, self._changed = phrases.t, phrases.unit(self.name), changed
        self._low, self._high = axis["low"], axis["high"]
        self._at = round(float(axis["now"]), _DIGITS)
        words = phrases.axis(self.name)
        self.called = (words, self.name, *axis["aliases"])
        step, side = _STEP[axis["unit"]], _SIDE[axis["unit"]]
        low, high = max(self._low, -side), min(self._high, side)
        with ui.row().classes("w-full items-center gap-x-3 gap-y-0 px-2") as self.element:
            with ui.column().classes("gap-0 grow").style("flex-basis: 13rem"):
                ui.label(words)
                ui.label(" · ".join([*axis["aliases"], self.name])).classes("text-xs opacity-70")
            self.field = ui.number(value=self._at, step=step, suffix=self._unit.strip(), validation=self._problem)
            self.field.props(f'dense outlined aria-label="{words}"').classes("w-28").on("keydown.enter", entered)
            with ui.column().classes("gap-0 grow").style("flex-basis: 9rem"):
                self._slider = ui.slider(min=low, max=high, step=step, value=self._at)
                self._slider.props(f'dense aria-label="{words}"').classes("w-full px-2")
                with ui.row().classes("w-full justify-between text-xs opacity-70"):
                    ui.label(self._limit(low))
                    ui.label(self._limit(high))
            back = ui.button(icon="undo", on_click=self._take_back).props("flat dense round")
            self._back = back.props(f'aria-label="{self._t("legs.take_back")}"').tooltip(self._t("legs.take_back"))
        self._mark()
        self.field.on_value_change(self._typed)
        self._slider.on_value_change(self._slid)

    @property
    def value(self) -> float:
        """Where it is to go [deg or m]."""
        return self._at if self.field.value is None else float(self.field.value)

    @property
    def wrong(self) -> bool:
        """Whether it cannot go there."""
        return self._problem(self.field.value) is not None

    def settle(self, value: float | None) -> None:
        """Show where the joint is, the same as before where that is None, and count it as not set."""
        self._at = self._at if value is None else round(value, _DIGITS)
        self.is_set = False
        self._show(self._at)

    def _show(self, value: float) -> None:
        self._quiet = True
        self.field.value = self._slider.value = value
        self._quiet = False
        self._mark()

    def _mark(self) -> None:
        if self.is_set:
            self.element.classes(_SET)
        else:
            self.element.classes(remove=_SET)
        self._back.style(f"visibility: {'visible' if self.is_set else 'hidden'}")

    def _take_back(self) -> None:
        self.settle(None)
        self._changed()

    def _typed(self) -> None:
        if not self._quiet:
            self._set(self.field.value)

    def _slid(self) -> None:
        if not self._quiet:
            self._set(self._slider.value)

    def _set(self, value: float | None) -> None:
        self.is_set = value is not None
        if value is not None and self._problem(value) is None:
            self._show(value)
        self._mark()
        self._changed()

    def _problem(self, value: Any) -> str | None:
        if value is None or self._low <= value <= self._high:
            return None
        return self._t("legs.limits", low=self._limit(self._low), high=self._limit(self._high))

    def _limit(self, value: float) -> str:
        return f"{figure(value)}{self._unit}" if isfinite(value) else ""
