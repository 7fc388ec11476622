"""Learn with Stable-Baselines3, PPO or SAC, and write the policy as ONNX.

python examples/learning/deep.py Reach --algorithm sac --steps 20000 --out runs/reach
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path
from typing import Any

from held_back import compare
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import SubprocVecEnv
from torch import nn, set_num_threads

from simrob_drake.base.frames import Vector
from simrob_drake.extensions.learning import ENVIRONMENTS
from simrob_drake.extensions.learning.writing import write_network

ALGORITHMS: dict[str, Any] = {"ppo": PPO, "sac": SAC}
SETTINGS: dict[str, dict[str, Any]] = {
    "ppo": {
        "n_steps": 512,
        "batch_size": 128,
        "policy_kwargs": {"net_arch": [64, 64], "log_std_init": -1.0},
    },
    "sac": {"learning_starts": 1000, "policy_kwargs": {"net_arch": [64, 64]}},
}


def learn(env: str, folder: Path, *, algorithm: str, steps: int, seed: int, workers: int) -> Any:
    """Learn on environments side by side, and return the model; the returns of all episodes go to ``curve.csv``."""
    folder.mkdir(parents=True, exist_ok=True)
    set_num_threads(1)
    given = {
        "n_envs": workers,
        "seed": seed,
        "monitor_dir": str(folder / "monitors"),
        "vec_env_cls": SubprocVecEnv,
    }
    envs = make_vec_env(f"simrob_drake.extensions.learning:simrob/{env}-v0", **given)
    try:
        model = ALGORITHMS[algorithm](
            "MlpPolicy", envs, seed=seed, device="cpu", **SETTINGS[algorithm]
        )
        model.learn(steps)
    finally:
        envs.close()
    tables = [file.read_text().splitlines()[1:] for file in (folder / "monitors").glob("*.csv")]
    episodes = sorted(
        (row for table in tables for row in csv.DictReader(table)), key=lambda row: float(row["t"])
    )
    with (folder / "curve.csv").open("w", newline="") as file:
        curve = csv.writer(file)
        curve.writerow(["wall_minutes", "steps", "return"])
        curve.writerows([float(row["t"]) / 60, row["l"], row["r"]] for row in episodes)
    return model


def layers(model: Any) -> tuple[list[tuple[Vector, Vector]], str, str]:
    """Return the layers of a model's mean action, the function between them, and that at the end."""
    if isinstance(model, PPO):
        parts, last = [*model.policy.mlp_extractor.policy_net, model.policy.action_net], "Identity"
    else:
        parts, last = [*model.actor.latent_pi, model.actor.mu], "Tanh"
    activation = type(parts[1]).__name__.capitalize()  # as ONNX calls it: Tanh, Relu, Elu
    linear = [part for part in parts if isinstance(part, nn.Linear)]
    return (
        [(part.weight.detach().numpy(), part.bias.detach().numpy()) for part in linear],
        activation,
        last,
    )


def main() -> None:
    """Learn, write the policy, and compare it with doing nothing, on seeds that were held back."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("env", choices=list(ENVIRONMENTS))
    options.add_argument("--algorithm", choices=list(ALGORITHMS), default="ppo")
    options.add_argument("--steps", type=int, default=20_000)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--workers", type=int, default=2)
    options.add_argument("--out", type=Path, default=Path("runs/learnt"))
    given = vars(options.parse_args())
    env, folder = given.pop("env"), given.pop("out")
    began = time.perf_counter()
    weights, activation, last = layers(learn(env, folder, **given))
    file = write_network(folder / "policy.onnx", weights, activation=activation, last=last)
    print(f"learnt in {(time.perf_counter() - began) / 60:.1f} min: {file}")
    compare(env, file)


if __name__ == "__main__":
    main()
