"""States between steps: exact at step ends, cubic for positions, straight for velocities, held for discrete values."""

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.results.record.history import PlantSlice, StateHistory

TIMES = np.array([0.0, 0.1, 0.4, 1.0])
PLANT = PlantSlice(positions=slice(1, 2), velocities=slice(2, 3))


def cubic(t):
    return 1 + 2 * t - 3 * t**2 + 0.5 * t**3, 2 - 6 * t + 1.5 * t**2


@pytest.fixture
def history():
    """One other state (5 t), then a plant whose position follows a cubic."""
    position, velocity = cubic(TIMES)
    return StateHistory(
        TIMES,
        np.column_stack([5 * TIMES, position, velocity]),
        [np.array([[0.0], [1.0], [2.0], [3.0]])],
    )


def rates(states):
    return states[:, [2]]


def test_positions_follow_the_cubic_that_the_rates_give(history):
    """Between steps, positions are a cubic Hermite spline; all other values are linear."""
    times = np.linspace(0, 1, 57)
    states = history.at(times, PLANT, rates)

    np.testing.assert_allclose(states.continuous[:, 1], cubic(times)[0], atol=1e-14)
    np.testing.assert_allclose(states.continuous[:, 0], 5 * times, atol=1e-14)
    np.testing.assert_allclose(
        states.continuous[:, 2], np.interp(times, TIMES, cubic(TIMES)[1]), atol=1e-14
    )


def test_step_ends_are_exact(history):
    """The interpolated states at the ends of the steps equal the recorded ones to the last bit."""
    np.testing.assert_array_equal(history.at(TIMES, PLANT, rates).continuous, history.continuous)


@pytest.mark.parametrize("time", [-0.1, 1.1, np.nan])
def test_of_times_outside_of_the_run_nothing_is_known(history, time):
    """A time outside of the run, or NaN, raises an error with the time and the range of the run."""
    with pytest.raises(
        InvalidParameter, match=r"time is -?[\d.nan]+ s; it must be within the run, 0 to 1 s"
    ):
        history.at(np.array([0.5, time]), PLANT, rates)


def test_discrete_values_are_those_held_over_the_step_that_ended_there(history):
    """Discrete values within a step are those at its end."""
    states = history.at(np.array([0.0, 0.05, 0.1, 0.11, 0.4, 0.9]), PLANT, rates)
    np.testing.assert_array_equal(states.discrete[0][:, 0], [0, 1, 1, 2, 2, 3])


def test_steps_are_their_ends_at_the_times_of_their_starts(history):
    """`steps` gives the state at the end of the step of each time, with the time at which the step begins."""
    steps = history.steps(np.array([0.0, 0.05, 0.1, 0.11, 0.4, 0.9, 1.0]))

    np.testing.assert_array_equal(steps.times, [0.0, 0.0, 0.0, 0.1, 0.1, 0.4, 0.4])
    np.testing.assert_array_equal(steps.continuous, history.continuous[[0, 1, 1, 2, 2, 3, 3]])
    np.testing.assert_array_equal(steps.discrete[0][:, 0], [0, 1, 1, 2, 2, 3, 3])


def test_a_history_can_be_continued_from_an_earlier_state(history):
    """`with_end` drops the rows from the first time of the new end on, and appends the new rows."""
    other = StateHistory(np.array([0.25, 0.3]), np.zeros((2, 3)), [np.array([[7.0], [8.0]])])
    joined = history.with_end(other)

    np.testing.assert_array_equal(joined.times, [0, 0.1, 0.25, 0.3])
    np.testing.assert_array_equal(joined.discrete[0][:, 0], [0, 1, 7, 8])
    assert joined.last().end == 0.3
