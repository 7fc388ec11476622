"""Moves that would drive an arm through itself: refused by all moves, by one policy."""

import json

import numpy as np
import pytest

from simrob_drake import Arm
from simrob_drake.cli.app import run_command
from simrob_drake.programs.errors import GoalInCollision, NoFreePath, PathCollision
from simrob_drake.programs.plan import check_collisions
from simrob_drake.programs.segments import PathPoint
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.load import bare_station

FOLDED_DEG = [0, -90, 168, 0, 0, 0]
FOLDED = np.deg2rad(FOLDED_DEG)
"""A UR5 whose wrist is some 40 mm deep in its shoulder."""

SHIPPED = ["irb120", "irb120_gripper", "ur3", "ur5", "ur10", "puma560", "tx40"]


def arm_of(robot: str, mode: str = "kinematic") -> Arm:
    return Arm(bare_station(robot, {"mode": mode}))


@pytest.mark.parametrize("mode", ["kinematic", "dynamic"])
def test_a_move_into_the_arm_itself_is_refused(mode):
    arm = arm_of("ur5", mode)

    with pytest.raises(PathCollision, match=r"link_1 would collide with link_4, .* mm deep") as hit:
        arm.move_abs_j(FOLDED)
    assert hit.value.bodies == ("link_1", "link_4")
    assert 0.005 < hit.value.depth < 0.05
    assert arm.cell.state is None or np.allclose(
        arm.reference, arm.plan.move_abs_j(arm.reference).start
    )
    with pytest.raises(GoalInCollision):
        arm.move_free(joints=FOLDED)


def test_poses_lead_into_the_arm_no_more_than_postures():
    arm = arm_of("ur5")
    pose = arm.pose(FOLDED)

    arm.move_abs_j(FOLDED + np.deg2rad([0, 0, -25, 0, 0, 0]))

    for move in (arm.plan.move_j, arm.plan.move_l):
        with pytest.raises(PathCollision, match="link_1 would collide with link_4"):
            move(pose)


def test_without_the_check_the_verdict_has_the_depth_and_a_free_move_its_distance():
    arm = arm_of("ur5")
    free = arm.move_abs_j(FOLDED + np.deg2rad([0, 0, -25, 0, 0, 0])).verdict.moves[0]

    assert free.own_distance > 0.0

    folded = arm.move_abs_j(FOLDED, check=None).verdict.moves[0]
    assert folded.own_distance < -0.03
    assert folded.own_nearest == "link_1 to link_4"
    assert folded.summary()["own_distance"] == folded.own_distance

    # The way out is no deeper than the start, so it is free.
    out = arm.move_abs_j(FOLDED + np.deg2rad([0, 0, -25, 0, 0, 0]))
    assert out.ending == "completed"


def test_a_recorded_move_without_the_check_is_written_so_that_it_runs_again():
    arm = arm_of("ur5")
    arm.record()
    arm.move_abs_j(FOLDED, check=None)

    (move,) = arm.cell.tape.moves()

    assert move["move_abs_j"]["check"] == "limits"


@pytest.mark.long
def test_programs_in_files_are_refused(tmp_path, capsys):
    file = tmp_path / "folded.yaml"
    station = {"name": "alone", "mode": "kinematic", "robot": {"model": "ur5"}}
    (tmp_path / "station.yaml").write_text(json.dumps(station))
    moves = [{"move_abs_j": {"targets_deg": FOLDED_DEG}}]

    file.write_text(json.dumps({"station": "station.yaml", "moves": moves}))

    out = ["--out", str(tmp_path / "run"), "--no-recording"]
    assert run_command(["run", str(file), *out]) == 2
    assert "link_1 would collide with link_4" in capsys.readouterr().err

    moves[0]["move_abs_j"]["check"] = None
    file.write_text(json.dumps({"station": "station.yaml", "moves": moves}))

    assert run_command(["run", str(file), *out]) == 0


def test_the_check_of_a_station_names_a_reference_that_leads_into_the_arm():
    reference = {"kind": "move", "target_deg": FOLDED_DEG, "duration": 2.0}
    findings = check_station(bare_station("ur5", {"reference": reference}))

    (found,) = [finding for finding in findings if finding.subject == "links of robot"]
    assert found.level == "warning"
    assert "link_1 and link_4 overlap" in found.text


def goal_collides(arm: Arm, posture: np.ndarray) -> bool:
    """Whether ordinary moves take a posture as a collision, whatever the way there."""
    rows = {"robot": np.array([arm.reference, posture])}
    try:
        check_collisions(
            arm.cell.collision_model, rows, np.array([0.0, 1.0]), lambda _: PathPoint(1, "goal")
        )
    except PathCollision:
        return True
    return False


@pytest.mark.long
@pytest.mark.parametrize("robot", SHIPPED)
def test_ordinary_moves_and_moves_around_obstacles_agree_on_what_collides(robot):
    arm = arm_of(robot)
    model = arm.cell.robot("robot").model

    lower, upper = np.clip(model.axis_limits, -np.pi, np.pi)
    random = np.random.default_rng(52)
    for posture in random.uniform(lower, upper, (20, len(lower))):
        posture[[*model.fingers]] = arm.reference[[*model.fingers]]
        expected = goal_collides(arm, posture)
        try:
            arm.plan.move_free(joints=posture, planning_time=0.02, duration=20.0)
            found = False
        except GoalInCollision:
            found = True
        except NoFreePath:  # the goal is free
            found = False
        assert found == expected, posture
        if expected:
            with pytest.raises(PathCollision):
                arm.plan.move_abs_j(posture, duration=20.0)


def test_moves_agree_on_a_goal_between_half_the_tolerance_and_all_of_it():
    """A search uses half of the tolerance: it still reaches goals that use more."""
    arm = arm_of("ur5")
    model = arm.cell.collision_model

    def depth(angle: float) -> float:
        model.place_robots({"robot": np.deg2rad([0, -90, angle, 0, 0, 0])})
        return max(
            (overlap.depth for overlap in model.policy.overlaps(tolerance_factor=0.0)), default=0.0
        )

    angle = next(angle for angle in np.arange(150.0, 168.0, 0.02) if depth(angle) > 0.003)
    assert 0.003 < depth(angle) < 0.005
    goal = np.deg2rad([0, -90, angle, 0, 0, 0])
    assert arm.plan.move_abs_j(goal).end == pytest.approx(goal)
    assert arm.plan.move_free(joints=goal).end == pytest.approx(goal)
