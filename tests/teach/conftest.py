"""What tests of pages leave behind."""

import sys
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def _modules_stay() -> Iterator[None]:
    """Keep the package's modules: NiceGUI's tests forget those of pages, and all that these are part of."""
    known = {name: module for name, module in sys.modules.items() if name.partition(".")[0] == "simrob_drake"}
    yield
    sys.modules.update(known)
    for name in [
        name for name in sys.modules if name.startswith("simrob_drake.")
    ]:  # some belong to one that was made anew
        parent, _, own = name.rpartition(".")
        setattr(sys.modules[parent], own, sys.modules[name])
