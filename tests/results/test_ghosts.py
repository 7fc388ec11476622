"""Ghosts: copies of a robot's links where forward kinematics has them, and of nothing else."""

import base64

import numpy as np
import pytest
from pydrake.geometry import Role

from simrob_drake import load_station
from simrob_drake.programs.model import StationModel
from simrob_drake.results.animation.drawn import commands, draw_geometry, ghosts
from simrob_drake.results.animation.scene import ViewedStation


@pytest.fixture(scope="module")
def config():
    return load_station("two_irb120")


def test_links_that_move_stand_where_kinematics_has_them(config):
    """Each moving link has one copy for each posture, at the pose of the forward kinematics."""
    posture = np.deg2rad([30, -20, 10, 40, 50, -60])
    said = ghosts(ViewedStation(config), "left", [np.zeros(6), posture], [True, False], 1)

    assert said[0] == {"type": "delete", "path": "/drake/ghosts"}
    copies = {command["path"]: command for command in said if command["type"] == "copy"}
    places = {
        command["path"]: command["matrix"] for command in said if command["type"] == "set_transform"
    }
    assert copies.keys() == places.keys()
    assert len(copies) == 2 * 6, "six links of one robot move"

    model = StationModel(config)
    model.place_robots({"left": posture})

    for link in range(1, 7):
        path = f"left/irb120/link_{link}"
        frame = model.plant.GetFrameByName(f"link_{link}", model.robots["left"].instance)
        matrix = np.reshape(places[f"/drake/ghosts/1/{path}"], (4, 4), order="F")
        np.testing.assert_allclose(matrix, model.pose(frame).GetAsMatrix4(), atol=1e-7)
        good, bad = (copies[f"/drake/ghosts/{number}/{path}"] for number in (0, 1))
        assert good["source"] == bad["source"] == f"/drake/station/{path}"
        assert good["color"] != bad["color"]
        assert good["opacity"] < bad["opacity"], "the second is marked"


def test_what_they_are_copies_of_is_in_the_view(config):
    """The commands of ghosts copy objects that the page of the station has."""
    scene = ViewedStation(config)
    told = commands(
        lambda meshcat: draw_geometry(meshcat, scene.query(), {"station": Role.kIllustration})
    )

    drawn = b"".join(base64.b64decode(command) for command in told if isinstance(command, str))

    for command in ghosts(scene, "right", [np.zeros(6)], [True]):
        if command["type"] == "copy":
            assert command["source"].encode() in drawn


def test_without_postures_they_go(config):
    """Without postures, the earlier ghosts are only deleted."""
    assert ghosts(ViewedStation(config), "left", [], []) == [
        {"type": "delete", "path": "/drake/ghosts"}
    ]
