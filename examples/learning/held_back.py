"""Compare a policy with doing nothing, on seeds that no search has seen."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.extensions.learning.policy import Network

SEEDS = range(900_000, 900_020)


def returns(env: str, network: Network | None) -> Vector:
    """Return what episodes with a network give, or with no action at all."""
    made, totals = gymnasium.make(f"simrob_drake.extensions.learning:simrob/{env}-v0"), []
    for seed in SEEDS:
        seen, _ = made.reset(seed=seed)
        total, done = 0.0, False
        while not done:
            action = (
                np.zeros(made.action_space.shape)
                if network is None
                else np.clip(network(seen), -1, 1)
            )
            seen, reward, ended, cut, _ = made.step(action.astype(np.float32))
            total, done = total + float(reward), ended or cut
        totals.append(total)
    return np.array(totals)


def compare(env: str, file: Path) -> None:
    """Print both."""
    for name, network in (("nothing", None), (file.name, Network(file, "policy"))):
        found = returns(env, network)
        print(
            f"{name}: return {found.mean():.4g} ± {found.std():.2g} on {len(found)} seeds that were held back"
        )
