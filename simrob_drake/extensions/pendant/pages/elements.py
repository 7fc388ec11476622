"""What pages are built of: buttons, fields and sliders, for keyboards and screen readers, too, and how they follow."""

import asyncio
from collections.abc import Callable
from math import ceil, floor, inf, isfinite
from typing import Any
from weakref import WeakKeyDictionary

from nicegui import Client, ElementFilter, context, core, ui

from simrob_drake.extensions.pendant.pages.words import Words

_DIGITS = 3  # behind the point
_DIGITS_OF_ANGLES = 1  # behind the point of a limit in degrees
_SLACK = 0.5 * 10**-_DIGITS
"""How far beyond a limit a number may be entered that is no angle; it stands for the limit then."""
_SLACK_OF_ANGLES = 0.01
"""The same of angles [deg]: limits are often round numbers of degrees that a file has as rounded radians."""
_SAME = 1e-6
"""Numbers that differ by less are the same."""
_DEBOUNCE = (
    600  # after the last key until a typed number counts, unless the user ends it with Enter [ms]
)


def limit_text(t: Words, value: float, unit: str, *, is_upper: bool) -> str:
    """Write a limit with its unit, so that the value that is read can be entered.

    A limit of an angle has one digit behind the point. It is rounded to the nearest number if that is accepted (165°
    for a limit of 2.87979 rad, which is 164.9998°), otherwise towards the inside.

    Args:
        t: texts in the language of the page.
        value: the limit.
        unit: unit behind the number, as :class:`Phrases` has it.
        is_upper: whether it is an upper limit.
    """
    if not isfinite(value):
        return ""
    scale = 10.0 ** (_DIGITS_OF_ANGLES if unit == "°" else _DIGITS)
    nearest = round(value * scale) / scale
    inside = (floor if is_upper else ceil)(value * scale) / scale
    shown = nearest if abs(nearest - value) <= slack_of(unit) else inside
    return f"{t.figure(shown)}{unit}"


def slack_of(unit: str) -> float:
    """How far beyond a limit a number of a unit may be entered. It stands for the limit then."""
    return _SLACK_OF_ANGLES if unit == "°" else _SLACK


def step_of(unit: str) -> float:
    """Return the step of fields and sliders for numbers of a unit."""
    return 0.01 if unit == " m" else 1.0


