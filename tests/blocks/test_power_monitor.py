"""The monitor of mechanical power, against its equation, a closed form and the signals of a run."""

import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.stations.resolve import resolve

GRAVITY = 9.81  # m/s², the pendulum's station
UPPER = (
    0.01596350,
    0.07516596,
)  # mass [kg] and distance of its centre from the joint [m], of the pendulum's URDF
LOWER_MASS, LENGTH = 0.02635619, 0.14  # kg, m between the joints
DAMPING = 0.01  # N·m·s/rad, each joint


@pytest.mark.parametrize(
    ("torque", "velocity", "power"),
    [
        ([3, -2], [2, 5], 16),
        ([3, 2], [-2, 5], 16),
        ([0, 50], [9, 0], 0),
        ([1, 1], [np.nan, 0], np.inf),
    ],
)
def test_power_is_the_sum_of_sizes(torque, velocity, power):
    config = load_station("double_pendulum", {"monitors.power_limit": {"limit": 10, "hold": 0.5}})
    condition = config.monitors["power_limit"].condition("power_limit", resolve(config))
    values = np.array(torque, dtype=float), np.array(velocity, dtype=float)
    assert condition.watched == {"torque": 2, "velocity": 2}
    assert condition.excess(*values) == power - 10
    assert (
        condition.why(*values)
        == "the power of the joints of robot reached the limit of 10 W for 0.5 s"
    )


def test_a_run_ends_where_lifting_and_damping_take_the_power():
    """The upper link turns steadily and the lower one hangs, so power is lifting and twice damping; none is braking."""
    speed, limit = 2.0, 0.15  # rad/s, W
    lifting = speed * GRAVITY * (UPPER[0] * UPPER[1] + LOWER_MASS * LENGTH)
    angle = np.arcsin((limit - 2 * DAMPING * speed**2) / lifting)
    overrides = {"mode": "kinematic", "monitors.power_limit": {"limit": limit}}
    steadily = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], [[0.0, speed], [0.0, -speed]])
    result = simulate(load_station("double_pendulum", overrides), reference=steadily, duration=0.75)
    assert result.stopped_by == "power_limit"
    assert result.stop_time == pytest.approx(angle / speed, abs=1e-3)
    told = "the power of the joints of robot reached the limit of 0.15 W"
    assert result.message == f"{told}, at {result.stop_time:.4g} s"


@pytest.mark.long
@pytest.mark.parametrize("hold", [0.0, 0.05])
def test_a_move_ends_where_its_signals_say(hold):
    free = simulate(load_station("irb120_dynamic", {"sample_rate": 1000}))
    power = np.abs(free.axes("tau") * free.axes("v")).sum(axis=1)
    limit = 0.5 * float(power.max())
    above = power > limit
    onset = free.times[np.argmax(above)]
    assert onset > 0
    assert above[(free.times >= onset) & (free.times <= onset + hold)].all()
    monitors = {"monitors.power_limit": {"limit": limit, "hold": hold}}
    result = simulate(load_station("irb120_dynamic", monitors))
    assert result.stopped_by == "power_limit"
    # as it is cut, and as it was sampled
    assert result.stop_time == pytest.approx(onset + hold, abs=1e-3 + 1e-3)


def test_a_bound_that_bounds_nothing_is_refused():
    for bad in (0, -5, float("nan")):
        with pytest.raises(SimrobError, match=r"monitors\.power_limit\.limit: "):
            load_station("irb120_dynamic", {"monitors.power_limit": {"limit": bad}})
    with pytest.raises(SimrobError, match=r"monitors\.power_limit\.limit: this key is required"):
        load_station("irb120_dynamic", {"monitors.power_limit": {}})
