"""Augmented random search: a linear policy, moved along random directions by how much better one side is (Mania 2018).

Version V2-t of arXiv 1803.07055: observations are normalised by what was seen so far, and the best directions count.

All directions of an iteration are robots of one vector in MuJoCo; what was found is then tried in Drake.

python examples/learning/ars.py Reach --out runs/reach
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path

import gymnasium
import numpy as np
from held_back import compare

from simrob_drake.base.frames import Vector
from simrob_drake.extensions.learning import ENVIRONMENTS
from simrob_drake.extensions.learning.vector import StationVectorEnvironment
from simrob_drake.extensions.learning.writing import write_network


def tried(
    env: StationVectorEnvironment, weights: Vector, normal: tuple[Vector, Vector], seed: int
) -> tuple[Vector, Vector]:
    """Return what an episode gives each of k policies, shape (k,), and all that was observed, shape (m, observed).

    All begin alike; action = weights (k, acts, observed) @ ((observation - mean) / spread).
    """
    mean, spread = normal
    seen, _ = env.reset(seed=[seed] * env.num_envs)
    totals, going, rows = np.zeros(env.num_envs), np.ones(env.num_envs, bool), [seen]
    while going.any():
        actions = np.einsum("kao,ko->ka", weights, (seen - mean) / spread)
        seen, rewards, ended, cut, _ = env.step(actions)
        totals += np.where(going, rewards, 0.0)
        rows.append(seen[going])
        going &= ~(ended | cut)
    return totals, np.concatenate(rows, dtype=float)


def search(
    name: str,
    folder: Path,
    *,
    iterations: int,
    directions: int,
    best: int,
    step: float,
    noise: float,
    seed: int,
) -> tuple[Vector, Vector]:
    """Return weights and biases of the policy that was found; the curve goes to the folder."""
    kind = {"vectorization_mode": "vector_entry_point"}
    env = gymnasium.make_vec(f"simrob/{name}-v0", num_envs=2 * directions, **kind)
    assert isinstance(env, StationVectorEnvironment)
    shape = env.single_action_space.shape + env.single_observation_space.shape
    draw, weights = np.random.default_rng(seed), np.zeros(shape)
    count, sums, squares = 1e-6, np.zeros(shape[1]), np.full(shape[1], 1e-6)
    folder.mkdir(parents=True, exist_ok=True)
    began = time.perf_counter()
    with (folder / "curve.csv").open("w", newline="") as file:
        curve = csv.writer(file)
        curve.writerow(["iteration", "wall_minutes", "mean", "best"])
        for iteration in range(iterations):
            mean = sums / count
            spread = np.sqrt(np.maximum(squares / count - mean**2, 1e-4))
            deltas = draw.standard_normal((directions, *shape))
            sides = np.concatenate([weights + noise * deltas, weights - noise * deltas])
            totals, rows = tried(env, sides, (mean, spread), 1000 * seed + iteration)
            pairs = totals.reshape(2, directions).T
            chosen = np.argsort(-pairs.max(axis=1))[:best]
            moved = (pairs[chosen, 0] - pairs[chosen, 1]) @ deltas[chosen].reshape(best, -1)
            weights = weights + step / (
                best * max(float(pairs[chosen].std()), 1e-9)
            ) * moved.reshape(shape)
            count, sums, squares = (
                count + len(rows),
                sums + rows.sum(axis=0),
                squares + (rows**2).sum(axis=0),
            )
            row = [
                iteration,
                (time.perf_counter() - began) / 60,
                float(pairs.mean()),
                float(pairs.max()),
            ]
            curve.writerow([f"{value:.5g}" for value in row])
            file.flush()
    mean = sums / count
    spread = np.sqrt(np.maximum(squares / count - mean**2, 1e-4))
    return weights / spread, -(weights / spread) @ mean


def main() -> None:
    """Search, write the policy, and compare it with doing nothing, on seeds that were held back."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("env", choices=[name for name in ENVIRONMENTS if name != "HandGuide"])
    options.add_argument("--out", type=Path, default=Path("runs/searched"))
    options.add_argument("--iterations", type=int, default=150)
    options.add_argument("--directions", type=int, default=32)
    options.add_argument("--best", type=int, default=16)
    options.add_argument("--step", type=float, default=0.03)
    options.add_argument("--noise", type=float, default=0.05)
    options.add_argument("--seed", type=int, default=1)
    given = vars(options.parse_args())
    env, folder = given.pop("env"), given.pop("out")
    weights, biases = search(env, folder, **given)
    compare(env, write_network(folder / "policy.onnx", [(weights, biases)]))


if __name__ == "__main__":
    main()
