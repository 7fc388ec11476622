"""The joints of a robot: to be found by name, each with a field and a slider for where it is to go.

A mark on the slider shows where it is, and words say why that is somewhere else.
"""

from asyncio import wrap_future
from collections.abc import Callable, Mapping, Sequence
from math import degrees, inf
from typing import Any

from nicegui import background_tasks, context, ui

from simrob_drake.extensions.pendant.pages import plots
from simrob_drake.extensions.pendant.pages.elements import Dial, NumberField, follow, icon_button
from simrob_drake.extensions.pendant.pages.words import Content, Phrases, matches
from simrob_drake.extensions.pendant.run import shortfall
from simrob_drake.extensions.pendant.session import Session

_SIDE = {"deg": 180.0, "m": 1.0}  # how far a slider goes to either side where an axis has no limit
_DIGITS = 2  # behind the point, of a joint that was not set
_SET = "background: color-mix(in srgb, var(--q-primary) 20%, transparent)"  # how a joint looks that was set


class Joints:
    """A list of joints in which targets are set."""

    def __init__(
        self,
        phrases: Phrases,
        axes: Sequence[Content],
        *,
        changed: Callable[[], None],
        entered: Callable[[], object],
    ) -> None:
        """Build the list.

        ``changed`` is called after each change of a target, ``entered`` when the user ends a number with the key Enter.
        """
        t, self._changed = phrases.t, changed
        self._search = ui.input(t("legs.search"), on_change=self._find).props(
            "clearable dense outlined type=search"
        )
        self._search.classes("w-full")
        with (
            ui.column()
            .classes("w-full gap-0 overflow-y-auto flex-nowrap")
            .classes("pendant-joints")
        ):
            self._rows = [_Row(phrases, axis, changed, entered) for axis in axes]
            self._nothing = ui.label(t("legs.no_joint"))
        self._find()

    @property
    def dials(self) -> dict[str, Dial]:
        """What sets each joint, by axis."""
        return {row.name: row.dial for row in self._rows}

    @property
    def targets(self) -> dict[str, float]:
        """Where joints are to go that were set, and can [deg or m], by axis."""
        return {row.name: row.value for row in self._rows if row.is_set and row.value is not None}

    def refuse_wrong(self) -> bool:
        """Tell whether a target cannot be, and take the user to the first."""
        wrong = next((row for row in self._rows if row.is_set and row.value is None), None)
        if wrong is not None:
            self._search.value = ""
            wrong.dial.number.needed()
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
        self.set({name: value for name, value in targets.items() if name not in self.targets})

    def set(self, targets: Mapping[str, float]) -> None:
        """Set joints [deg or m]."""
        for row in self._rows:
            if row.name in targets:
                row.set(targets[row.name])
        if targets:
            self._changed()

    def follow(self, values: Mapping[str, float]) -> None:
        """Show where joints are [deg or m] that are not set."""
        for row in self._rows:
            if not row.is_set and row.name in values:
                row.settle(values[row.name])

    def _find(self) -> None:
        shown = [matches(self._search.value or "", row.called) for row in self._rows]
        for row, visible in zip(self._rows, shown, strict=True):
            row.dial.row.set_visibility(visible)
        self._nothing.set_visibility(not any(shown))


class _Row:
    """One joint, which is set or not."""

    def __init__(
        self,
        phrases: Phrases,
        axis: Content,
        changed: Callable[[], None],
        entered: Callable[[], object],
    ) -> None:
        self.name: str = axis["name"]
        self.is_set, self._changed, self._at = False, changed, float(axis["now"])
        words = phrases.axis(self.name)
        self.called = (words, self.name, *axis["aliases"])
        self.dial = axis_dial(
            phrases, axis, words, about=" · ".join((*self.called[2:], self.name)), moved=self._moved
        )
        self.dial.number.field.on("keydown.enter", entered)
        with self.dial.row:
            self._back = icon_button(
                "backspace", f"{phrases.t('legs.take_back')}: {words}", self._take_back
            )
        self.settle(None)

    @property
    def value(self) -> float | None:
        """Where it is to go [deg or m]; None where it cannot."""
        return self.dial.value

    def settle(self, value: float | None) -> None:
        """Show where the joint is, the same as before where that is None, and count it as not set."""
        self._at = round(self._at if value is None else value, _DIGITS)
        self.dial.show(self._at)
        self._mark(is_set=False)

    def set(self, value: float) -> None:
        """Take where the joint is to go [deg or m]."""
        self.dial.show(value)
        self._mark(is_set=self.dial.number.field.value is not None)

    def _moved(self) -> None:
        self._mark(is_set=self.dial.number.field.value is not None)
        self._changed()

    def _mark(self, *, is_set: bool) -> None:
        self.is_set = is_set
        self.dial.row.style(add=_SET if is_set else None, remove=None if is_set else _SET)
        self._back.style(f"visibility: {'visible' if is_set else 'hidden'}")

    def _take_back(self) -> None:
        self.settle(None)
        self._changed()


