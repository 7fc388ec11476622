"""A walker from scratch: oscillators in the joints and linear feedback of the IMU, all figures found by CMA-ES.

After A. Raffin et al., "An Open-Loop Baseline for Reinforcement Learning Locomotion Tasks" (arXiv 2310.05808). The only
prior knowledge is the symmetry of the body: legs move alike but for their phases, and what leans to the left is
answered on the left as what leans to the right on the right. Amplitudes, phases, posture and gains begin at nothing.

python examples/learning/oscillators.py --out runs/walker
"""

from __future__ import annotations

import argparse
import csv
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import gymnasium
import numpy as np
from cmaes import CMA

import simrob_drake.extensions.learning
from simrob_drake import load_station
from simrob_drake.base.frames import Vector
from simrob_drake.extensions.learning.environment import StationEnvironment
from simrob_drake.extensions.learning.task import load_task
from simrob_drake.extensions.learning.writing import write_network
from simrob_drake.extensions.tuning.processes import Processes
from simrob_drake.stations.load import station_yaml

assert simrob_drake.extensions.learning.ENVIRONMENTS  # importing it registers them
TASK = Path(__file__).with_name("walk.yaml")
FAST = {"solver": {"kind": "discrete", "time_step": 0.005}}
HARMONICS = 2
FREQUENCY = (0.5, 4.0)  # Hz: where the search may look for it, by factors, from the middle on
MIRRORED = np.array([-1, 1, -1, -1, 1, -1])  # roll, pitch, yaw and their rates in a mirror


@dataclass(frozen=True)
class Body:
    """What the axes of a robot on legs are, by their names: which joint of which leg."""

    axes: Sequence[str]

    @property
    def joints(self) -> list[str]:
        """Kinds of joint, the same on every leg."""
        return list(dict.fromkeys(_kind(axis) for axis in self.axes))

    @property
    def legs(self) -> list[str]:
        """Legs; each has a phase of its own."""
        return list(dict.fromkeys(_leg(axis) for axis in self.axes))

    @property
    def size(self) -> int:
        """Number of figures that the search has to find."""
        joints, legs = len(self.joints), len(self.legs)
        return (
            1
            + (legs - 1)
            + joints * (1 + 2 * HARMONICS)
            + joints * 6 * (1 + ("front" in str(self.legs)))
        )

    def policy(self, figures: Vector) -> tuple[float, Vector, Vector]:
        """Return frequency [Hz], weights (m, 6 + 2 harmonics) on attitude, rates and clock, and biases (m,)."""
        joints, legs = self.joints, self.legs
        parts = iter(figures)

        def take(count: int) -> Vector:
            return np.array([next(parts) for _ in range(count)])

        low, high = np.log(FREQUENCY)
        frequency = float(np.exp(low + (high - low) / (1 + np.exp(-take(1)[0]))))
        phases = np.concatenate([[0.0], np.pi * take(len(legs) - 1)])
        biases = take(len(joints))
        swings = take(len(joints) * HARMONICS * 2).reshape(len(joints), HARMONICS, 2)
        ends = 2 if any("front" in leg for leg in legs) else 1
        gains = take(len(joints) * 6 * ends).reshape(len(joints), ends, 6)
        weights, bias = np.zeros((len(self.axes), 6 + 2 * HARMONICS)), np.zeros(len(self.axes))
        for row, axis in enumerate(self.axes):
            joint, leg = joints.index(_kind(axis)), _leg(axis)
            bias[row] = biases[joint]
            side = np.where(MIRRORED < 0, 1.0 if "left" in leg else -1.0, 1.0)
            gain = gains[joint, 0] + (
                gains[joint, 1] * (1.0 if "front" in leg else -1.0) if ends == 2 else 0.0
            )
            weights[row, :6] = side * gain * [1, 1, 1, 0.2, 0.2, 0.2]
            for harmonic in range(HARMONICS):
                turn = (harmonic + 1) * phases[legs.index(leg)]
                sine, cosine = swings[joint, harmonic] / (harmonic + 1)
                weights[row, 6 + harmonic] = sine * np.cos(turn) - cosine * np.sin(turn)
                weights[row, 6 + HARMONICS + harmonic] = sine * np.sin(turn) + cosine * np.cos(turn)
        return frequency, weights, bias


def _kind(axis: str) -> str:
    return "_".join(
        part for part in axis.split("_") if part not in ("left", "right", "front", "rear")
    )


def _leg(axis: str) -> str:
    return "_".join(part for part in axis.split("_") if part in ("left", "right", "front", "rear"))


@lru_cache(maxsize=1)
def environment(station: str, fast: bool = False) -> StationEnvironment:
    """Return the environment of this process, built once."""
    made = gymnasium.make(
        "simrob/Walk-v0", task=TASK, station=station, overrides=FAST if fast else {}
    ).unwrapped
    assert isinstance(made, StationEnvironment)
    return made


