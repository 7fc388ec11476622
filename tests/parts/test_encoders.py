"""Encoders: against what they are told to get wrong, and no more."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError

RATE = 100


def moved(duration=1.0, **encoders):
    """Move the arm's joint 1 by 30 degrees while encoders look at it."""
    config = load_station(
        "irb120_dynamic",
        {
            "sensors": {"encoders": {"rate": RATE, **encoders}},
            "reference": {"kind": "ramp", "target_deg": {"joint_1": 30}, "duration": 1.0},
            "sample_rate": RATE,
        },
    )
    return simulate(config, duration=duration, progress=False)


def test_without_errors_they_tell_the_truth_and_its_differences():
    result = moved()
    true, told = result["q.joint_1"], result["position.encoders.joint_1"]
    assert told == pytest.approx(true, abs=1e-12)
    assert result["velocity.encoders.joint_1"][1:] == pytest.approx(np.diff(true) * RATE, abs=1e-9)


def test_they_round_to_their_resolution():
    result = moved(resolution_deg=0.5)
    true, told = np.rad2deg(result["q.joint_1"]), np.rad2deg(result["position.encoders.joint_1"])
    assert told == pytest.approx(np.round(told / 0.5) * 0.5, abs=1e-9)
    assert abs(told - true).max() == pytest.approx(0.25, abs=0.05)


def test_noise_is_as_large_as_asked_and_the_same_for_a_seed():
    one, other = moved(noise_deg=0.1, seed=1), moved(noise_deg=0.1, seed=2)
    errors = np.rad2deg(
        [one[f"position.encoders.joint_{k}"] - one[f"q.joint_{k}"] for k in range(1, 7)]
    )
    assert errors.std() == pytest.approx(0.1, rel=0.1)  # 606 figures: 3 % of one sigma
    assert (moved(noise_deg=0.1, seed=1).values == one.values).all()
    assert (other["position.encoders.joint_1"] != one["position.encoders.joint_1"]).all()


@pytest.mark.parametrize("in_loop", [False, True])
def test_a_delay_tells_what_was(in_loop):
    result = moved(delay=0.03, in_loop=in_loop)
    true, told = result["q.joint_1"], result["position.encoders.joint_1"]
    # in a run's sample at the time of an encoder's, the encoder's last one stands
    lag = 3 + in_loop
    assert told[10:] == pytest.approx(true[10 - lag : len(true) - lag], abs=1e-12)
    assert told[:3] == pytest.approx(np.zeros(3), abs=1e-12)


def test_smoothing_is_a_low_pass_of_its_time_constant():
    result = moved(smoothing=0.09)
    raw, share = np.diff(result["q.joint_1"]) * RATE, 0.01 / 0.1
    expected = np.zeros(len(raw) + 1)
    for k, speed in enumerate(raw):
        expected[k + 1] = expected[k] + share * (speed - expected[k])
    assert result["velocity.encoders.joint_1"] == pytest.approx(expected, abs=1e-9)


@pytest.mark.long
def test_a_loop_makes_its_sensor_sample_while_stepping():
    cells = [
        {"targets_deg": {"joint_5": 20}, "duration": 0.2},
        {"targets_deg": {"joint_5": 0}, "duration": 0.2},
    ]
    loop = {
        "kind": "sequencer",
        "cells": cells,
        "reads": {"position": "encoders", "velocity": "encoders"},
    }
    config = load_station(
        "irb120_dynamic", {"sensors": {"encoders": {"delay": 0.05}}, "controllers": {"s": loop}}
    )
    late = simulate(config, duration=1.5, progress=False)
    true = load_station("irb120_dynamic", {"controllers": {"s": {**loop, "reads": {}}}})
    at_once = simulate(true, duration=1.5, progress=False)
    ends = [result.times[np.argmax(result["s.done"] > 0)] for result in (late, at_once)]
    assert 0.05 < ends[0] - ends[1] < 0.2


@pytest.mark.parametrize(
    "wrong", [{"resolution_deg": -1}, {"delay": -0.1}, {"robot": "left"}, {"noise": 1}]
)
def test_what_cannot_be_is_refused(wrong):
    with pytest.raises(SimrobError, match=next(iter(wrong)) if "robot" not in wrong else "left"):
        moved(**wrong)
