"""Torques of moves against the motors: held or refused, slowed down where the time is free, warned about otherwise."""

import warnings

import numpy as np
import pytest

from simrob_drake import Arm, load_station
from simrob_drake.programs.errors import TorqueLimitExceeded
from simrob_drake.programs.moves.move_j import plan_move_abs_j
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.torques import TorqueShortage
from tests.programs.conftest import BARE

TARGET = np.deg2rad([60.0, 20.0, 0.0, 0.0, 60.0, 0.0])


def limited_arm(station: str = "irb120_dynamic", **limits: float) -> Arm:
    """The arm of 1 kg of tools with other torque limits of some axes [N·m]."""
    changes = {"servo.torque_limit": limits} if limits else {}
    return Arm(load_station(station, {**BARE, **changes}))


def planned(arm: Arm, **how: object) -> Plan:
    """A move of the arm to the target, planned only."""
    return plan_move_abs_j(arm.cell.planning(arm.name), TARGET, check="limits", **how)


def largest_torque(arm: Arm, plan: Plan, axis: int) -> float:
    """Largest torque of an axis over a plan, from positions at fine times by finite differences [N·m]."""
    times = np.linspace(0.0, plan.duration, 801)
    step = times[1]
    q = plan.postures(times)
    v = np.gradient(q, step, axis=0)
    a = np.gradient(v, step, axis=0)
    dynamics = arm.cell.model.rigid.dynamics(arm.name)
    return float(np.abs(dynamics.inverse_dynamics(q, v, a)[:, axis]).max())


def test_a_move_of_free_time_is_slowed_to_what_the_motor_gives() -> None:
    free = planned(limited_arm())
    strong = limited_arm()
    needed = largest_torque(strong, free, 0)
    weak = limited_arm(joint_1=0.5 * needed)

    slow = planned(weak)

    assert slow.duration > 1.2 * free.duration
    assert largest_torque(weak, slow, 0) <= 0.5 * needed * 1.01
    # and not much slower than it must be
    assert largest_torque(weak, slow, 0) >= 0.5 * needed * 0.85
    np.testing.assert_allclose(slow.end, free.end)


def test_a_move_in_a_given_time_is_warned_about_with_the_time_that_would_do() -> None:
    strong = limited_arm()
    needed = largest_torque(strong, planned(strong, duration=1.0), 0)

    weak = limited_arm(joint_1=0.5 * needed)

    with pytest.warns(
        TorqueShortage, match=r"joint_1 would need .* lags behind; give the move a duration of"
    ) as caught:
        plan = planned(weak, duration=1.0)
    assert plan.duration == 1.0

    proposed = float(str(caught[0].message).rsplit("duration of ", 1)[1].split()[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error", TorqueShortage)
        planned(weak, duration=proposed)


def test_a_motor_that_cannot_hold_the_arm_refuses_the_move() -> None:
    arm = limited_arm(joint_2=1.0)

    with pytest.raises(
        TorqueLimitExceeded, match=r"joint_2 would need .* N·m to stay at rest there, .* 1 N·m"
    ) as refused:
        planned(arm)

    dynamics = arm.cell.model.rigid.dynamics(arm.name)
    assert refused.value.axis == "joint_2"
    assert abs(refused.value.torque) > 1.0
    start = np.deg2rad([0.0, 0.0, 0.0, 0.0, 90.0, 0.0])
    assert (
        abs(refused.value.torque)
        <= np.abs(dynamics.gravity(np.linspace(start, TARGET, 200)))[:, 1].max() * 1.01
    )


def test_nothing_is_compared_in_a_kinematic_station_or_unasked() -> None:
    planned(limited_arm("irb120_kinematic"))
    arm = limited_arm(joint_2=1.0)
    plan_move_abs_j(arm.cell.planning(arm.name), TARGET, check="nothing")


def test_a_strong_arm_takes_the_time_that_it_took_before() -> None:
    """One second to a target of ten points: the usual time, in which its motors have torque to spare."""
    assert planned(limited_arm()).duration == pytest.approx(1.0)
