"""A browser for the tests of a module, and a page in it that must not complain.

No longer: while it is there, others in the same process cannot begin an event loop of their own.
"""

import pytest
from running import browser, missing

_PATIENCE = 60_000  # ms, on a machine that does other things


def pytest_collection_modifyitems(items):
    if why := missing():
        for item in items:
            if "e2e" in item.path.parts:
                item.add_marker(pytest.mark.skip(reason=why))


@pytest.fixture(scope="module")
def chromium():
    from playwright.sync_api import expect

    expect.set_options(timeout=_PATIENCE)
    with browser() as running:
        yield running


@pytest.fixture
def page(chromium):
    """A page whose scripts raise nothing."""
    # small, since it draws in three dimensions without a graphics card
    small = {"viewport": {"width": 1100, "height": 600}, "device_scale_factor": 0.5}
    context = chromium.new_context(**small, accept_downloads=True)
    page = context.new_page()
    page.set_default_timeout(_PATIENCE)
    raised = []
    page.on("pageerror", lambda problem: raised.append(str(problem)))
    yield page
    context.close()
    assert raised == []
