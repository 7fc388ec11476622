"""Jog an arm: its joints between their limits, and its tool around where it is, along the axes of a frame."""

from __future__ import annotations

from asyncio import sleep, wrap_future
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any

from nicegui import background_tasks, context, ui

from simrob_drake.extensions.pendant.pages.elements import (
    Dial,
    NumberField,
    follow,
    set_keys,
    set_label,
)
from simrob_drake.extensions.pendant.pages.joints import Marks, axis_dial
from simrob_drake.extensions.pendant.pages.words import MILLI, Phrases, frame_words, joint_words
from simrob_drake.extensions.pendant.run import level_of
from simrob_drake.extensions.pendant.session import Session

WAY, TURN = 100.0, 30.0
"""How far the sliders of the tool go to either side unless it is changed [mm, deg]; LimPos and LimRot of SimRob."""

_WAYS, _TURNS = ("x", "y", "z"), ("Rz", "Ry", "Rx")
_SAME = 1e-6  # m or deg
_DIGITS = 3  # behind the point, of mm and degrees
_QUIET = 0.4  # s without a jog until the sliders show where the arm is: more may be on the way


class Jogging:
    """Sliders that move the arm while they are moved; where the arm goes by other means, they follow."""

    def __init__(
        self, session: Session, phrases: Phrases, axes: list[Mapping[str, Any]], place: ArmState
    ) -> None:
        """Build the sliders."""
        self._session, self._t, self._place = session, phrases.t, place
        self._awaited, self._by_tool = 0, False
        self._at: list[float] = []  # pose in the base
        self._middle = self._at
        with ui.tabs().props("dense align=left").classes("w-full") as kinds:
            set_keys(ui.tab("joints", label=self._t("arm.joints")), "Alt+J")
            set_keys(ui.tab("tool", label=self._t("arm.tool_centre")), "Alt+K")
        with ui.tab_panels(kinds, value="joints", animated=False).classes("w-full bg-transparent"):
            with ui.tab_panel("joints").classes("p-0 gap-1"):
                self._joints = {axis["name"]: self._joint(phrases, axis) for axis in axes}
            Marks(session, phrases, axes, self._joints, kinds)
            with ui.tab_panel("tool").classes("p-0 gap-1"):
                self._build_tool()
        self._off = ui.label().classes("text-sm pendant-off").props("aria-live=polite")
        self._distance_off = 0.0  # of the tool from where it should be [m]
        self._turn_off = 0.0  # the same of its direction [deg]
        place.subscribe(self._follow)
        # The verdict on a run may come after the question where the tool is.
        follow(session, self._show_off, "message")

    def _joint(self, phrases: Phrases, axis: Mapping[str, Any]) -> Dial:
        name, words = axis["name"], joint_words(phrases, axis["name"]).capitalize()
        return axis_dial(phrases, axis, words, live=True, moved=lambda: self._jog_joint(name))

    def _build_tool(self) -> None:
        t = self._t
        with ui.row().classes("w-full items-center gap-2"):
            self._frame = ui.select(["base"], value="base", label=t("arm.frame"), with_input=True)
            self._frame.props("dense outlined options-dense").classes("grow").style(
                "min-width: 9rem"
            )
            self._frame.on_value_change(self._reframe)
            self._way, self._turn = (
                ui.number(
                    t("arm.range"),
                    value=value,
                    min=low,
                    max=high,
                    suffix=unit,
                    on_change=self._range,
                )
                for value, low, high, unit in ((WAY, 1, 2000, "mm"), (TURN, 1, 180, "°"))
            )
            for field, name in ((self._way, "range_mm"), (self._turn, "range_deg")):
                field.props(
                    f'dense outlined prefix="±" debounce=600 aria-label="{t(f"arm.{name}")}"'
                ).classes("w-28")
            ui.button(t("arm.centre"), icon="filter_center_focus", on_click=self._recentre).props(
                "flat dense no-caps"
            )
        self._dials = [
            Dial(t, name, low=-far, high=far, unit=unit, live=True, moved=self._jog_tool)
            for names, far, unit in ((_WAYS, WAY, " mm"), (_TURNS, TURN, "°"))
            for name in names
        ]
        with ui.row().classes("w-full gap-1").props("role=group") as pose:
            set_label(pose, t("arm.pose"))
            self._pose = [
                NumberField(t, name, 0.0, unit=unit)
                for names, unit in ((_WAYS, " mm"), (_TURNS, "°"))
                for name in names
            ]
        for one, name in zip(self._pose, (*_WAYS, *_TURNS), strict=True):
            # else it would be called as the slider above
            set_label(one.field, f"{name}: {t('arm.pose')}")
            one.field.classes("grow tabular-nums").style("flex: 1 1 30%").on(
                "keydown.enter", self._go
            )

    def _range(self) -> None:
        for number, dial in enumerate(self._dials):
            far = (self._way if number < len(_WAYS) else self._turn).value
            if far:
                dial.between(-far, far)

    def _reframe(self) -> None:
        if self._frame.value and self._frame.value != self._place.frame:
            self._place.frame = self._frame.value
            self._recentre()
            self._place.ask()

    def _jog_joint(self, name: str) -> None:
        self._by_tool, value = False, self._joints[name].value
        if value is not None:
            self._await(self._session.arm.jog_axes({name: value}))

    def _jog_tool(self) -> None:
        self._by_tool = True
        held = [value for dial in self._dials if (value := dial.value) is not None]
        if len(held) == len(self._dials):
            self._await(
                self._session.arm.jog_tool(_in_metres(held), self._place.frame, start=self._middle)
            )

    def _go(self) -> None:
        """Go to the pose that was typed."""
        held = [value for one in self._pose if (value := one.needed()) is not None]
        if len(held) == len(self._pose):
            self._by_tool = False
            self._await(self._session.arm.jog_pose(_in_metres(held), self._place.frame))

    def _await(self, jog: Future[Any]) -> None:
        background_tasks.create(self._went(jog))

    async def _went(self, jog: Future[Any]) -> None:
        """Wait for a jog, and look where the last of several led."""
        self._awaited += 1
        try:
            await wrap_future(jog)
            await sleep(_QUIET)
            if self._awaited == 1:
                await self._place.asked()
        finally:
            self._awaited -= 1

    def _follow(self) -> None:
        """Show where the arm is, unless it is on its way; the tool's sliders count anew where it got otherwise."""
        values = self._place.values
        self._frame.set_options(frame_words(self._t, values["frames"]), value=self._place.frame)
        for number, (one, value) in enumerate(zip(self._pose, values["pose"], strict=True)):
            one.field.value = round(value / MILLI if number < len(_WAYS) else value, _DIGITS) + 0.0
        self._distance_off, self._turn_off = values["off"]
        self._show_off()
        if self._awaited > 1:
            return
        for name, value in values["axes"].items():
            self._joints[name].show(value)
        before, self._at = self._at, values["base_pose"]
        stays = (
            before
            and max(abs(now - then) for now, then in zip(self._at, before, strict=True)) < _SAME
        )
        if not stays and not (self._awaited and self._by_tool):
            self._recentre()

    def _show_off(self) -> None:
        """Show how far the tool is from where it should be, if that can be seen.

        It is red only if the verdict on the run warns, so that the page does not alarm where all is within bounds.
        """
        distance = self._distance_off
        turn = self._turn_off
        levels = {level_of(distance, "m"), level_of(turn, "deg")} - {""}
        level = max(levels, default="")  # red comes after amber
        if level == "red" and self._session.message.severity not in ("warning", "failure"):
            level = "amber"
        figure = self._t.figure
        values = {"distance": figure(round(distance / MILLI, 1)), "turn": figure(round(turn, 1))}
        self._off.classes(replace=f"text-sm pendant-off {level}").set_text(
            self._t("shortfall.tool", **values) if level else ""
        )

    def _recentre(self) -> None:
        """Let the sliders of the tool count from where it is."""
        self._middle = self._at
        for dial in self._dials:
            dial.show(0.0)


