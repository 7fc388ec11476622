"""Runs that follow each other are one film."""

import numpy as np
import pytest
from PIL import Image

from simrob_drake import LeggedRobot, Program, load_station
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.results.record.run import events_of
from simrob_drake.results.result import join_runs

PARCEL = {"parent": "world", "pose": [0.2, -0.3, 0.3, 0, 0, 0]}


@pytest.fixture(scope="module")
def robot():
    """The humanoid after a program of three runs, of which the walk has other servos and signals."""
    humanoid = LeggedRobot("humanoid_dynamic")
    moves = [
        {"target_deg": {"HomDF": 40}, "duration": 0.4},
        {"walk": {"steps": 2}},
        {"target_deg": {"HomDF": 0}},
    ]
    humanoid.run(Program.model_validate({"moves": moves}))
    return humanoid


@pytest.mark.long
def test_runs_join_where_each_begins(robot):
    first, walk, last = robot.runs
    whole = join_runs(robot.runs)

    assert whole.stop_time == pytest.approx(first.stop_time + walk.stop_time + last.stop_time)

    times = np.array(
        [0.0, 0.2, first.stop_time, first.stop_time + 3.0, whole.stop_time - 0.5, whole.stop_time]
    )
    rows = whole.positions_at(times)

    np.testing.assert_allclose(rows[1], first.positions_at(np.array([0.2]))[0])
    np.testing.assert_allclose(
        rows[2], first.positions_at(np.array([first.stop_time]))[0], atol=1e-9
    )
    np.testing.assert_allclose(rows[3], walk.positions_at(np.array([3.0]))[0])
    np.testing.assert_allclose(rows[4], last.positions_at(np.array([last.stop_time - 0.5]))[0])
    np.testing.assert_allclose(rows[5], last.positions_at(np.array([last.stop_time]))[0])
    np.testing.assert_array_equal(whole.positions_at(times[::-1]), rows[::-1])
    np.testing.assert_array_equal(whole.positions_at(times[3:4]), rows[3:4])  # of one run alone
    assert (np.diff(whole.times) >= 0).all()
    knee = whole["q.right_knee"]
    assert len(knee) == len(whole.times)
    np.testing.assert_array_equal(knee[-len(last.times) :], last["q.right_knee"])


@pytest.mark.long
def test_a_program_is_one_film(robot, tmp_path):
    page = robot.film(tmp_path / "walk.html")
    assert page.stat().st_size > 1e5
    assert robot.film(tmp_path / "walk.png").read_bytes().startswith(b"\x89PNG")


def test_what_is_no_film_is_told(robot, tmp_path):
    with pytest.raises(
        InvalidParameter,
        match=r"walk\.gif; it must be a file that ends in \.html or \.png or \.mp4",
    ):
        robot.film(tmp_path / "walk.gif")
    with pytest.raises(InvalidParameter, match="runs is empty"):
        LeggedRobot("humanoid_fixed").film(tmp_path / "walk.html")


@pytest.mark.long
def test_pieces_that_change_hands_are_where_the_robot_has_them(tmp_path):
    held = LeggedRobot(load_station("humanoid_fixed", {"pieces.parcel": PARCEL}))
    move = {"target_deg": {"HomDF": 40}, "duration": 0.1}
    taken = {"attach": {"piece": "parcel", "pose": [0.0, 0.0, -0.05, 0.0, 0.0, 0.0]}}
    held.run(Program.model_validate({"moves": [move, taken, move]}))

    whole = held.result()

    assert [text for _, text in events_of(whole)] == ["start", "parcel to robot", "end"]

    narrow, wide = (
        Image.open(held.film(tmp_path / "hands.png", frames=n)).width for n in ("events", 4)
    )
    assert 1.3 < wide / narrow < 1.35  # three frames against four
    np.testing.assert_allclose(whole.piece_pose("parcel")[0, :3], PARCEL["pose"][:3], atol=1e-12)
    np.testing.assert_allclose(
        whole.piece_pose("parcel")[-1, :3], held.cell.frame("parcel").translation(), atol=1e-12
    )
