"""Laws of time that cruise, against their closed forms."""

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.blocks.cruise import TimeLaw, cruise, cruise_in, cruise_to, smooth_law
from simrob_drake.blocks.references import smooth


def ends(law: TimeLaw, order: int) -> np.ndarray:
    """Return a derivative at the beginning and the end of each polynomial, shape (k, 2)."""
    return np.array([law.at(law.breaks[k : k + 2], k, order) for k in range(len(law.coefficients))])


def test_a_trapezoid_speeds_up_cruises_and_slows_down() -> None:
    length, speed, push = 1.2, 0.8, 2.0
    law = cruise(length, speed, push, np.inf)
    assert law.duration == pytest.approx(length / speed + speed / push)
    np.testing.assert_allclose(np.diff(law.breaks), [speed / push, length / speed - speed / push, speed / push])
    np.testing.assert_allclose(ends(law, 1), [[0, speed], [speed, speed], [speed, 0]], atol=1e-12)
    np.testing.assert_allclose(ends(law, 2), [[push, push], [0, 0], [-push, -push]], atol=1e-12)
    np.testing.assert_allclose(ends(law, 0)[[0, -1], [0, 1]], [0, length], atol=1e-12)


def test_a_way_too_short_for_the_speed_is_a_triangle() -> None:
    law = cruise(0.1, 5.0, 2.0, np.inf)
    assert law.duration == pytest.approx(2 * np.sqrt(0.1 / 2.0))
    assert ends(law, 1).max() == pytest.approx(np.sqrt(0.1 * 2.0))


def test_an_s_curve_takes_its_jerk_time_longer() -> None:
    length, speed, push, jerk = 1.2, 0.8, 2.0, 10.0
    law = cruise(length, speed, push, jerk)
    assert law.duration == pytest.approx(length / speed + speed / push + push / jerk)
    assert ends(law, 1).max() == pytest.approx(speed)
    assert ends(law, 2).max() == pytest.approx(push)
    np.testing.assert_allclose(ends(law, 3)[:, 0], [jerk, 0, -jerk, 0, -jerk, 0, jerk], atol=1e-9)


@pytest.mark.parametrize(
    ("length", "speed", "push", "jerk", "duration"),
    [
        (0.5, 9.0, 2.0, 10.0, None),  # the speed is not reached: v² / a + v a / j = L
        (0.01, 9.0, 9.0, 10.0, 4 * np.cbrt(0.01 / (2 * 10.0))),  # nor the acceleration: four equal jerks
        (1.0, 0.1, 9.0, 10.0, 1.0 / 0.1 + 2 * np.sqrt(0.1 / 10.0)),  # the speed, but not the acceleration
    ],
)
def test_what_is_not_reached_on_a_short_way(length: float, speed: float, push: float, jerk: float, duration) -> None:
    law = cruise(length, speed, push, jerk)
    if duration is None:
        top = ends(law, 1).max()
        assert top**2 / push + top * push / jerk == pytest.approx(length)
        duration = length / top + top / push + push / jerk
    assert law.duration == pytest.approx(duration)


def test_laws_of_any_figures_keep_them_and_go_on_without_a_jump() -> None:
    random = np.random.default_rng(5)
    for case in range(300):
        length, speed, push = 10 ** random.uniform(-2, 1, 3)
        jerk = [np.inf, None, 10 ** random.uniform(-1, 3)][case % 3]
        law = cruise(length, speed, push, jerk)
        for order, scale in enumerate((length, speed, push)[: 2 if jerk == np.inf else 3]):
            values = ends(law, order)
            np.testing.assert_allclose(values[1:, 0], values[:-1, 1], atol=1e-5 * scale)
            outer = [0.0, length if order == 0 else 0.0]
            np.testing.assert_allclose(values[[0, -1], [0, 1]], outer, atol=1e-5 * scale)
        assert ends(law, 1).max() <= speed * (1 + 1e-6)
        assert np.abs(ends(law, 2)).max() <= push * (1 + 1e-6)
        reached = [np.isclose(np.abs(ends(law, order)).max(), top, rtol=1e-5) for order, top in ((1, speed), (2, push))]
        assert any(reached) or (
            jerk is not None and np.isclose(np.abs(ends(law, 3)).max(), jerk)
        )  # else not the shortest


