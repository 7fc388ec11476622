"""The script that learns by PPO: its first round, and that the file gives what the model gives."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "examples" / "learning"


@pytest.mark.long
def test_a_round_of_learning_writes_a_policy_and_its_curve(tmp_path):
    for package in ("stable_baselines3", "onnxruntime", "gymnasium", "mujoco"):
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"needs {package}")
    asked = ["--robots", "32", "--steps", "1536", "--out", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, __file__, str(FOLDER / "learn_yobotics.yaml"), *asked],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(FOLDER), *sys.path])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = (tmp_path / "curve.csv").read_text().splitlines()
    assert rows[0] == "wall_minutes,processor_minutes,steps,return,seconds"


if __name__ == "__main__":
    import ppo

    from simrob_drake.parts.controllers.policy import Network

    saved = ppo.save

    def checked(model, folder):
        """Hold the file against the model, with what it observes normalised."""
        file = saved(model, folder)
        network, normal = Network(file, "policy"), model.get_vec_normalize_env()
        for seen in np.random.default_rng(1).normal(size=(5, network.inputs)).astype(np.float32):
            expected, _ = model.predict(normal.normalize_obs(seen), deterministic=True)
            np.testing.assert_allclose(np.clip(network(seen), -1, 1), expected, atol=1e-4)
        return file

    ppo.save = checked
    ppo.main()
