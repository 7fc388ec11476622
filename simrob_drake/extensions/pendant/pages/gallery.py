"""The gallery of robots and stations, behind one button of the page, and found by a search."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

from nicegui import ui
from nicegui.events import MultiUploadEventArguments

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.files import robot_files
from simrob_drake.extensions.pendant.own_files import MOST
from simrob_drake.extensions.pendant.pages.elements import follow, set_keys, set_label
from simrob_drake.extensions.pendant.pages.words import Words, matches
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.robots.catalog import load_robot, robot_names
from simrob_drake.stations.load import station_names

Files = dict[str, bytes]  # by their names
PICTURE = "picture.png"
"""File with the picture of a robot, in its folder."""
PICTURES = "pictures"
"""Path below which the server has the pictures of robots by their names. NiceGUI's own images of files would be gone as
soon as any tab is closed."""


def build(
    session: Session, t: Words, load: Callable[[str], object], take: Callable[[Files], object]
) -> None:
    """Build the button in the present place, and what it opens.

    ``load`` loads another robot or station, ``take`` files of the user's own.
    """
    uploads = _uploads(t, take)
    with ui.dialog() as dialog, ui.card().classes("pendant-gallery"):
        set_label(dialog, t("shell.robots"))
        ui.html(t("shell.robots"), tag="h2", sanitize=False).classes("pendant-heading")
        search = ui.input(t("shell.search")).props("autofocus clearable dense outlined")
        search.classes("w-full")
        with ui.element("div").classes("pendant-robots"):
            pictures = {name: _picture(name, load) for name in _robots()}
        with ui.row().classes("gap-1") as stations:
            names = {name: _station(name, load) for name in station_names()}
        set_label(stations.props("role=group"), t("shell.stations"))
        nothing = ui.label(t("shell.not_found"))
        own = ui.button(t("shell.own_files"), icon="upload_file").props("outline no-caps")
        own.on("click", js_handler=f"() => getElement({uploads.id}).$refs.qRef.pickFiles()")
        ui.label(t("shell.own_files_help")).classes("text-sm opacity-70")
    set_keys(
        ui.button(t("shell.robots"), icon="apps", on_click=dialog.open).props("flat dense no-caps"),
        "Alt+G",
    )

    entries = [*pictures.items(), *names.items()]

    def find() -> None:
        for name, entry in entries:
            entry.set_visibility(matches(search.value or "", [name]))
        nothing.set_visibility(not any(entry.visible for _, entry in entries))

    def mark() -> None:
        models = {robot["model"] for robot in session.description.get("robots", {}).values()}
        for own, marked in ((pictures, models), (names, {session.book.station})):
            for name, entry in own.items():
                entry.props["aria-pressed"] = "true" if name in marked else "false"

    def load_first() -> None:
        """Load the first entry that the search shows, as Enter does in other search fields."""
        first = next((name for name, entry in entries if entry.visible), None)
        if search.value and first is not None:
            load(first)

    search.on_value_change(find)
    search.on("keydown.enter", load_first)
    find()
    follow(session, mark, "description")


def _uploads(t: Words, take: Callable[[Files], object]) -> ui.upload:
    """Build what takes files that are dropped on the page or chosen; it is not seen itself."""

    async def received(event: MultiUploadEventArguments) -> None:
        take({file.name: await file.read() for file in event.files})
        uploads.reset()

    def refused() -> None:
        ui.notify(t("shell.own_files_large", size=f"{MOST // 1_000_000}"), type="negative")

    uploads = ui.upload(
        multiple=True,
        auto_upload=True,
        max_total_size=MOST,
        on_multi_upload=received,
        on_rejected=refused,
    )
    return uploads.classes("pendant-own")


@cache
def _robots() -> list[str]:
    """Return the robots of this package and of extensions, those with legs first."""
    return sorted(robot_names(), key=_has_no_feet)


def _has_no_feet(name: str) -> bool:
    """Whether a robot has no feet. One of an extension that cannot be loaded has none; its button shows the reason."""
    try:
        return load_robot(name).feet is None
    except SimrobError:
        return True


def picture_file(robot: str) -> Path | None:
    """Return the file with the picture of a robot. None if there is no such robot, or it has no picture."""
    description = robot_files().get(robot)
    picture = None if description is None else description.with_name(PICTURE)
    return picture if picture is not None and picture.is_file() else None


def _picture(name: str, load: Callable[[str], object]) -> ui.element:
    """Build the button of a robot: its picture, or a sign if it has none, and its name."""
    button = ui.element("button").classes("pendant-robot").props("type=button")
    button.on("click", lambda: load(name))
    with button:
        if picture_file(name) is None:
            ui.icon("smart_toy").classes("pendant-robot-sign")
        else:
            ui.element("img").props(f"src={PICTURES}/{name} alt=''")
        ui.label(name.replace("_", " "))
    return button


def _station(name: str, load: Callable[[str], object]) -> ui.element:
    return (
        ui.button(name.replace("_", " "), on_click=lambda: load(name))
        .props("outline dense no-caps")
        .classes("px-2")
    )
