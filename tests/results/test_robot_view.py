"""The robot in the browser: shown on this computer only, with a slider for every joint."""

import base64
from threading import Thread

import numpy as np
import pytest

from simrob_drake.results.animation.robot_view import RobotView
from simrob_drake.robots.catalog import load_robot
from tests.results.test_window import asked, events

JOINT_2 = "joint_2 [\\u00b0]"  # in degrees


def pose(told, path):
    """Return where a path of the page is told to be; something was drawn there before."""
    drawn = [base64.b64decode(one) for one in told if isinstance(one, str)]
    assert any(b"set_object" in one and path.encode() in one for one in drawn)
    (command,) = (one for one in told if isinstance(one, dict) and one.get("path") == path)
    return np.array(command["matrix"]).reshape(4, 4).T


@pytest.fixture
def view():
    view = RobotView(load_robot("irb120"))
    yield view
    view.close()


@pytest.mark.parametrize("prefix", ["robot", "collision"])
def test_the_page_shows_the_robot_where_its_sliders_are(view, prefix):
    """The upper arm turns about joint 2, 0.29 m above the foot, by as much as its slider says: about y."""
    for message in ("NaN", "Infinity", '"x"', "[]", "1e999"):
        assert asked(view.url, "told", f'["{JOINT_2}", {message}]')[0] == 204

    view.run(timeout=0.05)
    assert pose(
        events(view.url, "poses"), f"/drake/{prefix}/irb120/irb120/link_2"
    ) == pytest.approx(at(0.0), abs=1e-6)

    asked(view.url, "told", f'["{JOINT_2}", 30]')
    view.run(timeout=0.05)

    assert pose(
        events(view.url, "poses"), f"/drake/{prefix}/irb120/irb120/link_2"
    ) == pytest.approx(at(np.pi / 6), abs=1e-6)


def at(angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, 0, sin, 0], [0, 1, 0, 0], [-sin, 0, cos, 0.29], [0, 0, 0, 1]])


def test_stop_ends_the_view(view):
    running = Thread(target=view.run, args=(60,))
    running.start()
    asked(view.url, "told", '["Stop", 1]')

    running.join(timeout=5)

    assert not running.is_alive()


def test_every_joint_has_a_slider_at_its_home(view):
    sliders = view.sliders()
    assert list(sliders) == [f"joint_{number}" for number in range(1, 7)]
    assert sliders["joint_5"] == pytest.approx(np.pi / 2, abs=1e-9)