class NumberField:
    """A field for a number.

    Attributes:
        field: as the page has it.
        low: the smallest number.
        high: the largest one.
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
        step: float | None = None,
        whole: bool = False,
        titled: bool = True,
    ) -> None:
        """Build it in the present place; it shows its label if it is titled, and the unit behind the number."""
        step = step or step_of(unit)
        self._t, self.low, self.high, self._unit, self._whole = t, low, high, unit, whole
        self.field = ui.number(
            label if titled else None, value=value, step=step, suffix=unit.strip() or None
        )
        self.field.props("dense outlined hide-bottom-space no-error-icon").validation = self.problem
        set_label(self.field, label)

    @property
    def value(self) -> float | None:
        """What it holds; None where that is nothing or refused, as it says in the field."""
        value = self.field.value
        if value is None or self.problem(value) is not None:
            return None
        limited = min(max(float(value), self.low), self.high)
        return (
            int(value) if self._whole else limited if abs(limited - value) > _SAME else float(value)
        )

    def needed(self) -> float | None:
        """Return what it holds; where that is nothing or refused, None, and the user is taken there."""
        if self.value is None:
            self.field.error = self.problem(self.field.value) or self._t("legs.number_needed")
            self.field.run_method("focus")
        return self.value

    def problem(self, value: Any) -> str | None:
        """Return what is wrong with a value, if anything is."""
        slack = slack_of(self._unit)
        within = value is None or self.low - slack <= value <= self.high + slack
        if within and not (self._whole and value is not None and value % 1):
            return None
        low, high = (
            limit_text(self._t, limit, self._unit, is_upper=limit == self.high)
            for limit in (self.low, self.high)
        )
        kind = "whole_limits" if self._whole else "limits"
        if low and high:
            return self._t(f"legs.{kind}", low=low, high=high)
        return (
            self._t(f"legs.{kind}_low", low=low) if low else self._t(f"legs.{kind}_high", high=high)
        )


class Slider(ui.slider):
    """A slider that moves in the browser alone: what comes back late from here would take back what was done since."""

    LOOPBACK = False


_VALUE_LABEL = "data-text"
"""Property of a slider with the id of the label whose text is its value, for :mod:`page.js`."""
_UNIT = "data-unit"
"""Property of a slider with the unit of its value, for :mod:`page.js`."""


def name_value_text(slider: ui.slider, label: ui.label) -> None:
    """Let screen readers read the text of a label as the value of a slider. Call it where the slider is built."""
    slider.props[_VALUE_LABEL] = f"c{label.id}"


class Dial:
    """A number, and a slider for it; both show the same, and only what can be is taken.

    Attributes:
        number: its field.
        row: that all of it stands in.
    """

    def __init__(
        self,
        t: Words,
        name: str,
        *,
        low: float,
        high: float,
        unit: str,
        side: float = inf,
        about: str = "",
        live: bool = False,
        moved: Callable[[], object],
    ) -> None:
        """Build it, at 0.

        ``unit`` stands behind the number, as :class:`Phrases` has it, and ``about`` below its name; the slider goes so
        far to either ``side`` where no limit is nearer. With ``live`` something moves with it: a number that is typed
        counts after a while, or with Enter. ``moved`` is called after each change by the user, also to what cannot be.
        """
        self._t, self._moved, self._unit, self._side, self._quiet = t, moved, unit, side, False
        self._marked: object = None
        with ui.row().classes(
            "pendant-dial w-full items-center gap-x-2 gap-y-0 px-2 rounded"
        ) as self.row:
            with ui.column().classes("gap-0 grow").style("flex-basis: 11rem"):
                ui.label(name)
                if about:
                    ui.label(about).classes("text-xs opacity-70")
                self._why = ui.label().classes("text-xs pendant-off")
            self.number = NumberField(t, name, 0.0, unit=unit, titled=False)
            self.number.field.classes("w-28").props(f"debounce={_DEBOUNCE}" if live else "")
            with ui.column().classes("gap-0 grow relative").style("flex-basis: 7rem"):
                self._slider = (
                    Slider(min=0, max=1, step=step_of(unit), value=0)
                    .props("dense")
                    .classes("w-full px-2")
                )
                set_label(self._slider, name)
                self._slider.props[_UNIT] = unit.strip() or None
                self._tick = ui.element("div").classes("pendant-tick").props("aria-hidden=true")
                with ui.row().classes("w-full justify-between text-xs opacity-70"):
                    self._ends = ui.label(), ui.label()
        self.between(low, high)
        self.mark(None)
        self.number.field.on_value_change(lambda: self._set(self.number.field.value))
        self._slider.on_value_change(lambda: self._set(self._slider.value))

    @property
    def value(self) -> float | None:
        """What it is set to; None where that cannot be."""
        return self.number.value

    def between(self, low: float, high: float) -> None:
        """Let it go between other values."""
        self.number.low, self.number.high = low, high
        ends = max(low, -self._side), min(high, self._side)
        self._slider.props["min"], self._slider.props["max"] = (round(end, _DIGITS) for end in ends)
        self._slider.update()
        low_label, high_label = self._ends
        low_label.text = limit_text(self._t, low, self._unit, is_upper=False)
        high_label.text = limit_text(self._t, high, self._unit, is_upper=True)

    def lock(self) -> None:
        """Let the user see the value, and not change it."""
        self.number.field.disable()
        self._slider.disable()

    def show(self, value: float) -> None:
        """Show a value, without moving anything."""
        self._quiet = True
        shown = round(value, _DIGITS) + 0.0
        self.number.field.value = self._slider.value = shown
        self._quiet = False

    def mark(self, value: float | None, level: str = "", why: str = "") -> None:
        """Mark on the slider where that is what it sets, in the colour of a level, and say why it is not as it is set.

        Without a value there is no mark.
        """
        low, high = self._slider.props["min"], self._slider.props["max"]
        part = 0.0 if value is None else min(max((value - low) / (high - low), 0.0), 1.0)
        look = f"pendant-tick {'hidden' if value is None else level}", f"--at: {part:.3f}", why
        if look != self._marked:  # many are told at each moment of a run
            self._marked = look
            self._tick.classes(replace=look[0]).style(replace=look[1])
            self._why.classes(replace=f"text-xs pendant-off {level}").set_text(why)

    def _set(self, value: float | None) -> None:
        if not self._quiet:
            if value is not None and self.number.problem(value) is None:
                self.show(value)
            self._moved()


def allow(button: ui.button, why_not: str) -> None:
    """Let a button act, or tell in words why it cannot."""
    button.set_enabled(not why_not)
    button.props["title"] = why_not or None
    button.update()


KEYS = "aria-keyshortcuts"
"""Property of an element with the keys that press it. :func:`set_keys` gives it."""
_BROWSER_LETTERS = "DEF"
"""Letters that browsers take with Alt: the address bar, and menus."""


class KeyTable:
    """The shortcuts of a page: each combination of keys presses one element."""

    def __init__(self) -> None:
        """Make an empty table."""
        self._elements: dict[str, ui.element] = {}

    def is_free(self, keys: str) -> bool:
        """Check whether no element of the page has these keys. An element that was deleted has none any more."""
        element = self._elements.get(keys)
        return element is None or element.is_deleted

    def add(self, keys: str, element: ui.element) -> None:
        """Give keys to an element.

        Args:
            keys: such as ``Space``, ``Control+Z`` or ``Alt+G``, as :mod:`page.js` spells them.
            element: the element that the keys press.

        Raises:
            ValueError: an element of the page has these keys already.
        """
        if not self.is_free(keys):
            owner = _name_of(self._elements[keys])
            raise ValueError(f"the keys {keys} of {_name_of(element)!r} press {owner!r} already")
        self._elements[keys] = element
        element.props[KEYS] = keys

    def free_letter(self, text: str) -> str:
        """Find the first letter of a text that is free with Alt. Returns an empty text if there is none."""
        letters = (letter for letter in text.upper() if letter.isascii() and letter.isalpha())
        free = (
            letter
            for letter in letters
            if letter not in _BROWSER_LETTERS and self.is_free(f"Alt+{letter}")
        )
        return next(free, "")


_key_tables: WeakKeyDictionary[Client, KeyTable] = WeakKeyDictionary()


def page_keys() -> KeyTable:
    """Return the shortcuts of the present page."""
    return _key_tables.setdefault(context.client, KeyTable())


def set_keys(element: ui.element, keys: str) -> None:
    """Give keys to an element of the present page.

    Raises:
        ValueError: another element of the page has these keys.
    """
    page_keys().add(keys, element)


def _name_of(element: ui.element) -> str:
    """Return the name by which users know an element."""
    return str(
        element.props.get("aria-label")
        or element.props.get("label")
        or getattr(element, "text", "")
    )


_KEY_NAMES = "Space", "Home", "Shift", "Control"
"""Keys that have other names on the keyboards of some languages. The texts of the page have these."""


def keys_in_words(t: Words, keys: str) -> str:
    """Name a combination of keys as the keyboards of the page's language do.

    Args:
        t: texts in the language of the page.
        keys: such as ``Control+Z``, as :func:`set_keys` takes them.
    """
    return "+".join(t(f"keys.{key}") if key in _KEY_NAMES else key for key in keys.split("+"))


def icon_button(
    icon: str,
    text: str,
    on_click: Callable[[], Any] | None = None,
    *,
    keys: str = "",
    t: Words | None = None,
    is_tip_above: bool = False,
) -> ui.button:
    """Make a button that shows an icon.

    Args:
        icon: name of the icon. Each icon of the page has one meaning.
        text: what the button does; shown as a tooltip, and read by screen readers.
        on_click: callback for a click.
        keys: keys that press the button, such as ``Space`` or ``Control+Z``.
        t: texts in the language of the page, which name keys. Without them the keys are named in English.
        is_tip_above: whether the tooltip is above the button, if what is below must not be covered.

    Raises:
        ValueError: another element of the page has these keys.
    """
    button = ui.button(icon=icon, on_click=on_click).props("flat round dense")
    set_label(button, text)
    if keys:
        set_keys(button, keys)
    named_keys = keys_in_words(t, keys) if t is not None else keys
    with button:
        tip = ui.tooltip(f"{text} ({named_keys})" if keys else text)
    if is_tip_above:
        tip.props('anchor="top middle" self="bottom middle"')
    return button


def set_label(element: ui.element, text: str) -> None:
    """Let an element be called by a text, for who does not see it."""
    element.props["aria-label"] = text
    element.update()


def shortcuts(t: Words) -> list[tuple[str, str]]:
    """List all keys of the present page, and what they do, in the language of the page's texts."""
    found = [
        element
        for element in ElementFilter(local_scope=False, only_visible=True)
        if KEYS in element.props
    ]
    return [(keys_in_words(t, element.props[KEYS]), _name_of(element)) for element in found]


