"""Prove a walker where it never learnt: seeds, ground, load and solver that were held back, in its station as it is.

python examples/learning/prove_walker.py examples/learning/yobotics_walker.yaml --out runs/proof.csv
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake import load_station
from simrob_drake.extensions.learning.episode import Episode
from simrob_drake.extensions.tuning.processes import Processes

CONDITIONS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "friction 0.6": {"contact.friction": {"static": 0.6, "dynamic": 0.6}},
    "1 kg on its back": {
        "pieces.load": {
            "model": "box",
            "parent": "robot",
            "mass": 1.0,
            "pose": [0, 0, 0.1, 0, 0, 0],
        }
    },
    "steps of 2 ms": {"solver": {"kind": "discrete", "time_step": 2e-3}},
    "cenic": {
        "solver": {"kind": "continuous", "scheme": "cenic", "accuracy": 1e-3, "max_step": 0.02}
    },
}
FIRST, MANY = 910_000, 100  # seeds: nothing was chosen by these
NOISE_DEG = 1.0  # standard deviation of where each axis begins
FAR, LONG = 3.0, 20.0  # what is asked for [m, s]
TOLD = ("condition", "seed", "ahead", "aside", "lasted", "ended")


@dataclass(frozen=True)
class Walk:
    """A walk that is asked for, and what became of it."""

    condition: str
    seed: int
    station: Path
    ahead: float = 0.0  # m
    aside: float = 0.0  # m
    lasted: float = 0.0  # s
    ended: str = ""  # why, if it fell

    @property
    def proven(self) -> bool:
        """Whether it went far enough, and stood all the time."""
        return not self.ended and self.ahead >= FAR


@lru_cache(maxsize=1)
def episode(station: Path, condition: str) -> Episode:
    """Return the station of this process, built once for a condition."""
    return Episode(load_station(station, CONDITIONS[condition]))


def walked(walk: Walk) -> Walk:
    """Walk. The policy is the station's own: nothing is asked of it from outside."""
    made, draw = episode(walk.station, walk.condition), np.random.default_rng(walk.seed)
    seeds = draw.integers(2**31, size=len(made.seeds)).tolist()
    away = np.deg2rad(NOISE_DEG) * draw.standard_normal(len(made.robot.axes))
    made.begin(seeds=seeds, start=np.clip(made.robot.initial + away, *made.robot.model.axis_limits))
    while not made.ended and made.time < LONG - made.period / 2:
        made.advance(None)
    ahead, aside, _ = made.moment(goal=np.zeros(3)).place.round(3).tolist()
    return replace(walk, ahead=ahead, aside=aside, lasted=round(made.time, 2), ended=made.ended)


def main() -> None:
    """Walk under all conditions with all seeds, and print in how many the walker did what is asked for."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("station", type=Path)
    options.add_argument("--out", type=Path, default=Path("runs/proof.csv"))
    options.add_argument(
        "--conditions", nargs="+", choices=list(CONDITIONS), default=list(CONDITIONS)
    )
    options.add_argument("--first", type=int, default=FIRST, help="the first seed")
    options.add_argument("--many", type=int, default=MANY, help="how many")
    given = options.parse_args()
    seeds = range(given.first, given.first + given.many)
    walks = [
        Walk(condition, seed, given.station) for condition in given.conditions for seed in seeds
    ]
    given.out.parent.mkdir(parents=True, exist_ok=True)
    found = []
    with Processes() as processes, given.out.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow([*TOLD])
        for walk in processes.outcomes(
            walked, walks, lambda walk: replace(walk, ended="its process died")
        ):
            found.append(walk)
            table.writerow([getattr(walk, name) for name in TOLD])
            file.flush()
    for condition in given.conditions:
        own = [walk for walk in found if walk.condition == condition]
        ways = np.array([walk.ahead for walk in own if not walk.ended] or [0.0])
        done = sum(walk.proven for walk in own)
        print(
            f"{condition}: {done} of {len(own)} upright over {FAR:g} m in {LONG:g} s; median {np.median(ways):.2f} m"
        )


if __name__ == "__main__":
    main()
