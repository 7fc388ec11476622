"""What a verdict says of each move, against closed forms and independent kinematics."""

import json

import numpy as np
import pytest

from simrob_drake import Arm, Workcell, load_station
from simrob_drake.cli.app import run_command
from simrob_drake.results.verdict.moves import table_of_moves
from tests.widths import too_wide

TABLE, DOWN = "inclined_table", [0.0, 0.0, np.pi]


def over_the_table(overrides=None):
    arm = Arm(load_station("irb120_workcell", overrides), tool="pencil")
    arm.move_j([0.1, 0.1, 0.05, *DOWN], wobj=TABLE, check="limits")
    return arm


def test_a_line_over_a_table_reaches_its_end_its_speed_and_its_height():
    move = (
        over_the_table()
        .move_l([[0.1, 0.1, 0.02], [0.2, 0.1, 0.01]], wobj=TABLE, speed=0.1)
        .verdict.moves[0]
    )

    assert (move.move, move.robot, move.reached, move.warnings) == (
        "the move (move_l)",
        "robot",
        True,
        (),
    )
    # kinematic: it is where it should be
    assert (
        max(move.position_error, move.orientation_error, move.following_error, move.torque_time)
        < 1e-9
    )
    assert move.asked_speed == 0.1
    assert move.speed == pytest.approx(0.1, rel=0.01)
    assert move.distance == pytest.approx(0.01, abs=1e-6)  # the tip ends that far over the table
    assert move.nearest == "pencil to inclined_table"


@pytest.mark.long
def test_a_slack_arm_ends_beside_its_target_by_what_the_joints_are_off():
    arm = over_the_table({"mode": "dynamic", "servo.feedforward": "none"})
    result = arm.move_l([0.2, 0.1, 0.05], wobj=TABLE, duration=0.5)
    (move,) = result.verdict.moves

    away = np.linalg.norm(arm.pose()[:3] - arm.pose(arm.reference)[:3])

    assert move.position_error == pytest.approx(away, abs=1e-6)
    assert move.following_error >= move.position_error > 0.005
    warning = f"the move (move_l) ends {1e3 * away:.3g} mm from its target (bound 2 mm)"
    assert warning in result.warnings
    assert not move.reached

    bound = {
        "verdict.move_end": "none",
        "verdict.move_following": 0.001,
        "verdict.move_distance": 1.0,
    }
    quiet = Arm(
        load_station("irb120_workcell", {**bound, "mode": "dynamic", "servo.feedforward": "none"})
    )

    (other,) = quiet.move_abs_j([0.1, 0, 0, 0, 1.5, 0], duration=0.2).verdict.moves

    assert other.reached
    leaves_path, comes_near = other.warnings
    assert f"deviates by {1e3 * other.following_error:.3g} mm from its path" in leaves_path
    assert f"is {1e3 * other.distance:.3g} mm" in comes_near


@pytest.mark.long
def test_a_move_at_the_torque_limit_and_one_that_is_too_short_for_its_speed_say_so():
    weak = {"servo.torque_limit": {"joint_1": 0.5}, "verdict.move_speed": 0.9}
    arm = Arm(load_station("irb120_workcell", {"mode": "dynamic", **weak}))

    result = arm.move_abs_j([0.5, 0, 0, 0, 1.5, 0], duration=0.5, check="limits")

    (move,) = result.verdict.moves
    share = (np.abs(result["tau.joint_1"]) > 0.499).mean()
    assert move.torque_time == pytest.approx(share * 0.5)
    assert share > 0.2

    (short,) = (
        over_the_table({"verdict.move_speed": 0.9})
        .move_l([0.11, 0.1, 0.05], wobj=TABLE, speed=1.0)
        .verdict.moves
    )
    assert short.warnings == (f"the move (move_l) reaches {short.speed:.3g} of 1 m/s (bound 90 %)",)


def test_a_move_that_a_monitor_ends_was_not_reached_and_that_is_no_warning():
    wall = {
        "monitors.fence": {
            "kind": "workspace",
            "lower": [-1.0, -1.0, 0.0],
            "upper": [1.0, 0.05, 1.0],
        }
    }
    arm = Arm(load_station("irb120_workcell", wall))

    result = arm.move_abs_j([0.5, 0, 0, 0, 1.5, 0], duration=0.5)

    (move,) = result.verdict.moves
    assert result.stopped_by == "fence"
    assert (move.reached, move.warnings) == (False, ())
    assert move.end == result.stop_time < 0.5
    assert move.position_error > 0.01


@pytest.mark.long
def test_moves_of_a_program_are_called_by_their_numbers(tmp_path, capsys):
    file = tmp_path / "program.yaml"
    ahead = {"targets": [0.1, 0, 0, 0, 1.2, 0], "duration": 0.3}
    both = [{"move_abs_j": {**ahead, "robot": robot}} for robot in ("left", "right")]

    file.write_text(
        json.dumps(
            {"station": "two_arms", "robot": "left", "moves": [{"wait": 0.1}, {"together": both}]}
        )
    )

    assert run_command(["run", str(file), "--out", str(tmp_path / "run"), "--no-recording"]) == 0
    out = capsys.readouterr().out
    assert "nearest: 236 mm, left.link_2 to bar, in move 2 (move_abs_j of left)" in out
    assert too_wide(out) == []
    moves = json.loads((tmp_path / "run" / "summary.json").read_text())["verdict"]["moves"]
    assert [move["move"] for move in moves] == [
        "move 2 (move_abs_j of left)",
        "move 2 (move_abs_j of right)",
    ]
    assert [(move["begin"], move["end"]) for move in moves] == [
        (pytest.approx(0.1), pytest.approx(0.4))
    ] * 2

    cell = Workcell("two_arms")
    cell.record()
    cell.wait(0.1)
    cell.arm("left").move_abs_j([0.1, 0, 0, 0, 1.2, 0], duration=0.3)

    (row,) = table_of_moves(cell.result().verdict.moves)[1:]

    assert row[:3] == ["move 2 (move_abs_j of left)", "0.40", "yes"]
