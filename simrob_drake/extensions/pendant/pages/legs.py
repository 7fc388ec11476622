"""The page of a robot with legs, in the order of use: joints, a test, the program, a run of it."""

from asyncio import wrap_future
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import degrees
from typing import Any

from nicegui import ui

from simrob_drake.base.errors import SimrobError
from simrob_drake.extensions.pendant.pages import plots
from simrob_drake.extensions.pendant.pages.elements import (
    allow,
    card,
    folded,
    follow,
    icon_button,
    numbered,
    rebuild,
    set_keys,
    set_label,
)
from simrob_drake.extensions.pendant.pages.joints import Joints, Marks, shown_at
from simrob_drake.extensions.pendant.pages.move_forms import choices_of, duration_field, offers
from simrob_drake.extensions.pendant.pages.move_list import MoveList
from simrob_drake.extensions.pendant.pages.words import Content, Phrases, Words
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.programs.moves.kinds import KINDS


def build(session: Session, t: Words) -> None:
    """Build the page of a session's robot in the present place; it is built anew for another robot."""

    def robot() -> Content:
        found: Content = session.description.get("robots", {}).get(session.book.robot, {})
        return found

    def state() -> list[Any]:
        axes = [
            {key: value for key, value in axis.items() if key != "now"}
            for axis in robot().get("axes", ())
        ]
        loops = [loop["name"] for loop in session.description.get("loops", ())]
        return [{**robot(), "axes": axes}, loops, session.description.get("pieces")]

    def show() -> None:
        if robot().get("kind") == "legs" and robot()["axes"]:
            _build(session, t, robot())
        else:
            ui.label(t("legs.none"))

    rebuild(session, state, show, "description")


def _build(session: Session, t: Words, robot: Content) -> None:
    phrases = Phrases(t, robot["axes"])
    _Teaching(session, phrases, robot)
    with card(t("legs.program")):
        MoveList(session, phrases, robot)
    with card(t("legs.motions")):
        _button(t("legs.step"), session.step, keys="Alt+P")
        offers(
            session,
            phrases,
            choices_of(session, robot),
            [kind for kind in KINDS.values() if kind.of_legs],
        )
    if session.description.get("loops"):
        with card(t("legs.loops")):
            _loops(session, phrases)
    _plots(session, phrases)


def _plots(session: Session, phrases: Phrases) -> None:
    """Build the plots, which are there while their place is open, and anew where there are other signals."""

    def names() -> list[Any]:
        return list(session.description.get("signals", ())) if expansion.value else []

    def show() -> None:
        if names():
            moves = [*session.book.pending, *(move.entry() for move in session.book.program.moves)]
            moved = {phrases.plain(axis) for move in moves for axis in move.get("target_deg", ())}
            plots.build(session, phrases.t, moved)

    with folded(phrases.t("legs.plots")) as expansion:
        expansion.on_value_change(rebuild(session, names, show, "description"))


