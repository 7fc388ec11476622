"""The stations of the thesis's outer loops: that each does what it is there for, at two solver settings and rates."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.parts.controllers.limbs import limb_to
from simrob_drake.stations.posed import PosedStation
from tests.benchmarks.terrain import BLIND, crossed

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
    "changed",
    [{}, {"controllers.touchdown.rate": 50, "solver.max_step": 0.0025}, {"controllers.touchdown.rate": 200}],
    ids=["as it is", "half the rate, short steps", "double the rate"],
)
def test_touchdown_crosses_steps_straight_on(changed):
    found = crossed(0, changed, seconds=8.0)
    assert found.upright
    assert found.ahead > 1.0
    assert abs(np.rad2deg(found.yaw)) < 10


def test_without_touchdown_the_same_steps_turn_it_away():
    found = crossed(0, BLIND, seconds=8.0)
    assert abs(np.rad2deg(found.yaw)) > 20


def test_a_leg_s_screws_are_those_of_the_plant():
    robot = PosedStation(load_station("yobotics_dynamic")).station.robots["robot"]
    plant, context = robot.plant, robot.plant.CreateDefaultContext()
    rng = np.random.default_rng(1)
    for foot, frame in robot.tools.items():
        if not foot.endswith("foot"):
            continue
        limb, positions = limb_to(robot, frame), rng.uniform(-1, 1, len(robot.axes))
        robot.axis_map.set_positions(plant, context, positions)
        place = plant.CalcRelativeTransform(context, robot.root, frame).translation()
        assert limb.place(positions) == pytest.approx(place, abs=1e-12)
        for number, axis in enumerate(limb.axes):
            small = np.zeros(len(positions))
            small[axis] = 1e-6
            slope = (limb.place(positions + small) - limb.place(positions - small)) / 2e-6
            assert limb.rates(positions)[:, number] == pytest.approx(slope, abs=1e-8)
