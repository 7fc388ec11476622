"""Laws of time that cruise, against their closed forms."""

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.blocks.cruise import TimeLaw, cruise, cruise_in, cruise_to, smooth_law
from simrob_drake.blocks.references import smooth


def ends(law: TimeLaw, order: int) -> np.ndarray:
    """A derivative at the beginning and the end of each polynomial, shape (k, 2)."""
    values = []
    for piece in range(len(law.coefficients)):
        begin_and_end = law.breaks[piece : piece + 2]
        values.append(law.at(begin_and_end, piece, order))
    return np.array(values)


def test_a_trapezoid_speeds_up_cruises_and_slows_down() -> None:
    """A trapezoid has ramps of v / a around a constant speed, and takes L / v + v / a."""
    length = 1.2
    speed = 0.8
    push = 2.0

    law = cruise(length, speed, push, np.inf)

    ramp = speed / push
    assert law.duration == pytest.approx(length / speed + ramp)
    np.testing.assert_allclose(np.diff(law.breaks), [ramp, length / speed - ramp, ramp])
    np.testing.assert_allclose(ends(law, 1), [[0, speed], [speed, speed], [speed, 0]], atol=1e-12)
    np.testing.assert_allclose(ends(law, 2), [[push, push], [0, 0], [-push, -push]], atol=1e-12)
    np.testing.assert_allclose(ends(law, 0)[[0, -1], [0, 1]], [0, length], atol=1e-12)


def test_a_way_too_short_for_the_speed_is_a_triangle() -> None:
    """On a path shorter than v² / a, the speed sqrt(L a) is reached for an instant."""
    length = 0.1
    push = 2.0

    law = cruise(length, 5.0, push, np.inf)

    assert law.duration == pytest.approx(2 * np.sqrt(length / push))
    assert ends(law, 1).max() == pytest.approx(np.sqrt(length * push))


def test_an_s_curve_takes_its_jerk_time_longer() -> None:
    """An S-curve takes L / v + v / a + a / j, and has the jerk j in four of its seven pieces."""
    length = 1.2
    speed = 0.8
    push = 2.0
    jerk = 10.0

    law = cruise(length, speed, push, jerk)

    assert law.duration == pytest.approx(length / speed + speed / push + push / jerk)
    assert ends(law, 1).max() == pytest.approx(speed)
    assert ends(law, 2).max() == pytest.approx(push)
    np.testing.assert_allclose(ends(law, 3)[:, 0], [jerk, 0, -jerk, 0, -jerk, 0, jerk], atol=1e-9)


@pytest.mark.parametrize(
    ("length", "speed", "push", "jerk", "duration"),
    [
        (0.5, 9.0, 2.0, 10.0, None),  # the speed is not reached: v² / a + v a / j = L
        # nor the acceleration: four equal jerks
        (
            0.01,
            9.0,
            9.0,
            10.0,
            4 * np.cbrt(0.01 / (2 * 10.0)),
        ),
        # the speed, but not the acceleration
        (
            1.0,
            0.1,
            9.0,
            10.0,
            1.0 / 0.1 + 2 * np.sqrt(0.1 / 10.0),
        ),
    ],
)
def test_what_is_not_reached_on_a_short_way(
    length: float, speed: float, push: float, jerk: float, duration: float | None
) -> None:
    """The duration follows from the limits that are reached. If it is None, it is that of the first case's equation."""
    law = cruise(length, speed, push, jerk)

    if duration is None:
        top = ends(law, 1).max()
        assert top**2 / push + top * push / jerk == pytest.approx(length)
        duration = length / top + top / push + push / jerk
    assert law.duration == pytest.approx(duration)


def outer_ends(law: TimeLaw, order: int) -> np.ndarray:
    """A derivative at the beginning and the end of the whole motion, shape (2,)."""
    return ends(law, order)[[0, -1], [0, 1]]


def largest(law: TimeLaw, order: int) -> float:
    """Largest absolute value of a derivative at the ends of the polynomials."""
    return float(np.abs(ends(law, order)).max())


def test_laws_of_any_limits_keep_them_and_go_on_without_a_jump() -> None:
    """Laws for random limits begin and end at rest, join their pieces, and reach at least one of the limits."""
    random = np.random.default_rng(5)
    for case in range(300):
        length, speed, push = 10 ** random.uniform(-2, 1, 3)
        jerk = [np.inf, None, 10 ** random.uniform(-1, 3)][case % 3]
        law = cruise(length, speed, push, jerk)

        scales = [length, speed, push]
        if jerk == np.inf:
            scales = [length, speed]  # the acceleration of a trapezoid jumps
        for order, scale in enumerate(scales):
            values = ends(law, order)
            np.testing.assert_allclose(values[1:, 0], values[:-1, 1], atol=1e-5 * scale)
            at_end = length if order == 0 else 0.0
            np.testing.assert_allclose(outer_ends(law, order), [0.0, at_end], atol=1e-5 * scale)
        assert ends(law, 1).max() <= speed * (1 + 1e-6)
        assert largest(law, 2) <= push * (1 + 1e-6)
        # A law that reaches no limit is not the shortest one.
        reaches_speed = np.isclose(largest(law, 1), speed, rtol=1e-5)
        reaches_push = np.isclose(largest(law, 2), push, rtol=1e-5)
        reaches_jerk = jerk is not None and np.isclose(largest(law, 3), jerk)
        assert reaches_speed or reaches_push or reaches_jerk


