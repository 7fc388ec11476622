"""The script that learns by PPO: its first round, and that the file gives what the model gives."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[3] / "examples" / "learning"


@pytest.mark.long
def test_a_round_of_learning_writes_a_policy_and_its_curve(tmp_path):
    for package in ("stable_baselines3", "onnxruntime", "gymnasium", "mujoco"):
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"needs {package}")
    for start in (
        [],
        ["--start", str(tmp_path / "policy.onnx")],
    ):  # the second one goes on from the first
        asked = ["--robots", "32", "--steps", "1536", "--out", str(tmp_path), *start]
        done = subprocess.run(
            [sys.executable, __file__, str(FOLDER / "learn_yobotics.yaml"), *asked],
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(FOLDER), *sys.path])},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert ("begins as it" in done.stdout) == bool(start)
        rows = (tmp_path / "curve.csv").read_text().splitlines()
        assert rows[0] == "wall_minutes,processor_minutes,steps,return,seconds"


if __name__ == "__main__":
    import ppo

    from simrob_drake.extensions.learning.policy import Network

    saved, begun = ppo.save, ppo.begin_as

    def checked(model, folder):
        """Save, and hold the file against the model."""
        return compared(model, saved(model, folder))

    def begins(model, file):
        """Begin as a file, and hold that against the model."""
        begun(model, file)
        print(f"begins as it: {compared(model, file)}")

    def compared(model, file):
        """Hold a file against a model, with what that observes normalised."""
        network, normal = Network(file, "policy"), model.get_vec_normalize_env()
        for seen in normal.get_original_obs()[:5].astype(np.float32):  # nothing that is clipped
            expected, _ = model.predict(normal.normalize_obs(seen), deterministic=True)
            np.testing.assert_allclose(np.clip(network(seen), -1, 1), expected, atol=1e-4)
        return file

    ppo.save, ppo.begin_as = checked, begins
    ppo.main()
