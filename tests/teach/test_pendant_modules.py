"""A click on Test passes few modules, from the page to the run and back: who follows it in the code reads them."""

import asyncio

import pytest
from fake_runs import BenchRun

pytest.importorskip("nicegui", reason="needs the extra gui")
from nicegui import ui
from nicegui.testing import user_simulation

from simrob_drake.teach.pages import shell
from simrob_drake.teach.pendant import Pendant
from simrob_drake.teach.session import Session
from tests.modules_passed import modules_entered

MOST = 75


def test_a_click_on_test_passes_few_modules(tmp_path):
    """All is in one process here, and what is counted is what a robot that is open already is tested with."""
    made = []

    def opened(what, robot):
        hand_over = asyncio.get_running_loop().call_soon_threadsafe
        return Session.open(what, tmp_path, robot=robot, live=BenchRun, hand_over=hand_over)

    def page():
        made[:] = made or [Pendant(opened, "humanoid")]
        shell.build(made[0])

    async def run():
        async with user_simulation(root=page) as user:
            await user.open("/")
            await asyncio.sleep(0.5)
            session = made[0].session
            fields = user.find(ui.number).elements
            next(one for one in fields if "left elbow" in str(one.props.get("aria-label")).lower()).value = 30.0
            with modules_entered() as passed:
                user.find("2. Test").click()
                await asyncio.sleep(0.1)
                while session.phase != "idle":
                    await asyncio.sleep(0.05)
                await asyncio.sleep(0.3)  # until the page has heard of it
            assert session.run.time == session.run.reach > 0.0
            session.close()
        return passed

    passed = asyncio.run(run())
    assert len(passed) <= MOST, sorted(passed)
