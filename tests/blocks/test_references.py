"""References against their polynomials: values, derivatives, corners and ends."""

import numpy as np
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import BsplineBasis
from pydrake.polynomial import Polynomial
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.trajectories import (
    BsplineTrajectory,
    CompositeTrajectory,
    PathParameterizedTrajectory,
    PiecewisePolynomial,
    PiecewiseQuaternionSlerp,
    Trajectory,
)
from scipy.interpolate import CubicSpline

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.blocks.monitor import EventTimes
from simrob_drake.blocks.references import (
    Reference,
    ReferenceSource,
    SineReference,
    add_reference,
    corner_times,
    hermite,
    hermite_samples,
    hold,
    interpolate_samples,
    later,
    move,
    ramp,
    reference_values,
    sequence,
)

START = np.array([0.1, -0.2, 0.0])
TARGET = np.array([1.1, 0.3, 0.0])


def value(trajectory: Trajectory, time: float, order: int = 0) -> np.ndarray:
    return trajectory.EvalDerivative(time, order).ravel()


def played(builder: DiagramBuilder, source: ReferenceSource) -> Diagram:
    for name in ("position", "velocity", "acceleration"):
        if getattr(source, name) is not None:
            builder.ExportOutput(getattr(source, name), name)
    return builder.Build()


def signal(diagram: Diagram, name: str, time: float) -> np.ndarray:
    context = diagram.CreateDefaultContext()
    context.SetTime(time)
    return diagram.GetOutputPort(name).Eval(context)


def test_a_hold_stays_where_it_is_and_has_no_corner() -> None:
    trajectory = hold(START)
    for time in (0.0, 1.0, 1e6):
        np.testing.assert_array_equal(value(trajectory, time), START)
    assert corner_times(trajectory) == []


def test_a_ramp_with_a_blend_gathers_speed_evenly_goes_on_and_slows_down() -> None:
    """The speed rises over the blend to distance / (duration - blend), stays, and falls in the same way."""
    begin = 0.5
    end = 2.5
    blend = 0.4

    trajectory = ramp(START, TARGET, duration=end - begin, start_time=begin, blend=blend)

    full_speed = (TARGET - START) / (end - begin - blend)
    for time in np.linspace(begin, end, 101):
        share = np.clip(min(time - begin, end - time) / blend, 0, 1)
        np.testing.assert_allclose(value(trajectory, time, order=1), share * full_speed, atol=1e-12)
    np.testing.assert_allclose(value(trajectory, begin), START, atol=1e-15)
    np.testing.assert_allclose(
        value(trajectory, (begin + end) / 2), (START + TARGET) / 2, atol=1e-12
    )
    np.testing.assert_allclose(value(trajectory, end + 0.5), TARGET, atol=1e-12)


@pytest.mark.parametrize("start_time", [0.0, 0.5])
def test_a_ramp_is_a_straight_line_with_two_corners(start_time: float) -> None:
    trajectory = ramp(START, TARGET, duration=2.0, start_time=start_time)

    for part in (0.0, 0.25, 0.5, 1.0):
        expected = START + part * (TARGET - START)
        np.testing.assert_allclose(value(trajectory, start_time + 2.0 * part), expected, atol=1e-15)
    np.testing.assert_allclose(
        value(trajectory, start_time + 1.0, order=1), (TARGET - START) / 2, atol=1e-15
    )
    assert corner_times(trajectory) == [start_time, start_time + 2.0]


@pytest.mark.parametrize("start_time", [0.0, 0.5])
def test_a_move_rests_at_both_ends(start_time: float) -> None:
    trajectory = move(START, TARGET, duration=2.0, start_time=start_time)

    end = start_time + 2.0
    np.testing.assert_allclose(value(trajectory, start_time), START, atol=1e-14)
    np.testing.assert_allclose(value(trajectory, end), TARGET, atol=1e-14)
    for order in (1, 2):
        np.testing.assert_allclose(value(trajectory, start_time, order), 0, atol=1e-13)
        np.testing.assert_allclose(value(trajectory, end, order), 0, atol=1e-13)
    assert corner_times(trajectory) == []


