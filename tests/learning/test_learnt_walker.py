"""The walker that was learnt, as it lies beside the scripts."""

from pathlib import Path

import pytest

from simrob_drake import load_station, simulate
from simrob_drake.results.record.walks import locomotion

pytest.importorskip("onnxruntime")
FOLDER = Path(__file__).parents[2] / "examples" / "learning"


@pytest.mark.parametrize(("name", "ahead"), [("walker", 0.6), ("trot", 1.2)])
def test_what_was_learnt_walks_in_its_station(name, ahead):
    """A hundred walks of 20 s are in each proof; here are the first seconds of another one."""
    config = load_station(FOLDER / f"yobotics_{name}.yaml", {"sensors.imu.seed": 7})
    result = simulate(config, duration=4, progress=False)
    assert result.ending == "completed"
    assert locomotion(result).ahead > ahead
    assert (FOLDER / f"yobotics_{name}.onnx").stat().st_size < 1_000_000


def test_the_trot_goes_at_the_speed_that_is_commanded():
    ways = []
    for speed in (0.2, 0.6):
        config = load_station(FOLDER / "yobotics_trot.yaml", {"controllers.policy.goal": [speed, 0]})
        ways.append(locomotion(simulate(config, duration=4, progress=False)).ahead)
    assert ways[1] > ways[0] + 1.0