_PAUSE = 0.05  # from one look at the session to the next [s]
_PAUSE_OF_TICKS = 0.2
"""The same while a run ticks [s]. A browser draws the whole page anew for each change: at twenty a second one without a
graphics card falls seconds behind, and what is clicked or let go is heard as late."""


def follow(session: Any, update: Callable[[], object], *topics: str) -> None:
    """Update a part of the present page now, and after changes of some topics, or all, as long as the page is there.

    Call it where the part is built: the update may make and change elements as the code there may. Several changes in
    a twentieth of a second are one to it, and several ticks in a fifth of a second.
    """
    place, client = context.slot.parent, context.client
    waiting = False

    def hear(topic: str) -> None:
        nonlocal waiting
        if not waiting and (not topics or topic in topics):
            waiting = True
            asyncio.get_running_loop().call_later(
                _PAUSE_OF_TICKS if topic == "tick" else _PAUSE, look
            )

    def look() -> None:
        nonlocal waiting
        waiting = False
        if client.is_deleted or place.is_deleted or not core.app.is_started:
            forget()  # a task begun after the server's last would never end: its loop is about to close
            return
        with place:
            try:
                update()
            except Exception as problem:  # else nobody hears of it
                core.app.handle_exception(problem)

    forget = session.listen(hear)
    client.on_delete(forget)
    update()


