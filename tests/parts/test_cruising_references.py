"""References that cruise, in stations: the limits of robot and user, and what is refused."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.urdf import DRAKE, joint_value


def run(reference, **overrides):
    return simulate(
        load_station("irb120_kinematic", {"reference": reference, **overrides}), progress=False
    )


@pytest.mark.parametrize("kind", ["trapezoid", "s_curve"])
def test_the_robot_s_own_limits_hold_unless_told(kind):
    robot = load_robot("irb120")
    result = run(
        {"kind": kind, "target_deg": {"joint_1": 120, "joint_5": 20}, "start": 0.3},
        sample_rate=1000,
    )
    speed = np.abs(result.axes("v")).max(axis=0)
    push = np.abs(np.diff(result.axes("v"), axis=0)).max(axis=0) * 1000
    assert speed[0] == pytest.approx(robot.speed_limits[0], rel=1e-6)
    assert push[0] == pytest.approx(robot.accelerations[0], rel=1e-2)
    assert (speed <= robot.speed_limits + 1e-9).all()
    np.testing.assert_allclose(result.axes("q")[-1], np.deg2rad([120, 0, 0, 0, 20, 0]), atol=1e-12)
    way, top, most = np.deg2rad(120), robot.speed_limits[0], robot.accelerations[0]
    duration = way / top + top / most * (1.0 if kind == "trapezoid" else 1.5)
    moving = np.flatnonzero(np.abs(result["v.joint_1"]) > 1e-6)
    assert np.ptp(result.times[moving]) == pytest.approx(duration, abs=3e-3)
    assert result.times[moving[0]] == pytest.approx(0.3, abs=3e-3)


def test_a_user_s_limits_hold_too():
    told = {"speed_deg": 40, "acceleration_deg": {"joint_1": 100}, "jerk_deg": 800}
    result = run({"kind": "s_curve", "target_deg": {"joint_1": 60}, **told}, sample_rate=1000)
    v = np.rad2deg(result["v.joint_1"])
    assert v.max() == pytest.approx(40)
    assert np.abs(np.diff(v)).max() * 1000 == pytest.approx(100, rel=1e-3)
    assert np.abs(np.diff(v, n=2)).max() * 1e6 == pytest.approx(800, rel=1e-2)


def test_limits_come_from_the_urdf_where_the_robot_s_file_tells_none():
    namespace = 'xmlns:drake="http://drake.mit.edu"'
    joint = ET.fromstring(
        f'<joint {namespace}><limit velocity="2" drake:acceleration="7"/></joint>'
    )
    assert (joint_value(joint, "velocity"), joint_value(joint, f"{DRAKE}acceleration")) == (
        2.0,
        7.0,
    )
    assert (
        joint_value(ET.fromstring('<joint><limit velocity="0"/></joint>'), f"{DRAKE}acceleration")
        == 0.0
    )
    assert joint_value(ET.fromstring("<joint/>"), "velocity") == 0.0
    np.testing.assert_allclose(
        np.rad2deg(load_robot("irb120").accelerations), [2000] * 3 + [3000] * 3
    )


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
def test_limits_that_cannot_be(reference, message):
    with pytest.raises(SimrobError, match=message):
        run({"kind": "trapezoid", "target_deg": 10, **reference})


def test_a_robot_without_figures_must_be_told():
    change = {"reference": {"kind": "trapezoid", "target_deg": [70, 60]}}
    with pytest.raises(
        SimrobError, match=r"reference\.\w+_deg of joint_1 is None; it must be given \[deg/s²?\]"
    ):
        simulate(load_station("double_pendulum", change), progress=False)
    change["reference"] |= {"speed_deg": 20, "acceleration_deg": 20}
    assert simulate(load_station("double_pendulum", change), progress=False).ending == "completed"
