"""Augmented random search: a linear policy, moved along random directions by how much better one side is (Mania 2018).

Version V2-t of arXiv 1803.07055: observations are normalised by what was seen so far, and the best directions count.

python examples/learning/ars.py Balance --iterations 30 --out runs/balance
"""

from __future__ import annotations

import argparse
import csv
import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import gymnasium
import numpy as np
from held_back import compare

from simrob_drake.frames import Vector
from simrob_drake.learning import ENVIRONMENTS
from simrob_drake.learning.environment import StationEnvironment
from simrob_drake.learning.writing import write_network
from simrob_drake.tuning.processes import Processes


@dataclass(frozen=True)
class Trial:
    """A linear policy to be tried in an episode: action = weights @ ((observation - mean) / spread)."""

    number: int
    env: str
    weights: Vector
    mean: Vector
    spread: Vector
    seed: int


@dataclass(frozen=True)
class Tried:
    """What an episode gave: its return, and count, sum and sum of squares of what was observed."""

    number: int
    total: float
    count: int = 0
    sums: Vector | float = 0.0
    squares: Vector | float = 0.0


@lru_cache(maxsize=1)
def environment(env: str) -> StationEnvironment:
    """Return the environment of this process, built once."""
    made = gymnasium.make(f"simrob/{env}-v0").unwrapped
    assert isinstance(made, StationEnvironment)
    return made


def tried(trial: Trial) -> Tried:
    """Return what an episode gives."""
    env = environment(trial.env)
    seen, _ = env.reset(seed=trial.seed)
    rows, total, done = [seen], 0.0, False
    while not done:
        action = trial.weights @ ((seen - trial.mean) / trial.spread)
        seen, reward, ended, cut, _ = env.step(np.clip(action, -1, 1))
        rows.append(seen)
        total, done = total + reward, ended or cut
    table = np.array(rows, dtype=float)
    return Tried(trial.number, total, len(table), table.sum(axis=0), (table**2).sum(axis=0))


def search(
    env: str, folder: Path, *, iterations: int, directions: int, best: int, step: float, noise: float, seed: int
) -> tuple[Vector, Vector]:
    """Return weights and biases of the policy that was found; the curve goes to the folder."""
    shape = environment(env).action_space.shape + environment(env).observation_space.shape
    draw, weights = np.random.default_rng(seed), np.zeros(shape)
    count, sums, squares = 1e-6, np.zeros(shape[1]), np.full(shape[1], 1e-6)
    folder.mkdir(parents=True, exist_ok=True)
    began = time.perf_counter()
    with Processes() as processes, (folder / "curve.csv").open("w", newline="") as file:
        curve = csv.writer(file)
        curve.writerow(["iteration", "wall_minutes", "mean", "best"])
        for iteration in range(iterations):
            mean = sums / count
            spread = np.sqrt(np.maximum(squares / count - mean**2, 1e-4))
            deltas = draw.standard_normal((directions, *shape))
            sides = [weights + sign * noise * delta for delta in deltas for sign in (1, -1)]
            at = 1000 * seed + iteration
            trials = [Trial(number, env, side, mean, spread, at) for number, side in enumerate(sides)]
            outcomes = processes.outcomes(tried, trials, lambda trial: Tried(trial.number, -1e3))
            found = sorted(outcomes, key=lambda each: each.number)
            pairs = np.array([each.total for each in found]).reshape(directions, 2)
            chosen = np.argsort(-pairs.max(axis=1))[:best]
            moved = (pairs[chosen, 0] - pairs[chosen, 1]) @ deltas[chosen].reshape(best, -1)
            weights = weights + step / (best * max(float(pairs[chosen].std()), 1e-9)) * moved.reshape(shape)
            count += sum(each.count for each in found)
            sums = sums + sum(each.sums for each in found)
            squares = squares + sum(each.squares for each in found)
            row = [iteration, (time.perf_counter() - began) / 60, float(pairs.mean()), float(pairs.max())]
            curve.writerow([f"{value:.5g}" for value in row])
            file.flush()
    mean = sums / count
    spread = np.sqrt(np.maximum(squares / count - mean**2, 1e-4))
    return weights / spread, -(weights / spread) @ mean


def main() -> None:
    """Search, write the policy, and compare it with doing nothing, on seeds that were held back."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("env", choices=list(ENVIRONMENTS))
    options.add_argument("--out", type=Path, default=Path("runs/searched"))
    options.add_argument("--iterations", type=int, default=30)
    options.add_argument("--directions", type=int, default=8)
    options.add_argument("--best", type=int, default=4)
    options.add_argument("--step", type=float, default=0.03)
    options.add_argument("--noise", type=float, default=0.05)
    options.add_argument("--seed", type=int, default=1)
    given = vars(options.parse_args())
    env, folder = given.pop("env"), given.pop("out")
    weights, biases = search(env, folder, **given)
    compare(env, write_network(folder / "policy.onnx", [(weights, biases)]))


if __name__ == "__main__":
    main()