def rebuild(
    session: Any, state: Callable[[], Any], build: Callable[[], object], *topics: str
) -> Callable[[], None]:
    """Build a part in the present place now, and anew after changes of some topics where its state is another.

    ``state`` tells what the part is built of. What is returned looks whether that has changed.
    """
    place, built = ui.column().classes("w-full gap-4"), list[Any]()

    def show() -> None:
        now = state()
        if built != [now]:
            built[:] = [now]
            place.clear()
            with place:
                build()

    follow(session, show, *topics)
    return show


def own_tab_panels() -> ui.tab_panels | None:
    """Find the tab panels of which the present place is a part. Returns None on a page without tabs."""
    parents = context.slot.parent.ancestors(include_self=True)
    return next((parent for parent in parents if isinstance(parent, ui.tab_panels)), None)


def card(title: str, number: int = 0, about: str = "") -> ui.column:
    """Make a part of a page with a heading; ``number`` is its place in the order of use."""
    with ui.column().classes("pendant-plate w-full min-w-0 gap-2 p-3").props("role=group") as found:
        set_label(found, title)
        ui.label(numbered(title, number)).classes("text-base font-bold").props(
            "role=heading aria-level=2"
        )
        if about:
            ui.label(about).classes("text-sm opacity-70")
    return found


def folded(title: str) -> ui.expansion:
    """Make a part of a page that shows its heading until it is opened."""
    return ui.expansion(title).classes("pendant-plate w-full").props("dense header-class=font-bold")


def numbered(text: str, number: int) -> str:
    """Return a text with its number, if it has one."""
    return f"{number}. {text}" if number else text