def test_a_law_of_a_given_time_speeds_up_for_a_quarter_of_it() -> None:
    flat, rounded = cruise_in(2.0, rounded=False), cruise_in(2.0, rounded=True)
    np.testing.assert_allclose(flat.breaks, [0, 0.5, 1.5, 2.0])
    np.testing.assert_allclose(rounded.breaks, [0, 1 / 6, 1 / 3, 0.5, 1.5, 5 / 3, 11 / 6, 2.0])
    for law in (flat, rounded):
        assert ends(law, 0)[-1, 1] == pytest.approx(1.0)
        assert law.slower(1.5).duration == pytest.approx(3.0)
        np.testing.assert_allclose(ends(law.slower(1.5), 1), ends(law, 1) / 1.5, atol=1e-12)
        even = len(law.coefficients) // 2  # its polynomial in the middle
        at = law.times_of(np.array([0.25, 0.5, 1.0]))
        assert at[1:] == pytest.approx([1.0, 2.0])
        assert law.at(at[0], even) == pytest.approx(0.25)


def test_the_smooth_law_is_that_of_moves() -> None:
    times = np.linspace(0, 1.7, 9)
    np.testing.assert_allclose(smooth_law(1.7).at(times, 0), smooth(times / 1.7), atol=1e-12)


START, TARGET = np.array([0.1, -0.2, 0.3]), np.array([1.1, -0.5, 0.3])
SPEEDS, PUSHES = np.array([2.0, 0.5, 1.0]), np.array([4.0, 6.0, 1.0])


def test_axes_go_straight_and_arrive_together_at_the_limit_of_one() -> None:
    reference = cruise_to(START, TARGET, SPEEDS, PUSHES, np.full(3, np.inf), start_time=0.5)
    shares = np.abs(TARGET - START)[:2]
    speed, push = (SPEEDS[:2] / shares).min(), (PUSHES[:2] / shares).min()  # of the way from 0 to 1
    assert reference.start_time() == 0.5
    assert reference.end_time() - 0.5 == pytest.approx(1 / speed + speed / push)
    times = np.linspace(0.5, reference.end_time(), 500)
    q, v, a = (reference.MakeDerivative(order).vector_values(times).T for order in range(3))
    parts = (q[:, 0] - START[0]) / (TARGET - START)[0]
    np.testing.assert_allclose(q, START + np.outer(parts, TARGET - START), atol=1e-12)
    np.testing.assert_allclose(q[-1], TARGET, atol=1e-12)
    assert np.abs(v[:, 1]).max() == pytest.approx(0.5)  # the second axis is the slowest for its way
    assert np.abs(a[:, 0]).max() == pytest.approx(4.0)  # and the first has the least acceleration
    assert (np.abs(v).max(axis=0) <= SPEEDS + 1e-9).all()
    assert (np.abs(a).max(axis=0) <= PUSHES + 1e-9).all()


def test_an_s_curve_of_axes_keeps_their_jerks() -> None:
    reference = cruise_to(START, TARGET, SPEEDS, PUSHES, np.array([30.0, 20.0, 1.0]))
    times = np.linspace(0, reference.end_time(), 2000)
    jerks = np.abs(reference.MakeDerivative(3).vector_values(times)).max(axis=1)
    assert (jerks <= [30.0 + 1e-6, 20.0 + 1e-6, 1e-12]).all()
    assert np.isclose(jerks[:2], [30.0, 20.0]).any()


def test_no_way_takes_no_time_and_no_limit_no_time_that_cannot_be_told() -> None:
    assert cruise_to(START, START, SPEEDS, PUSHES).value(3.0).ravel() == pytest.approx(START)
    for jerk in (np.inf, None, 1e300):
        law = cruise(1.0, 1e300, 1e300, jerk)
        assert 1e-4 < law.duration < 1e-3
        np.testing.assert_allclose(ends(law, 0)[[0, -1], [0, 1]], [0, 1], atol=1e-9)
        np.testing.assert_allclose(ends(law, 1)[[0, -1], [0, 1]], 0, atol=1e-9 * np.abs(ends(law, 1)).max())


@pytest.mark.parametrize("limits", [(1e-300, 1.0, 1.0), (1.0, 1e-300, None), (1.0, 1.0, 1e-300)])
def test_what_would_take_for_ever_is_refused(limits) -> None:
    with pytest.raises(InvalidParameter, match=r"the time of the motion is .*limits are too low"):
        cruise(1.0, *limits)
