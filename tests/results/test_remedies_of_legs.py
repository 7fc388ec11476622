"""What the verdict proposes for a joint of a robot on legs that turns too fast: something that can be typed."""

from dataclasses import replace
from typing import NamedTuple

import pytest

from simrob_drake import load_station, simulate
from simrob_drake.results.verdict.remedies import more_time_for_speed


class Worst(NamedTuple):
    """A worst value, as remedies look at it."""

    subject: str
    value: float = 1.8


def run_of(station):
    return simulate(load_station(station, {"duration": 0.02}), progress=False)


def test_a_loop_that_walks_is_given_slower_steps_by_its_key():
    run = run_of("zjudancer_walking")
    said = "take slower steps: --set controllers.walk.gait.step_time=SECONDS"

    assert more_time_for_speed(run, Worst("left_knee")).text == said

    load_station("zjudancer_walking", {"controllers.walk.gait.step_time": 0.4})  # the key is taken


def test_a_joint_of_no_leg_is_not_given_other_steps():
    run = run_of("zjudancer_walking")
    for axis in ("neck_yaw", "left_shoulder_pitch"):
        assert "step" not in more_time_for_speed(run, Worst(axis)).text


@pytest.mark.parametrize(("did", "has_steps"), [("walk", True), ("", False)])
def test_options_of_a_planned_walk_are_named_only_after_a_move(did, has_steps):
    run = replace(run_of("zjudancer_dynamic"), did=did)
    text = more_time_for_speed(run, Worst("right_ankle_pitch")).text

    assert ("--amplitude 0.5" in text) == has_steps
    assert ("--step-time" in text) == has_steps
