"""Monitor of mechanical power: against its equation, a closed form and the signals of a run."""

import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.stations.resolve import resolve

# Values of the double pendulum's station and URDF.
GRAVITY = 9.81  # m/s²
UPPER_MASS = 0.01596350  # kg
UPPER_CENTRE = 0.07516596  # m, from the joint
LOWER_MASS = 0.02635619  # kg
LENGTH = 0.14  # m, between the joints
DAMPING = 0.01  # N·m·s/rad, of each joint


@pytest.mark.parametrize(
    ("torque", "velocity", "power"),
    [
        ([3, -2], [2, 5], 16),
        ([3, 2], [-2, 5], 16),
        ([0, 50], [9, 0], 0),
        ([1, 1], [np.nan, 0], np.inf),
    ],
)
def test_the_power_is_the_sum_of_absolute_values(torque, velocity, power):
    """Braking counts as driving, and a velocity that is not a number as an infinite power."""
    config = load_station("double_pendulum", {"monitors.power_limit": {"limit": 10, "hold": 0.5}})

    condition = config.monitors["power_limit"].condition("power_limit", resolve(config))

    values = (np.array(torque, dtype=float), np.array(velocity, dtype=float))
    assert condition.watched == {"torque": 2, "velocity": 2}
    assert condition.excess(*values) == power - 10
    message = "the power of the joints of robot reached the limit of 10 W for 0.5 s"
    assert condition.why(*values) == message


def test_a_run_ends_when_lifting_and_damping_need_the_power():
    """The upper link turns at a constant speed w, and the lower one hangs.

    At the angle q, the power is w g (m_1 c + m_2 l) sin(q) for lifting and 2 d w² for the dampers of the joints.
    """
    speed = 2.0  # rad/s
    limit = 0.15  # W
    overrides = {"mode": "kinematic", "monitors.power_limit": {"limit": limit}}
    motion = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], [[0.0, speed], [0.0, -speed]])

    result = simulate(load_station("double_pendulum", overrides), reference=motion, duration=0.75)

    largest_lifting = speed * GRAVITY * (UPPER_MASS * UPPER_CENTRE + LOWER_MASS * LENGTH)
    angle = np.arcsin((limit - 2 * DAMPING * speed**2) / largest_lifting)
    assert result.stopped_by == "power_limit"
    assert result.stop_time == pytest.approx(angle / speed, abs=1e-3)
    reason = "the power of the joints of robot reached the limit of 0.15 W"
    assert result.message == f"{reason}, at {result.stop_time:.4g} s"


@pytest.mark.long
@pytest.mark.parametrize("hold", [0.0, 0.05])
def test_a_run_ends_when_the_recorded_power_has_exceeded_the_limit(hold):
    free = simulate(load_station("irb120_dynamic", {"sample_rate": 1000}))
    power = np.abs(free.axes("tau") * free.axes("v")).sum(axis=1)
    limit = 0.5 * float(power.max())
    is_above = power > limit
    onset = free.times[np.argmax(is_above)]
    assert onset > 0
    assert is_above[(free.times >= onset) & (free.times <= onset + hold)].all()

    monitors = {"monitors.power_limit": {"limit": limit, "hold": hold}}
    result = simulate(load_station("irb120_dynamic", monitors))

    assert result.stopped_by == "power_limit"
    # One tolerance of a sample each for the end of the run and for the onset.
    assert result.stop_time == pytest.approx(onset + hold, abs=1e-3 + 1e-3)


@pytest.mark.parametrize("limit", [0, -5, float("nan")])
def test_an_invalid_limit_is_refused(limit):
    with pytest.raises(SimrobError, match=r"monitors\.power_limit\.limit: "):
        load_station("irb120_dynamic", {"monitors.power_limit": {"limit": limit}})


def test_a_missing_limit_is_refused():
    with pytest.raises(SimrobError, match=r"monitors\.power_limit\.limit: this key is required"):
        load_station("irb120_dynamic", {"monitors.power_limit": {}})