@dataclass(frozen=True)
class Trial:
    """Figures to be tried in an episode."""

    number: int
    station: str
    figures: Vector
    seed: int
    duration: float
    fast: bool


def tried(trial: Trial) -> tuple[int, float, float, float, float]:
    """Return number, return, distance forward [m], duration [s] and time of the processor [s] of an episode."""
    began = time.process_time()
    env = environment(trial.station, trial.fast)
    policy = env.episode.policy
    frequency, weights, bias = Body(env.policy_axes).policy(trial.figures)
    policy.clock = frequency * np.arange(1, HARMONICS + 1)
    seen, _ = env.reset(seed=trial.seed)
    total, ended = 0.0, False
    while not ended and env.episode.time < trial.duration - 1e-6:
        seen, reward, ended, _, info = env.step(weights @ seen + bias)
        total += reward
    return (
        trial.number,
        total,
        float(info["place"][0]),
        env.episode.time,
        time.process_time() - began,
    )


def died(trial: Trial) -> tuple[int, float, float, float, float]:
    """Return what becomes of a trial whose process died."""
    return trial.number, -1e3, 0.0, 0.0, 0.0


def search(
    station: str,
    folder: Path,
    *,
    start: Path | None,
    sigma: float,
    seed: int,
    generations: int,
    duration: float,
    population: int,
    workers: int,
    fast: bool,
) -> Vector:
    """Search and return the figures of the last mean; the curve goes to the folder."""
    axes = environment(station).policy_axes
    mean = np.zeros(Body(axes).size) if start is None else np.array(json.loads(start.read_text()))
    strategy = CMA(mean=mean, sigma=sigma, seed=seed, population_size=population)
    began, used = time.perf_counter(), 0.0
    folder.mkdir(parents=True, exist_ok=True)
    with Processes(workers) as processes, (folder / "curve.csv").open("w", newline="") as file:
        curve = csv.writer(file)
        curve.writerow(
            ["generation", "wall_minutes", "processor_minutes", "best", "mean", "ahead", "lasted"]
        )
        for generation in range(generations):
            asked = [strategy.ask() for _ in range(strategy.population_size)]
            trials = [
                Trial(number, station, figures, 1000 * seed + generation, duration, fast)
                for number, figures in enumerate(asked)
            ]
            found = sorted(processes.outcomes(tried, trials, died))
            strategy.tell([(asked[number], -total) for number, total, *_ in found])
            best = max(found, key=lambda row: row[1])
            used += sum(row[4] for row in found)
            times = [(time.perf_counter() - began) / 60, used / 60]
            row = [
                generation,
                *times,
                best[1],
                float(np.mean([each[1] for each in found])),
                *best[2:4],
            ]
            curve.writerow([f"{value:.5g}" for value in row])
            file.flush()
            (folder / "figures.json").write_text(json.dumps(strategy.mean.tolist()))
    print(
        f"{generations} generations of {population} in {(time.perf_counter() - began) / 60:.1f} min"
    )
    return np.array(strategy.mean)


def save(station: str, figures: Vector, folder: Path, *, fast: bool) -> Path:
    """Write the policy as ONNX, and a station with it; return its file."""
    frequency, weights, bias = Body(environment(station).policy_axes).policy(figures)
    network = write_network(folder / "policy.onnx", [(weights, bias)])
    learnt = {
        "network": str(network.resolve()),
        "clock": [frequency * (number + 1) for number in range(HARMONICS)],
    }
    overrides = {**load_task(TASK)[0].overrides, **(FAST if fast else {})}
    config = load_station(
        station, {**overrides, **{f"controllers.policy.{key}": learnt[key] for key in learnt}}
    )
    file = folder / "station.yaml"
    file.write_text(station_yaml(config.model_copy(update={"name": "walker", "duration": 20.0})))
    return file


def main() -> None:
    """Search, and write the policy."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--station", default="yobotics_dynamic")
    options.add_argument("--out", type=Path, default=Path("runs/walker"))
    options.add_argument("--seed", type=int, default=1)
    options.add_argument(
        "--start", type=Path, help="figures.json of an earlier search; from nothing unless given"
    )
    options.add_argument("--sigma", type=float, default=0.3)
    options.add_argument("--generations", type=int, default=20)
    options.add_argument("--duration", type=float, default=6.0)
    options.add_argument("--population", type=int, default=16)
    options.add_argument("--workers", type=int, default=2)
    options.add_argument(
        "--fast", action="store_true", help="steps of 5 ms, and not those of the station"
    )
    given = vars(options.parse_args())
    station, folder = given.pop("station"), given.pop("out")
    print(save(station, search(station, folder, **given), folder, fast=given["fast"]))


if __name__ == "__main__":
    main()