def _in_metres(values: list[float]) -> list[float]:
    """Return a pose in m and degrees that is in mm and degrees."""
    return [value * MILLI if number < len(_WAYS) else value for number, value in enumerate(values)]


class ArmState:
    """What :func:`simrob_drake.extensions.pendant.arm_questions.where` says of the arm that is taught.

    Attributes:
        frame: in which the page wants its tool's pose.
        values: the last answer; empty until there is one.
    """

    def __init__(self, session: Session) -> None:
        """Ask, now and after each run."""
        self.frame = "base"
        self.values: dict[str, Any] = {}
        self._session, self._client = session, context.client
        self._callbacks: list[Callable[[], object]] = []
        follow(session, self.ask, "phase", "description")

    def subscribe(self, callback: Callable[[], object]) -> None:
        """Call something after each answer, which may have moved on since."""
        self._callbacks.append(callback)

    def ask(self) -> None:
        """Ask, unless the arm is on its way: it is asked when it stands."""
        if self._session.phase == "idle":
            background_tasks.create(self.asked())

    async def asked(self) -> None:
        """Ask, and wait until all who are to hear the answer have."""
        values = await wrap_future(self._session.arm.where(self.frame))
        if values and not self._client.is_deleted:
            self.values = values
            for callback in self._callbacks:
                callback()
