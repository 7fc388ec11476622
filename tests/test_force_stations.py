"""The stations whose loops watch a force or a torque: what they hold, at other solvers and at other rates."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError

FINE = {"solver.max_step": 0.005}
RADAU = {
    "solver": {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-2, "max_step": 0.01},
    "servo.realization": "per_joint",
}
SAP_LIKE = {"solver": {"kind": "discrete", "scheme": "similar", "time_step": 1e-3}}
SOFT = {"pieces.board.contact.stiffness": 1000}
RUBBER = {
    "contact.model": "hydroelastic",
    "pieces.board.contact": {"hydroelastic_modulus": 3e5},
    "pieces.tip.contact": {"hydroelastic_modulus": 1e9},
}


def press(duration, **overrides):
    """Return a run, the force upon the board and the speed of the tool over it."""
    result = simulate(
        load_station("irb120_force_control", overrides), duration=duration, progress=False
    )
    speed = np.hypot(*(np.gradient(result[f"tcp.{axis}"], result.times) for axis in "xy"))
    return result, result["force.touch.z"], speed


def protected(duration=None, **overrides):
    return simulate(
        load_station("irb120_motor_protection", overrides), duration=duration, progress=False
    )


@pytest.mark.parametrize(
    "changed",
    [
        {},
        SOFT,
        *(
            pytest.param(other, marks=pytest.mark.long)
            for other in (
                FINE,
                {"controllers.press.rate": 50},
                {"controllers.press.rate": 200},
                {**SOFT, **FINE},
                RUBBER,
            )
        ),
    ],
)
def test_the_tool_presses_with_10_N_at_rest_and_while_it_wipes_at_50_mm_s(changed):
    result, force, speed = press(4.5, **changed)

    # at rest, as it gathers speed, and while it wipes
    assert force[result.times > 2.2] == pytest.approx(10, abs=0.5)
    assert speed[(result.times > 3.1) & (result.times < 4.45)] == pytest.approx(0.05, abs=1.5e-3)
    assert force.max() < 10.5  # the approach is slow enough for the blow, and nothing winds up


@pytest.mark.long
def test_it_does_so_under_another_scheme_and_the_board_gives_way_as_its_stiffness_says():
    result, force, _ = press(3.2, **RADAU)

    breaks_loose = (result.times > 2.55) & (result.times < 2.75)  # friction at rest lets go
    assert force[(result.times > 2.2) & ~breaks_loose] == pytest.approx(10, abs=0.5)
    assert force[breaks_loose] == pytest.approx(10, abs=0.8)

    depths = []
    for stiffness in (1e5, 1000.0):
        still, force, _ = press(
            4.0, **{"reference.kind": "hold", "pieces.board.contact.stiffness": stiffness}
        )
        depths.append(0.032 - still["tcp.z"][-1])  # the board's top is at 22 mm, the tip has 10 mm

    assert depths == pytest.approx([10 / 1e5, 10 / (2 / (1 / 1e5 + 1 / 1000))], rel=0.03)


@pytest.mark.long
def test_the_arm_gives_way_where_it_meets_a_box_and_stops_instead_of_pushing_for_ever():
    alone = protected(2.2, **{"controllers": {}})

    assert alone["tau.joint_2"][-1] == pytest.approx(150)  # at saturation, to the end
    assert alone["force.touch.z"][-1] > 400
    for changed in (
        {},
        FINE,
        SAP_LIKE,
        {"controllers.protection.rate": 50},
        {"controllers.protection.rate": 200},
    ):
        result = protected(2.2, **changed)
        stage, times, torque = result["protection.stage"], result.times, result["tau.joint_2"]
        gives, stops = times[np.argmax(stage == 2)], times[np.argmax(stage == 3)]
        assert gives == pytest.approx(0.88, abs=0.03)
        assert stops == pytest.approx(1.37, abs=0.04)
        assert torque[(times > gives + 0.1) & (times < stops - 0.02)] == pytest.approx(50, abs=10)
        rest = times > stops + 0.5  # it carries its weight, and does not press
        assert torque[rest] == pytest.approx(-15.5, abs=1)
        assert abs(result["force.touch.z"][rest]).max() < 10
        assert abs(result["v.joint_2"][rest]).max() < 0.02
        assert result["tcp.z"][-1] == pytest.approx(0.21, abs=3e-4)  # on the box


def test_a_box_that_is_left_lets_the_arm_come_back_to_its_reference():
    down, up = [0, 31.469, 14.9, 0, 43.631, 0], [0, 19.558, -9.388, 0, 79.83, 0]
    targets = [{"time": time, "target_deg": pose} for time, pose in ((2, down), (3, down), (5, up))]
    way = {
        "reference": {"kind": "sequence", "targets": targets},
        "controllers.protection.reset_after": 0.3,
    }

    result = protected(6.0, **way)

    assert {2, 3} <= set(result["protection.stage"])
    assert result["protection.stage"][-1] == 0
    assert result["q_ref.joint_3"][-1] == pytest.approx(np.deg2rad(up[2]))
    assert np.abs(np.diff(result["q_ref.joint_3"])).max() < 0.1


def test_a_force_of_a_body_region_stops_it_and_may_end_the_run():
    hand = {
        "controllers.protection.reads.force": "touch",
        "controllers.protection.force": "hands_and_fingers",
    }
    result, plain = protected(2.0, **hand), protected(2.0)

    stops = [run.times[np.argmax(run["protection.stage"] == 3)] for run in (result, plain)]
    begins = result.times[np.argmax(result["force.touch.z"] > 140)]
    assert stops[0] - begins == pytest.approx(0.1, abs=0.025)
    assert stops[0] < stops[1] - 0.3

    ended = protected(2.0, **hand, **{"controllers.protection.then": "end"})
    assert (ended.ending, ended.stopped_by) == ("monitor", "protection")
    assert "the force was above 140 N" in ended.message


def test_a_warm_motor_is_held_at_what_it_may_give_for_ever():
    keys = {"limit": 100, "nominal": {"joint_2": 30}, "thermal_time": 1, "patience": 9}
    changed = {f"controllers.protection.{key}": value for key, value in keys.items()}
    result = protected(4.0, **changed, **{"servo.torque_limit": 150})
    heat, torque = result["protection.heat.joint_2"], result["tau.joint_2"]
    times, ratio = result.times, (torque / 30) ** 2
    # theta' = r^2 - theta, by the trapezoidal rule
    steps = np.diff(times) * (ratio[:-1] + ratio[1:]) / 2
    expected = [0.0]

    for step, length in zip(steps, np.diff(times), strict=True):
        expected.append(expected[-1] * np.exp(-length) + step * np.exp(-length / 2))

    assert heat == pytest.approx(np.array(expected), abs=0.08)
    assert heat.max() < 1.15
    assert torque[-100:] == pytest.approx(30, abs=3)


@pytest.mark.long
def test_a_run_goes_on_while_an_axis_gives_way_to_the_last_bit():
    deep = {"kind": "hold", "target_deg": [0, 31.469, 14.9, 0, 43.631, 0]}
    config = load_station("irb120_motor_protection", {**SAP_LIKE, "reference": deep})

    first = simulate(config, duration=0.5, progress=False)

    assert first["protection.stage"][-1] == 2

    second = simulate(config, duration=0.5, start=first.final_state, progress=False)
    whole = simulate(config, duration=1.0, progress=False)

    assert (second.values[-1] == whole.values[-1]).all()
    assert second["protection.stage"][-1] == 3


@pytest.mark.parametrize(
    ("station", "overrides", "words"),
    [
        ("force_control", {"press.reads": {}}, "controllers.press.reads is {}"),
        ("force_control", {"press.reads.force": "tuch"}, "controllers.press.reads.force 'tuch'"),
        ("force_control", {"press.direction": [0, 0, 0]}, "must not be the zero vector"),
        ("force_control", {"press.force": -10}, "controllers.press.force"),
        ("force_control", {"press.robot": "left"}, "left"),
        ("motor_protection", {"protection.limit": {"joint_7": 10}}, "joint_7"),
        ("motor_protection", {"protection.limit": [1, 2]}, "controllers.protection.limit"),
        ("motor_protection", {"protection.limit": -1}, "must be positive"),
        (
            "motor_protection",
            {"protection.nominal": -3},
            "controllers.protection.nominal of joint_1 is -3 N·m; it must be positive",
        ),
        (
            "motor_protection",
            {"protection.weight": 0.5},
            "motor protection always acts in full",
        ),
        (
            "motor_protection",
            {"protection.limit": 200},
            "less than the torque limit of the servo, 150 N·m",
        ),
        ("motor_protection", {"protection.nominal": 60}, "must be at most its limit, 50 N·m"),
        ("motor_protection", {"protection.warn": 1.5}, "controllers.protection.warn"),
        (
            "motor_protection",
            {"protection.limit": None, "protection.nominal": None},
            "give at least one of limit, nominal and force",
        ),
        (
            "motor_protection",
            {"protection.force": 100},
            "a mapping with a force sensor, {force: <sensor>}",
        ),
        (
            "motor_protection",
            {"protection.force": "hand", "protection.reads.force": "touch"},
            "body region 'hand'",
        ),
        (
            "motor_protection",
            {"protection.force": 9, "protection.reads.force": "feel"},
            "reads.force 'feel'",
        ),
        (
            "motor_protection",
            {"protection.reads.asked": "touch"},
            "controllers.protection.reads 'asked'",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_its_key(station, overrides, words):
    changed = {f"controllers.{key}": value for key, value in overrides.items()}
    with pytest.raises(SimrobError) as caught:
        simulate(load_station(f"irb120_{station}", changed), duration=0.05, progress=False)
    assert words in str(caught.value)


def test_a_servo_without_stiffness_cannot_give_way():
    with pytest.raises(SimrobError, match=r"servo\.kp of joint_2 is 0"):
        load_station("irb120_motor_protection", {"servo.kp": {"joint_2": 0}})


def test_protection_lies_above_a_force_that_is_too_large():
    """Who asks for more than a hand may bear is stopped; the loop below goes on, and moves nothing."""
    above = {
        "kind": "motor_protection",
        "force": "hands_and_fingers",
        "reads": {"force": "touch"},
        "priority": 1,
    }
    asked = {"controllers.press.force": 200, "reference.kind": "hold"}

    result, force, _ = press(3.5, **{**asked, "controllers.guard": above})

    assert result["guard.stage"][-1] == 3
    assert 140 < force.max() < 200
    assert force[-1] < 25
    assert np.ptp(result["q_ref.joint_2"][-50:]) < 1e-12
