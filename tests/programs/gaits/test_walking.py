"""Walks that the robots really do, held by nothing but their feet; the minutes are in tests/benchmarks/walking.py."""

from functools import partial

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station, simulate
from simrob_drake.blocks.contacts import Contacts
from simrob_drake.kinematics.skeleton import skeleton_of
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.motion import MAX_STEP
from simrob_drake.programs.gaits.quadruped import crawl, three_legs, trot
from simrob_drake.programs.gaits.sequences import march, posing
from simrob_drake.programs.gaits.walker import feet_of
from simrob_drake.results.record.walks import locomotion

pytestmark = pytest.mark.usefixtures("no_plots")


def walked(motion, overrides=None):
    result = simulate(motion.station(overrides), reference=motion.trajectory(), progress=False)
    return result, locomotion(result)


def planned_way(motion):
    return float(np.linalg.norm(motion.root[-1, :2, 3]))


@pytest.mark.long
@pytest.mark.parametrize(
    ("plan", "tilt"),
    [
        (lambda: walk("humanoid", 6), 6.0),
        (lambda: walk("humanoid", 6, "real_sole"), 20.0),  # it leans on purpose
        (lambda: walk("roid1", 10), 5.0),
        (lambda: walk("zjudancer", 6), 5.0),
        (lambda: trot("yobotics", 11), 12.0),
        (lambda: crawl("yobotics", 8), 3.0),
    ],
    ids=["humanoid", "humanoid on its real sole", "roid1", "zjudancer", "trot", "crawl"],
)
def test_a_walk_goes_about_as_far_as_planned_and_straight(plan, tilt):
    motion = plan()
    result, found = walked(motion)

    assert result.ending == "completed"
    assert found.upright
    assert np.rad2deg(found.tilt) < tilt
    assert found.ahead == pytest.approx(planned_way(motion), rel=0.12)
    assert abs(found.drift) < 0.1 * found.ahead
    assert abs(np.rad2deg(found.yaw)) < 5
    assert found.peak_torque["ratio"] <= 1 + 1e-9


def test_the_humanoid_falls_on_its_real_sole_if_it_does_not_lean():
    """The pendulum's plan for area C, on area B: what the lean is for, and that the floor is no hidden support."""
    _, found = walked(walk("humanoid", 6, feet="spheres_B"))
    assert not found.upright


@pytest.mark.long
def test_the_march_of_the_thesis_walks_with_its_gains():
    motion = march("humanoid", 4)
    config = motion.station()

    assert config.inputs == ()  # no reference velocity: the gains of the thesis as they are

    servo = config.servo_of("robot")
    assert (servo.kp, servo.kd) == (100, 100)

    _, found = walked(motion)
    assert found.upright
    assert 0.12 < found.ahead < 0.25
    assert np.rad2deg(found.tilt) < 3


@pytest.mark.long
def test_a_turning_walk_turns_the_robot():
    motion = walk("zjudancer", 6, "turn")
    planned = np.rad2deg(np.arctan2(motion.root[-1, 1, 0], motion.root[-1, 0, 0]))

    _, found = walked(motion)

    assert found.upright
    assert planned == pytest.approx(30)
    assert np.rad2deg(found.yaw) == pytest.approx(planned, rel=0.15)


@pytest.mark.long
def test_a_foot_stays_up_for_as_long_as_asked():
    motion = three_legs("yobotics", foot="front_left_foot", seconds=2.0)
    result, found = walked(motion)
    foot = next(
        foot for foot in feet_of(skeleton_of("yobotics"), 0.0) if foot.name == "front_left_foot"
    )
    plant = result.plant.plant
    context = plant.CreateDefaultContext()
    times = np.arange(0.0, motion.duration, 0.05)
    heights = []

    for row in result.positions_at(times):
        plant.SetPositions(context, row)
        heights.append(
            (plant.GetFrameByName(foot.link).CalcPoseInWorld(context) @ foot.point)[2] - foot.over
        )

    assert found.upright
    assert (np.array(heights) > 0.02).sum() * 0.05 >= 2.0


