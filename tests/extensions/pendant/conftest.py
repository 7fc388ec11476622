"""NiceGUI's tests forget the modules of pages, and all that these are part of, as this package; here they may not."""

from contextlib import suppress
from types import SimpleNamespace

import pytest

with suppress(ImportError):
    from nicegui.testing import general

    general.sys = SimpleNamespace(modules={})  # of which it takes the modules out


@pytest.fixture(autouse=True)
def _no_task_is_left():
    """A task whose loop is closed hangs the next test that ends a server: who has left it fails in its place."""
    yield
    with suppress(ImportError):
        from nicegui.background_tasks import running_tasks

        left = {task for task in running_tasks if task.get_loop().is_closed()}
        running_tasks.difference_update(left)
        assert not left


@pytest.fixture(autouse=True)
def _pages_without_leisure(monkeypatch):
    """Pages follow their sessions almost at once: who watches in a test has quicker eyes than a user."""
    with suppress(ImportError):
        from simrob_drake.extensions.pendant.pages import elements, station

        monkeypatch.setattr(elements, "_PAUSE", 0.01)
        monkeypatch.setattr(elements, "_PAUSE_OF_TICKS", 0.01)
        monkeypatch.setattr(station, "_PAUSE", 0.03)
