"""A pad over the view that drives a walk by keys, a gamepad or a finger, and tells what is asked for and done."""

from collections.abc import Sequence
from math import atan2, cos, degrees, pi, radians, sin
from typing import Any

from nicegui import context, ui

from simrob_drake.extensions.pendant.pages import plots
from simrob_drake.extensions.pendant.pages.elements import allow, follow, icon_button, set_label
from simrob_drake.extensions.pendant.pages.joints import signal_of
from simrob_drake.extensions.pendant.pages.words import Words
from simrob_drake.extensions.pendant.session import Session

_POSE = "base_pose"
_BEFORE = 1.0  # over how long the speed of a robot that sways is told [s]
_SIDEWAYS = (("chevron_left", "left", "KeyQ"), ("chevron_right", "right", "KeyE"))


def build(session: Session, t: Words) -> None:
    """Build the button that begins a drive, which only robots have that can, and the pad, which is there meanwhile."""
    client, driving = context.client, session.driving
    with ui.element("div").classes("pendant-driver").props("role=group tabindex=0") as pad:
        set_label(pad, t("drive.pad"))
        with ui.element("div").classes("pendant-stick").props("aria-hidden=true"):
            ui.element("div").classes("pendant-knob")
        with ui.element("div").classes("pendant-driven"):
            asked, done, clock = (ui.label() for _ in range(3))
            with ui.row().classes("items-center gap-1 no-wrap"):
                sides = [icon_button(icon, t(f"drive.{name}")) for icon, name, _ in _SIDEWAYS]
                icon_button("stop_circle", t("drive.end"), lambda: driving.end(client.id))
            ui.label(t("drive.hint")).classes("pendant-drive-hint")
    for side, (_, _, key) in zip(sides, _SIDEWAYS, strict=True):
        side.props(f"data-key={key} tabindex=-1")
    pad.on(
        "steer", lambda event: driving.command(client.id, *event.args["detail"]), args=["detail"]
    )
    button = icon_button("sports_esports", t("drive.begin"), keys="Shift+D", t=t).classes(
        "pendant-drive"
    )
    client.on_disconnect(lambda: driving.end(client.id))

    watched = ""

    def show() -> None:
        nonlocal watched
        if watched != (watched := signal_of(session, _POSE)):
            # Until a station is loaded, and for a robot without a free base, there is no such signal.
            plots.watch(session, [watched] if watched else [], pad)
        limits, mine = driving.limits, driving.driver == client.id
        button.set_visibility(limits is not None and not mine)
        allow(button, "" if driving.driver is None else t("notice.driven"))
        if mine and not pad.visible:
            ui.run_javascript(f"getHtmlElement({pad.id}).focus()")
        pad.set_visibility(mine)
        for side in sides:
            side.set_visibility(bool(limits and limits["sideways"]))
        if mine:
            tell(limits or {})

    def tell(limits: dict[str, float]) -> None:
        asked.text = t("drive.asked", **_words(t, driving.asked))
        speeds = _speeds(
            session.run.history.get(signal_of(session, _POSE), ()),
            radians(limits.get("facing_deg", 0.0)),
        )
        done.text = t("drive.done", **_words(t, speeds))
        clock.text = (
            t("run.ratio", ratio=t.decimals(session.run.ratio, 1))
            + f"  {t.decimals(session.run.time, 2)} s"
        )

    button.on_click(lambda: driving.begin(client.id))
    follow(session, show, "description", "phase", "tick")
    ui.run_javascript(f"window.drivePad(getHtmlElement({pad.id}))")


def _words(t: Words, speeds: Sequence[float]) -> dict[str, str]:
    digits = {"ahead": 2, "left": 2, "turn": 0}
    return {
        name: t.decimals(round(value, digits[name]) + 0.0, digits[name])
        for name, value in zip(digits, speeds, strict=True)
    }


def _speeds(poses: Any, facing: float) -> tuple[float, float, float]:
    """Return how fast a base went of late, by its times [s] and poses: ahead, to the left [m/s], turn [deg/s]."""
    if not poses:
        return 0.0, 0.0, 0.0
    end, now = poses[-1]
    begin, before = next(row for row in poses if row[0] >= end - _BEFORE)
    if end <= begin:
        return 0.0, 0.0, 0.0
    time, (x, y) = end - begin, (now[axis] - before[axis] for axis in (0, 1))
    turned = (_yaw(now) - _yaw(before) + pi) % (2 * pi) - pi
    heading = _yaw(before) + turned / 2 + facing
    ahead, left = x * cos(heading) + y * sin(heading), y * cos(heading) - x * sin(heading)
    return ahead / time, left / time, degrees(turned) / time


def _yaw(pose: Sequence[float]) -> float:
    *_, w, x, y, z = pose
    return atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