@pytest.mark.long
@pytest.mark.parametrize("name", ["crouch", "bow", "wave"])
def test_the_humanoid_keeps_its_balance_in_postures(name):
    _, found = walked(posing("humanoid", name))
    assert found.upright
    assert np.hypot(found.ahead, found.drift) < 0.01


@pytest.mark.parametrize("steps", [1, pytest.param(2, marks=pytest.mark.long), 4])
@pytest.mark.parametrize(
    "plan", [partial(walk, "humanoid"), partial(trot, "yobotics")], ids=["humanoid", "trot"]
)
def test_so_many_steps_are_so_many_step_lengths(plan, steps):
    motion, length = plan(steps), {"humanoid": 0.10, "yobotics": 0.15}[plan.args[0]]

    assert planned_way(motion) == pytest.approx(steps * length, abs=1e-3)

    _, found = walked(motion)
    assert found.upright
    assert found.ahead == pytest.approx(steps * length, rel=0.15)


def test_hands_meet_the_floor_in_a_fall_and_hold_trunk_and_head_over_it():
    result, found = walked(posing("humanoid", "fall_forward"))

    assert result.ending == "completed"
    assert found.tilt > np.deg2rad(70)

    plant, inspector = result.plant.plant, result.plant.scene_graph.model_inspector()
    touching = [
        {
            plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).name()
            for pair in Contacts.of(contacts).pairs
            for shape in pair
        }
        for contacts in result.contacts_at(result.times)
    ]

    assert set().union(*touching) == {"world", "left_foot", "right_foot", "left_hand", "right_hand"}
    assert not {"left_hand", "right_hand"} & touching[100]  # while it tips
    assert {"left_hand", "right_hand"} < touching[-1]

    hands = [
        Contacts.of(contacts).forces[:, 2] for contacts in result.contacts_at(result.times[-1:])
    ]
    assert np.abs(hands).sum() == pytest.approx(2.292 * 9.80665, rel=0.02)  # its weight: at rest


def test_what_the_station_of_a_motion_is_told_stays():
    """Floor, servo, inputs and steps are the motion's, but for those that are given."""
    motion = walk("roid1", 6)
    config = motion.station()
    entry = LeggedRobot("roid1_dynamic")

    adapted = motion.adapt_station(entry.cell.config, "robot")

    assert (adapted.floor, adapted.inputs, adapted.solver) == (
        config.floor,
        config.inputs,
        config.solver,
    )
    assert adapted.servo_of("robot") == config.servo_of("robot")
    assert (config.solver.max_step, config.engine.has_fixed_steps) == (MAX_STEP, True)

    given = {"servo": {"kp": 7.0}, "inputs": [], "floor.size": 1.5, "solver.max_step": 0.015}
    told = motion.station(given)

    assert (told.servo_of("robot").kp, told.inputs, told.floor.size) == (7.0, (), 1.5)
    assert told.servo_of("robot").kd == config.servo_of("robot").kd
    assert told.solver.max_step == 0.015
    assert not motion.station({"solver.error_control": True}).engine.has_fixed_steps
    assert not motion.station({"solver.accuracy": 1e-4}).engine.has_fixed_steps
    assert motion.station({"duration": 1.0}).duration == 1.0


@pytest.mark.long
def test_a_walk_at_its_own_steps_goes_as_far_as_at_finer_ones_and_its_station_says_them(tmp_path):
    motion = trot("yobotics", 16)
    result, found = walked(motion)

    assert len(result.step_times) - 1 == pytest.approx(motion.duration / MAX_STEP, abs=1)

    _, fine = walked(motion, {"solver.max_step": 0.0025})
    assert found.ahead == pytest.approx(fine.ahead, rel=0.02)

    file = result.save(tmp_path / "trot", recording=False) / "station.yaml"
    assert load_station(file).solver == result.config.solver


def test_a_kinematic_station_is_as_it_was():
    config = load_station("humanoid_fixed", {"mode": "kinematic"})
    assert posing("humanoid", "swim").adapt_station(config, "robot") is config
