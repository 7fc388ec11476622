"""Both engines have one opinion about states that have run away."""

import pytest

from simrob_drake import load_station, simulate
from simrob_drake.results.record.history import RUNAWAY


@pytest.fixture
def config():
    """A ball that gravity of 1e4 m/s² pulls up: after 20 s it is 2000 km high, at 200 km/s."""
    changes = {"gravity": -1e4, "duration": 20.0, "sensors": {}, "sample_rate": 10}
    return load_station("bouncing_ball", changes)


def test_what_is_far_in_drake_is_far_in_mujoco(config):
    """Before, the run in MuJoCo ended after 14 s with "a state ran away to infinity"."""
    mujoco = pytest.importorskip("simrob_drake.extensions.mujoco.runner")

    in_drake = simulate(config, progress=False)
    in_mujoco = mujoco.MujocoRunner(config, step=0.01).run()

    for run in (in_drake, in_mujoco):
        assert run.ending == "completed"
        assert 1e6 < run.piece_pose("ball")[-1, 2] < RUNAWAY
    height = in_drake.piece_pose("ball")[-1, 2]
    assert in_mujoco.piece_pose("ball")[-1, 2] == pytest.approx(height, rel=1e-3)  # steps of 10 ms
    assert height == pytest.approx(0.5e4 * 20.0**2, rel=1e-4)