def axis_dial(phrases: Phrases, axis: Content, name: str, **how: Any) -> Dial:
    """Build the dial that sets an axis [deg or m], within its limits.

    The dial of a passive axis shows its position, and cannot be set.

    Args:
        phrases: words of the page.
        axis: the axis, as a description has it.
        name: name of the axis in words.
        how: further arguments of :class:`Dial`.
    """
    low, high, unit = axis["low"], axis["high"], phrases.unit(axis["name"])
    is_passive = axis.get("passive", False)
    if is_passive:
        about = how.get("about", "")
        no_motor = phrases.t("legs.no_motor")
        how["about"] = f"{about} · {no_motor}" if about else no_motor
    dial = Dial(phrases.t, name, low=low, high=high, unit=unit, side=_SIDE[axis["unit"]], **how)
    if is_passive:
        dial.lock()
    return dial


def axis_field(phrases: Phrases, axis: Content, value: float) -> NumberField:
    """Build a field for the target of an axis [deg or m], which is refused beyond the limits."""
    name, low, high = axis["name"], axis["low"], axis["high"]
    return NumberField(
        phrases.t, phrases.axis(name), value, low=low, high=high, unit=phrases.unit(name)
    )


_SIGNALS = ("reference", "position", "torque")
_BEFORE = 0.05  # from a moment to the one before, by which it is told how fast a joint moves [s]
_NOTED = {"deg": 0.5, "m": 0.0005}
"""Least difference from the request with which a joint's measured position is written below it [deg or m]."""
_FORCES = {"deg": "N·m", "m": "N"}


def signal_of(session: Session, kind: str) -> str:
    """Return the signal of a kind of the robot that a session teaches; empty without one."""
    names = [signal["name"] for signal in session.description.get("signals", ())]
    return next((name for name in (f"{session.book.robot}.{kind}", kind) if name in names), "")


def shown_at(session: Session, kind: str, before: float = 0.0) -> Sequence[float] | None:
    """Return a signal of the taught robot at the moment that is shown, or so long before [s]; None where not kept."""
    ring = session.run.history_of(signal_of(session, kind))
    found = plots.at(ring, session.run.time - before) if session.run.time else None
    return None if found is None else plots.as_list(found)


class Marks:
    """Of all joints of the robot that is taught."""

    def __init__(
        self,
        session: Session,
        phrases: Phrases,
        axes: Sequence[Content],
        dials: Mapping[str, Dial],
        place: ui.element,
    ) -> None:
        """Mark dials of axes by their names, as long as an element of the page is there."""
        self._session, self._phrases, self._axes, self._dials = session, phrases, axes, dials
        self._limits: Sequence[float] = [inf] * len(axes)
        self._client = context.client
        plots.watch(
            session, [name for kind in _SIGNALS if (name := signal_of(session, kind))], place
        )
        follow(session, self._ask, "program", "description", "phase")
        follow(session, self._show, "tick", "phase")

    def _ask(self) -> None:
        if self._session.description and self._session.phase in ("idle", "running", "paused"):
            background_tasks.create(self._asked())

    async def _asked(self) -> None:
        """Ask what the drives can do, which changes with settings, also while something runs."""
        limits = await wrap_future(self._session.client.ask("torque_limits"))
        if limits and not self._client.is_deleted:
            self._limits = (
                limits
                if self._session.description.get("mode") == "dynamic"
                else [inf] * len(limits)
            )
            self._show()

    def _show(self) -> None:
        found = [shown_at(self._session, kind) for kind in _SIGNALS]
        asked, done, torques = found
        if asked is None or done is None:
            for dial in self._dials.values():
                dial.mark(None)
            return
        earlier = shown_at(self._session, "position", _BEFORE) or done
        for number, axis in enumerate(self._axes):
            turn = degrees if axis["unit"] == "deg" else float
            where, torque = turn(done[number]), torques[number] if torques else 0.0
            gap = shortfall(
                axis,
                turn(asked[number]),
                where,
                speed=(where - turn(earlier[number])) / _BEFORE,
                torque=torque,
                limit=self._limits[number],
            )
            runs_on = gap.reason in ("", "moving", "gains") and self._session.phase == "running"
            why = (
                ""
                if runs_on
                else self._why(axis, gap.reason, where, gap.off, torque, self._limits[number])
            )
            self._dials[axis["name"]].mark(where, gap.level, why)

    def _why(
        self, axis: Content, reason: str, done: float, off: float, torque: float, limit: float
    ) -> str:
        if not reason and abs(off) < _NOTED[axis["unit"]]:
            return ""
        reason = reason or "measured"
        unit, force = self._phrases.unit(axis["name"]), _FORCES[axis["unit"]]
        digits = 1 if axis["unit"] == "deg" else 4
        figure = self._phrases.t.figure
        lengths = {
            name: f"{figure(round(value, digits))}{unit}"
            for name, value in (("done", done), ("off", abs(off)))
        }
        forces = {"torque": figure(round(abs(torque), 2)), "limit": f"{figure(limit)} {force}"}
        return self._phrases.t(f"shortfall.{reason}", **lengths, **forces)
