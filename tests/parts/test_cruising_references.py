"""References that cruise, in stations: the limits of robot and user, and what is refused."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.urdf import DRAKE, joint_value


def run(reference, **overrides):
    """Run a kinematic arm with a reference."""
    config = load_station("irb120_kinematic", {"reference": reference, **overrides})
    return simulate(config, progress=False)


@pytest.mark.parametrize("kind", ["trapezoid", "s_curve"])
def test_by_default_a_motion_reaches_the_robots_own_limits(kind):
    """A trapezoid of length d takes d / v + v / a with the limits v and a. An s_curve has ramps 1.5 times as long."""
    robot = load_robot("irb120")
    target = {"joint_1": 120, "joint_5": 20}

    result = run({"kind": kind, "target_deg": target, "start": 0.3}, sample_rate=1000)

    velocities = result.axes("v")
    speeds = np.abs(velocities).max(axis=0)
    accelerations = np.abs(np.diff(velocities, axis=0)).max(axis=0) * 1000
    speed_limit = robot.speed_limits[0]
    acceleration_limit = robot.accelerations[0]
    assert speeds[0] == pytest.approx(speed_limit, rel=1e-6)
    assert accelerations[0] == pytest.approx(acceleration_limit, rel=1e-2)
    assert (speeds <= robot.speed_limits + 1e-9).all()
    np.testing.assert_allclose(result.axes("q")[-1], np.deg2rad([120, 0, 0, 0, 20, 0]), atol=1e-12)

    ramp_factor = 1.0 if kind == "trapezoid" else 1.5
    duration = np.deg2rad(120) / speed_limit + speed_limit / acceleration_limit * ramp_factor
    times = result.times[np.abs(result["v.joint_1"]) > 1e-6]
    assert np.ptp(times) == pytest.approx(duration, abs=3e-3)
    assert times[0] == pytest.approx(0.3, abs=3e-3)


def test_a_motion_reaches_the_limits_of_the_user():
    limits = {"speed_deg": 40, "acceleration_deg": {"joint_1": 100}, "jerk_deg": 800}

    result = run({"kind": "s_curve", "target_deg": {"joint_1": 60}, **limits}, sample_rate=1000)

    velocity = np.rad2deg(result["v.joint_1"])
    assert velocity.max() == pytest.approx(40)
    assert np.abs(np.diff(velocity)).max() * 1000 == pytest.approx(100, rel=1e-3)
    assert np.abs(np.diff(velocity, n=2)).max() * 1e6 == pytest.approx(800, rel=1e-2)


def test_limits_of_a_joint_are_read_from_the_urdf():
    namespace = 'xmlns:drake="http://drake.mit.edu"'
    limit = '<limit velocity="2" drake:acceleration="7"/>'
    with_both = ET.fromstring(f"<joint {namespace}>{limit}</joint>")
    without_acceleration = ET.fromstring('<joint><limit velocity="0"/></joint>')
    without_limits = ET.fromstring("<joint/>")

    assert joint_value(with_both, "velocity") == 2.0
    assert joint_value(with_both, f"{DRAKE}acceleration") == 7.0
    assert joint_value(without_acceleration, f"{DRAKE}acceleration") == 0.0
    assert joint_value(without_limits, "velocity") == 0.0


def test_accelerations_of_a_robot_are_those_of_its_file():
    accelerations = load_robot("irb120").accelerations

    np.testing.assert_allclose(np.rad2deg(accelerations), [2000] * 3 + [3000] * 3)


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        (
            {"speed_deg": 300},
            "reference.speed_deg of joint_1 is 300 deg/s; it must be at most 250, the robot's own",
        ),
        (
            {"acceleration_deg": {"joint_2": 2500}},
            r"acceleration_deg of joint_2 is 2500 deg/s²; .* at most 2000",
        ),
        ({"speed_deg": 0}, "must be positive"),
        ({"speed_deg": {"joint_7": 10}}, "no axis of irb120 .*joint_7"),
        ({"jerk_deg": 100}, "jerk_deg: unknown key"),
    ],
)
def test_invalid_limits_are_refused_with_their_cause(reference, message):
    with pytest.raises(SimrobError, match=message):
        run({"kind": "trapezoid", "target_deg": 10, **reference})


def test_a_robot_without_limits_needs_those_of_the_reference():
    reference = {"kind": "trapezoid", "target_deg": [70, 60]}
    limited = {**reference, "speed_deg": 20, "acceleration_deg": 20}

    with pytest.raises(
        SimrobError, match=r"reference\.\w+_deg of joint_1 is None; it must be given \[deg/s²?\]"
    ):
        simulate(load_station("double_pendulum", {"reference": reference}), progress=False)
    result = simulate(load_station("double_pendulum", {"reference": limited}), progress=False)

    assert result.ending == "completed"
