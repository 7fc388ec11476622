"""NiceGUI's tests forget the modules of pages, and all that these are part of, as this package; here they may not."""

from contextlib import suppress
from types import SimpleNamespace

with suppress(ImportError):
    from nicegui.testing import general

    general.sys = SimpleNamespace(modules={})  # of which it takes the modules out
