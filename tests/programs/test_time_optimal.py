"""Moves in the least time: within the limits of speed, acceleration and torque, and quicker than what cruises."""

import shutil

import numpy as np
import pytest
import yaml

from simrob_drake import Arm, Workcell, load_station
from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.files import models_root
from simrob_drake.programs.errors import SpeedLimitExceeded
from simrob_drake.programs.time_optimal import _RobotMotion
from tests.programs.conftest import DOWN, HOME

FAR = (1.2, 0.6, -0.6, 0.5, 0.9, 1.0)


def shares(arm, plan):
    """Return the largest parts of the limits of speed, acceleration and torque that a plan takes, looked at densely."""
    robot = arm.cell.robot(arm.name)
    q, v, a = plan.motion(np.linspace(0, plan.duration, 1000))
    limits = robot.model.speed_limits, robot.model.accelerations, robot.gains.torque_limit
    taken = v, a, arm.inverse_dynamics(q, v, a)
    return [float(np.abs(rows / limit).max()) for rows, limit in zip(taken, limits, strict=True)]


@pytest.fixture
def heavy():
    """An arm whose torques are what limits it."""
    return weak_arm(30)


def weak_arm(torque):
    return Arm(
        load_station(
            "irb120_kinematic", {"robot.initial_deg": {"joint_5": 90}, "servo.torque_limit": torque}
        )
    )


@pytest.mark.parametrize("move", ["joints", "line", "zones"])
def test_limits_are_kept_and_used(kinematic, move):
    def plan(**how):
        if move == "joints":
            return kinematic.plan.move_abs_j(FAR, **how)
        if move == "line":
            return kinematic.plan.move_l([0.2, 0.2, 0.1, *DOWN], wobj="table", **how)
        return kinematic.plan.move_abs_j([[0.5, 0.5, 0, 0, 1, 0], FAR], zone="z50", **how)

    if move == "line":
        kinematic.move_j([0.1, 0.1, 0.1, *DOWN], wobj="table")
    fastest, cruising = plan(profile="time_optimal"), plan(profile="s_curve", duration=10.0)
    taken = shares(kinematic, fastest)
    assert 0.95 < max(taken) < 1.001
    # of torque: without weight, at most
    ratios = np.array(shares(kinematic, cruising)) ** [
        1,
        0.5,
        0.5,
    ]
    assert fastest.duration < 10.0 * ratios[:2].max()
    np.testing.assert_allclose(fastest.end, cruising.end, atol=1e-9)
    assert len(fastest.arrivals) == len(cruising.arrivals)
    _, v, a = fastest.motion(np.array([0.0, fastest.duration]))
    np.testing.assert_allclose([v, a], 0.0, atol=1e-6)


def test_weak_motors_take_longer(kinematic, heavy):
    strong, weak = (arm.plan.move_abs_j(FAR, profile="time_optimal") for arm in (kinematic, heavy))
    assert weak.duration > 1.1 * strong.duration
    assert 0.9 < shares(heavy, weak)[2] < 1.001


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_the_torque_of_a_stretched_motion_is_that_of_a_move_that_lasts_as_long(heavy, factor):
    parts = np.linspace(0.0, 1.0, 200)
    quick = heavy.plan.move_abs_j(FAR, duration=0.5, check="nothing")
    stretched = heavy.plan.move_abs_j(FAR, duration=0.5 * factor, check="nothing")
    robot = heavy.cell.robot(heavy.name)
    motion = _RobotMotion(
        robot, heavy.cell.model.dynamics(heavy.name), *quick.motion(parts * quick.duration)
    )

    excess = motion.torque_excess(factor)

    torques = heavy.inverse_dynamics(*stretched.motion(parts * stretched.duration))
    expected = np.abs(torques / robot.gains.torque_limit).max()
    assert excess == pytest.approx(expected, rel=1e-6)


def test_motors_that_cannot_hold_the_arm_are_told():
    arm = weak_arm(1)
    with pytest.raises(
        InvalidParameter, match="another profile: the motors cannot hold the robot on this path"
    ):
        arm.plan.move_abs_j(FAR, profile="time_optimal")


def test_a_speed_is_the_most_of_the_tool(kinematic):
    plan = kinematic.plan.move_abs_j(FAR, profile="time_optimal", speed=0.3)
    places = kinematic.chain.forward(plan.postures(times := np.linspace(0, plan.duration, 2000)))[
        :, :3, 3
    ]

    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times)
    assert 0.28 < speeds.max() < 0.303


@pytest.mark.long
def test_around_obstacles_for_two_and_when_nothing_moves():
    cell = Workcell("two_arms")
    ends = {"left": [0, 60, -30, 0, 30, 0], "right": [40, 60, -30, 0, 30, 0]}
    moves = [
        {"move_free": {"joints_deg": end, "robot": name, "profile": "time_optimal"}}
        for name, end in ends.items()
    ]
    slow = [{"move_free": {"joints_deg": end, "robot": name}} for name, end in ends.items()]

    quick = cell.arm("left").do({"together": moves}).stop_time

    assert quick < Workcell("two_arms").arm("left").do({"together": slow}).stop_time

    arm = cell.arm("left")
    assert arm.move_abs_j(arm.reference, profile="time_optimal").stop_time == pytest.approx(0.01)


