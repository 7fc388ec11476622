"""Buttons that keyboards and screen readers know as well as mice do."""

from collections.abc import Callable
from typing import Any

from nicegui import ElementFilter, ui

KEYS = "aria-keyshortcuts"


def icon_button(icon: str, text: str, on_click: Callable[[], Any] | None = None, *, keys: str = "") -> ui.button:
    """Make a button that shows an icon, and tells in words what it does.

    Args:
        icon: of Material Icons.
        text: what it does.
        on_click: what is done then.
        keys: that press it, such as ``Space`` or ``Control+Z``; any button may have them, in :data:`KEYS`.
    """
    button = ui.button(icon=icon, on_click=on_click).props("flat round dense")
    told(button, text)
    if keys:
        button.props[KEYS] = keys
    with button:
        ui.tooltip(f"{text} ({keys})" if keys else text)
    return button


def told(element: ui.element, text: str) -> None:
    """Let an element be called by a text, for who does not see it."""
    element.props["aria-label"] = text
    element.update()


def shortcuts() -> list[tuple[str, str]]:
    """Return all keys of the present page, and what they do."""
    found = [element.props for element in ElementFilter(local_scope=False, only_visible=True) if KEYS in element.props]
    return [(props[KEYS], props.get("aria-label") or props.get("label", "")) for props in found]
