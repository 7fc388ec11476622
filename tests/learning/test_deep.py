"""Networks of Stable-Baselines3 as ONNX files: they give what the model gives."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("onnxruntime")
gymnasium = pytest.importorskip("gymnasium")

from simrob_drake.learning.writing import write_network  # noqa: E402
from simrob_drake.parts.controllers.network import Network  # noqa: E402

FOLDER = Path(__file__).parents[2] / "examples" / "learning"


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_model_as_onnx_gives_its_mean_action(algorithm, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [str(FOLDER), *sys.path])
    spec = importlib.util.spec_from_file_location("deep", FOLDER / "deep.py")
    deep = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(deep)
    env = gymnasium.make("simrob_drake.learning:simrob/Reach-v0")
    model = deep.ALGORITHMS[algorithm]("MlpPolicy", env, seed=1, device="cpu", **deep.SETTINGS[algorithm])
    layers, activation, last = deep.layers(model)
    file = write_network(tmp_path / "policy.onnx", layers, activation=activation, last=last)
    network = Network(file, "policy")
    for seen in np.random.default_rng(1).normal(size=(5, *env.observation_space.shape)).astype(np.float32):
        expected, _ = model.predict(seen, deterministic=True)
        np.testing.assert_allclose(np.clip(network(seen), -1, 1), expected, atol=1e-5)  # 32 bits