def test_a_move_is_the_shortest_polynomial_that_rests() -> None:
    trajectory = move(START, TARGET, duration=2.0)
    for s in np.linspace(0, 1, 11):
        expected = START + (TARGET - START) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        np.testing.assert_allclose(value(trajectory, 2.0 * s), expected, atol=1e-14)
    # its largest speed is 15/8 of the mean one, half way
    np.testing.assert_allclose(
        value(trajectory, 1.0, order=1), 15 / 8 * (TARGET - START) / 2.0, atol=1e-14
    )


def test_a_sequence_goes_through_its_targets_with_continuous_acceleration() -> None:
    times = [0.5, 0.8, 2.0]
    targets = [TARGET, -TARGET, START]

    trajectory = sequence(START, times, targets)

    for time, target in zip(times, targets, strict=True):
        np.testing.assert_allclose(value(trajectory, time), target, atol=1e-14)
        for order in (1, 2):
            for side in (
                -1e-9,
                1e-9,
            ):  # the jerk is below 2e3 rad/s^3, so 1e-9 s change no more than 2e-6 rad/s^2
                if time + side < 2.0:
                    np.testing.assert_allclose(value(trajectory, time + side, order), 0, atol=1e-5)
    assert corner_times(trajectory) == []


@pytest.mark.parametrize("times", [[1.0, 1.0], [2.0, 1.0], [0.0, 1.0], [-1.0, 1.0]])
def test_the_times_of_a_sequence_rise(times: list[float]) -> None:
    with pytest.raises(InvalidParameter, match=r"^times: .* s follows "):
        sequence(START, times, [TARGET, START])


@pytest.mark.parametrize("duration", [0.0, -1.0, np.nan])
def test_a_move_names_its_duration_if_that_is_not_positive(duration: float) -> None:
    """`move` has no parameter `times`, so its error must name the duration."""
    with pytest.raises(InvalidParameter, match=r"^duration is .*; it must be a positive time"):
        move(START, TARGET, duration=duration, start_time=0.5)


def test_a_linear_table_goes_straight_from_sample_to_sample() -> None:
    times = np.array([0.0, 1.0, 3.0])
    samples = np.array([[0.0, 1.0], [2.0, 1.0], [2.0, -3.0]])

    trajectory = interpolate_samples(times, samples, linear=True)

    for time in np.linspace(0, 3, 13):
        expected = [np.interp(time, times, samples[:, joint]) for joint in range(2)]
        np.testing.assert_allclose(value(trajectory, time), expected, atol=1e-14)
    assert corner_times(trajectory) == [0.0, 1.0, 3.0]


def test_a_cubic_table_is_the_spline_of_scipy() -> None:
    random = np.random.default_rng(5)
    times = np.cumsum(random.uniform(0.1, 1.0, 9))
    samples = random.normal(size=(9, 4))
    # both with not-a-knot ends
    trajectory = interpolate_samples(times, samples)

    spline = CubicSpline(times, samples)

    for time in np.linspace(times[0], times[-1], 57):
        for order in (0, 1, 2):
            np.testing.assert_allclose(
                value(trajectory, time, order), spline(time, order), atol=1e-9
            )


def test_inside_of_a_cubic_table_there_is_no_corner() -> None:
    times = np.linspace(0, 2, 9)
    corners = corner_times(interpolate_samples(times, np.sin(times)[:, np.newaxis]))
    assert corners == [0.0, 2.0]  # it starts and ends in motion


def test_a_hermite_table_is_the_piecewise_polynomial_of_drake() -> None:
    """The spline through positions and velocities equals Drake's cubics, with derivatives of up to 1e3 and 1e5."""
    random = np.random.default_rng(6)
    times = np.cumsum(random.uniform(0.01, 0.1, 40))
    positions, velocities = random.normal(size=(2, 40, 3))

    curve = hermite(times, positions, velocities)

    cubics = PiecewisePolynomial.CubicHermite(times, positions.T, velocities.T)
    checked_times = np.union1d(times, np.linspace(times[0], times[-1], 300))
    for order, tolerance in ((0, 1e-13), (1, 1e-11), (2, 1e-8)):
        found = curve.MakeDerivative(order).vector_values(checked_times)
        expected = cubics.MakeDerivative(order).vector_values(checked_times)
        np.testing.assert_allclose(found, expected, atol=tolerance)
    assert corner_times(curve) == [times[0], times[-1]]


def test_two_samples_are_a_line() -> None:
    np.testing.assert_allclose(value(interpolate_samples([0, 2], [[0.0], [1.0]]), 0.5), [0.25])


