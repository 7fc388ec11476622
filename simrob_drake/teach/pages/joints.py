"""The joints of a robot: to be found by name, and each with a field and a slider for where it is to go."""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite

from nicegui import ui

from simrob_drake.teach.pages.elements import NumberField, icon_button, set_label
from simrob_drake.teach.pages.phrases import Content, Phrases, figure, matches

STEPS = {"deg": 1.0, "m": 0.01}
"""Of fields and sliders, by unit."""
_SIDE = {"deg": 180.0, "m": 1.0}
"""How far a slider goes to either side where an axis has no limit."""
_DIGITS = 2  # behind the point, of a joint that was not set
_SET = "background: color-mix(in srgb, var(--q-primary) 20%, transparent)"  # how a joint looks that was set


class Joints:
    """A list of joints in which targets are set."""

    def __init__(
        self, phrases: Phrases, axes: Sequence[Content], *, changed: Callable[[], None], entered: Callable[[], object]
    ) -> None:
        """Build the list.

        ``changed`` is called after each change of a target, ``entered`` when the user ends a number with the key Enter.
        """
        t = phrases.t
        self._search = ui.input(t("legs.search"), on_change=self._find).props("clearable dense outlined type=search")
        self._search.classes("w-full")
        with ui.column().classes("w-full gap-0 overflow-y-auto flex-nowrap").style("max-height: max(16rem, 38vh)"):
            self._rows = [_Row(phrases, axis, changed, entered) for axis in axes]
            self._nothing = ui.label(t("legs.no_joint"))
        self._find()

    @property
    def targets(self) -> dict[str, float]:
        """Where joints are to go that were set, and can [deg or m], by axis."""
        return {row.name: row.value for row in self._rows if row.is_set and row.value is not None}

    def refuse_wrong(self) -> bool:
        """Tell whether a target cannot be, and take the user to the first."""
        wrong = next((row for row in self._rows if row.is_set and row.value is None), None)
        if wrong is not None:
            self._search.value = ""
            wrong.number.needed()
        return wrong is not None

    def settle(self) -> None:
        """Count no joint as set any more; each shows the number that it has."""
        for row in self._rows:
            row.settle(row.value if row.is_set else None)

    def forget(self) -> None:
        """Take back all that was set."""
        for row in self._rows:
            row.settle(None)

    def restore(self, targets: Mapping[str, float]) -> None:
        """Set joints again as they were tested in vain [deg or m], but those that were set anew since."""
        for row in self._rows:
            if row.name in targets and not row.is_set:
                row.set(targets[row.name])

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
        self._changed, self._at = changed, round(float(axis["now"]), _DIGITS)
        words, unit = phrases.axis(self.name), phrases.unit(self.name)
        self.called = (words, self.name, *axis["aliases"])
        with ui.row().classes("w-full items-center gap-x-2 gap-y-0 px-2 py-1 rounded") as self.element:
            with ui.column().classes("gap-0 grow").style("flex-basis: 11rem"):
                ui.label(words)
                ui.label(" · ".join([*axis["aliases"], self.name])).classes("text-xs opacity-70")
            self.number = axis_field(phrases, axis, self._at)
            self.number.field.classes("w-24").on("keydown.enter", entered)
            with ui.column().classes("gap-0 grow").style("flex-basis: 7rem"):
                self._slider = _slider(axis, unit, self._at)
                set_label(self._slider, words)
            self._back = icon_button("undo", f"{phrases.t('legs.take_back')}: {words}", self._take_back)
        self._mark()
        self.number.field.on_value_change(lambda: self.set(self.number.field.value))
        self._slider.on_value_change(lambda: self.set(self._slider.value))

    @property
    def value(self) -> float | None:
        """Where it is to go [deg or m]; None where it cannot."""
        return self.number.value

    def settle(self, value: float | None) -> None:
        """Show where the joint is, the same as before where that is None, and count it as not set."""
        self._at = self._at if value is None else round(value, _DIGITS)
        self.is_set = False
        self._show(self._at)

    def set(self, value: float | None) -> None:
        """Take where the joint is to go [deg or m]; None where that is not said any more."""
        if self._quiet:
            return
        self.is_set = value is not None
        if value is not None and self.number.problem(value) is None:
            self._show(value)
        self._mark()
        self._changed()

    def _show(self, value: float) -> None:
        self._quiet = True
        self.number.field.value = self._slider.value = value
        self._quiet = False
        self._mark()

    def _mark(self) -> None:
        self.element.style(add=_SET if self.is_set else None, remove=None if self.is_set else _SET)
        self._back.style(f"visibility: {'visible' if self.is_set else 'hidden'}")

    def _take_back(self) -> None:
        self.settle(None)
        self._changed()


def axis_field(phrases: Phrases, axis: Content, value: float, *, titled: bool = False) -> NumberField:
    """Build a field for the target of an axis [deg or m], which is refused beyond the limits."""
    return NumberField(
        phrases.t,
        phrases.axis(axis["name"]),
        value,
        low=axis["low"],
        high=axis["high"],
        unit=phrases.unit(axis["name"]),
        step=STEPS[axis["unit"]],
        titled=titled,
    )


def _slider(axis: Content, unit: str, value: float) -> ui.slider:
    """Build the slider of an axis, with its limits below it."""
    side = _SIDE[axis["unit"]]
    low, high = max(axis["low"], -side), min(axis["high"], side)
    slider = ui.slider(min=low, max=high, step=STEPS[axis["unit"]], value=value).props("dense").classes("w-full px-2")
    with ui.row().classes("w-full justify-between text-xs opacity-70"):
        for limit in (axis["low"], axis["high"]):
            ui.label(f"{figure(limit)}{unit}" if isfinite(limit) else "")
    return slider
