"""The stations of the thesis's outer loops: that each does what it is there for, at two solver settings and rates."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate

FINE = {"solver.max_step": 0.005}


def run(name, duration=None, **overrides):
    return simulate(load_station(name, overrides), duration=duration, progress=False)


@pytest.mark.parametrize(
    ("changed", "slowest"), [({}, 13.5), ({"servo.kp": 50, "servo.kd": 50}, 14), ({"servo.kd": 10, **FINE}, 5)]
)
def test_the_sequencer_visits_every_cell_in_the_robot_s_own_time(changed, slowest):
    result = run("humanoid_sequencer", **changed)
    cell, done = result["sequence.cell"], result["sequence.done"]
    assert list(dict.fromkeys(cell)) == [0, 1, 2, 3]
    assert done[-1] == 1
    assert slowest - 1 < result.times[np.argmax(done)] < slowest
    assert result["base.y"][-1] < -0.09  # a step ahead
    assert result.ending == "completed"


@pytest.mark.parametrize(("target", "changed"), [(0.36, {}), (0.40, FINE), (0.44, {"controllers.height.rate": 50})])
def test_the_humanoid_finds_its_height_and_then_raises_its_arms(target, changed):
    result = run("humanoid_height", **{"controllers.height.target": target, **changed})
    height, acts = result["base.z"], result["height.active"]
    assert result.ending == "completed"
    assert height[-1] == pytest.approx(target, abs=1e-3)
    begins = np.argmax(acts)
    assert height[begins] == pytest.approx(target, abs=3e-3)
    assert abs(result["q.left_shoulder_pitch"][: begins + 1]).max() < 1e-3
    assert np.rad2deg(result["q.left_shoulder_pitch"][-1]) > 60


def test_a_shoulder_with_a_weight_moves_without_sense():
    result = run("humanoid_height", duration=5.0, **{"controllers.height.weights.right_shoulder_pitch": -1})
    assert np.rad2deg(result["q.right_shoulder_pitch"][-1]) > 45


@pytest.mark.parametrize("changed", [{}, {**FINE, "controllers.lean.rate": 200}])
def test_roid1_leans_to_where_it_is_asked_to_be_and_comes_back(changed):
    result = run("roid1_lateral", **changed)
    side = result["base.y"]
    assert side[(result.times > 3) & (result.times < 3.4)] == pytest.approx(0.03, abs=3e-4)
    assert side[-1] == pytest.approx(0, abs=3e-4)


def test_too_far_a_lean_ends_in_the_fall_monitor():
    result = run("roid1_lateral", duration=10.0, **{"controllers.lean.target": 0.12})
    assert result.stopped_by == "fall"


@pytest.mark.parametrize(
    ("robot", "force"),
    [
        ("humanoid", [0, -24.5, 0]),  # forward; upright it withstands 13.7 N, 6.5 N and 16.7 N
        ("roid1", [9.5, 0, 0]),
        ("zjudancer", [0, 24, 0]),
    ],
)
def test_a_push_that_fells_a_robot_does_not_fell_one_that_balances(robot, force):
    pushed = {"forces.push": {"kind": "push", "start": 0.5, "force": force}}
    station = f"{robot}_balance"
    assert run(station, duration=2.5, controllers={}, **pushed).stopped_by == "fall"
    for changed in ({}, {**FINE, "controllers.balance.rate": 200}):
        result = run(station, duration=3.5, **pushed, **changed)
        assert result.ending == "completed"
        assert result["base.z"][-1] == pytest.approx(result["base.z"][0], rel=0.05)
        assert abs(result["balance.offset.left_hip_pitch"]).max() > np.deg2rad(30)


def test_a_robot_that_stands_undisturbed_is_left_alone_by_its_noisy_sensors():
    sensors = {"position": "encoders", "velocity": "encoders", "orientation": "imu", "angular_velocity": "imu"}
    result = run("zjudancer_balance", duration=2.0, forces={}, **{"controllers.balance.reads": sensors})
    assert abs(np.rad2deg(result["balance.offset.left_hip_pitch"])).max() < 5
    assert result["base.z"][-1] == pytest.approx(result["base.z"][0], abs=2e-3)
