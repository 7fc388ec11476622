"""Each term of a reward against the figure worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RollPitchYaw, RotationMatrix

from simrob_drake.extensions.learning.rewards import TERMS, RewardSample, rewards, turned_from

NOW = RewardSample(
    place=np.array([1.0, -0.2, -0.05]),
    speed=np.array([0.4, 9.0, 9.0]),
    turned=np.array([0.1, -0.2, 0.3]),
    spin=np.array([1.0, 2.0, -2.0]),
    effort=np.array([0.5, -1.0]),
    action=np.array([1.0, 0.0]),
    last_action=np.array([0.5, 0.5]),
    tool=np.array([0.3, 0.0, 0.4]),
    tool_speed=np.array([0.1, 0.0, 0.0]),
    goal=np.array([0.3, 0.3, 0.8]),
    time=0.5,
    push=np.array([10.0, 0.0, 5.0]),
    desired_speed=0.3,
    yields=0.02,
    ended=True,
)
BY_HAND = {
    "ahead": 0.3,  # it goes 0.4 m/s, and 0.3 are wanted
    "tracking": 0.0,  # it flies off to the side
    "bounce": 81.0,
    "alive": 1.0,
    "height": 0.05**2,
    "lateral": 0.2**2,
    "heading": np.exp(-((0.3 - 0.8 * 0.5) ** 2) / 0.25),  # half a second after the start
    "lean": 0.1**2 + 0.2**2,
    "rotation": 0.1**2 + 0.2**2 + 0.3**2,
    "spin": 9.0,
    "effort": (0.25 + 1.0) / 2,
    "haste": 0.5,
    "distance": 0.5,  # 3 4 5
    "yielding": 0.1**2 + 0.1**2,  # 0.2 and 0.1 m/s are asked for, 0.1 and 0 are there
    "ended": 1.0,
}


def test_every_term_is_as_worked_out_by_hand():
    assert set(BY_HAND) == set(TERMS)
    assert {name: TERMS[name](NOW) for name in TERMS} == pytest.approx(BY_HAND)


def test_tracking_is_of_the_speed_as_the_robot_faces_now():
    """Turned to the left by 90°, a robot that goes 0.5 m/s along y goes ahead; 0.4 m/s off give 1/e."""
    facing = replace(NOW, turned=np.array([0.0, 0.0, np.pi / 2]), speed=np.array([0.0, 0.5, 0.0]))
    for goal, expected in (([0.5, 0.0], 1.0), ([0.1, 0.0], np.exp(-1)), ([0.5, 0.4], np.exp(-1))):
        assert TERMS["tracking"](replace(facing, goal=np.array(goal))) == pytest.approx(expected)
    assert TERMS["tracking"](
        replace(facing, goal=np.array([0.3, 0.0]), astray=0.2)
    ) == pytest.approx(np.exp(-1))


def test_averaged_speeds_come_after_those_that_are():
    """From rest at 0.5 m/s ahead, the mean over a second is 0.5 (1 - exp(-t)) after t, whichever way it faces."""
    facing = replace(NOW, turned=np.array([0.0, 0.0, np.pi / 2]), speed=np.array([0.0, 0.5, 0.0]))
    means = np.zeros(2)
    for _ in range(30):
        _, means = facing.averaged(means, 0.02, 1.0)
    np.testing.assert_allclose(means, [0.5 * (1 - np.exp(-0.6)), 0.0], atol=1e-12)
    np.testing.assert_allclose(facing.averaged(means, 0.02, 0.0)[1], [0.5, 0.0], atol=1e-12)
    at_goal = replace(facing.averaged(means, 0.02, 1e9)[0], goal=means)
    assert TERMS["tracking"](at_goal) == pytest.approx(1.0)


def test_weights_count_by_the_time_but_the_end_counts_once():
    assert rewards({"ahead": 2.0, "lateral": -3.0, "ended": -5.0}, NOW, 0.02) == pytest.approx(
        {"ahead": 0.012, "lateral": -3 * 0.04 * 0.02, "ended": -5.0}
    )


def test_a_robot_that_stands_higher_than_at_the_start_pays_nothing_for_it():
    assert TERMS["height"](RewardSample(**{**vars(NOW), "place": np.array([0, 0, 0.1])})) == 0


def test_turns_are_seen_from_where_it_stood():
    """Of a robot that faces y and then leans 0.2 rad about its own x."""
    faced = RollPitchYaw(0, 0, np.pi / 2).ToRotationMatrix()
    leaned = faced @ RotationMatrix.MakeXRotation(0.2)
    orientations = [turn.ToQuaternion().wxyz() for turn in (faced, leaned)]
    np.testing.assert_allclose(turned_from(*orientations), [0.2, 0, 0], atol=1e-12)


def test_turns_of_many_robots_are_those_of_drake():
    drawn = np.random.default_rng(0).standard_normal((20, 4))
    start, *others = (RotationMatrix(Quaternion(row / np.linalg.norm(row))) for row in drawn)
    expected = [RollPitchYaw(start.inverse() @ other).vector() for other in others]
    np.testing.assert_allclose(turned_from(drawn[0], drawn[1:]), expected, atol=1e-12)
