"""Motors whose torque falls with their speed: plans, runs, walks, tuning and monitors judge them by one function."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simrob_drake import Arm, load_station, simulate
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.extensions.tuning.rollout import measures
from simrob_drake.programs.errors import SpeedLimitExceeded, TorqueLimitExceeded
from simrob_drake.programs.torques import TorqueShortage
from simrob_drake.results.record.walks import locomotion
from tests.stations.test_motors import FASTEST, JOINT, MOTOR, RADAU, STALL, STATION

INERTIA = 0.05 + 0.3**2  # of the joint's link about its axis: the body and 1 kg at 0.3 m [kg m²]


@pytest.fixture
def station(tmp_path: Path) -> Path:
    """A joint that turns about the vertical, without gravity and friction, with an accurate solver."""
    (tmp_path / "robot.yaml").write_text(JOINT)
    (tmp_path / "joint.yaml").write_text(STATION)
    return tmp_path / "joint.yaml"


def config_of(file: Path, **changes: Any):
    return load_station(file, {**MOTOR, "solver": RADAU, **changes})


def arm_of(file: Path, **changes: Any) -> Arm:
    return Arm(config_of(file, reference={"kind": "hold"}, **changes))


def share_of_move(duration: float, angle: float = 2.0) -> float:
    """Largest share of the motor in a smooth move, by the polynomial 10 s³ - 15 s⁴ + 6 s⁵ and the motor's line."""
    s = np.linspace(0.0, 1.0, 2001)
    speed = angle / duration * 30 * s**2 * (1 - s) ** 2
    torque = INERTIA * angle / duration**2 * 60 * s * (1 - s) * (1 - 2 * s)
    return float((np.abs(torque + STALL / FASTEST * speed) / STALL).max())


def test_shares_of_motors(station: Path):
    """The stall torque counts at rest, none is left at the no-load speed, and more is available against the motion."""
    gains = arm_of(station).cell.robot("robot").gains

    torques = np.array([[STALL], [0.0], [-STALL], [STALL / 4]])
    speeds = np.array([[0.0], [FASTEST], [FASTEST], [-FASTEST]])
    shares = gains.torque_shares(torques, speeds)

    np.testing.assert_allclose(shares[:, 0], [1.0, 1.0, 0.0, 0.75])
    assert gains.limit_at_rest == pytest.approx([STALL])


def test_a_plan_is_judged_as_its_run_is(station: Path):
    """A move of 0.7 s reaches 5.4 rad/s, where the motor has 0.7 of its 10 N·m: the plan reports it as the run does."""
    assert share_of_move(0.7) > 1.0
    assert share_of_move(0.75) < 1.0
    arm = arm_of(station)
    arm.cell.record()

    with pytest.warns(
        TorqueShortage, match=r"joint_1 would need .* N·m at its speed there"
    ) as caught:
        arm.move_abs_j([2.0], duration=0.7)
    proposed = float(str(caught[0].message).rpartition("a duration of ")[2].split()[0])

    assert "at its torque limit" in arm.cell.result().warnings[0]
    assert share_of_move(proposed) < 1.0
    assert share_of_move(proposed / 1.03) > 1.0


def test_a_move_of_free_time_is_slowed_to_the_line_of_its_motor(station: Path):
    arm = arm_of(station)
    plan = arm.plan.move_abs_j([3.05])

    share = share_of_move(plan.duration, angle=3.05)

    assert share_of_move(1.0, angle=3.05) > 1.0  # in the usual time it needs more
    assert 0.9 < share <= 1.0


def test_the_fastest_move_keeps_to_the_line_of_its_motor(station: Path):
    arm = arm_of(station)

    plan = arm.plan.move_abs_j([2.0], profile="time_optimal")

    motion = plan.motion(np.linspace(0.0, plan.duration, 400))
    shares = arm.cell.robot(arm.name).gains.torque_shares(
        INERTIA * motion.accelerations, motion.velocities
    )
    assert shares.max() < 1.01


def test_moves_keep_to_the_no_load_speed(station: Path):
    """`check` and the verdict judge by the motor's no-load speed, and so do moves and references."""
    arm = arm_of(station)

    with pytest.raises(SpeedLimitExceeded):
        arm.plan.move_abs_j([2.0], duration=2.0 * 1.875 / (1.05 * FASTEST))

    too_fast = {"kind": "trapezoid", "target_deg": 30, "speed_deg": 340, "acceleration_deg": 300}
    with pytest.raises(
        InvalidParameter, match=r"speed_deg .* is 340 deg/s; it must be at most 330\.02"
    ):
        simulate(config_of(station, reference=too_fast), progress=False)


def test_a_stall_torque_below_the_limit_holds_no_more(station: Path):
    """A limit of 100 N·m does not let a motor with 10 N·m hold a load of 15 N·m."""
    changes = {
        "gravity": 50.0,
        "servo.torque_limit": 100.0,
        "robot.base": [0, 0, 1, 0, 0, np.pi / 2],
    }
    arm = arm_of(station, **changes)

    with pytest.raises(TorqueLimitExceeded, match=r"the limit of its motor is 10 N·m"):
        arm.plan.move_abs_j([0.2])


def test_a_monitor_of_the_torque_limit_knows_the_line(station: Path):
    """The joint accelerates at the limit of its motor and never comes near 10 N·m for 0.1 s."""
    monitor = {"kind": "torque_limit", "hold": 0.1}
    run = simulate(config_of(station, monitors={"busy": monitor}), progress=False)

    assert run.ending == "monitor"
    assert run.message.startswith("joint_1 stayed at the limit of its motor for 0.1 s")
    assert run.stop_time == pytest.approx(0.1, abs=5e-3)


def test_walks_and_tuning_judge_motors_as_the_verdict_does():
    """A walk whose motors are at their limits for 7 % of the time is reported as saturated by all of them."""
    run = simulate(load_station("zjudancer_walking", {"duration": 2.5}), progress=False)

    walk = locomotion(run)
    figures = run.verdict.summary()["figures"]

    assert figures["torque_share"]["value"] > 0.99
    assert walk.peak_torque["ratio"] == figures["torque_share"]["value"]
    assert walk.peak_torque["axis"] == figures["torque_share"]["of"]
    assert walk.saturated == figures["torque_time"]["value"] > 0.0
    assert measures(run)["peak_torque"] == figures["torque_share"]["value"]
