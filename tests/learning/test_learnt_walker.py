"""The walker that was learnt, as it lies beside the scripts."""

from pathlib import Path

import pytest

from simrob_drake import load_station, simulate
from simrob_drake.results.record.walks import locomotion

pytest.importorskip("onnxruntime")
FOLDER = Path(__file__).parents[2] / "examples" / "learning"


def test_what_was_learnt_walks_in_its_station():
    """Twenty walks of 20 s are in its proof; here are the first seconds of another one."""
    config = load_station(FOLDER / "yobotics_walker.yaml", {"sensors.imu.seed": 7})
    result = simulate(config, duration=4, progress=False)
    assert result.ending == "completed"
    assert locomotion(result).ahead > 0.6  # 3 m in 20 s
    assert (FOLDER / "yobotics_walker.onnx").stat().st_size < 1_000_000
