"""The recording, the live view and the camera of both."""

import base64
import gc
import json
import os
import re
import shutil
import socket
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from urllib.parse import urlsplit

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidParameter, OutputError
from simrob_drake.blocks.contacts import Contacts
from simrob_drake.results.animation import live, recording
from simrob_drake.results.animation.camera import (
    FIELD_OF_VIEW,
    WINDOW_ASPECT,
    aspect_of,
    camera_on,
    frame_times,
)
from simrob_drake.results.animation.drawn import open_meshcat
from simrob_drake.results.animation.live import LiveView
from simrob_drake.results.animation.recording import save_recording
from simrob_drake.results.animation.scene import ViewedStation
from simrob_drake.results.colours import PATHS


@pytest.fixture(scope="module")
def result():
    return simulate(load_station("irb120_dynamic"), duration=0.6, progress=False)


@pytest.fixture(scope="module")
def page(result, tmp_path_factory):
    return save_recording(result, tmp_path_factory.mktemp("page") / "recording.html").read_text(
        encoding="utf-8"
    )


def messages(page: str) -> list[bytes]:
    """Return what Meshcat's page is told, which lies in it as base64."""
    return [base64.b64decode(text) for text in re.findall(r"base64,([A-Za-z0-9+/=]+)", page)]


def listens(address: str, port: int) -> bool:
    with socket.socket() as client:
        client.settimeout(1)
        return client.connect_ex((address, port)) == 0


def listening():
    """Return the addresses and ports, in hexadecimal, at which this process listens."""
    sockets = {os.readlink(file) for file in Path("/proc/self/fd").iterdir() if file.is_symlink()}
    rows = [line.split() for line in Path("/proc/self/net/tcp").read_text().splitlines()[1:]]
    return [row[1] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in sockets]


def place_of(url: str) -> tuple[str, int]:
    parts = urlsplit(url)
    return parts.hostname, parts.port


def test_the_page_holds_the_motion_of_every_link_and_plays_at_once(page):
    (animation,) = [message for message in messages(page) if b"set_animation" in message]

    assert all(f"/link_{number}".encode() in animation for number in range(1, 7))
    assert b"play\xc3" in animation  # true, in MessagePack
    assert b"loopMode\xcd\x08\x99" in animation  # 2201: repeat
    assert any(b"tool_path/robot" in message for message in messages(page))


def test_contact_spheres_that_touched_are_shown_where_they_are(tmp_path):
    """Four at the corners of each sole of roid1; the ball looks like its own sphere, which is not drawn twice."""
    feet = {b"l_foot": 0, b"r_foot": 0}
    for station in ("roid1_dynamic", "bouncing_ball"):
        run = simulate(load_station(station), duration=0.2, progress=False)
        told = messages(save_recording(run, tmp_path / "spheres.html").read_text(encoding="utf-8"))
        drawn = [one for one in told if b"set_object" in one and b"contact_sphere_" in one]
        assert all(b"SphereGeometry" in one for one in drawn)
        for foot in feet:
            feet[foot] += sum(foot in one for one in drawn)
        assert station == "roid1_dynamic" or not drawn
    assert feet == {b"l_foot": 4, b"r_foot": 4}


def test_the_sum_of_forces_stands_at_the_centre_of_pressure_of_each_foot(tmp_path):
    """The feet carry the weight, and what presses has no moment about the point."""
    run = simulate(load_station("humanoid_dynamic"), duration=1.0, progress=False)
    (now,) = (Contacts.of(results) for results in run.contacts_at(np.array([run.stop_time])))
    inspector = run.plant.scene_graph.model_inspector()

    sums = recording._sums(inspector, now)
    assert len(sums) == 2

    weight = (
        run.plant.plant.CalcTotalMass(run.plant.plant.CreateDefaultContext()) * STANDARD_GRAVITY
    )
    # it stands almost still
    assert sum(force[2] for _, force in sums.values()) == pytest.approx(weight, rel=0.02)
    middles = np.sort([point[0] for point, _ in sums.values()])
    # in the seen foot, half as wide: x of the ankle
    assert np.abs(np.abs(middles) - 0.0444).max() < 0.028

    names = [
        [inspector.GetName(inspector.GetFrameId(shape)) for shape in pair] for pair in now.pairs
    ]
    for (foot, _), (centre, force) in sums.items():
        sense = np.array(
            [[(first == foot) - (second == foot)] for first, second in names], dtype=float
        )
        np.testing.assert_allclose(force, (sense * now.forces).sum(axis=0))
        np.testing.assert_allclose(
            (sense * np.cross(now.points - centre, now.normal_forces)).sum(axis=0), 0, atol=1e-9
        )

    page = save_recording(run, tmp_path / "stands.html").read_text(encoding="utf-8")
    told = [one for one in messages(page) if b"contact_forces/sum_" in one and b"set_object" in one]
    assert len(told) == 4  # shaft and head of each
    assert '"sum of the forces on a body"' in page


