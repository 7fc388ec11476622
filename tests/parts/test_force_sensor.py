"""Errors of force sensors: resolution, noise and delay."""

from typing import NamedTuple

import numpy as np
import pytest

from simrob_drake import SimulationResult, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector

RATE = 100
TIPPING = {
    "pieces.box.pose": [0, 0, 0.112, 0, 0.3, 0],
    "sensors.true": {"kind": "force", "body": "box"},
}


class Measured(NamedTuple):
    """Run of a box that rocks on its corners, with wrenches (m, 6) [N, N·m] of two sensors.

    Attributes:
        result: the run.
        wrench: wrench of the sensor with errors.
        true_wrench: wrench of a sensor without errors.
    """

    result: SimulationResult
    wrench: Vector
    true_wrench: Vector


def measure(duration=1.0, **errors):
    """Run the box, with errors of the first sensor by their keys."""
    overrides = {
        **TIPPING,
        "sensors.floor": {"kind": "force", "body": "box", "rate": RATE, **errors},
        "sensors.true": {**TIPPING["sensors.true"], "rate": RATE},
        "sample_rate": RATE,
        "duration": duration,
    }
    result = simulate(load_station("box_on_floor", overrides), progress=False)

    def wrench_of(sensor):
        return np.hstack([result.vector(f"force.{sensor}"), result.vector(f"moment.{sensor}")])

    return Measured(result=result, wrench=wrench_of("floor"), true_wrench=wrench_of("true"))


def test_values_are_rounded_to_the_resolutions():
    measured = measure(resolution=2.0, moment_resolution=0.05)

    steps = np.repeat([2.0, 0.05], 3)
    rounded = np.round(measured.true_wrench / steps) * steps
    assert measured.wrench == pytest.approx(rounded, abs=1e-9)
    assert np.ptp(measured.true_wrench[:, 2]) > 10


def test_noise_has_the_given_size_and_is_the_same_for_a_seed():
    noise = {"noise": 0.5, "moment_noise": 0.01}

    measured = measure(**noise, seed=1)
    again = measure(**noise, seed=1)
    other = measure(**noise, seed=2)

    errors = measured.wrench - measured.true_wrench
    # The standard deviation of 303 values has itself one of 4 %, the mean of 101 values one of 0.1 sigma.
    assert errors[:, :3].std() == pytest.approx(0.5, rel=0.15)
    assert errors[:, 3:].std() == pytest.approx(0.01, rel=0.15)
    assert abs(errors.mean(axis=0) / np.repeat([0.5, 0.01], 3)).max() < 0.35
    assert (again.result.values == measured.result.values).all()
    assert (other.wrench != measured.wrench).all()


def test_a_delay_gives_values_of_earlier_samples():
    measured = measure(delay=0.03)

    first_value = measured.true_wrench[0]
    assert measured.wrench[10:] == pytest.approx(measured.true_wrench[7:-3], abs=1e-12)
    assert measured.wrench[:3] == pytest.approx(np.tile(first_value, (3, 1)), abs=1e-12)


def test_a_sensor_with_errors_needs_a_rate():
    with pytest.raises(SimrobError, match="needs a rate"):
        load_station("box_on_floor", {"sensors.floor.noise": 1})
    with pytest.raises(SimrobError, match=r"sensors\.floor\.delay"):
        load_station("box_on_floor", {"sensors.floor.rate": 100, "sensors.floor.delay": -1})
