"""Learn by PPO on many robots at once in MuJoCo, and write the policy as ONNX, what it observes normalised within.

PPO is that of Stable-Baselines3; returns go to curve.csv, and to TensorBoard where that is installed.

python examples/learning/ppo.py examples/learning/learn_zjudancer.yaml --out runs/zjudancer
"""

from __future__ import annotations

import argparse
import csv
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from deep import layers
from onnx import numpy_helper
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize
from torch import nn, set_num_threads

from simrob_drake.base.frames import Vector
from simrob_drake.extensions.learning.policy import Network
from simrob_drake.extensions.learning.vector import StationVectorEnvironment
from simrob_drake.extensions.learning.writing import write_network

SETTINGS: dict[str, Any] = {
    "n_steps": 48,
    "batch_size": 1536,
    "n_epochs": 5,
    "gamma": 0.98,
    "gae_lambda": 0.95,
    "learning_rate": lambda left: 1e-4 + 6e-4 * left,
    "ent_coef": 0.0,
    "max_grad_norm": 1.0,
    "policy_kwargs": {"net_arch": {"pi": [128, 64], "vf": [128, 64]}, "activation_fn": nn.ELU},
}
LOOKED_AT = 150  # steps of robots that begin as another network [control periods]


class Robots(VecEnv):
    """A vector of Gymnasium as Stable-Baselines3 has it: one whose robots begin anew at once."""

    def __init__(self, robots: StationVectorEnvironment) -> None:
        """Take the vector."""
        self.robots, self._actions = robots, np.zeros(0)
        super().__init__(
            robots.num_envs, robots.single_observation_space, robots.single_action_space
        )

    def reset(self) -> Any:
        """Begin all episodes, from the seed that was given."""
        return self.robots.reset(seed=self._seeds[0])[0]

    def step_async(self, actions: Vector) -> None:
        """Keep the actions."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Step; what a robot observed at its end is told beside what it observes at its new beginning."""
        seen, rewards, ended, cut, info = self.robots.step(self._actions)
        told: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for place in np.flatnonzero(ended | cut):
            told[place] = {
                "terminal_observation": info["final_obs"][place],
                "TimeLimit.truncated": bool(cut[place]),
            }
        return seen, rewards.astype(np.float32), ended | cut, told

    def close(self) -> None:
        """Let the threads end."""
        self.robots.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute, the same for all."""
        return [getattr(self.robots, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of all."""
        setattr(self.robots, attr_name, value)

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **options: Any
    ) -> list[Any]:
        """Call a method of all."""
        return [getattr(self.robots, method_name)(*args, **options)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return that none is."""
        return [False] * self.num_envs


class Curve(BaseCallback):
    """Write the mean return and length of the last episodes after each round, and end when the time is over."""

    def __init__(self, folder: Path, minutes: float) -> None:
        """Begin the table."""
        super().__init__()
        self._folder, self._minutes, self._began = folder, minutes, time.perf_counter()
        with (folder / "curve.csv").open("w", newline="") as file:
            csv.writer(file).writerow(
                ["wall_minutes", "processor_minutes", "steps", "return", "seconds"]
            )

    def _on_step(self) -> bool:
        return (time.perf_counter() - self._began) / 60 < self._minutes

    def _on_rollout_end(self) -> None:
        episodes = self.model.ep_info_buffer or []
        returns, lasted = ([episode[key] for episode in episodes] for key in ("r", "l"))
        if not returns:
            return
        wall, used = (time.perf_counter() - self._began) / 60, time.process_time() / 60
        period = self.training_env.get_attr("period")[0]
        row = [wall, used, self.num_timesteps, np.mean(returns), np.mean(lasted) * period]
        with (self._folder / "curve.csv").open("a", newline="") as file:
            csv.writer(file).writerow(
                [f"{value:.5g}" if value < 1e5 else f"{value:.0f}" for value in row]
            )
        save(self.model, self._folder)


def save(model: Any, folder: Path) -> Path:
    """Write the mean action of a model, which observes as VecNormalize gives it, and return the file."""
    normal = model.get_vec_normalize_env()
    spread = np.sqrt(normal.obs_rms.var + normal.epsilon)
    ((weights, biases), *others), activation, last = layers(model)
    first = weights / spread, biases - (weights / spread) @ normal.obs_rms.mean
    return write_network(folder / "policy.onnx", [first, *others], activation=activation, last=last)


def begin_as(model: Any, file: Path) -> None:
    """Give a model the mean action of a network that :func:`save` wrote; what that observes is looked at first."""
    network, robots = Network(file, "policy"), model.get_vec_normalize_env()
    robots.reset()
    for _ in range(LOOKED_AT):
        robots.step(
            np.array([network(seen) for seen in robots.get_original_obs().astype(np.float32)])
        )
    stored = [numpy_helper.to_array(each) for each in onnx.load(file).graph.initializer]
    (weights, biases), *others = zip(stored[::2], stored[1::2], strict=True)
    normal = robots.obs_rms
    first = weights * np.sqrt(normal.var + robots.epsilon), biases + weights @ normal.mean
    for own, other in zip(layers(model)[0], [first, *others], strict=True):
        for array, values in zip(own, other, strict=True):
            array[:] = values  # of the model itself


def main() -> None:
    """Learn, and write the policy after each round."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("task", help="a name, such as walk, or a YAML file")
    options.add_argument("--robots", type=int, default=128)
    options.add_argument("--steps", type=int, default=1_800_000)
    options.add_argument("--step", type=float, default=0.005, help="of MuJoCo [s]")
    options.add_argument(
        "--deviation", type=float, default=0.13, help="of actions at the start, of their reach"
    )
    options.add_argument("--minutes", type=float, default=120)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--start", type=Path, help="a policy.onnx to begin as")
    options.add_argument("--out", type=Path, default=Path("runs/learnt"))
    given = options.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    set_num_threads(1)
    robots: Any = VecMonitor(
        Robots(StationVectorEnvironment(given.robots, given.task, step=given.step))
    )
    robots.seed(given.seed)
    robots = VecNormalize(robots, gamma=SETTINGS["gamma"])
    SETTINGS["policy_kwargs"]["log_std_init"] = float(np.log(given.deviation))
    board = str(given.out) if find_spec("tensorboard") else None
    model = PPO(
        "MlpPolicy", robots, seed=given.seed, device="cpu", tensorboard_log=board, **SETTINGS
    )
    if given.start is not None:
        begin_as(model, given.start)
    model.learn(given.steps, Curve(given.out, given.minutes))
    print(f"learnt: {save(model, given.out)}")


if __name__ == "__main__":
    main()
