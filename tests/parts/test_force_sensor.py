"""Force sensors that are no better than real ones: against what they are told to get wrong, and no more."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError

RATE = 100
TIPPING = {
    "pieces.box.pose": [0, 0, 0.112, 0, 0.3, 0],
    "sensors.true": {"kind": "force", "body": "box"},
}


def felt(duration=1.0, **sensor):
    """Let a box rock on its corners; return the run, and what the two sensors tell of it, both as Drake computes it."""
    floor = {"kind": "force", "body": "box", "rate": RATE, **sensor}
    overrides = {**TIPPING, "sensors.floor": floor, "sample_rate": RATE, "duration": duration}
    overrides["sensors.true"] = {**TIPPING["sensors.true"], "rate": RATE}
    result = simulate(load_station("box_on_floor", overrides), progress=False)
    return result, *(
        np.hstack([result.vector(f"{part}.{name}") for part in ("force", "moment")])
        for name in ("floor", "true")
    )


def test_they_round_to_their_resolutions():
    _, told, true = felt(resolution=2.0, moment_resolution=0.05)
    steps = np.repeat([2.0, 0.05], 3)
    assert told == pytest.approx(np.round(true / steps) * steps, abs=1e-9)
    assert np.ptp(true[:, 2]) > 10


def test_noise_is_as_large_as_asked_and_the_same_for_a_seed():
    one, told, true = felt(noise=0.5, moment_noise=0.01, seed=1)
    errors = told - true
    assert errors[:, :3].std() == pytest.approx(0.5, rel=0.15)  # 303 figures: 4 % of one sigma
    assert errors[:, 3:].std() == pytest.approx(0.01, rel=0.15)
    # 101 figures: 0.1 of one sigma
    assert abs(errors.mean(axis=0) / np.repeat([0.5, 0.01], 3)).max() < 0.35
    assert (felt(noise=0.5, moment_noise=0.01, seed=1)[0].values == one.values).all()
    assert (felt(noise=0.5, moment_noise=0.01, seed=2)[1] != told).all()


def test_a_delay_tells_what_was():
    _, told, true = felt(delay=0.03)
    assert told[10:] == pytest.approx(true[7:-3], abs=1e-12)
    assert told[:3] == pytest.approx(np.tile(true[0], (3, 1)), abs=1e-12)


def test_what_errs_needs_a_rate():
    with pytest.raises(SimrobError, match="needs a rate"):
        load_station("box_on_floor", {"sensors.floor.noise": 1})
    with pytest.raises(SimrobError, match=r"sensors\.floor\.delay"):
        load_station("box_on_floor", {"sensors.floor.rate": 100, "sensors.floor.delay": -1})
