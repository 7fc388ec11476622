"""The stations of the thesis's outer loops: that each does what it is there for, at two solver settings and rates."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.blocks.contacts import Contacts
from simrob_drake.parts.controllers.support import limb_to
from simrob_drake.stations.posed import PosedStation
from tests.benchmarks.terrain import BLIND, crossed

FINE = {"solver.max_step": 0.005}
long = pytest.mark.long  # the same at other settings


def run(name, duration=None, **overrides):
    return simulate(load_station(name, overrides), duration=duration, progress=False)


@pytest.mark.long
@pytest.mark.parametrize(
    ("changed", "slowest"),
    [
        ({}, 13.5),
        pytest.param({"servo.kp": 50, "servo.kd": 50}, 14, marks=long),
        pytest.param({"servo.kd": 10, **FINE}, 5, marks=long),
    ],
)
def test_the_sequencer_visits_every_cell_in_the_robot_s_own_time(changed, slowest):
    result = run("humanoid_sequencer", **changed)

    cell, done = result["sequence.cell"], result["sequence.done"]
    assert list(dict.fromkeys(cell)) == [0, 1, 2, 3]
    assert done[-1] == 1
    assert slowest - 1 < result.times[np.argmax(done)] < slowest
    assert result["base.y"][-1] < -0.09  # a step ahead
    assert result.ending == "completed"


@pytest.mark.parametrize(
    ("target", "changed"),
    [
        (0.36, {}),
        pytest.param(0.40, FINE, marks=long),
        pytest.param(0.44, {"controllers.height.rate": 50}, marks=long),
    ],
)
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
    result = run(
        "humanoid_height", duration=5.0, **{"controllers.height.weights.right_shoulder_pitch": -1}
    )
    assert np.rad2deg(result["q.right_shoulder_pitch"][-1]) > 45


@pytest.mark.parametrize(
    "changed", [{}, pytest.param({**FINE, "controllers.lean.rate": 200}, marks=long)]
)
def test_roid1_leans_to_where_it_is_asked_to_be_and_comes_back(changed):
    result = run("roid1_lateral", **changed)

    side = result["base.y"]
    assert side[(result.times > 3) & (result.times < 3.4)] == pytest.approx(0.03, abs=3e-4)
    assert side[-1] == pytest.approx(0, abs=3e-4)


@pytest.mark.long
def test_too_far_a_lean_ends_in_the_fall_monitor():
    result = run("roid1_lateral", duration=10.0, **{"controllers.lean.target": 0.12})
    assert result.stopped_by == "fall"


def tilt(result):
    """Return how far the trunk leans from upright [deg]: R33 of its orientation is 1 - 2 (x² + y²)."""
    return np.rad2deg(np.arccos(1 - 2 * (result["base.qx"] ** 2 + result["base.qy"] ** 2)))


def reaction(result, falls, rate):
    """Check that the guard acts from the first sample after the threshold on; return how late it is [s]."""
    acts = result["guard.active"] > 0
    late = result.times[np.argmax(acts)] - result.times[np.argmax(falls)]
    assert 0 <= late <= 1 / rate + 1.5e-3  # it is seen a recorded sample later
    assert not acts[: np.argmax(falls)].any()
    assert acts[np.argmax(acts) :].all()  # latched
    return late


@pytest.mark.long
@pytest.mark.parametrize(
    ("height", "changed"),
    [
        (0.40, {}),
        pytest.param(0.38, FINE, marks=long),
        pytest.param(0.40, {"controllers.guard.rate": 50}, marks=long),
        pytest.param(
            0.38, {"controllers.guard.rate": 200, "controllers.crouch.rate": 50}, marks=long
        ),
    ],
)
def test_the_guard_extends_the_arms_as_soon_as_the_hip_is_below_its_height(height, changed):
    result = run(
        "humanoid_fall_guard",
        6.5,
        **{"controllers.guard.height": height, "sample_rate": 1000, **changed},
    )
    reaction(result, result["base.z"] < height, changed.get("controllers.guard.rate", 100))

    assert result.ending == "completed"
    # they lag by 1 s
    assert np.rad2deg(result["q.left_shoulder_pitch"][-1]) == pytest.approx(90, abs=5)
    assert tilt(result)[-1] < 5


@pytest.mark.long
def test_a_guard_below_where_the_hip_stays_never_acts():
    result = run("humanoid_fall_guard", **{"controllers.guard.height": 0.34})

    assert 0.34 < result["base.z"].min() < 0.37
    assert not result["guard.active"].any()
    assert abs(result["q_ref.left_shoulder_pitch"]).max() == 0


def touched(result):
    """Return the names of the bodies that touch the floor at the ends of the steps of a run."""
    plant, inspector = result.plant.plant, result.plant.scene_graph.model_inspector()
    pairs = [
        pair for found in result.contacts_at(result.step_times) for pair in Contacts.of(found).pairs
    ]
    return {
        plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).name()
        for pair in pairs
        for shape in pair
    }


FEET = {"world", "left_foot", "right_foot"}
HANDS = {"left_hand", "right_hand"}


@pytest.mark.parametrize(
    "changed",
    [
        {},
        pytest.param({**FINE, "solver.accuracy": 1e-4}, marks=long),
        pytest.param({"controllers.guard.rate": 50}, marks=long),
        pytest.param({"controllers.guard.rate": 200}, marks=long),
    ],
)
def test_the_arms_catch_a_robot_that_falls_forward(changed):
    result = run("humanoid_fall_forward", **{"sample_rate": 1000, **changed})
    reaction(result, tilt(result) > 15, changed.get("controllers.guard.rate", 100))

    assert touched(result) == FEET | HANDS
    assert result["distance.head"].min() > 0.14
    assert result["distance.hand"][-1] == pytest.approx(0, abs=1e-3)
    assert not result["guard_behind.active"].any()


@pytest.mark.parametrize(
    ("force", "changed"),
    [
        (5.5, {}),
        pytest.param(6.5, FINE, marks=long),
        (7.7, {}),
        pytest.param(9, {"controllers.guard.rate": 50}, marks=long),
        pytest.param(15, FINE, marks=long),
    ],
)
def test_hands_catch_it_after_any_push_that_tips_it_over_ahead_or_onto_its_back(force, changed):
    result = run("humanoid_fall_forward", 4.0, **{"forces.shove.force": [0, -force, 0], **changed})

    acts = {name: result[f"{name}.active"].any() for name in ("guard", "guard_behind")}
    assert acts == {"guard": force > 7, "guard_behind": force < 7}
    assert touched(result) == FEET | HANDS
    assert result["distance.head"].min() > 0.13


@pytest.mark.parametrize("changed", [{}, pytest.param(FINE, marks=long)])
def test_without_the_guard_the_head_hits_the_floor(changed):
    result = run("humanoid_fall_forward", controllers={}, **changed)
    # the head is fixed to its neck
    assert FEET | {"neck"} <= touched(result) <= FEET | {"neck", "trunk"}
    assert result["distance.head"][-1] == pytest.approx(0, abs=1e-3)


@pytest.mark.long
def test_a_push_that_does_not_tip_the_robot_over_leaves_the_guard_alone():
    result = run("humanoid_fall_forward", **{"forces.shove.force": [0, -4, 0]})

    assert not result["guard.active"].any()
    assert not result["guard_behind.active"].any()
    assert touched(result) == FEET
    assert tilt(result)[-1] < 1


@pytest.mark.long
@pytest.mark.parametrize("rate", [pytest.param(50, marks=long), 100])
def test_a_guard_of_the_capture_point_sees_the_fall_before_the_tilt_does(rate):
    arms = {"right_shoulder_pitch": 110, "left_shoulder_pitch": 110}
    by_step = {
        "kind": "fall_guard",
        "capture_point": 0.0,
        "posture_deg": arms,
        "rate": rate,
        "priority": 2,
    }

    result = run("humanoid_fall_forward", **{"controllers.step": by_step})

    early, late = (result.times[np.argmax(result[f"{name}.active"])] for name in ("step", "guard"))
    assert 0.5 < early < late - 0.05
    assert touched(result) == FEET | HANDS

    still = run(
        "humanoid_fall_forward", **{"controllers.step": by_step, "forces.shove.force": [0, -4, 0]}
    )
    assert not still["step.active"].any()


@pytest.mark.long
@pytest.mark.parametrize(
    "changed",
    [
        pytest.param({}, id="as it is"),
        pytest.param(
            {"controllers.touchdown.rate": 50, "solver.max_step": 0.0025},
            id="half the rate, short steps",
            marks=long,
        ),
        pytest.param({"controllers.touchdown.rate": 200}, id="double the rate", marks=long),
    ],
)
def test_touchdown_crosses_steps_straight_on(changed):
    found = crossed(0, changed, seconds=8.0)

    assert found.upright
    assert found.ahead > 1.0
    assert abs(np.rad2deg(found.yaw)) < 10


@long
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
            slope = np.subtract(limb.place(positions + small), limb.place(positions - small)) / 2e-6
            assert limb.rates(positions)[:, number] == pytest.approx(slope, abs=1e-8)


@pytest.mark.long
@pytest.mark.parametrize(
    ("robot", "force", "axis"),
    [
        # to the left; upright it withstands 16.7 N, 6.5 N and 16.7 N
        (
            "humanoid",
            [31.7, 0, 0],
            "right_hip_roll",
        ),
        # a leg that came back sooner would set it rocking
        pytest.param("humanoid", [26.7, 0, 0], "right_hip_roll", marks=long),
        pytest.param("roid1", [11.7, 0, 0], "left_hip_pitch", marks=long),  # forward
        pytest.param("zjudancer", [0, 31.7, 0], "left_hip_pitch", marks=long),
    ],
)
@pytest.mark.parametrize(
    "changed",
    [
        pytest.param(FINE, id="fine"),
        pytest.param(
            {"solver.max_step": 0.0025, "controllers.balance.rate": 200},
            id="twice the rate",
            marks=long,
        ),
    ],
)
def test_a_push_that_fells_a_robot_does_not_fell_one_that_balances(robot, force, axis, changed):
    pushed = {"forces.push": {"kind": "push", "start": 0.5, "force": force}}

    station = f"{robot}_balance"
    assert run(station, duration=2.5, controllers={}, **pushed).stopped_by == "fall"

    result = run(station, duration=3.0, **pushed, **changed)
    assert result.ending == "completed"
    assert result["base.z"][-1] > 0.95 * result["base.z"][0]
    assert np.hypot(result["base.qx"], result["base.qy"])[-1] < 0.05  # upright within 6°
    assert abs(result[f"balance.offset.{axis}"]).max() > np.deg2rad(30)


@pytest.mark.long
def test_a_robot_that_stands_undisturbed_is_left_alone_by_its_noisy_sensors():
    sensors = {
        "position": "encoders",
        "velocity": "encoders",
        "orientation": "imu",
        "angular_velocity": "imu",
    }
    result = run(
        "zjudancer_balance", duration=2.0, forces={}, **{"controllers.balance.reads": sensors}
    )

    assert abs(np.rad2deg(result["balance.offset.left_hip_pitch"])).max() < 5
    for told in ("com", "capture_point"):
        assert 0 < max(abs(result[f"balance.{told}.{axis}"]).max() for axis in "01") < 0.1
    assert result["base.z"][-1] == pytest.approx(result["base.z"][0], abs=2e-3)
