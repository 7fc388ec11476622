"""The taught targets of an arm: kept under a name, gone to again, and forgotten."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from nicegui import ui

from simrob_drake.teach.pages.arm_words import WORLD, frame_words, pose_words, work_objects
from simrob_drake.teach.pages.buttons import KEYS, icon_button
from simrob_drake.teach.pages.following import follow
from simrob_drake.teach.pages.whereabouts import Whereabouts
from simrob_drake.teach.pages.words import Words
from simrob_drake.teach.session import Session


def build(session: Session, t: Words, place: Whereabouts) -> None:
    """Build the list, and above it what teaches another one where the arm is."""

    def teach() -> None:
        session.teach_target((name.value or "").strip() or None, frame.value or WORLD)
        name.value = ""

    def frames() -> None:
        known = work_objects(place.told["frames"])
        frame.set_options(frame_words(t, known), value=frame.value if frame.value in known else WORLD)

    with ui.row().classes("w-full items-center gap-2"):
        name = ui.input(t("arm.name")).props("dense outlined clearable").classes("grow").style("min-width: 7rem")
        name.on("keydown.enter", teach)
        frame = ui.select({WORLD: t("arm.frame_world")}, value=WORLD, label=t("arm.goes_with"), with_input=True)
        frame.props("dense outlined options-dense").classes("grow").style("min-width: 8rem")
        ui.button(t("arm.teach"), icon="add_location", on_click=teach).props("no-caps").props[KEYS] = "Alt+T"
    found = ui.element("ul").classes("w-full p-0 m-0").style("list-style: none")
    shown: list[Any] = []

    def show() -> None:
        if shown == [session.targets]:
            return
        shown[:] = [dict(session.targets)]
        found.clear()
        with found:
            for target, taught in session.targets.items():
                _target(session, t, target, taught)
            if not session.targets:
                ui.label(t("arm.no_targets")).classes("opacity-70 py-1")

    place.heard(frames)
    follow(session, show, "program")


def _target(session: Session, t: Words, name: str, taught: Mapping[str, Any]) -> None:
    frame = taught["frame"]
    told = [pose_words(taught["pose"]), "" if frame == WORLD else t("arm.in_frame", frame=frame), taught["tool"]]
    with ui.element("li").classes("w-full"), ui.row().classes("w-full items-center gap-2 no-wrap"):
        ui.label(name).classes("font-medium").style("min-width: 3rem; overflow-wrap: anywhere")
        ui.label(" · ".join(filter(None, told))).classes("grow text-sm")
        icon_button("near_me", t("arm.go_to", name=name), partial(session.jog_axes, taught["axes"]))
        icon_button("call_split", t("arm.branches_of", name=name), partial(session.branches, name))
        icon_button("delete", t("arm.forget", name=name), partial(session.remove_target, name))