@pytest.mark.parametrize(
    ("rounded", "breaks"),
    [
        (False, [0, 0.5, 1.5, 2.0]),
        (True, [0, 1 / 6, 1 / 3, 0.5, 1.5, 5 / 3, 11 / 6, 2.0]),  # a ramp has three equal parts
    ],
)
def test_a_law_of_a_given_time_speeds_up_for_a_quarter_of_it(
    rounded: bool, breaks: list[float]
) -> None:
    """A motion of 2 s has ramps of 0.5 s, and covers half of its path in half of the time."""
    law = cruise_in(2.0, rounded=rounded)

    np.testing.assert_allclose(law.breaks, breaks)
    assert ends(law, 0)[-1, 1] == pytest.approx(1.0)
    times = law.times_of(np.array([0.25, 0.5, 1.0]))
    assert times[1:] == pytest.approx([1.0, 2.0])
    middle_piece = len(law.coefficients) // 2
    assert law.at(times[0], middle_piece) == pytest.approx(0.25)


@pytest.mark.parametrize("rounded", [False, True])
def test_a_slower_law_takes_longer_at_a_lower_speed(rounded: bool) -> None:
    """A law that is slower by a factor takes the factor longer, with the speeds divided by it."""
    factor = 1.5
    law = cruise_in(2.0, rounded=rounded)

    slower = law.slower(factor)

    assert slower.duration == pytest.approx(3.0)
    np.testing.assert_allclose(ends(slower, 1), ends(law, 1) / factor, atol=1e-12)


def test_the_smooth_law_is_that_of_moves() -> None:
    times = np.linspace(0, 1.7, 9)
    np.testing.assert_allclose(smooth_law(1.7).at(times, 0), smooth(times / 1.7), atol=1e-12)


# A motion of three axes, of which the third one rests.
START = np.array([0.1, -0.2, 0.3])
TARGET = np.array([1.1, -0.5, 0.3])
WAY = TARGET - START
SPEEDS = np.array([2.0, 0.5, 1.0])
PUSHES = np.array([4.0, 6.0, 1.0])  # largest accelerations


def test_axes_go_straight_and_arrive_together_at_the_limit_of_one() -> None:
    """The second axis, the slowest for its way, limits the speed, and the first one the acceleration."""
    begin = 0.5

    reference = cruise_to(START, TARGET, SPEEDS, PUSHES, np.full(3, np.inf), start_time=begin)

    # Speed and acceleration of the part of the way, from 0 to 1, that all axes have covered.
    lengths = np.abs(WAY)[:2]
    speed = (SPEEDS[:2] / lengths).min()
    push = (PUSHES[:2] / lengths).min()
    assert reference.start_time() == begin
    assert reference.end_time() - begin == pytest.approx(1 / speed + speed / push)
    times = np.linspace(begin, reference.end_time(), 500)
    positions, velocities, accelerations = (
        reference.MakeDerivative(order).vector_values(times).T for order in range(3)
    )
    parts = (positions[:, 0] - START[0]) / WAY[0]
    np.testing.assert_allclose(positions, START + np.outer(parts, WAY), atol=1e-12)
    np.testing.assert_allclose(positions[-1], TARGET, atol=1e-12)
    largest_speeds = np.abs(velocities).max(axis=0)
    largest_pushes = np.abs(accelerations).max(axis=0)
    assert largest_speeds[1] == pytest.approx(SPEEDS[1])
    assert largest_pushes[0] == pytest.approx(PUSHES[0])
    assert (largest_speeds <= SPEEDS + 1e-9).all()
    assert (largest_pushes <= PUSHES + 1e-9).all()


def test_an_s_curve_of_axes_keeps_their_jerks() -> None:
    reference = cruise_to(START, TARGET, SPEEDS, PUSHES, np.array([30.0, 20.0, 1.0]))

    times = np.linspace(0, reference.end_time(), 2000)
    jerks = np.abs(reference.MakeDerivative(3).vector_values(times)).max(axis=1)
    assert (jerks <= [30.0 + 1e-6, 20.0 + 1e-6, 1e-12]).all()
    assert np.isclose(jerks[:2], [30.0, 20.0]).any()


def test_a_motion_to_the_start_stays_there() -> None:
    reference = cruise_to(START, START, SPEEDS, PUSHES)

    assert reference.value(3.0).ravel() == pytest.approx(START)


@pytest.mark.parametrize("jerk", [np.inf, None, 1e300])
def test_enormous_limits_still_give_a_duration_that_can_be_computed_with(jerk) -> None:
    law = cruise(1.0, 1e300, 1e300, jerk)

    assert 1e-4 < law.duration < 1e-3
    np.testing.assert_allclose(outer_ends(law, 0), [0, 1], atol=1e-9)
    np.testing.assert_allclose(outer_ends(law, 1), 0, atol=1e-9 * largest(law, 1))


@pytest.mark.parametrize("limits", [(1e-300, 1.0, 1.0), (1.0, 1e-300, None), (1.0, 1.0, 1e-300)])
def test_a_motion_that_would_take_too_long_is_refused(limits) -> None:
    message = r"the time of the motion is .*; the limits of its speed, .* are too low"

    with pytest.raises(InvalidParameter, match=message):
        cruise(1.0, *limits)
