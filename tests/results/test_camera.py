"""From where a run is looked at: the front quarter, and beside a robot that walks."""

import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import ImageDraw
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station, simulate
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.results.animation import live
from simrob_drake.results.animation.camera import (
    PANE_ASPECT,
    WINDOW_ASPECT,
    side,
    walked_displacement,
)
from simrob_drake.results.animation.pictures import Studio, save_film_strip
from simrob_drake.results.animation.recording import save_recording
from simrob_drake.results.animation.scene import (
    SPACING,
    ViewedStation,
    add_floor_grid,
    floor_lines,
    with_floor_under,
)
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve


@pytest.fixture(scope="module")
def walked():
    motion = walk("zjudancer", 4)
    return simulate(motion.station(), reference=motion.trajectory(), progress=False)


def plant_of(name, overrides=None):
    return add_plant(DiagramBuilder(), resolve(load_station(name, overrides)))


@pytest.mark.parametrize("robot", ["humanoid", "roid1", "zjudancer", "yobotics"])
def test_a_legged_robot_is_seen_from_its_front_quarter(robot):
    aside = side(plant_of(f"{robot}_dynamic")) - np.deg2rad(load_gaits(robot).facing_deg)
    assert np.rad2deg(aside) % 360 == pytest.approx(310)


def test_a_robot_that_stands_turned_is_seen_from_its_front_all_the_same():
    station = load_station("roid1_dynamic")

    pose = [*station.robots["robot"].base]
    pose[3] = np.deg2rad(70)
    assert np.rad2deg(side(plant_of("roid1_dynamic", {"robot.base": pose}))) == pytest.approx(20)


def test_a_narrow_view_of_a_wide_robot_is_from_farther_away(monkeypatch):
    cameras = []
    monkeypatch.setattr(live, "look", lambda _, camera: cameras.append(camera))
    config = load_station("yobotics_dynamic")

    for view in (live.StationView(lambda *_: None), live.StationView(lambda *_: None, PANE_ASPECT)):
        view.draw(config)

    wide, narrow = (float(np.linalg.norm(camera.eye - camera.target)) for camera in cameras)
    assert narrow == pytest.approx(WINDOW_ASPECT / PANE_ASPECT * wide, rel=0.25)
    assert narrow > 1.1 * wide


def test_arms_are_seen_as_ever_and_do_not_move_the_camera():
    assert np.rad2deg(side(plant_of("irb120_dynamic"))) == pytest.approx(-50)
    assert (
        walked_displacement(simulate(load_station("irb120_dynamic"), duration=0.1, progress=False))
        is None
    )


def test_the_camera_stands_still_where_a_robot_stays():
    assert (
        walked_displacement(
            simulate(load_station("zjudancer_dynamic"), duration=0.3, progress=False)
        )
        is None
    )


def test_the_camera_goes_with_the_robot_but_does_not_sway(walked):
    way = walked_displacement(walked)(walked.times)
    base = walked.pose("base")[:, :3]

    assert np.abs(way - (base - base[0]))[:, :2].max() < 0.06
    np.testing.assert_allclose(way[-1, :2], (base[-1] - base[0])[:2], atol=0.01)
    np.testing.assert_array_equal(way[:, 2], 0.0)
    sway, camera = (np.abs(np.diff(values[:, 0])).sum() for values in (base, way))  # it walks to y
    assert camera < 0.6 * sway


def test_the_camera_goes_as_far_wherever_the_robot_begins(walked):
    values = walked.values.copy()
    for axis, place in (("x", 3.0), ("y", -2.0)):
        values[:, walked.names.index(f"base.{axis}")] += place
    elsewhere = replace(walked, values=values)

    way = walked_displacement(walked)(walked.times)
    other_way = walked_displacement(elsewhere)(walked.times)

    np.testing.assert_allclose(other_way[:, :2], way[:, :2], atol=1e-9)


def test_a_walking_robot_is_equally_large_in_all_frames(walked):
    images = list(
        Studio(walked, height=200).images(np.array([0.0, walked.stop_time / 2, walked.stop_time]))
    )

    for image in images:
        colours = image.astype(int)
        blue = np.flatnonzero((colours[:, :, 2] > colours[:, :, 0] + 60).any(axis=1))
        assert np.ptp(blue) > 140  # from its head to its toes
        assert blue[0] < 30
        assert blue[-1] > 160
    edges = [np.vstack([image[0], image[:, 0], image[:, -1]]).astype(int) for image in images]
    # floor and sky alone
    assert all((np.abs(edge[:, 2] - edge[:, 0]) < 30).all() for edge in edges)


def test_the_floor_has_lines_for_a_walk_only(walked):
    names = []
    for way in (None, walked_displacement(walked)(walked.times)):
        scene = ViewedStation(walked.config, path=way)
        inspector = scene.query().inspector()
        names.append({inspector.GetName(geometry) for geometry in inspector.GetAllGeometryIds()})

    lines = {name for name in names[1] - names[0] if "line_" in name}
    assert len(lines) == len(names[1] - names[0]) > 40


