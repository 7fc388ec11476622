"""The words on the pad for pushes: where the axes of bodies point, and where a push that way really leads."""

import numpy as np
import pytest

from simrob_drake import simulate
from simrob_drake.extensions.pendant.push_sides import SIDES, push_sides
from simrob_drake.programs.arm import Workcell
from simrob_drake.results.record.walks import locomotion


@pytest.mark.parametrize("station", ["humanoid_dynamic", "roid1_dynamic", "zjudancer_dynamic"])
@pytest.mark.parametrize("word", ["ahead", "back", "left", "right"])
def test_a_push_towards_a_side_moves_the_robot_there(station, word):
    cell = Workcell(station)
    words = push_sides(cell, ["robot"])["robot"]
    assert sorted(words.values()) == ["ahead", "back", "down", "left", "right", "up"]
    (side,) = (side for side, known in words.items() if known == word)
    mass = cell.model.plant.CalcTotalMass(cell.model.plant.CreateDefaultContext())
    push = {
        "force": (4.0 * mass * SIDES[side]).tolist(),
        "start": 0.0,
        "duration": 0.1,
        "at": "robot",
    }
    moved = locomotion(simulate(station, duration=0.12, pushes={"push": push}))
    expected = {"ahead": (1, 0), "back": (-1, 0), "left": (0, 1), "right": (0, -1)}[word]
    assert np.array([moved.ahead, moved.drift]) @ expected > 0.9 * moved.distance > 0.0


def test_sides_of_links_follow_their_own_axes_and_pieces_have_no_front():
    words = push_sides(Workcell("irb120_dynamic"), ["robot", "gripper"])
    assert words["robot"] == {
        "-x": "back", "+x": "ahead", "-y": "right", "+y": "left", "-z": "down", "+z": "up"
    }  # fmt: skip
    # At zero angles the flange of the arm looks ahead: the z axis of the gripper does, too.
    assert words["gripper"]["+z"] == "ahead"
    assert words["gripper"]["+y"] == "up"
    assert push_sides(Workcell("humanoid_box"), ["parcel"])["parcel"] == {"-z": "down", "+z": "up"}


def test_an_oblique_side_has_no_word():
    words = push_sides(Workcell("yobotics_dynamic"), ["front_right_foot"])["front_right_foot"]
    assert words == {"-y": "right", "+y": "left"}