@pytest.mark.parametrize(
    ("times", "positions", "message"),
    [
        ([0], [[1.0]], "m > 1"),
        ([], [], "m > 1"),
        ([0, 1], [1.0, 2.0], "m > 1"),
        ([0, 1], [[1.0], [2.0], [3.0]], "m > 1"),
        ([[0, 1]], [[1.0], [2.0]], "m > 1"),
        ([0, 1, 1], [[1.0]] * 3, r"reference times: 1 s follows 1 s; increase each time"),
        ([0, 2, 1], [[1.0]] * 3, r"reference times: 1 s follows 2 s; increase each time"),
        ([0, 1, 2], [[1.0], [np.nan], [1.0]], "row 1 of the reference is .*must be finite"),
        ([0, 1, np.inf], [[1.0]] * 3, "row 2 of the reference is .*must be finite"),
    ],
)
def test_a_table_that_cannot_be_says_where(times: list, positions: list, message: str) -> None:
    with pytest.raises(InvalidParameter, match=message):
        interpolate_samples(times, positions)


def test_a_jump_is_a_corner() -> None:
    steps = PiecewisePolynomial.ZeroOrderHold([0.0, 1.0, 2.0], [[0.0, 1.0, 1.0]])
    assert corner_times(steps) == [1.0]


def test_corners_before_time_zero_do_not_count() -> None:
    assert corner_times(ramp(START, TARGET, duration=2.0, start_time=-1.0)) == [1.0]


def test_a_change_of_acceleration_alone_is_no_corner() -> None:
    # q = t^2 and then its tangent: positions and velocities join
    curve = PiecewisePolynomial(
        [np.array([[Polynomial([0.0, 0.0, 1.0])]]), np.array([[Polynomial([1.0, 2.0])]])], [0, 1, 2]
    )
    assert corner_times(curve) == [2.0]


def test_of_a_trajectory_that_is_no_polynomial_only_the_ends_count() -> None:
    slerp = PiecewiseQuaternionSlerp(
        [0.5, 1.0, 2.0], [Quaternion(), Quaternion(0, 1, 0, 0), Quaternion()]
    )
    assert corner_times(slerp) == [0.5, 2.0]


@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_a_source_plays_the_trajectory_and_holds_its_ends(derivatives: int) -> None:
    builder = DiagramBuilder()
    trajectory = move(START, TARGET, duration=1.0, start_time=0.5)

    diagram = played(builder, add_reference(builder, trajectory, derivatives=derivatives))

    np.testing.assert_allclose(signal(diagram, "position", 0.0), START, atol=1e-14)
    np.testing.assert_allclose(signal(diagram, "position", 9.0), TARGET, atol=1e-14)
    np.testing.assert_allclose(signal(diagram, "position", 0.8), value(trajectory, 0.8), atol=1e-14)
    assert diagram.num_output_ports() == 1 + derivatives
    for order, name in ((1, "velocity"), (2, "acceleration")):
        if order <= derivatives:
            np.testing.assert_allclose(
                signal(diagram, name, 0.8), value(trajectory, 0.8, order), atol=1e-12
            )


@pytest.mark.parametrize(("time", "moving"), [(0.25, False), (1.0, True), (2.75, False)])
def test_outside_of_a_ramp_the_velocity_is_zero(time: float, moving: bool) -> None:
    builder = DiagramBuilder()
    source = add_reference(
        builder, ramp(START, TARGET, duration=2.0, start_time=0.5), derivatives=2
    )

    expected = (TARGET - START) / 2 if moving else np.zeros(3)
    np.testing.assert_allclose(
        signal(played(builder, source), "velocity", time), expected, atol=1e-14
    )


def test_corners_become_events_of_the_simulation() -> None:
    builder = DiagramBuilder()
    trajectory = ramp(START, TARGET, duration=0.7, start_time=0.3)
    builder.AddNamedSystem("edges", EventTimes(corner_times(trajectory)))
    diagram = played(builder, add_reference(builder, trajectory))
    ends: list[float] = []
    simulator = Simulator(diagram)
    simulator.set_monitor(lambda context: ends.append(context.get_time()))

    simulator.AdvanceTo(2.0)

    assert {0.3, 1.0} <= set(ends)


