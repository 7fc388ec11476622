"""Networks of Stable-Baselines3 as ONNX files: they give what the model gives.

In a process of its own: PyTorch does not bear all libraries that other tests have loaded.
"""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[3] / "examples" / "learning"


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_model_as_onnx_gives_its_mean_action(algorithm, tmp_path):
    for package in ("stable_baselines3", "onnxruntime", "gymnasium"):
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"needs {package}")
    done = subprocess.run(
        [sys.executable, __file__, algorithm, str(tmp_path / "policy.onnx")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def check(algorithm: str, file: str) -> None:
    """Check that a model that was not trained is the network that is written."""
    import gymnasium

    from simrob_drake.extensions.learning.policy import Network
    from simrob_drake.extensions.learning.writing import write_network

    sys.path.insert(0, str(FOLDER))
    import deep

    env = gymnasium.make("simrob_drake.extensions.learning:simrob/Reach-v0")
    model = deep.ALGORITHMS[algorithm](
        "MlpPolicy", env, seed=1, device="cpu", **deep.SETTINGS[algorithm]
    )
    layers, activation, last = deep.layers(model)
    network = Network(write_network(Path(file), layers, activation=activation, last=last), "policy")
    for seen in (
        np.random.default_rng(1).normal(size=(5, *env.observation_space.shape)).astype(np.float32)
    ):
        expected, _ = model.predict(seen, deterministic=True)
        np.testing.assert_allclose(np.clip(network(seen), -1, 1), expected, atol=1e-5)  # 32 bits


if __name__ == "__main__":
    check(*sys.argv[1:])
