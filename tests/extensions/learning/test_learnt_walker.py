"""The walker that was learnt, as it lies beside the scripts."""

from pathlib import Path

import pytest

from simrob_drake import load_station, simulate
from simrob_drake.results.record.walks import locomotion

pytest.importorskip("onnxruntime")
FOLDER = Path(__file__).parents[3] / "examples" / "learning"


# two speeds [m/s], and the part of the way between them that is gone at least in the first 4 s
WALKERS = {
    "yobotics_trot": (0.2, 0.6, 0.5),
    "zjudancer_march": (0.1, 0.3, 0.5),
    "roid1_march": (0.05, 0.2, 0.4),
}


def walked(name, **changes):
    """A hundred walks are in each proof; here are the first seconds of another one."""
    result = simulate(
        load_station(FOLDER / f"{name}.yaml", {"sensors.imu.seed": 7, **changes}),
        duration=4,
        progress=False,
    )
    assert result.ending == "completed"
    assert (FOLDER / f"{name}.onnx").stat().st_size < 100_000
    return locomotion(result)


@pytest.mark.long
def test_what_was_learnt_from_scratch_walks_in_its_station():
    assert walked("yobotics_walker").ahead > 0.6


@pytest.mark.long
@pytest.mark.parametrize("name", WALKERS)
def test_walkers_go_at_the_speed_that_is_commanded(name):
    slow, fast, part = WALKERS[name]
    ways = [
        walked(name, **{"controllers.policy.goal": [speed, 0, 0]}).ahead for speed in (slow, fast)
    ]
    assert ways[1] > ways[0] + 4.0 * part * (fast - slow)


@pytest.mark.long
@pytest.mark.parametrize("name", WALKERS)
def test_walkers_turn_as_they_are_told_within_what_their_motors_have(name):
    station = FOLDER / f"{name}.yaml"
    left, right = (
        walked(name, **{"controllers.policy.goal": [0.1, 0, turn]}).yaw for turn in (0.3, -0.3)
    )
    assert left > 0.6
    assert right < -0.6
    assert load_station(station).servo.motor is not None
