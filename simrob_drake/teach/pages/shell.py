"""The page that all tabs share: what is loaded, the view of it, the bar that runs it, and the tabs."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from nicegui import ui

from simrob_drake.teach.pages.words import Words

TABS = ("legs", "arm", "station")


def build(session: Any, t: Words) -> None:
    """Build the page of a session into the present client."""
    with ui.tabs() as tabs:
        for name in TABS:
            ui.tab(name, label=t(f"shell.{name}_tab"))
    with ui.tab_panels(tabs, value=TABS[0], keep_alive=True).classes("w-full"):
        for name in TABS:
            with ui.tab_panel(name):
                module = f"simrob_drake.teach.pages.{name}"
                if find_spec(module):
                    import_module(module).build(session, t)