def test_a_trajectory_is_a_column() -> None:
    wide = PiecewisePolynomial(np.zeros((2, 3)))
    with pytest.raises(InvalidParameter, match="trajectory is 2 x 3"):
        add_reference(DiagramBuilder(), wide)


@pytest.mark.parametrize("time", [0.0, 0.123, 4.5])
def test_a_sine_and_its_derivatives_are_the_closed_form(time: float) -> None:
    """The source of a sine plays c + a sin(w t + phi), a w cos(w t + phi) and -a w² sin(w t + phi)."""
    sine = SineReference(
        centre=np.array([0.1, -1.0]),
        amplitude=np.array([0.5, 0.2]),
        frequency=1.5,
        phase=np.array([0.0, 1.2]),
    )
    builder = DiagramBuilder()

    diagram = played(builder, add_reference(builder, sine))

    omega = 2 * np.pi * sine.frequency
    angle = omega * time + sine.phase
    position = sine.centre + sine.amplitude * np.sin(angle)
    velocity = sine.amplitude * omega * np.cos(angle)
    acceleration = -sine.amplitude * omega**2 * np.sin(angle)
    np.testing.assert_allclose(signal(diagram, "position", time), position, atol=1e-12)
    np.testing.assert_allclose(signal(diagram, "velocity", time), velocity, atol=1e-11)
    np.testing.assert_allclose(signal(diagram, "acceleration", time), acceleration, atol=1e-10)


CUBIC = PiecewisePolynomial.CubicShapePreserving(
    [0.0, 0.7, 1.5, 2.0], np.array([[0.0, 1.0, -1.0, 0.5]])
)


@pytest.mark.parametrize(
    "reference",
    [
        ramp(START, TARGET, duration=1.0, start_time=0.5),
        move(START, TARGET, duration=2.0),
        hermite([0.0, 0.4, 2.0], [START, TARGET, START], np.ones((3, 3))),
        CompositeTrajectory([CUBIC.slice(0, 1), CUBIC.slice(1, 2)]),
        PathParameterizedTrajectory(
            CUBIC, PiecewisePolynomial.FirstOrderHold([0.0, 2.0], [[0.0, 2.0]])
        ),
        SineReference(START, TARGET, 0.7, np.array([0.1, 0.2, 0.3])),
    ],
    ids=["polynomial", "smooth", "spline", "composite", "of_another_kind", "sine"],
)
def test_a_reference_goes_on_later_as_it_was(reference: Reference) -> None:
    """The shifted reference at a time is the reference that much later; one of another kind has errors of samples."""
    times = np.linspace(0.0, 1.0, 37)
    np.testing.assert_allclose(
        reference_values(later(reference, 0.9), times),
        reference_values(reference, times + 0.9),
        atol=1e-8,
    )


def test_a_reference_that_is_over_holds_its_end() -> None:
    left = later(move(START, TARGET, duration=2.0), 3.0)
    np.testing.assert_allclose(reference_values(left, np.zeros(1))[0], TARGET, atol=1e-15)


def test_a_spline_whose_velocity_jumps_is_sampled_between_its_knots() -> None:
    """A knot that occurs three times lets the velocity of a cubic spline jump: its knots alone do not describe it."""
    smooth_knots = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]
    corner_knots = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]
    counts = []

    for knots in (smooth_knots, corner_knots):
        points = [np.array([[float(number % 3)]]) for number in range(len(knots) - 4)]
        trajectory = BsplineTrajectory(BsplineBasis(4, knots), points)

        samples = hermite_samples(trajectory, 0.0, 2.0, 100.0)

        counts.append(len(samples.times))

    assert counts[0] == 3
    assert counts[1] > 200


def test_a_spline_of_straight_lines_is_sampled_between_its_knots() -> None:
    """The velocity of a spline of order 2 jumps at each knot: cubics through its knots alone would round it."""
    points = [np.array([[value]]) for value in (0.0, 1.0, 0.0)]
    trajectory = BsplineTrajectory(BsplineBasis(2, [0.0, 0.0, 1.0, 2.0, 2.0]), points)

    samples = hermite_samples(trajectory, 0.0, 2.0, 100.0)

    assert len(samples.times) > 200
    middle = hermite(samples.times, samples.positions, samples.velocities).value(0.5)
    assert middle[0, 0] == pytest.approx(0.5, abs=1e-9)