def test_the_page_needs_no_other_file(page):
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=[\"']?(?!data:)", page)


def run_of(page):
    """Return what the page's own script knows."""
    return json.loads(re.search(r"const RUN = (.*);\n", page).group(1))


def test_the_page_says_whose_run_it_is_how_it_ended_and_what_has_which_colour(tmp_path):
    result = simulate(load_station("irb120_force_stop"), progress=False)
    named = replace(result, config=result.config.model_copy(update={"name": "</script><b>"}))
    page = save_recording(named, tmp_path / "stop.html").read_text(encoding="utf-8")

    run = run_of(page)

    assert run["name"] == "</script><b>"
    assert run["name"] not in page
    assert run["message"] == f"stopped by stop: {result.message}"
    assert run["stopped"] is True
    assert run["end"] == result.stop_time
    assert [text for _, text in run["legend"]] == [
        "path of the tool",
        "contact forces",
        "sum of the forces on a body",
    ]
    assert len({colour for colour, _ in run["legend"]} | set(run["axes"])) == 6


def test_ways_of_several_tools_are_told_apart(tmp_path):
    result = simulate(load_station("two_irb120"), duration=0.05, progress=False)
    run = run_of(save_recording(result, tmp_path / "two.html").read_text(encoding="utf-8"))

    assert run["legend"] == [
        [PATHS[0], "path of the tool of left"],
        [PATHS[1], "path of the tool of right"],
    ]
    assert (run["stopped"], run["message"]) == (False, result.message)


@pytest.mark.parametrize(
    ("simulated", "clock", "said"),
    [
        (3.0, 2.0, "1.5 × "),
        (30.0, 2.0, "15 × "),
        (0.03, 2.0, "0.015 × "),
        (0.001, 3.0, "0.00033 × "),
        (0.0, 2.0, "6"),
    ],
)
def test_how_fast_a_run_was_has_two_digits(simulated, clock, said, result):
    run = replace(result, times=np.array([0.0, simulated]), stepping_time=clock, signal_time=0.0)
    run = replace(run, step_times=np.linspace(0.0, simulated, 7))

    assert run.speed_in_words.startswith(said)
    assert run.speed_in_words.endswith("6 steps")
    assert "0 × real" not in run.speed_in_words


@pytest.mark.long
@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs the browser chromium")
def test_a_browser_has_a_clock_and_a_bar_to_play_by(result, tmp_path):
    api = pytest.importorskip("playwright.sync_api")
    file = save_recording(result, tmp_path / "recording.html")
    drawing = [
        "--no-sandbox",
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
    ]

    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=drawing)
        page = browser.new_page(viewport={"width": 500, "height": 400})
        raised = []
        page.on("pageerror", lambda problem: raised.append(str(problem)))
        page.goto(file.as_uri())
        api.expect(page.locator("#run")).to_contain_text("ran to its end at 0.6 s")
        button, slider, clock = (
            page.locator(f"#player {one}") for one in ("button", "input[type=range]", "#clock")
        )
        button.click()
        api.expect(button).to_have_attribute("aria-label", "play")
        slider.evaluate("bar => { bar.value = 0.25; bar.dispatchEvent(new Event('input')) }")
        api.expect(clock).to_have_text("0.25 / 0.60 s")
        low = page.locator("#meshcat-pane").bounding_box()
        assert low["y"] + low["height"] <= page.locator("#player").bounding_box()["y"]
        button.click()
        api.expect(clock).not_to_have_text("0.25 / 0.60 s")
        browser.close()

    assert raised == []


def test_the_camera_is_in_the_page(page, result):
    view = camera_on(ViewedStation(result.config).extents_of_run(result), aspect=WINDOW_ASPECT)
    height = np.array(view.eye[2], dtype=">f8").tobytes()
    assert any(b"/Cameras/default" in message and height in message for message in messages(page))


def test_recording_leaves_nothing_that_listens(result, tmp_path, monkeypatch):
    opened_at = []

    def opened():
        meshcat = open_meshcat()
        opened_at.append(place_of(meshcat.web_url()))
        assert listens(*opened_at[0])
        return meshcat

    monkeypatch.setattr(recording, "open_meshcat", opened)
    save_recording(result, tmp_path / "recording.html")
    assert not listens(*opened_at[0])


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have one loopback address")
def test_meshcat_listens_at_a_loopback_address_that_nobody_guesses():
    before = set(listening())
    first, second = open_meshcat(), open_meshcat()

    (one, port), (other, _) = place_of(first.web_url()), place_of(second.web_url())

    assert one.startswith("127.")
    assert one != other
    assert listens(one, port)

    # 127.0.0.1, where a page in a browser would look first, and every address
    known = {
        "0100007F",
        "00000000",
    }
    assert known.isdisjoint(place.split(":")[0] for place in set(listening()) - before)