def test_the_strip_of_a_walk_tells_how_far_it_went(walked, tmp_path, monkeypatch):
    shown = []
    write = ImageDraw.ImageDraw.multiline_text

    def told(pen, place, text, *how, **more):
        shown.append(text)
        write(pen, place, text, *how, **more)

    monkeypatch.setattr(ImageDraw.ImageDraw, "multiline_text", told)
    save_film_strip(walked, tmp_path / "strip.png", frames=3, height=40)
    base = walked.pose("base")[:, :2]
    # The captions of so small a strip are broken into lines.
    captions = [" ".join(text.split()) for text in shown]
    assert captions[0] == "0.00 s, 0.00 m"
    time, distance = (float(part.split()[0]) for part in captions[-1].split(", "))
    assert time == pytest.approx(walked.stop_time, abs=0.005)
    assert distance == pytest.approx(np.linalg.norm(base[-1] - base[0]), abs=0.03)


def test_the_lines_lie_on_whole_tenths_of_the_floor_about_the_way():
    way = np.array([[0.0, 0.0, 0.0], [5.0, 0.3, 0.0]])
    lines = floor_lines(way, size=8.0)

    assert np.abs(lines[..., :2]).max() <= 4.0
    along_x = lines[:, 0, 0] != lines[:, 1, 0]
    for chosen, across in ((along_x, 1), (~along_x, 0)):
        places = lines[chosen][:, 0, across]
        np.testing.assert_array_equal(places, lines[chosen][:, 1, across])
        np.testing.assert_allclose(np.diff(places), SPACING)
        np.testing.assert_allclose(places / SPACING, np.round(places / SPACING), atol=1e-9)
    assert lines[..., 0].max() == 4.0  # the floor ends there


def test_every_fifth_line_of_a_floor_in_pictures_is_bold():
    graph = SceneGraph()
    add_floor_grid(
        graph, np.array([[0.0, 0.0, 0.0], [1.2, 0.3, 0.0]]), size=8.0, tilt=RigidTransform()
    )
    inspector, bold = graph.model_inspector(), []

    for line in inspector.GetAllGeometryIds():
        shape, pose = inspector.GetShape(line), inspector.GetPoseInFrame(line)
        across = int(shape.width() < shape.depth())
        if min(shape.width(), shape.depth()) > 0.006:
            bold.append((across, round(float(pose.translation()[1 - across]), 9)))

    assert {place for _, place in bold} <= {number / 2 for number in range(-3, 6)}
    assert len(bold) == len(set(bold)) > 8


def test_the_floor_reaches_beyond_a_walk_and_is_left_where_that_is_short():
    station = load_station("zjudancer_dynamic")
    wide = with_floor_under(station, np.array([[0.0, -7.0, 0.0], [2.0, 0.0, 0.0]]))

    assert wide.floor.size / 2 > 7.5
    assert with_floor_under(station, np.zeros((1, 3))) == station
    assert with_floor_under(load_station("double_pendulum"), np.full((1, 3), 9.0)).floor is None


def told(page):
    """Return what the page's own script is told."""
    return json.loads(re.search(r"const RUN = (.*);\n", page).group(1))


def test_the_page_of_a_walk_goes_along_with_it(walked, tmp_path):
    run = told(
        save_recording(walked, tmp_path / "walk.html", frames_per_second=20.0).read_text(
            encoding="utf-8"
        )
    )

    times = np.append(np.arange(np.ceil(20 * walked.stop_time)) / 20, walked.stop_time)
    np.testing.assert_allclose(run["way"], walked_displacement(walked)(times), atol=1e-4)
    assert run["rate"] == 20.0
    ends = np.array(run["lines"])
    assert (ends.min(axis=(0, 1))[:2] < np.min(run["way"], axis=0)[:2] - 1.0).all()
    assert (ends.max(axis=(0, 1))[:2] > np.max(run["way"], axis=0)[:2] + 1.0).all()


def test_the_page_of_an_arm_stands_still(tmp_path):
    result = simulate(load_station("irb120_dynamic"), duration=0.1, progress=False)
    run = told(save_recording(result, tmp_path / "arm.html").read_text(encoding="utf-8"))

    assert run["way"] == []

    corners = ViewedStation(result.config).extents_of_run(result)
    assert np.linalg.norm(corners - run["middle"], axis=1).max() <= run["radius"] + 1e-9


@pytest.mark.long
@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs the browser chromium")
def test_a_browser_keeps_the_walking_robot_in_the_middle_until_it_is_told_not_to(walked, tmp_path):
    page = save_recording(walked, tmp_path / "walk.html").read_text(encoding="utf-8")
    staying = "<script>document.querySelector('#switches input').click()</script>"
    (tmp_path / "stay.html").write_text(
        page.replace("</body>", f"{staying}</body>"), encoding="utf-8"
    )
    time = round(850 * walked.stop_time)

    goes_along, stays = (shown_in_browser(tmp_path, name, time) for name in ("walk", "stay"))

    assert goes_along == pytest.approx(0.5, abs=0.15)
    assert abs(stays - goes_along) > 0.2


def shown_in_browser(folder, name, time):
    """Return where the blue robot is at a time [ms] of a page, from 0 at the left edge to 1; 2: out of sight."""
    picture = folder / f"{name}_{time}.png"
    drawing = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    alone = ["--no-sandbox", "--disable-background-networking", f"--user-data-dir={folder}/profile"]
    shown = [
        f"--virtual-time-budget={time}",
        f"--screenshot={picture}",
        f"file://{folder}/{name}.html",
    ]
    command = ["chromium", "--headless", "--window-size=500,320", *drawing, *alone, *shown]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    colours = imread(picture)
    above = colours[: len(colours) * 2 // 3]  # the legend below has blue, too
    columns = np.flatnonzero((above[..., 2] > above[..., 0] + 0.25).any(axis=0))
    return columns.mean() / colours.shape[1] if len(columns) else 2.0
