"""When each move of a program began and ended, whatever runs the program is made of."""

import pytest

from simrob_drake import LeggedRobot, Program
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.whole_program import perform
from simrob_drake.stations.load import load_station


def spans_of(station, moves, **settings):
    """Run a program and return, for each move that was begun, its index, its begin and its end [s]."""
    cell = Workcell(load_station(station, settings))
    result = perform(cell, Program.of_content({"moves": moves}, "the program"))
    return [(span.index, span.begin, span.end) for span in result.move_spans]


def elbow(angle, duration):
    return {"target_deg": {"left_elbow": angle}, "duration": duration}


def test_joint_moves_of_one_run_follow_each_other_by_their_durations():
    moves = [elbow(30, 1.0), elbow(10, 0.5), {"wait": {"duration": 0.3}}, elbow(0, 0.7)]
    expected = [(0, 0.0, 1.0), (1, 1.0, 1.5), (2, 1.5, 1.8), (3, 1.8, 2.5)]

    found = spans_of("humanoid_fixed", moves)

    assert [span[0] for span in found] == [0, 1, 2, 3]
    assert [time for span in found for time in span[1:]] == pytest.approx(
        [time for span in expected for time in span[1:]]
    )


def test_moves_of_arms_and_moves_that_take_no_time_have_their_place_too():
    moves = [
        {"target_deg": {"joint_1": 10}, "duration": 0.4},
        {"tool": {"name": "load"}},
        {"wait": {"duration": 0.2}},
    ]
    found = spans_of("irb120_kinematic", moves)

    assert [span[0] for span in found] == [0, 1, 2]
    assert found[1][1] == found[1][2] == pytest.approx(0.4)
    assert found[2][1:] == (pytest.approx(0.4), pytest.approx(0.6))


def test_a_monitor_ends_the_move_that_it_ends_and_no_later_one_has_begun():
    # The neck may bend by 45°; a monitor 4° before ends the second move on its way to 44°.
    monitor = {"monitors.end": {"kind": "joint_limit", "margin_deg": 4.0}}
    nod = {"target_deg": {"neck_pitch": 44.0}, "duration": 0.5}

    found = spans_of("humanoid_fixed", [elbow(30, 0.5), nod, elbow(0, 0.5)], **monitor)

    assert [span[0] for span in found] == [0, 1]
    assert found[1][1] == pytest.approx(0.5)
    assert 0.5 < found[1][2] < 1.0


def test_a_legged_robot_keeps_the_spans_of_its_last_moves():
    robot = LeggedRobot("humanoid_fixed")
    robot.add_move({"left_elbow": 20}, 0.5)
    robot.add_move({"left_elbow": 0}, 0.5)
    robot.simulate()

    spans = robot.result().move_spans

    assert [(span.index, span.begin, span.end) for span in spans] == [(0, 0.0, 0.5), (1, 0.5, 1.0)]
    assert all(span.is_named for span in spans)
