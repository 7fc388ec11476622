"""Steps of environments a second of processor time: ``python -m tests.benchmarks.learning [SECONDS]``.

Each task with its own solver and with the one that its station has, in turns, so that a busy machine treats them alike;
and many robots in MuJoCo, all in one station, and each episode in one of 16 whose masses, friction and gains are drawn.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import mkdtemp
from time import process_time

import numpy as np
import yaml

from simrob_drake import load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.files import models_root
from simrob_drake.extensions.learning.environment import StationEnvironment
from simrob_drake.extensions.learning.task import load_task, task_names
from simrob_drake.extensions.learning.vector import StationVectorEnvironment

SECONDS = 2.0
ROUNDS = 5
MANY = 256
DRAWN = {"servo.kp": "uniform:60:100", "servo.kd": "uniform:2:4"}
OF_WALKERS = {
    "robot.mass_factors.trunk": "uniform:0.8:1.5",
    "contact.friction": {"values": [{"static": 0.5, "dynamic": 0.5}, {"static": 1, "dynamic": 1}]},
}
"""What is drawn of each station, and of those that stand on a floor."""


def speed(environment: StationEnvironment, seed: int, seconds: float) -> float:
    """Return how many steps of random actions an environment makes in a second, resets included."""
    environment.reset(seed=seed)
    chance, steps, begin = np.random.default_rng(seed), 0, process_time()
    while process_time() - begin < seconds:
        action = chance.uniform(-0.3, 0.3, environment.action_space.shape)
        *_, terminated, truncated, _ = environment.step(action)
        steps += 1
        if terminated or truncated:
            environment.reset(seed=seed + steps)
    return steps / (process_time() - begin)


def together(task: str | Path, seconds: float) -> str:
    """Return how many steps of single robots a vector of them makes in a second."""
    try:
        environment = StationVectorEnvironment(MANY, task)
    except SimrobError:
        return "–"
    environment.reset(seed=0)
    chance, steps, begin = np.random.default_rng(0), 0, process_time()
    while process_time() - begin < seconds:
        environment.step(chance.uniform(-0.3, 0.3, environment.action_space.shape))
        steps += MANY
    return f"{steps / (process_time() - begin):.0f}"


def drawn(name: str, folder: Path) -> Path:
    """Return a task whose stations are drawn."""
    known, file = (
        yaml.safe_load((models_root() / "tasks" / f"{name}.yaml").read_text()),
        folder / f"{name}.yaml",
    )
    file.write_text(
        yaml.safe_dump({**known, "random": {**DRAWN, **(OF_WALKERS if name == "walk" else {})}})
    )
    return file


def main(seconds: float = SECONDS) -> None:
    """Print a table."""
    print(
        "| task | solver | steps/s | of its station | steps/s | ratio | many in MuJoCo | each drawn |\n"
        "|---|---|---|---|---|---|---|---|"
    )
    folder = Path(mkdtemp())
    for name in task_names():
        station = load_station(load_task(name)[0].station)
        (robot,) = station.robots.values()
        realization = robot.servo.realization if robot.servo else "per_joint"
        kinds = {"solver": station.solver.model_dump(), "servo.realization": realization}
        pair = StationEnvironment(name), StationEnvironment(name, overrides=kinds)
        speeds = np.array([[speed(one, seed, seconds) for one in pair] for seed in range(ROUNDS)])
        own, its = np.median(speeds, axis=0)
        ratio = np.median(speeds[:, 0] / speeds[:, 1])
        schemes = [getattr(one.config.solver, "scheme", one.config.solver.kind) for one in pair]
        row = (
            name,
            schemes[0],
            f"{own:.0f}",
            schemes[1],
            f"{its:.0f}",
            f"{ratio:.1f}",
            together(name, seconds),
        )
        row = (*row, together(drawn(name, folder), seconds))
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main(*(float(one) for one in sys.argv[1:]))
