"""The robot in the browser: shown on this computer only, with a slider for every joint."""

import urllib.request

from simrob_drake.results.animation.robot_view import RobotView
from simrob_drake.robots.catalog import load_robot


def test_the_view_serves_the_robot_on_this_computer_only():
    view = RobotView(load_robot("irb120"))
    try:
        assert view.url.startswith("http://127.0.0.1:")
        view.run(timeout=0.1)
        with urllib.request.urlopen(f"{view.url}/download") as page:
            html = page.read().decode()
    finally:
        view.close()
    assert "<html" in html.lower()


def test_every_joint_has_a_slider_at_its_home():
    view = RobotView(load_robot("irb120"))
    try:
        sliders = view.sliders()
    finally:
        view.close()
    assert list(sliders) == [f"joint_{number}" for number in range(1, 7)]
    assert sliders["joint_5"] == 1.5708 or abs(sliders["joint_5"] - 1.5708) < 0.01
