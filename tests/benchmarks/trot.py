"""What yobotics withstands while it trots by the walking engine, each seed a little other: for docs/results/walking.md.

Run it with ``python -m tests.benchmarks.trot [NEWTON [SEEDS [KEY=VALUE]...]]``: pushes of 0.1 s from four sides, each
seed with a posture off by 0.5°, masses of all links by 5 %, a friction of 0.5 to 1.2, and a phase of the step. With
``steps [SEEDS [KEY=VALUE]...]`` it crosses 2 m of tiles of 0.2 m that lie within ±40 mm instead, with ``rubble`` stones
of up to 40 mm, with ``stairs`` four steps of 40 mm up and four down, with ``gaps`` eight of 60 mm: by the forces on its
feet, likewise each seed a little other; with ``controllers.walk.height_map=true`` it knows the ground.
"""

import math
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import numpy as np

from simrob_drake import SimulationResult, simulate
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.results.record.walks import locomotion
from simrob_drake.stations.load import load_station
from simrob_drake.stations.resolve import resolve

STATION = "yobotics_walking"
SIDES = {"forward": 0.0, "left": 90.0, "backward": 180.0, "right": 270.0}
LINKS = {
    "front_right": "FR_foot",
    "rear_left": "RL_foot",
    "front_left": "FL_foot",
    "rear_right": "RR_foot",
}
UNEVEN = {
    **{f"sensors.{place}": {"kind": "force", "body": link} for place, link in LINKS.items()},
    "controllers.walk.reads": {f"{place}_foot": f"force.{place}" for place in LINKS},
    "controllers.walk.gait": {
        "lift": 0.14,
        "lift_exponent": 1.5,
        "feedback": {"late_touchdown": 0.04, "search_speed": 0.1, "level_rate": 20},
    },
    "controllers.walk.commands": [],
    "controllers.walk.path": {"points": [[0, 0], [2.8, 0]], "speed": 0.2},
    "duration": 30.0,
    "sample_rate": 50,
}
GROUNDS = {
    "steps": {"height": 0.04, "size": 0.2, "length": 2},
    "rubble": {"height": 0.04, "size": 0.2, "length": 2},
    "stairs": {"height": 0.04, "size": 0.25, "length": 1.75},
    "gaps": {"height": 0.1, "size": 0.25, "length": 2, "gap": 0.06},
}
CROSSED = 2.65  # of the base: then all feet are behind the field [m]
PUSHED, STEP, AFTER = 2.5, 0.5, 2.0  # when, two steps, and how long it must keep its feet [s]
_POSTURE, _MASS, _FRICTION = 0.5, 0.05, (0.5, 1.2)


def doubtful(seed: int, folder: Path, station: str = STATION) -> dict[str, Any]:
    """Return what a seed makes otherwise; ``folder`` takes the robot of its masses."""
    draw = np.random.default_rng(seed)
    robot = resolve(load_station(station)).robots["robot"]
    units = robot.model.user_units
    start = robot.initial / units + draw.normal(0, _POSTURE, len(robot.axes))
    friction = draw.uniform(*_FRICTION)
    return {
        "robot.model": str(_weighed(robot.model.folder, folder / str(seed), draw)),
        "robot.initial_deg": start.tolist(),
        "contact.friction": {"static": friction, "dynamic": friction},
    }


def _weighed(folder: Path, copy: Path, draw: np.random.Generator) -> Path:
    """Copy a robot, each of its links with another mass and inertia."""
    if not copy.exists():
        shutil.copytree(folder, copy)
        for file in copy.glob("*.urdf"):
            tree = ElementTree.parse(file)
            for inertial in tree.iter("inertial"):
                part = draw.uniform(1 - _MASS, 1 + _MASS)
                for element in (*inertial.iter("mass"), *inertial.iter("inertia")):
                    for key, value in element.attrib.items():
                        element.set(key, str(part * float(value)))
            tree.write(file)
    return copy / "robot.yaml"


def pushed(
    seed: int, force: float, side: float, changes: Mapping[str, Any], folder: Path
) -> SimulationResult:
    """Return the run of a seed with a push."""
    when = PUSHED + STEP * np.random.default_rng([seed, int(side)]).uniform()
    turn = math.radians(side)
    push = {
        "kind": "push",
        "start": when,
        "force": [force * math.cos(turn), force * math.sin(turn), 0.0],
    }
    told = {
        **doubtful(seed, folder),
        "forces.push": push,
        "duration": when + AFTER,
        "sample_rate": 50,
        **changes,
    }
    return simulate(load_station(STATION, told), progress=False)


def main(force: float, seeds: int, changes: Mapping[str, Any]) -> None:
    """Push and print."""
    with TemporaryDirectory() as folder:
        for name, side in SIDES.items():
            runs = [pushed(seed, force, side, changes, Path(folder)) for seed in range(seeds)]
            upright = [run.stopped_by is None for run in runs]
            fell = [seed for seed, stays in enumerate(upright) if not stays]
            print(f"{force:g} N {name} | {sum(upright)} of {seeds} | fell: {fell}", flush=True)


def uneven(kind: str, seeds: int, changes: Mapping[str, Any]) -> None:
    """Cross and print."""
    ground, crossed = {"kind": kind, **GROUNDS[kind]}, 0
    with TemporaryDirectory() as folder:
        for seed in range(seeds):
            told = {
                **doubtful(seed, Path(folder)),
                "floor.terrain": {**ground, "seed": seed},
                **UNEVEN,
                **changes,
            }
            run = simulate(load_station(STATION, told), progress=False)
            walk, upright = locomotion(run), run.stopped_by is None
            crossed += upright and walk.ahead > CROSSED
            print(
                f"{kind} {seed} | {'upright' if upright else f'fell after {run.stop_time:.1f} s'} | "
                f"{walk.ahead:.2f} m ahead | {walk.drift:.2f} m aside | {math.degrees(walk.tilt):.1f}°",
                flush=True,
            )
    print(f"{kind} | crossed {crossed} of {seeds}")


if __name__ == "__main__":
    first, *rest = sys.argv[1:] or ["110"]
    pairs = [each.split("=", 1) for each in rest[1:]]
    told, count = (
        {key: parse_yaml(value, key) for key, value in pairs},
        int(rest[0]) if rest else 20,
    )
    if first in GROUNDS:
        uneven(first, count, told)
    else:
        main(float(first), count, told)