class _Teaching:
    """The joints and the buttons, numbered in the order of use."""

    def __init__(self, session: Session, phrases: Phrases, robot: Content) -> None:
        self._session, self._phrases, t = session, phrases, phrases.t
        with card(t("legs.joints"), 1) as plate:
            self._joints = Joints(phrases, robot["axes"], changed=self._tell, entered=self._test)
            self._overruled = ui.label().classes("text-sm text-warning")
            self._chosen = ui.label().classes("text-sm").props("aria-live=polite")
            self._tested = ui.label().classes("text-sm").props("aria-live=polite")
            with ui.row().classes("w-full items-center gap-2"):
                self._duration = duration_field(t)
                self._duration.field.classes("w-24")
                # what the field shows until the user sets another duration
                self._suggested = self._duration.value
                _button(t("legs.test"), self._test, 2, "Alt+T")
                self._add = _button(t("legs.add"), session.add, 3, "Alt+A")
                _button(t("legs.simulate"), session.simulate, 4, "Alt+S")
                _button(t("legs.discard"), lambda: self._back(session.discard), keys="Alt+X").props(
                    "outline"
                )
                _button(t("legs.reset"), lambda: self._back(session.reset), keys="Alt+R").props(
                    "outline"
                )
        self._axes = robot["axes"]
        Marks(session, phrases, self._axes, self._joints.dials, plate)
        follow(session, self._tell, "program")
        follow(session, self._show_overruled, "description")
        follow(session, self._show_where, "phase", "tick")
        follow(session, lambda: self._joints.set(session.hand.asked), "hand")

    def _show_overruled(self) -> None:
        """Say above the buttons that an outer loop, such as a walk, sets all joints, if one does."""
        loop = self._session.book.overruling_loop()
        self._overruled.set_visibility(bool(loop))
        if loop:
            self._overruled.text = self._phrases.t("legs.overruled", loop=self._phrases.name(loop))

    def _test(self) -> None:
        """Test what is set, or once more what was tested last, in the time that is given now."""
        seconds = self._duration.needed()
        if seconds is None or self._joints.refuse_wrong():
            return
        last = self._session.book.pending[-1] if self._session.book.pending else {}
        targets = self._joints.targets or last.get("target_deg", {})
        if not targets:
            ui.notify(self._phrases.t("legs.choose"))
            return

        ending = self._session.test(targets, seconds)
        self._joints.settle()
        ending.add_done_callback(lambda ended: self._restore(targets, ended.result()))
        self._tell()

    def _suggest_duration(self) -> None:
        """Show a duration that the servos can follow, unless the user has set one or a tested move waits."""
        if (
            self._duration.value != self._suggested
            or self._session.book.pending
            or not self._joints.targets
        ):
            return
        asked = shown_at(self._session, "reference")
        with suppress(SimrobError):  # a target beyond its limits is refused when the move is tested
            self._suggested = self._session.suggest_duration(self._joints.targets, asked)
            self._duration.field.value = self._suggested

    def _restore(self, targets: dict[str, float], ended: dict[str, Any] | None) -> None:
        """Set the targets again of a test that was refused or fell, to be set otherwise and tested again."""
        moves = self._session.book.pending
        refused = ended is None and not (
            moves and targets.items() <= moves[-1].get("target_deg", {}).items()
        )
        if refused or (ended and not ended["goes_on"] and ended["ending"] != "stopped"):
            self._joints.restore(targets)

    def _back(self, how: Callable[[], object]) -> None:
        self._joints.forget()
        self._tell()
        how()

    def _show_where(self) -> None:
        """Show what the joints are asked for that the user has not set, while nothing runs."""
        session = self._session
        if session.phase == "running":
            return
        asked = shown_at(session, "reference")
        if asked is not None or not session.run.time:
            shown = [axis["now"] for axis in self._axes] if asked is None else asked
            turns = [asked is not None and axis["unit"] == "deg" for axis in self._axes]
            values = [
                degrees(value) if turn else value for turn, value in zip(turns, shown, strict=True)
            ]
            self._joints.follow(
                {axis["name"]: value for axis, value in zip(self._axes, values, strict=True)}
            )

    def _tell(self) -> None:
        """Say what would be tested, and what was."""
        t, phrases = self._phrases.t, self._phrases
        self._session.hand.lean(self._joints.targets)
        axes = ", ".join(
            phrases.target(axis, value) for axis, value in self._joints.targets.items()
        )
        self._chosen.text = t("legs.chosen", axes=axes) if axes else t("legs.choose")
        self._suggest_duration()
        moves = "; ".join(phrases.move(move) for move in self._session.book.pending)
        self._tested.text = t("legs.tested", moves=moves) if moves else ""
        allow(self._add, "" if moves else t("notice.nothing_tested"))


def _loops(session: Session, phrases: Phrases) -> None:
    """Build a switch for each loop around the servos; the station is opened anew when one is switched."""

    def on() -> dict[str, bool]:
        return {loop["name"]: loop["on"] for loop in session.description.get("loops", ())}

    def switch(name: str, value: bool) -> None:
        if value != on().get(name, value) and not session.setup.switch_loop(name, value):
            show()

    def show() -> None:
        for name, value in on().items():
            switches[name].value = value

    async def explain(name: str) -> None:
        picture = await wrap_future(session.setup.loop_picture(name, phrases.t.language))
        if picture:
            with ui.dialog(value=True) as dialog, ui.card().style("max-width: min(95vw, 70rem)"):
                set_label(dialog, phrases.t("legs.how", loop=phrases.name(name)))
                ui.html(phrases.name(name), tag="h2", sanitize=False).classes("pendant-heading")
                ui.label(phrases.loop(name))
                ui.html(picture, sanitize=False).classes("w-full overflow-x-auto")
                ui.button(phrases.t("shell.close"), on_click=dialog.close)
            dialog.on("hide", dialog.delete)

    switches = dict[str, ui.switch]()
    for name, value in on().items():
        with ui.row().classes("w-full items-center gap-x-3 gap-y-0"):
            switches[name] = ui.switch(phrases.name(name), value=value)
            ui.label(phrases.loop(name)).classes("text-sm opacity-70 min-w-0 grow").style(
                "flex-basis: 14rem"
            )
            icon_button(
                "schema", phrases.t("legs.how", loop=phrases.name(name)), partial(explain, name)
            )
    for name, element in switches.items():
        element.on_value_change(lambda event, name=name: switch(name, event.value))
    follow(session, show, "description")


def _button(
    text: str, on_click: Callable[[], object], number: int = 0, keys: str = ""
) -> ui.button:
    """Build a button; ``number`` is its place in the order of use, ``keys`` press it."""
    button = ui.button(numbered(text, number), on_click=on_click).props("no-caps")
    if keys:
        set_keys(button, keys)
        button.tooltip(keys)
    return button