@pytest.mark.parametrize("key", ["duration", "times", "acceleration"])
def test_what_it_cannot_take(kinematic, key):
    with pytest.raises(InvalidParameter, match=key):
        kinematic.plan.move_abs_j(HOME, profile="time_optimal", **{key: 1.0})


def own_arm(folder, **keys):
    """Return an arm whose robot.yaml has further keys."""
    copied = shutil.copytree(models_root() / "irb120", folder / "irb120")
    file = copied / "robot.yaml"
    content = {**yaml.safe_load(file.read_text()), **keys}
    file.write_text(
        yaml.safe_dump({key: value for key, value in content.items() if value is not None})
    )
    return Arm(
        load_station(
            "irb120_kinematic", {"robot.model": str(file), "robot.initial_deg": {"joint_5": 90}}
        )
    )


@pytest.mark.parametrize("target", [FAR, (1.2, 0, 0, 0, 1.2, 0), (0.001, 0, 0, 0, np.pi / 2, 0)])
def test_limits_of_jerk_are_kept_and_used(kinematic, target):
    plan = kinematic.plan.move_abs_j(target, profile="jerk_limited")
    robot = kinematic.cell.robot(kinematic.name).model
    times = np.linspace(0, plan.duration, 2000)
    limits = robot.speed_limits, robot.accelerations, robot.jerks

    rates = [
        plan.trajectory.MakeDerivative(order).vector_values(times.tolist()).T for order in (1, 2, 3)
    ]

    shares = [float(np.abs(rows / limit).max()) for rows, limit in zip(rates, limits, strict=True)]
    assert max(shares) == pytest.approx(1.0, abs=2e-3)
    np.testing.assert_allclose([rows[[0, -1]] for rows in rates[:2]], 0.0, atol=1e-6)
    np.testing.assert_allclose(plan.end, target, atol=1e-9)


def test_what_limits_jerk_knows_no_curved_ways_and_needs_all_limits(kinematic, tmp_path):
    with pytest.raises(
        InvalidParameter, match="this one needs a path that is straight in the axes"
    ):
        kinematic.plan.move_l([0.2, 0.2, 0.1, *DOWN], wobj="table", profile="jerk_limited")
    for key in ("speed", "duration"):
        with pytest.raises(
            InvalidParameter,
            match=f"{key}: profile='jerk_limited' takes the least time; leave it out",
        ):
            kinematic.plan.move_abs_j(FAR, profile="jerk_limited", **{key: 1})

    arm = own_arm(tmp_path, jerk_deg=None)
    with pytest.raises(
        InvalidParameter,
        match="profile: jerk_limited needs a limit that joint_1 does not have; set jerk_deg in",
    ):
        arm.move_abs_j(FAR, profile="jerk_limited")


def test_a_tool_is_no_faster_than_it_is_rated_for(tmp_path):
    arm = own_arm(tmp_path, tcp_speed=0.5)

    with pytest.raises(
        SpeedLimitExceeded,
        match=r"the tool would move at .* m/s, beyond its rated speed of 0\.5 m/s",
    ) as caught:
        arm.move_abs_j(FAR, duration=1.0)

    slower = arm.plan.move_abs_j(FAR, duration=caught.value.duration)
    places = arm.chain.forward(slower.postures(times := np.linspace(0, slower.duration, 3000)))

    speeds = np.linalg.norm(np.diff(places[:, :3, 3], axis=0), axis=1) / times[1]
    assert 0.45 < speeds.max() <= 0.5

    fast = arm.move_abs_j(FAR, duration=1.0, check="nothing")
    assert any("of its rated speed" in warning for warning in fast.warnings)


def test_postures_have_names(tmp_path):
    arm = own_arm(tmp_path, postures={"ready": {"joint_2": 20, "joint_5": 60}})
    arm.move_abs_j([0.5, 0, 0, 0, 1.0, 0])

    arm.move_abs_j("ready")

    np.testing.assert_allclose(
        arm.reference, [0.5, np.deg2rad(20), 0, 0, np.deg2rad(60), 0], atol=1e-9
    )

    arm.do({"move_free": {"joints": "home"}})
    np.testing.assert_allclose(arm.reference, np.deg2rad([0, 0, 0, 0, 90, 0]), atol=1e-9)
    with pytest.raises(UnknownName, match="no posture of irb120 'redy'; did you mean 'ready'"):
        arm.do({"move_abs_j": "redy"})
    with pytest.raises(UnknownName, match="axis of irb120"):
        own_arm(tmp_path / "other", postures={"ready": {"elbow": 20}}).move_abs_j("ready")
