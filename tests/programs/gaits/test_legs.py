"""Legs by inverse kinematics: there and back, and what happens out of reach."""

import re

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.interpolation import stack_poses
from simrob_drake.kinematics.skeleton import skeleton_of
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.legs import ROWS, OutOfReach, leg_angles
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.programs.gaits.walker import facing_rotation, feet_of

COUNT = 50


@pytest.mark.parametrize("name", ["humanoid", "roid1", "zjudancer", "yobotics"])
def test_legs_there_and_back(name):
    skeleton, facing = skeleton_of(name), load_gaits(name).facing_deg
    rng = np.random.default_rng(3)

    root = stack_poses(
        rng.uniform(-0.1, 0.1, (COUNT, 3)), np.tile(facing_rotation(facing), (COUNT, 1, 1))
    )

    bent = np.array(
        [
            40.0 if "knee" in axis else -20.0 if "hip_pitch" in axis else 0.0
            for axis in skeleton.model.axes
        ]
    )
    for foot in feet_of(skeleton, facing):
        angles = np.deg2rad(bent + rng.uniform(-15, 15, (COUNT, len(bent))))
        wanted = foot.poses(angles, root)
        found = leg_angles(
            skeleton.model, foot, wanted, root, np.tile(np.deg2rad(bent), (COUNT, 1))
        )
        asked = [row for row in ROWS[len(foot.axes)] if row < 3]
        np.testing.assert_allclose(
            foot.poses(found, root)[:, asked, 3], wanted[:, asked, 3], atol=1e-8
        )
        if len(foot.axes) == 6:  # nothing is free: the angles themselves come back
            np.testing.assert_allclose(found[:, foot.axes], angles[:, foot.axes], atol=1e-4)


def straight_down(beyond):
    """Ask a leg of yobotics for a foot straight below its hip, ``beyond`` its length [m]."""
    skeleton = skeleton_of("yobotics")
    foot = feet_of(skeleton, 0.0)[0]
    length = 0.2115 + 0.23039 - 0.025  # thigh, shank, and up to the middle of the ball
    goal = np.eye(4)[np.newaxis]
    goal[:, :3, 3] = foot.home * [1, 1, 0] + [0, 0, -length - beyond]
    start = np.deg2rad(skeleton.model.axis_vector(skeleton.model.home_deg, "home"))[np.newaxis]
    return leg_angles(skeleton.model, foot, goal, np.eye(4)[np.newaxis], start, np.array([1.25]))


def test_a_leg_out_of_reach_says_which_when_and_by_how_much():
    with pytest.raises(OutOfReach, match=r"rear_left_foot is 17 mm too short at 1\.25 s"):
        straight_down(0.017)


def missing_length(error):
    """Distance by which the message of an error says that a leg is too short [m]."""
    found = re.search(r"is ([\d.]+) mm too short", str(error.value))
    return 1e-3 * float(found[1])


@pytest.mark.parametrize("beyond", [0.173, 0.0173, 0.0031, 0.00042, 0.00012])
def test_what_is_missing_is_told_and_never_as_nothing(beyond):
    with pytest.raises(OutOfReach) as error:
        straight_down(beyond)
    assert missing_length(error) == pytest.approx(beyond, rel=0.06)  # two digits


def test_what_nobody_sees_is_in_reach():
    """Half of a tenth of a millimetre: the leg is straight, to a hundredth of its length."""
    knee = skeleton_of("yobotics").model.axis_index("rear_left_knee")
    assert abs(straight_down(0.00005)[0, knee]) < 0.1


def test_a_plan_is_refused_for_its_worst_moment_and_soon():
    with pytest.raises(OutOfReach) as few:
        walk("humanoid", 12, step_length=0.2)
    with pytest.raises(OutOfReach) as many:
        walk("humanoid", 40, step_length=0.2)
    assert missing_length(many) == pytest.approx(missing_length(few), rel=0.1)


def test_a_leg_nearly_straight_is_in_reach():
    knee = skeleton_of("yobotics").model.axis_index("rear_left_knee")
    assert 0 < straight_down(-0.001)[0, knee] < 0.3


def test_a_joint_beyond_its_limit_is_named():
    skeleton = skeleton_of("yobotics")
    foot = feet_of(skeleton, 0.0)[0]

    start = np.deg2rad(skeleton.model.axis_vector(skeleton.model.home_deg, "home"))[np.newaxis]

    goal = np.eye(4)[np.newaxis]
    goal[:, :3, 3] = foot.home + np.array([0.0, 0.28, 0.35])
    with pytest.raises(OutOfReach, match=r"rear_left_hip_roll would need .* beyond its limits"):
        leg_angles(skeleton.model, foot, goal, np.eye(4)[np.newaxis], start)


def test_a_robot_without_feet_cannot_walk():
    with pytest.raises(InvalidParameter, match="without feet"):
        feet_of(skeleton_of("irb120"), 0.0)
