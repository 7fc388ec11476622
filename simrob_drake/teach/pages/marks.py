"""Marks on the sliders of joints: where each is at the moment that is shown, and why it is not where it should be."""

from asyncio import wrap_future
from collections.abc import Mapping, Sequence
from math import degrees, inf

from nicegui import background_tasks, context, ui

from simrob_drake.teach.pages import plots
from simrob_drake.teach.pages.elements import Dial, follow
from simrob_drake.teach.pages.phrases import Content, Phrases, figure
from simrob_drake.teach.session import Session
from simrob_drake.teach.shortfall import shortfall

_SIGNALS = ("reference", "position", "torque")
_BEFORE = 0.05
"""From a moment to the one before, by which it is told how fast a joint moves [s]."""
_FORCES = {"deg": "N·m", "m": "N"}


def signal_of(session: Session, kind: str) -> str:
    """Return the signal of a kind of the robot that a session teaches; empty without one."""
    names = [signal["name"] for signal in session.description.get("signals", ())]
    return next((name for name in (f"{session.book.robot}.{kind}", kind) if name in names), "")


def shown_at(session: Session, kind: str, before: float = 0.0) -> Sequence[float] | None:
    """Return a signal of the taught robot at the moment that is shown, or so long before [s]; None where not kept."""
    ring = session.run.history.get(signal_of(session, kind), ())
    found = plots.at(ring, session.run.time - before) if session.run.time else None
    return None if found is None else plots.as_list(found)


class Marks:
    """Of all joints of the robot that is taught."""

    def __init__(
        self, session: Session, phrases: Phrases, axes: Sequence[Content], dials: Mapping[str, Dial], place: ui.element
    ) -> None:
        """Mark dials of axes by their names, as long as an element of the page is there."""
        self._session, self._phrases, self._axes, self._dials = session, phrases, axes, dials
        self._limits: Sequence[float] = [inf] * len(axes)
        self._client = context.client
        plots.watch(session, [name for kind in _SIGNALS if (name := signal_of(session, kind))], place)
        follow(session, self._ask, "program", "description", "phase")
        follow(session, self._show, "tick", "phase")

    def _ask(self) -> None:
        if self._session.description and self._session.phase in ("idle", "running", "paused"):
            background_tasks.create(self._asked())

    async def _asked(self) -> None:
        """Ask what the drives can do, which changes with settings, also while something runs."""
        limits = await wrap_future(self._session.setup.torque_limits())
        if limits and not self._client.is_deleted:
            self._limits = limits if self._session.book.config.mode == "dynamic" else [inf] * len(limits)
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
            runs_on = gap.reason == "moving" or (gap.reason == "gains" and self._session.phase == "running")
            why = "" if runs_on else self._why(axis, gap.reason, where, gap.off, torque, self._limits[number])
            self._dials[axis["name"]].mark(where, gap.level, why)

    def _why(self, axis: Content, reason: str, done: float, off: float, torque: float, limit: float) -> str:
        if not reason:
            return ""
        unit, force = self._phrases.unit(axis["name"]), _FORCES[axis["unit"]]
        digits = 1 if axis["unit"] == "deg" else 4
        lengths = {name: f"{figure(round(value, digits))}{unit}" for name, value in (("done", done), ("off", abs(off)))}
        forces = {"torque": figure(round(abs(torque), 2)), "limit": f"{figure(limit)} {force}"}
        return self._phrases.t(f"shortfall.{reason}", **lengths, **forces)
