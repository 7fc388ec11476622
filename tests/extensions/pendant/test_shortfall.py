"""Why a joint is not where it should be: at its limit, on a stop, on its way, or where its gains hold it."""

from math import degrees

import numpy as np
import pytest

from simrob_drake import Arm
from simrob_drake.extensions.pendant import arm_questions
from simrob_drake.extensions.pendant.run import Shortfall, level_of, shortfall

JOINT = {"unit": "deg", "low": -90.0, "high": 110.0}
RAIL = {"unit": "m", "low": 0.0, "high": 0.5}


@pytest.mark.parametrize(
    ("asked", "done", "how", "level", "reason"),
    [
        (90.0, 89.0, {}, "", ""),
        (90.0, 88.0, {}, "amber", "gains"),
        (90.0, 80.0, {}, "red", "gains"),
        (90.0, 33.0, {"torque": -2.1, "limit": 3.0}, "red", "gains"),
        (90.0, 33.0, {"torque": -3.0, "limit": 3.0}, "red", "limit"),
        (90.0, 89.9, {"torque": 2.99, "limit": 3.0}, "red", "limit"),
        (90.0, 60.0, {"speed": 20.0}, "red", "moving"),
        (90.0, 60.0, {"speed": 20.0, "torque": 3.0, "limit": 3.0}, "red", "limit"),
        (90.0, 110.3, {}, "red", "stop"),
        (-60.0, -89.8, {}, "red", "stop"),
    ],
)
def test_a_joint_that_is_not_where_it_should_be_has_a_reason(asked, done, how, level, reason):
    assert shortfall(JOINT, asked, done, **how) == Shortfall(
        pytest.approx(done - asked), level, reason
    )


def test_prismatic_axes_count_in_metres():
    assert [level_of(off, "m") for off in (0.001, -0.002, 0.01)] == ["", "amber", "red"]
    assert shortfall(RAIL, 0.3, 0.295).reason == "gains"
    assert shortfall(RAIL, 0.3, 0.295, speed=0.1).reason == "moving"
    assert shortfall(RAIL, 0.45, 0.4999).reason == "stop"


def test_the_tool_is_as_far_off_as_its_joints_bring_it():
    """A joint that sags turns the tool about its axis, by the same angle."""
    arm = Arm("irb120_dynamic")
    arm.move_abs_j([0, 0.3, 0, 0, 0, 0], duration=1.0)
    told = arm_questions.where(arm)
    sag = arm.position - arm.reference
    assert abs(sag[1]) > 1e-3
    poses = arm.pose(np.array([arm.reference, arm.position]))
    distance = np.linalg.norm(np.diff(poses[:, :3], axis=0))
    assert told["off"][0] == pytest.approx(distance, rel=1e-6)
    assert told["off"][1] == pytest.approx(degrees(abs(sag[1:3].sum() + sag[4])), rel=0.02)
