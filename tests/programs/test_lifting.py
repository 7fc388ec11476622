"""A box that a gripper lifts, puts back, drops or loses: what the look-ahead refuses, and what the verdict says."""

import numpy as np
import pytest
import yaml

from simrob_drake import Workcell
from simrob_drake.base.errors import SimrobError
from simrob_drake.programs.errors import PathCollision
from simrob_drake.programs.program import Program
from simrob_drake.programs.whole_program import carried_program, perform
from simrob_drake.results.animation.pictures import side_by_side
from simrob_drake.results.record.run import all_events
from simrob_drake.results.verdict.moves import meaning_of_distances
from tests.programs.lifting import lifting_station

DOWN = {"target_deg": {"lift": 0.01}, "duration": 0.5}
UP = {"target_deg": {"lift": 0.2}, "duration": 0.8}
DOWN_AGAIN = {"target_deg": {"lift": 0.01}, "duration": 0.8}
GRIP = {"grip": {"force": 20}}
WEAK_GRIP = {"grip": {"force": 1}}  # friction holds 2 * 0.5 * 1 N, and the box weighs 1.96 N
OPEN = {"open": {}}


def rehearsed(folder, moves):
    """Look ahead along a program. Returns the cell at the end, the count of moves that were seen, and their time."""
    config = lifting_station(folder, moves)
    cell = Workcell(config)
    seen, time = cell.rehearse(carried_program(config))
    return cell, seen, time


def test_a_gripped_box_may_be_put_back(tmp_path):
    cell, seen, _ = rehearsed(tmp_path, [DOWN, GRIP, UP, DOWN_AGAIN, OPEN, UP])

    assert seen == 6
    pose = cell.state.joints["box::box/box"].position
    np.testing.assert_allclose(pose[4:], [0, 0, 0.02], atol=1e-9)  # where it was taken


def test_a_gripped_box_moves_with_the_fingers_in_the_look_ahead(tmp_path):
    cell, seen, _ = rehearsed(tmp_path, [DOWN, GRIP, UP])

    assert seen == 3
    pose = cell.state.joints["box::box/box"].position
    np.testing.assert_allclose(pose[4:], [0, 0, 0.02 + 0.19], atol=1e-9)
    # The fingers stop at the faces of the box, 40 mm apart: closed, theirs are 10 mm apart. Steps are up to 2 mm.
    np.testing.assert_allclose(cell.position("robot")[1:], 0.015, atol=2e-3)
    np.testing.assert_allclose(cell.reference("robot")[1:], 0.0, atol=1e-12)


def test_a_box_that_would_be_pressed_into_the_floor_is_found(tmp_path):
    lower = {"target_deg": {"lift": 0.0}, "duration": 1.0}
    with pytest.raises(PathCollision, match=r"move 4: .*floor.*box|move 4: .*box.*floor"):
        rehearsed(tmp_path, [DOWN, GRIP, UP, lower])


def test_the_look_ahead_ends_after_a_box_that_fingers_drop(tmp_path):
    _, seen, _ = rehearsed(tmp_path, [DOWN, GRIP, UP, OPEN, DOWN_AGAIN])
    assert seen == 4


def test_fingers_without_a_piece_still_run_into_it(tmp_path):
    closed = {"target_deg": {"finger_left_joint": 0.0}, "duration": 0.7}
    with pytest.raises(
        PathCollision,
        match=r"would collide with box, .*; `check: limits` in the move leaves out this check",
    ):
        rehearsed(tmp_path, [closed, DOWN])


def test_the_remedy_of_a_collision_can_be_written_in_a_move_of_joints(tmp_path):
    closed = {"target_deg": {"finger_left_joint": 0.0}, "duration": 0.7}
    _, seen, _ = rehearsed(tmp_path, [closed, {**DOWN, "check": "limits"}])

    assert seen == 2

    _, seen, _ = rehearsed(tmp_path, [closed, {**DOWN, "check": None}])
    assert seen == 2

    program = Program.of_content({"moves": [DOWN, {**DOWN, "check": "limits"}]}, "program")
    assert [move.entry() for move in program.moves] == [DOWN, {**DOWN, "check": "limits"}]


def test_robots_with_legs_refuse_the_check(tmp_path):
    from simrob_drake import LeggedRobot

    robot = LeggedRobot("humanoid_box")
    program = Program.of_content(
        {"moves": [{"target_deg": {"waist": 5}, "check": "limits"}]}, "program"
    )
    with pytest.raises(
        SimrobError, match="check: only moves of arms check speed limits and collisions"
    ):
        robot.run(program)


def test_a_box_that_fingers_hold_to_the_end_is_not_lost(tmp_path):
    config = lifting_station(tmp_path, [DOWN, GRIP, UP, DOWN_AGAIN, OPEN])
    result = perform(Workcell(config), carried_program(config))

    assert result.verdict["lost_piece"].worst.value == 0.0
    assert not [text for text in result.verdict.warnings if "slipped" in text]
    # Carried up, put down at its place, and released there on purpose.
    assert result["piece.box.z"].max() == pytest.approx(0.21, abs=2e-3)
    assert result["piece.box.z"][-1] == pytest.approx(0.02, abs=1e-3)


