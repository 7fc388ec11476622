"""Figures of a floor found from bounces, and traces that nothing can be learnt from."""

from pathlib import Path
from runpy import run_path

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidConfig, InvalidParameter

EXAMPLE = run_path(str(Path(__file__).parents[1] / "examples" / "bouncing_ball_identify.py"))
BounceLaw, BounceTrace = EXAMPLE["BounceLaw"], EXAMPLE["BounceTrace"]
identify_bounces, read_bounces = EXAMPLE["identify_bounces"], EXAMPLE["read_bounces"]
MASS = 0.9048  # kg


@pytest.fixture(scope="module")
def trace():
    """What a camera of 250 pictures a second sees of the station's ball, with 1 mm of noise."""
    contact = {"contact.stiffness": 4000, "contact.dissipation": 0.08}
    config = load_station("bouncing_ball", {**contact, "sample_rate": 250, "solver.accuracy": 1e-5})
    result = simulate(config, duration=1.0)
    noise = np.random.default_rng(seed=11).normal(0, 1e-3, len(result.times))
    return BounceTrace(result.times, result["distance.gap"] + noise)


@pytest.mark.long
def test_both_figures_are_found_within_2_percent(trace):
    found = identify_bounces(trace, mass=MASS)

    assert found.stiffness == pytest.approx(4000, rel=0.02)
    assert found.dissipation == pytest.approx(0.08, rel=0.02)
    for value, (low, high) in (
        (found.stiffness, found.stiffness_interval),
        (found.dissipation, found.dissipation_interval),
    ):
        assert low < value < high
        assert (high - low) / value < 0.05
    assert found.residual == pytest.approx(1e-3, rel=0.15)
    np.testing.assert_allclose(found.heights, trace.heights, atol=5e-3)


def test_the_law_is_that_of_the_station():
    result = simulate(load_station("bouncing_ball", {"solver.accuracy": 1e-5}), duration=1.0)
    heights = BounceLaw(MASS, 1000.0, 0.011).heights(result.times, 0.1, 0.0)
    np.testing.assert_allclose(heights, result["distance.gap"], atol=3e-4)


def test_the_law_without_dissipation_keeps_its_height():
    times = np.linspace(0, 3, 3001)
    heights = BounceLaw(MASS, 1e4, 0.0).heights(times, 0.1, 0.0)
    assert heights[times > 2].max() == pytest.approx(0.1, abs=1e-5)


def test_a_mass_is_positive(trace):
    with pytest.raises(InvalidParameter, match="mass is 0"):
        identify_bounces(trace, mass=0)


def csv_text(times, heights, header="time,height"):
    rows = (
        f"{time!r},{height!r}"
        for time, height in zip(times.tolist(), heights.tolist(), strict=True)
    )
    return "\n".join([header, *rows])


def test_a_file_gives_the_trace(trace, tmp_path):
    file = tmp_path / "trace.csv"
    file.write_text(csv_text(trace.times, trace.heights))

    again = read_bounces(str(file))

    np.testing.assert_array_equal(again.times, trace.times)
    np.testing.assert_array_equal(again.heights, trace.heights)
    assert again.bounces == trace.bounces >= 3


TIMES = np.linspace(0, 1, 251)
FALL = 0.1 - 9.80665 * TIMES**2 / 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            csv_text(TIMES, FALL, "t,h"),
            "line 1: lacks the columns time, height; required: time, height",
        ),
        ("", "is empty; it must contain a line of names"),
        (csv_text(TIMES[:10], FALL[:10]), "has 10 samples; it takes at least 20"),
        (
            csv_text(TIMES, np.where(TIMES[7] == TIMES, np.nan, FALL)),
            "line 9: contains a value that is not a number",
        ),
        (csv_text(TIMES, FALL).replace("0.02,", "0.02s,", 1), "is not a number"),
        (csv_text(np.sort(TIMES)[::-1], FALL), "line 3: times must rise"),
        (
            csv_text(np.sort(TIMES)[::-1], FALL).replace("\n", "\n\n\n", 1),
            "line 5: times must rise",
        ),
        (
            csv_text(np.delete(TIMES, range(50, 90)), np.delete(FALL, range(50, 90))),
            "line 52: a gap of 0.164 s from",
        ),
        (csv_text(TIMES, np.maximum(FALL, 0)), "holds 0 bounces; it takes at least 2"),
    ],
)
def test_traces_that_teach_nothing_are_refused(text, message, tmp_path):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InvalidConfig, match=message):
        read_bounces(tmp_path / "bad.csv")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InvalidConfig, match="cannot be read"):
        read_bounces(tmp_path / "none.csv")
    with pytest.raises(InvalidConfig, match=r"^none\.csv: cannot be read"):
        read_bounces("none.csv")
    for nothing in (None, 3):
        with pytest.raises(InvalidParameter, match=r"file is .*; it must be a path"):
            read_bounces(nothing)


@pytest.mark.long
def test_a_ball_that_is_let_go_at_rest_is_identified_without_any_noise():
    """The speed at the start is zero to rounding, and the Jacobian must not be."""
    times = np.arange(0.0, 1.2, 0.004)
    law = BounceLaw(mass=0.9, stiffness=4000.0, dissipation=0.08)

    found = identify_bounces(BounceTrace(times, law.heights(times, 0.1, 0.0)), mass=0.9)

    assert found.stiffness == pytest.approx(4000, rel=1e-4)
    assert found.dissipation == pytest.approx(0.08, rel=1e-3)
    assert found.stiffness_interval[0] <= found.stiffness <= found.stiffness_interval[1]
    assert len(repr(found)) < 300
