"""The pad of a drive: who may drive, what goes to the session, and what is told of what was asked and done."""

import asyncio
from math import cos, pi, sin
from types import SimpleNamespace

import pytest
from legs_session import LegsSession

pytest.importorskip("nicegui", reason="needs the extra gui")
from nicegui.testing import user_simulation

from simrob_drake.extensions.pendant.pages import drive
from simrob_drake.extensions.pendant.pages.words import words

LIMITS = {"ahead": 0.2, "backward": 0.1, "sideways": 0.05, "turn_deg": 20.0, "facing_deg": -90.0}


class Wheel(SimpleNamespace):
    """What a session has of a drive, and notes of what it was told."""

    def __init__(self, limits):
        super().__init__(limits=limits, driver=None, asked=(0.0, 0.0, 0.0), told=[])

    def begin(self, driver):
        self.driver = driver

    def command(self, driver, *parts):
        self.told.append((driver == self.driver, *parts))

    def end(self, driver):
        self.driver = None if driver == self.driver else self.driver


def shown(script, limits=LIMITS, language="en"):
    session = LegsSession()
    session.driving = Wheel(limits)

    async def run():
        async with user_simulation(lambda: drive.build(session, words(language))) as user:
            await user.open("/")
            await script(user, session)

    asyncio.run(run())
    return session


def labelled(user, text):
    return next(one for one in user.client.elements.values() if one.props.get("aria-label") == text)


async def heard(session):
    session.told("phase")
    await asyncio.sleep(0.05)


def test_only_a_robot_that_can_is_driven():
    async def scenario(user, session):
        assert not labelled(user, "Drive by hand").visible

    shown(scenario, limits=None)


@pytest.mark.parametrize(
    ("language", "begin", "asked"),
    [
        ("en", "Drive by hand", "asked: ahead 0.10"),
        ("es", "Conducir a mano", "pedido: adelante 0,10"),
    ],
)
def test_a_tab_drives_and_tells_how_and_what_comes_of_it(language, begin, asked):
    async def scenario(user, session):
        pad = labelled(user, words(language)("drive.pad"))
        assert not pad.visible
        session.driving.begin(user.client.id)
        turned = [
            (cos(pi / 4), 0, 0, sin(pi / 4)),
            (cos(pi / 4 + pi / 36), 0, 0, sin(pi / 4 + pi / 36)),
        ]
        poses = [(2.0, [0, 0, 0.4, *turned[0]]), (3.0, [0.12, 0, 0.4, *turned[1]])]
        session.run.history["base_pose"].extend(poses)
        session.driving.asked = (0.1, 0.0, -20.0)
        await heard(session)
        assert pad.visible
        assert not labelled(user, begin).visible
        await user.should_see(asked)
        await user.should_see("-20°/s")
        # it looks along -90° of its base, which has turned by 90°
        await user.should_see(words(language).decimals(0.12, 2))
        await user.should_see(" 10°/s")
        (steer,) = (one for one in pad._event_listeners.values() if one.type == "steer")
        steer.handler(SimpleNamespace(args={"detail": [0.5, 0, -1]}))
        session.driving.end(user.client.id)
        await heard(session)
        assert not pad.visible

    assert shown(scenario, language=language).driving.told == [(True, 0.5, 0, -1)]


def test_another_tab_that_drives_is_told():
    async def scenario(user, session):
        session.driving.begin("another")
        await heard(session)
        button = labelled(user, "Drive by hand")
        assert not button.enabled
        assert button.props["title"] == "Another tab drives the robot"
        assert not labelled(user, words("en")("drive.pad")).visible

    shown(scenario)


@pytest.mark.parametrize("turn", [0.0, 0.6, -0.6])
def test_the_speed_that_is_told_is_that_of_the_base_along_its_heading(turn):
    """On an arc of a circle: the chord over the time, along the middle heading, and the turn itself."""
    speed, facing, begin = 0.3, -pi / 2, 2.8

    def pose(time):
        yaw = begin + turn * time
        x, y = (
            (cos(begin) * speed * time, sin(begin) * speed * time)
            if not turn
            else ((sin(yaw) - sin(begin)) * speed / turn, (cos(begin) - cos(yaw)) * speed / turn)
        )
        half = (yaw - facing) / 2
        return time, [x, y, 0.4, cos(half), 0.0, 0.0, sin(half)]

    ahead, left, turned = drive._speeds([pose(0.05 * number) for number in range(41)], facing)
    assert ahead == pytest.approx(speed, rel=abs(turn) / 2 * 0.06 + 1e-9)
    assert left == pytest.approx(0.0, abs=1e-9)
    assert turned == pytest.approx(turn * 180 / pi)
