"""The robots and stations to choose from, in pictures, with the loaded one marked."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

from nicegui import ui

from simrob_drake.paths import models_root
from simrob_drake.robots.catalog import load_robot, robot_names
from simrob_drake.stations.load import station_names
from simrob_drake.teach.pages.buttons import told
from simrob_drake.teach.pages.following import follow
from simrob_drake.teach.pages.words import Words
from simrob_drake.teach.session import Session

PICTURE = "picture.png"
"""Of a robot, in its folder."""


def build(session: Session, t: Words, load: Callable[[str], None]) -> None:
    """Build the list of stations, and the pictures of the robots.

    Args:
        session: whose robots are marked.
        t: the words.
        load: loads another robot or station.
    """
    names = station_names()

    def chosen(name: str | None) -> None:
        if name in names and name != session.station:  # else it was shown, not chosen
            load(name)

    with ui.element("nav").classes("pendant-robots") as nav:
        told(nav, t("shell.robots"))
        stations = ui.select(names, label=t("shell.station"), with_input=True)
        stations.props("dense outlined options-dense").on_value_change(lambda event: chosen(event.value))
        pictures = {name: _picture(name, load) for name in _robots()}

    def mark() -> None:
        models = {robot["model"] for robot in session.description.get("robots", {}).values()}
        for name, picture in pictures.items():
            picture.props["aria-pressed"] = "true" if name in models else "false"
        stations.set_value(session.station if session.station in names else None)

    follow(session, mark, "description")


@cache
def _robots() -> list[str]:
    """Return the robots that have a picture, those with legs first."""
    names = [name for name in robot_names() if _file(name).is_file()]
    return sorted(names, key=lambda name: load_robot(name).feet is None)


def _picture(name: str, load: Callable[[str], None]) -> ui.element:
    button = ui.element("button").classes("pendant-robot").props("type=button")
    button.on("click", lambda: load(name))
    with button:
        ui.image(_file(name)).props("no-spinner no-transition alt='' fit=contain").style("height: 80px")
        ui.label(name.replace("_", " "))
    return button


def _file(name: str) -> Path:
    return models_root() / name / PICTURE