@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells what a process listens at")
def test_while_a_view_is_open_nothing_else_listens(result):
    gc.collect()
    before = len(listening())
    view = LiveView(result.config)

    gc.collect()

    assert len(listening()) == before + 1

    view.close()


def test_what_cannot_be_recorded_is_said(result, tmp_path):
    with pytest.raises(InvalidParameter, match="frames_per_second"):
        save_recording(result, tmp_path / "recording.html", frames_per_second=0)
    with pytest.raises(OutputError, match="nowhere"):
        save_recording(result, tmp_path / "nowhere" / "recording.html")


@pytest.mark.parametrize(("end", "rate"), [(0.3, 10.0), (3.0, 32.0), (0.55, 30.0), (0.0, 30.0)])
def test_frames_are_even_and_end_with_the_run(end, rate):
    times = frame_times(end, rate)

    assert times[-1] == end
    np.testing.assert_allclose(np.diff(times)[:-1], 1 / rate)
    assert np.all(np.diff(times) > 1e-6)


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.5])
def test_the_camera_has_all_points_in_its_picture_and_none_to_spare(aspect):
    points = np.random.default_rng(0).normal(size=(50, 3)) * [0.3, 1.0, 0.5] + [2.0, -1.0, 0.5]
    view = camera_on(points, aspect=aspect)

    forward = (view.target - view.eye) / np.linalg.norm(view.target - view.eye)
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    sight = points - view.eye
    up = np.cross(right, forward)
    ahead = sight @ forward * np.tan(FIELD_OF_VIEW / 2)
    largest = np.max([np.abs(sight @ right / ahead / aspect), np.abs(sight @ up / ahead)])
    assert 0.8 < largest < 1.0


def test_a_kinematic_station_is_shown_where_a_dynamic_one_is():
    positions = np.array([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]])
    modes = "dynamic", "kinematic"

    dynamic, kinematic = (
        ViewedStation(load_station(f"irb120_{mode}")).extents(positions) for mode in modes
    )

    np.testing.assert_allclose(kinematic, dynamic, atol=1e-12)
    assert np.ptp(dynamic, axis=0).min() > 0.1


def test_the_live_view_keeps_pace_with_the_clock_and_changes_nothing(result):
    view = LiveView(result.config)
    began = perf_counter()

    shown = simulate(result.config, progress=False, on_step=view.on_step)

    assert perf_counter() - began > 0.6 - 1 / 30

    view.close()
    np.testing.assert_array_equal(shown.values, result.values)
    np.testing.assert_array_equal(shown.step_times, result.step_times)


def test_a_live_view_takes_a_free_port_and_gives_it_back(result):
    first, second = LiveView(result.config), LiveView(result.config)
    places = [place_of(first.url), place_of(second.url)]

    assert places[0] != places[1]
    assert all(listens(*place) for place in places)

    first.close()
    assert not listens(*places[0])

    first.on_step(1.0, np.zeros(6))  # a closed view ignores what comes
    second.close()


def test_the_live_view_draws_even_pictures_between_steps(result, monkeypatch):
    drawn = []
    view = LiveView(result.config)
    monkeypatch.setattr(ViewedStation, "place", lambda scene, positions: drawn.append(positions[0]))
    for time in (0.0, 0.05, 0.2):
        view.on_step(time, np.full(6, 3 * time))
    view.on_step(0.25, np.full(6, np.nan))  # a diverging run's last state

    view.close()

    times = np.arange(7) / 30
    np.testing.assert_allclose(drawn, 3 * times, atol=1e-12)


def test_the_live_view_tells_time_and_speed(result, monkeypatch):
    clock, said = [100.0], []
    monkeypatch.setattr(live, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(live, "sleep", lambda seconds: clock.__setitem__(0, clock[0] + seconds))
    view = LiveView(result.config)
    monkeypatch.setattr(view, "say", said.append)
    for step in range(12):
        view.on_step(step / 30, np.zeros(6))
        clock[0] += 1 / 15  # what the simulation takes: twice as long as what it simulates

    view.close()

    assert (said[0], said[-1]) == ("0.00 s  1.0 ×", f"{11 / 30:.2f} s  0.5 ×")


def test_one_point_has_a_picture():
    """A robot without shapes whose links all begin at one place could not be saved."""
    view = camera_on(points := np.zeros((4, 3)), aspect=aspect_of(points))
    assert np.isfinite([view.eye, view.target]).all()
    assert np.linalg.norm(view.target - view.eye) > 0