def test_a_box_that_slips_out_of_the_fingers_is_reported_with_its_move(tmp_path):
    config = lifting_station(tmp_path, [DOWN, WEAK_GRIP, UP, {"wait": 0.2}])
    result = perform(Workcell(config), carried_program(config))

    lost = result.verdict["lost_piece"]
    # it stays behind near the floor
    assert lost.worst.value == pytest.approx(0.19 - 0.02, abs=0.04)
    assert lost.worst.move == "move 3"
    assert lost.warning.startswith("box slipped out of the fingers at ")
    assert (
        lost.remedy.text
        == "grip with more force, or raise the friction of the fingers and of the piece"
    )


def test_a_lost_box_in_the_way_of_a_later_move_is_named(tmp_path):
    config = lifting_station(tmp_path, [DOWN, WEAK_GRIP, UP, DOWN_AGAIN])
    with pytest.raises(
        PathCollision, match=r"would collide with box.*before that, box slipped out .* in move 3"
    ):
        perform(Workcell(config), carried_program(config))


def test_a_motor_that_presses_on_a_box_is_not_called_too_weak_to_hold(tmp_path):
    closed = {"target_deg": {"finger_left_joint": 0.0}, "duration": 0.7}
    config = lifting_station(tmp_path, [closed, {**DOWN, "check": "limits"}])

    result = perform(Workcell(config), carried_program(config))

    assert result["tau.lift"][-1] < -100  # downwards: gravity pulls that way, too
    remedies = [remark.remedy.text for remark in result.verdict.remarks if remark.remedy]
    assert any("presses against an obstacle" in text for text in remedies)
    assert not any("too weak" in text for text in remedies)


def test_a_motor_that_cannot_carry_its_load_is_called_too_weak(tmp_path):
    config = lifting_station(tmp_path, [{"wait": 0.5}]).model_copy()
    weak = Workcell(config)
    weak.limit_efforts("robot", {"lift": 10.0})  # 13.7 N are needed

    result = weak.wait(0.6)

    assert result["tau.lift"][-1] == pytest.approx(10.0)
    remedies = [remark.remedy.text for remark in result.verdict.remarks if remark.remedy]
    assert any("too weak to hold this" in text for text in remedies)


@pytest.mark.parametrize("stiffness", [14000, 3000])
def test_distances_of_a_gripped_box_do_not_alarm_and_do_not_depend_on_gains(tmp_path, stiffness):
    config = lifting_station(tmp_path, [DOWN, GRIP, UP])
    servo = config.servo.model_copy(update={"kp": {**config.servo.kp, "lift": stiffness}})
    config = config.model_copy(update={"servo": servo})

    down, grip, up = perform(Workcell(config), carried_program(config)).verdict.moves

    # The lift is at 130 mm, and the fingers end 20 + 50 + 45 mm below it.
    assert down.distance == pytest.approx(0.015, abs=1e-3)
    assert down.own_distance is None  # nothing of the robot moves relative to itself
    # The grip moves the fingers along the floor, and the pads on the box do not count.
    assert grip.distance is None
    assert grip.own_nearest == "finger_left to finger_right"
    assert grip.own_distance == pytest.approx(0.04, abs=1.5e-3)
    # The distance of the carried box to the floor would count, too, but it touches the floor at the start.
    assert up.nearest.endswith("to floor")
    assert up.distance == pytest.approx(0.015, abs=2e-3)
    assert up.own_distance is None
    assert meaning_of_distances([down, grip, up]).startswith(
        "nearest: smallest distance to another body. itself: "
    )


def test_events_name_what_touches_what_and_moves_as_the_user_wrote_them(tmp_path):
    config = lifting_station(tmp_path, [DOWN, GRIP, {"wait": 0.1}])
    result = perform(Workcell(config), carried_program(config))

    texts = [text for _, text in all_events(result)]

    assert "box touches finger_left" in texts
    assert "box touches finger_right" in texts
    assert "move 1 (target_deg) ends" in texts
    assert "move 2 (grip) ends" in texts
    assert result.verdict.moves[0].move == "move 1 (target_deg)"
    # The program is saved as it was written.
    assert Program.of_content(yaml.safe_load(result.program), "program").moves[0].entry() == DOWN


def test_captions_of_a_film_strip_do_not_run_into_each_other():
    width = 160
    image = np.full((240, width, 3), 255, dtype=np.uint8)

    strip = side_by_side(
        [image, image],
        ["1.00 s\nmove_abs_j of the left robot ends", "2.00 s\nbox touches finger_left"],
    )

    captions = np.asarray(strip)[240:].min(axis=2) < 200
    gap = captions[:, width : width + 6]  # between the two images
    assert captions[:, :width].any()
    assert not gap.any()
    assert not captions[
        :, [0, width - 1, width + 6, -1]
    ].any()  # each keeps clear of the borders of its image
