"""Where an arm can go: targets that were taught, and the postures for a pose, which the view shows as ghosts."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from nicegui import ui

from simrob_drake.teach.pages.arm_jogging import ArmState
from simrob_drake.teach.pages.elements import KEYS, icon_button, rebuild
from simrob_drake.teach.pages.words import (
    MILLI,
    WORLD,
    Phrases,
    Words,
    figure,
    frame_words,
    joint_words,
    pose_words,
    work_objects,
)
from simrob_drake.teach.session import Session


def build_teaching(session: Session, t: Words, place: ArmState) -> None:
    """Build what teaches a target where the arm is."""

    def teach() -> None:
        session.arm.teach_target((name.value or "").strip() or None, frame.value or WORLD)
        name.value = ""

    def frames() -> None:
        known = work_objects(place.values["frames"])
        frame.set_options(frame_words(t, known), value=frame.value if frame.value in known else WORLD)

    with ui.row().classes("w-full items-center gap-2"):
        name = ui.input(t("arm.name")).props("dense outlined clearable").classes("grow").style("min-width: 7rem")
        name.on("keydown.enter", teach)
        frame = ui.select({WORLD: t("arm.frame_world")}, value=WORLD, label=t("arm.goes_with"), with_input=True)
        frame.props("dense outlined options-dense").classes("grow").style("min-width: 8rem")
        ui.button(t("arm.teach"), icon="add_location", on_click=teach).props("no-caps").props[KEYS] = "Alt+T"
    place.subscribe(frames)


def build_targets(session: Session, t: Words) -> None:
    """Build the list of targets."""

    def show() -> None:
        with ui.element("ul").classes("w-full p-0 m-0").style("list-style: none"):
            for target, taught in session.book.targets.items():
                _target(session, t, target, taught)
        if not session.book.targets:
            ui.label(t("arm.no_targets")).classes("opacity-70 py-1")

    rebuild(session, lambda: dict(session.book.targets), show, "program")


def _target(session: Session, t: Words, name: str, taught: Mapping[str, Any]) -> None:
    frame = taught["frame"]
    parts = [pose_words(taught["pose"]), "" if frame == WORLD else t("arm.in_frame", frame=frame), taught["tool"]]
    with ui.element("li").classes("w-full"), ui.row().classes("w-full items-center gap-2 no-wrap"):
        ui.label(name).classes("font-medium").style("min-width: 3rem; overflow-wrap: anywhere")
        ui.label(" · ".join(filter(None, parts))).classes("grow text-sm")
        icon_button("near_me", t("arm.go_to", name=name), partial(session.arm.jog_axes, taught["axes"]))
        icon_button("call_split", t("arm.branches_of", name=name), partial(session.arm.branches, name))
        icon_button("delete", t("arm.forget", name=name), partial(session.arm.remove_target, name))


def build_branches(session: Session, phrases: Phrases) -> None:
    """Build the list of the branches that the session found last."""
    t = phrases.t
    with ui.row().classes("w-full items-center gap-2"):
        ui.button(t("arm.branches"), icon="call_split", on_click=partial(session.arm.branches, None)).props("no-caps")
        hide = ui.button(t("arm.hide"), on_click=session.arm.hide_ghosts).props("flat no-caps")

    def show() -> None:
        hide.set_visibility(bool(session.arm.ghosts))
        with ui.element("ol").classes("w-full p-0 m-0").style("list-style: none; max-height: 22rem; overflow-y: auto"):
            for number, branch in enumerate(session.arm.ghosts):
                _branch(session, phrases, number, branch)

    rebuild(session, lambda: list(session.arm.ghosts), show, "program")


def _branch(session: Session, phrases: Phrases, number: int, branch: Mapping[str, Any]) -> None:
    """Build the entry of one."""
    t, usable = phrases.t, branch["usable"]
    icon, colour, text = ("check", "positive", "usable") if usable else ("block", "negative", "not_usable")
    with ui.element("li").classes("w-full py-1").style("border-top: 1px solid var(--line)") as entry:
        for event in ("mouseenter", "focusin"):
            entry.on(event, partial(session.arm.mark_branch, number))
        entry.on("mouseleave", partial(session.arm.mark_branch, None))
        with ui.row().classes("w-full items-center gap-2 no-wrap"):
            ui.icon(icon, color=colour, size="1.4rem").props("aria-hidden=true")
            ui.label(t(f"arm.{text}", number=number + 1)).classes("font-medium")
            axes = "  ".join(_position(phrases, axis, value) for axis, value in branch["axes"].items())
            ui.label(axes).classes("grow tabular-nums")
            button = ui.button(t("arm.choose"), on_click=partial(session.arm.choose_branch, number))
            button.props(f'outline dense no-caps aria-label="{t("arm.choose_branch", number=number + 1)}"')
            button.set_enabled(usable)
        parts = (_load(phrases, branch), _room(phrases, branch), _gap(phrases, branch))
        ui.label(" · ".join(parts)).classes("text-sm")


def _load(phrases: Phrases, branch: Mapping[str, Any]) -> str:
    axis = branch["load"]["axis"]
    share, torque, limit = 100 * branch["load"]["share"], abs(branch["torque"][axis]), branch["limit"][axis]
    numbers = {"share": f"{share:.0f}", "torque": figure(round(torque, 2)), "limit": figure(limit)}
    return phrases.t("arm.load", axis=joint_words(phrases, axis), **numbers)


def _room(phrases: Phrases, branch: Mapping[str, Any]) -> str:
    left, axis = branch["room"]["left"], branch["room"]["axis"]
    key = "arm.room" if left >= 0 else "arm.beyond_by"
    return phrases.t(key, left=_position(phrases, axis, abs(left)), axis=joint_words(phrases, axis))


def _gap(phrases: Phrases, branch: Mapping[str, Any]) -> str:
    if branch["gap"] is None:
        return phrases.t("arm.no_gap")
    (first, second), distance = branch["gap"]["between"], round(branch["gap"]["distance"] / MILLI)
    key = "arm.inside" if distance < 0 else "arm.gap"
    things = {"first": first.replace("_", " "), "other": second.replace("_", " ")}
    return phrases.t(key, distance=figure(distance), depth=figure(-distance), **things)


def _position(phrases: Phrases, axis: str, value: float) -> str:
    digits = 1 if phrases.unit(axis) == "°" else 3
    return f"{figure(round(value, digits))}{phrases.unit(axis)}"
