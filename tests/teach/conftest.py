"""NiceGUI's tests forget the modules of pages, and all that these are part of, as this package; here they may not."""

from contextlib import suppress
from types import SimpleNamespace

import pytest

with suppress(ImportError):
    from nicegui.testing import general

    general.sys = SimpleNamespace(modules={})  # of which it takes the modules out


@pytest.fixture(autouse=True)
def _pages_without_leisure(monkeypatch):
    """Pages follow their sessions almost at once: who watches in a test has quicker eyes than a user."""
    with suppress(ImportError):
        from simrob_drake.teach.pages import elements, station

        monkeypatch.setattr(elements, "_PAUSE", 0.01)
        monkeypatch.setattr(station, "_PAUSE", 0.03)
