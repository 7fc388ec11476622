"""The robots and stations to choose from, in pictures, with the loaded one marked."""

from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from simrob_drake.paths import models_root
from simrob_drake.robots.catalog import robot_names
from simrob_drake.stations.load import station_names
from simrob_drake.teach.pages.buttons import told
from simrob_drake.teach.pages.following import follow
from simrob_drake.teach.pages.words import Words
from simrob_drake.teach.session import Session

PICTURE = "picture.png"
"""Of a robot, in its folder."""


def build(session: Session, t: Words, load: Callable[[str | Path], None]) -> None:
    """Build the pictures of the robots, and the list of stations.

    Args:
        session: whose robots are marked.
        t: the words.
        load: loads another robot or station.
    """
    with ui.element("nav").classes("pendant-robots") as nav:
        told(nav, t("shell.robots"))
        pictures = {name: _picture(name, load) for name in robot_names() if _file(name).is_file()}
        stations = ui.select(station_names(), label=t("shell.station"), with_input=True).props("dense outlined")
        stations.style("min-width: 13rem; align-self: center").on_value_change(lambda event: _chosen(event.value))

    def _chosen(name: str | None) -> None:
        if name and name != session.station:
            load(name)

    def mark() -> None:
        models = {robot["model"] for robot in session.description.get("robots", {}).values()}
        for name, picture in pictures.items():
            picture.props["aria-pressed"] = "true" if name in models else "false"
            picture.update()
        stations.set_value(session.station if session.station in station_names() else None)

    follow(session, mark, "description")


def _picture(name: str, load: Callable[[str | Path], None]) -> ui.element:
    button = ui.element("button").classes("pendant-robot").props("type=button")
    button.on("click", lambda: load(name))
    with button:
        ui.image(_file(name)).props("no-spinner no-transition alt='' fit=contain").style("height: 80px")
        ui.label(name)
    return button


def _file(name: str) -> Path:
    return models_root() / name / PICTURE
