"""From where a run is looked at: the front quarter, and beside a robot that walks."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station, simulate
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.walk import walk
from simrob_drake.results.animation.camera import side, walked_way
from simrob_drake.results.animation.pictures import Studio, save_film_strip
from simrob_drake.results.animation.scene import Scene
from simrob_drake.stations.plant import add_plant


@pytest.fixture(scope="module")
def walked():
    motion = walk("zjudancer", 8)
    return simulate(motion.station(), reference=motion.trajectory(), progress=False)


def plant_of(name, overrides=None):
    return add_plant(DiagramBuilder(), load_station(name, overrides))


@pytest.mark.parametrize("robot", ["humanoid", "roid1", "zjudancer", "yobotics"])
def test_a_legged_robot_is_seen_from_its_front_quarter(robot):
    aside = side(plant_of(f"{robot}_dynamic")) - np.deg2rad(load_gaits(robot).facing_deg)
    assert np.rad2deg(aside) % 360 == pytest.approx(310)


def test_a_robot_that_stands_turned_is_seen_from_its_front_all_the_same():
    station = load_station("roid1_dynamic")
    pose = [*station.robots["robot"].base]
    pose[3] = np.deg2rad(70)
    assert np.rad2deg(side(plant_of("roid1_dynamic", {"robot.base": pose}))) == pytest.approx(20)


def test_arms_are_seen_as_ever_and_do_not_move_the_camera():
    assert np.rad2deg(side(plant_of("irb120_dynamic"))) == pytest.approx(-50)
    assert walked_way(simulate(load_station("irb120_dynamic"), duration=0.1, progress=False)) is None


def test_the_camera_stands_still_where_a_robot_stays():
    assert walked_way(simulate(load_station("zjudancer_dynamic"), duration=0.3, progress=False)) is None


def test_the_camera_goes_with_the_robot_but_does_not_sway(walked):
    way = walked_way(walked)(walked.times)
    base = walked.pose("base")[:, :3]
    assert np.abs(way - (base - base[0]))[:, :2].max() < 0.06
    np.testing.assert_allclose(way[-1, :2], (base[-1] - base[0])[:2], atol=0.01)
    np.testing.assert_array_equal(way[:, 2], 0.0)
    sway, camera = (np.abs(np.diff(values[:, 0])).sum() for values in (base, way))  # it walks to y
    assert camera < 0.6 * sway


def test_a_walking_robot_is_equally_large_in_all_frames(walked):
    images = list(Studio(walked, height=200).images(np.array([0.0, walked.stop_time / 2, walked.stop_time])))
    for image in images:
        colours = image.astype(int)
        blue = np.flatnonzero((colours[:, :, 2] > colours[:, :, 0] + 60).any(axis=1))
        assert np.ptp(blue) > 140  # from its head to its toes
        assert blue[0] < 30
        assert blue[-1] > 160
    edges = [np.vstack([image[0], image[:, 0], image[:, -1]]).astype(int) for image in images]
    assert all((np.abs(edge[:, 2] - edge[:, 0]) < 30).all() for edge in edges)  # floor and sky alone


def test_the_floor_has_lines_for_a_walk_only(walked):
    names = []
    for way in (None, walked_way(walked)(walked.times)):
        scene = Scene(walked.config, way=way)
        inspector = scene.query().inspector()
        names.append({inspector.GetName(geometry) for geometry in inspector.GetAllGeometryIds()})
    lines = {name for name in names[1] - names[0] if "line_" in name}
    assert len(lines) == len(names[1] - names[0]) > 40


def test_the_strip_of_a_walk_tells_how_far_it_went(walked, tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: shown.extend(t.get_text() for t in figure.texts))
    save_film_strip(walked, tmp_path / "strip.png", frames=3, height=40)
    base = walked.pose("base")[:, :2]
    assert shown[0] == "0.00 s, 0.00 m"
    time, distance = (float(part.split()[0]) for part in shown[-1].split(", "))
    assert time == pytest.approx(walked.stop_time, abs=0.005)
    assert distance == pytest.approx(np.linalg.norm(base[-1] - base[0]), abs=0.03)
