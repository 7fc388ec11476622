"""Encoders: resolution, noise, delay and smoothing of their values."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError

RATE = 100


def measure(duration=1.0, **encoders):
    """Run an arm whose joint 1 moves by 30 degrees, with encoders."""
    config = load_station(
        "irb120_dynamic",
        {
            "sensors": {"encoders": {"rate": RATE, **encoders}},
            "reference": {"kind": "ramp", "target_deg": {"joint_1": 30}, "duration": 1.0},
            "sample_rate": RATE,
        },
    )
    return simulate(config, duration=duration, progress=False)


def test_without_errors_they_measure_the_positions_and_their_differences():
    result = measure()

    true = result["q.joint_1"]
    assert result["position.encoders.joint_1"] == pytest.approx(true, abs=1e-12)
    assert result["velocity.encoders.joint_1"][1:] == pytest.approx(np.diff(true) * RATE, abs=1e-9)


def test_positions_are_rounded_to_the_resolution():
    result = measure(resolution_deg=0.5)

    true = np.rad2deg(result["q.joint_1"])
    measured = np.rad2deg(result["position.encoders.joint_1"])
    assert measured == pytest.approx(np.round(measured / 0.5) * 0.5, abs=1e-9)
    assert abs(measured - true).max() == pytest.approx(0.25, abs=0.05)


def test_noise_has_the_given_size_and_is_the_same_for_a_seed():
    result = measure(noise_deg=0.1, seed=1)
    again = measure(noise_deg=0.1, seed=1)
    other = measure(noise_deg=0.1, seed=2)

    joints = [f"joint_{number}" for number in range(1, 7)]
    errors = np.rad2deg(
        [result[f"position.encoders.{name}"] - result[f"q.{name}"] for name in joints]
    )
    # The standard deviation of 606 values has itself one of 3 %.
    assert errors.std() == pytest.approx(0.1, rel=0.1)
    assert (again.values == result.values).all()
    assert (other["position.encoders.joint_1"] != result["position.encoders.joint_1"]).all()


@pytest.mark.parametrize("in_loop", [False, True])
def test_a_delay_gives_positions_of_earlier_samples(in_loop):
    result = measure(delay=0.03, in_loop=in_loop)

    true = result["q.joint_1"]
    measured = result["position.encoders.joint_1"]
    # A block in the loop is recorded before it takes the sample of the same time.
    lag = 3 + in_loop
    assert measured[10:] == pytest.approx(true[10 - lag : len(true) - lag], abs=1e-12)
    assert measured[:3] == pytest.approx(np.zeros(3), abs=1e-12)


def test_smoothing_is_a_low_pass_filter_of_its_time_constant():
    """With the period T and the time constant T_s, each sample adds T / (T + T_s) of the remaining difference."""
    result = measure(smoothing=0.09)

    speeds = np.diff(result["q.joint_1"]) * RATE
    share = 0.01 / (0.01 + 0.09)
    expected = np.zeros(len(speeds) + 1)
    for index, speed in enumerate(speeds):
        expected[index + 1] = expected[index] + share * (speed - expected[index])
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
    delayed = {"sensors": {"encoders": {"delay": 0.05}}, "controllers": {"s": loop}}
    true_state = {"controllers": {"s": {**loop, "reads": {}}}}

    with_delay = simulate(load_station("irb120_dynamic", delayed), duration=1.5, progress=False)
    without = simulate(load_station("irb120_dynamic", true_state), duration=1.5, progress=False)

    # The sequencer waits at each of its two cells for the delayed measurement.
    end_with_delay = with_delay.times[np.argmax(with_delay["s.done"] > 0)]
    end_without = without.times[np.argmax(without["s.done"] > 0)]
    assert 0.05 < end_with_delay - end_without < 0.2


@pytest.mark.parametrize(
    ("encoders", "message"),
    [
        ({"resolution_deg": -1}, "resolution_deg"),
        ({"delay": -0.1}, "delay"),
        ({"robot": "left"}, "left"),
        ({"noise": 1}, "noise"),
    ],
)
def test_an_invalid_section_is_refused_with_its_cause(encoders, message):
    with pytest.raises(SimrobError, match=message):
        measure(**encoders)
