"""Sines and trajectories answer the same questions, each against its definition."""

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem
from pydrake.trajectories import BsplineTrajectory

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.blocks.references import (
    ReferenceSignal,
    ReferenceSource,
    ReferenceTable,
    SineReference,
    as_reference,
    hermite,
    hold,
    interpolate_samples,
    move,
    ramp,
)
from simrob_drake.results.files import save_result

START = np.array([0.1, -0.2])
TARGET = np.array([1.1, 0.3])
SINE = SineReference(centre=START, amplitude=TARGET, frequency=0.7, phase=np.array([0.1, 0.2]))
MOVE = move(START, TARGET, duration=2.0)
SPLINE = hermite([0.0, 0.4, 2.0], [START, TARGET, START], np.ones((3, 2)))
REFERENCES = {
    "sine": SINE,
    "hold": hold(START),
    "ramp": ramp(START, TARGET, duration=1.0),
    "move": MOVE,
}
REFERENCES["spline"] = SPLINE


@pytest.mark.parametrize("reference", REFERENCES.values(), ids=REFERENCES)
def test_a_table_gives_the_reference_back(reference):
    signal = as_reference(reference)
    samples = signal.table(1.5)
    times = np.linspace(0.0, 1.5, 50)

    if samples.interpolation == "hermite":
        positions, velocities = np.hsplit(samples.values, 2)
        again = hermite(samples.times, positions, velocities)
    else:
        again = interpolate_samples(samples.times, samples.values)

    np.testing.assert_allclose(as_reference(again).values(times), signal.values(times), atol=1e-7)


@pytest.mark.parametrize("reference", REFERENCES.values(), ids=REFERENCES)
def test_size_and_span_say_where_a_reference_moves(reference):
    signal = as_reference(reference)

    assert isinstance(signal, ReferenceSignal)
    assert signal.size == 2
    start, end = signal.span
    if np.isfinite(end):
        outside = signal.values(np.array([start - 1.0, end + 1.0]), order=1)
        np.testing.assert_array_equal(outside, np.zeros((2, 2)))
    assert signal.oscillates == (reference is SINE)


def test_only_what_stands_still_or_swings_is_a_sine():
    assert as_reference(SINE).as_sine() is SINE

    still = as_reference(hold(START)).as_sine()
    np.testing.assert_array_equal(still.centre, START)
    np.testing.assert_array_equal(still.amplitude, np.zeros(2))
    assert as_reference(MOVE).as_sine() is None

    rows_at_rest = as_reference(
        interpolate_samples([0.0, 1.0, 2.0], [START, START, START])
    ).as_sine()
    np.testing.assert_array_equal(rows_at_rest.centre, START)
    np.testing.assert_array_equal(rows_at_rest.amplitude, [0.0, 0.0])


@pytest.mark.parametrize(
    "to_and_fro",
    [
        interpolate_samples([0.0, 1.0, 2.0], [START, TARGET, START]),
        # only the velocities say that it moves
        hermite([0.0, 2.0], [START, START], [[1.0, 0.0], [1.0, 0.0]]),
        SPLINE,
    ],
)
def test_a_motion_that_ends_where_it_began_does_not_stand_still(to_and_fro):
    assert as_reference(to_and_fro).as_sine() is None


def test_polynomials_say_so():
    assert as_reference(MOVE).as_polynomial() is MOVE
    assert isinstance(SPLINE, BsplineTrajectory)
    assert as_reference(SPLINE).as_polynomial() is None
    assert as_reference(SINE).as_polynomial() is None


def test_a_source_plays_any_trajectory_but_one_sine_only():
    key = as_reference(MOVE).player_key

    assert key == as_reference(SPLINE).player_key
    assert key != SINE.player_key

    equal = SineReference(START.copy(), TARGET.copy(), 0.7, np.array([0.1, 0.2]))
    assert equal.player_key == SINE.player_key
    for changed in (SINE.later(0.5), SineReference(START, TARGET, 0.8, SINE.phase)):
        assert changed.player_key != SINE.player_key


@pytest.mark.parametrize("reference", [SINE, MOVE], ids=["sine", "trajectory"])
def test_a_reference_of_too_few_axes_is_an_error(reference):
    with pytest.raises(SimrobError, match="a trajectory of 2 joints"):
        simulate(
            load_station("irb120_kinematic"), reference=reference, duration=0.1, progress=False
        )


class Chirp(ReferenceSignal):
    """A reference of another package: one axis swings faster and faster, q = 0.1 sin(t^2)."""

    size = 6
    span = (0.0, np.inf)
    oscillates = True
    player_key = "chirp"
    corner_times = ()

    def values(self, times, order=0):
        first = [0.1 * np.sin(times**2), 0.2 * times * np.cos(times**2)][order]
        return np.outer(first, np.eye(6)[0])

    def later(self, time):
        raise NotImplementedError

    def as_sine(self):
        return None

    def as_polynomial(self):
        return None

    def add_source(self, builder, name, derivatives):
        block = builder.AddNamedSystem(name, ChirpSource(self))
        return ReferenceSource(block.get_output_port())

    def table(self, duration):
        times = np.linspace(0.0, duration, 200)
        return ReferenceTable("cubic", times, self.values(times))


class ChirpSource(LeafSystem):
    def __init__(self, chirp):
        super().__init__()

        def calc(context, output):
            output.SetFromVector(chirp.values(np.array([context.get_time()]))[0])

        self.DeclareVectorOutputPort("position", 6, calc)


@pytest.mark.long
def test_a_reference_of_another_package_is_followed_and_saved(tmp_path):
    result = simulate(
        load_station("irb120_kinematic"), reference=Chirp(), duration=1.0, progress=False
    )

    np.testing.assert_allclose(result["q.joint_1"], 0.1 * np.sin(result.times**2), atol=1e-9)

    folder = save_result(result, result.verdict, tmp_path / "result", recording=False)
    again = simulate(load_station(folder / "station.yaml"), progress=False)

    np.testing.assert_allclose(again["q.joint_1"], result["q.joint_1"], atol=1e-5)
