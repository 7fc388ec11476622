"""The inverted pendulum against its equation and its closed form."""

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.programs.gaits.zmp import com_from_zmp

STEP, HEIGHT, GRAVITY = 0.002, 0.25, 9.80665
RATE = np.sqrt(GRAVITY / HEIGHT)
TIMES = np.arange(0, 8, STEP)


def test_it_has_the_zero_moment_point_that_was_asked_for():
    wanted = np.column_stack([0.1 * TIMES, 0.03 * np.sign(np.sin(8 * TIMES))])
    com = com_from_zmp(wanted, step=STEP, height=HEIGHT)

    acceleration = (com[2:] - 2 * com[1:-1] + com[:-2]) / STEP**2
    np.testing.assert_allclose(com[1:-1] - HEIGHT / GRAVITY * acceleration, wanted[1:-1], atol=1e-9)


def test_it_answers_a_step_before_and_after_as_the_closed_form():
    """For p = 0 before t0 and 1 after it the bounded solution is exp(w (t - t0)) / 2, and 1 - exp(-w (t - t0)) / 2."""
    since = TIMES - 4.0
    com = com_from_zmp((since >= 0).astype(float)[:, np.newaxis], step=STEP, height=HEIGHT)[:, 0]

    exact = np.where(
        since < 0,
        np.exp(RATE * np.minimum(since, 0)) / 2,
        1 - np.exp(-RATE * np.maximum(since, 0)) / 2,
    )
    np.testing.assert_allclose(com, exact, atol=RATE * STEP)  # the jump lies between two samples


def test_a_sine_comes_back_smaller_by_the_pendulum():
    """For p = sin(a t) the solution is c = sin(a t) / (1 + a² z / g)."""
    wanted = np.sin(5 * TIMES)
    com = com_from_zmp(wanted[:, np.newaxis], step=STEP, height=HEIGHT)[:, 0]

    middle = (TIMES > 2) & (TIMES < 6)
    np.testing.assert_allclose(com[middle], wanted[middle] / (1 + 25 / RATE**2), atol=2e-5)


@pytest.mark.parametrize(
    "wrong", [{"height": 0.0}, {"height": np.nan}, {"step": -1.0}, {"gravity": 0.0}]
)
def test_figures_must_be_positive(wrong):
    with pytest.raises(InvalidParameter, match=next(iter(wrong))):
        com_from_zmp(np.zeros((5, 1)), **{"step": 0.01, "height": 0.2, **wrong})


def test_two_samples_are_too_few():
    with pytest.raises(InvalidParameter, match="zmp"):
        com_from_zmp(np.zeros((2, 1)), step=0.01, height=0.2)
