"""Falls of walking robots, and in how many of them the head meets the floor: a table of docs/results/walking.md.

Run it with ``python -m tests.benchmarks.walking_falls [NAME]...``; it takes some minutes. Each seed draws
a push of 0.1 s from anywhere, at any moment of two steps, how far each joint is off, the mass of each link and the
friction of all that touches. The same falls without and with the guards of examples/loops/fall_guards.yaml.
"""

from __future__ import annotations

import math
import shutil
import sys
import tempfile
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from simrob_drake import simulate
from simrob_drake.base.files import models_root
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.results.result import SimulationResult

WITHSTANDS = {  # push of 0.1 s ahead, back, to the left and to the right: docs/results/walking.md [N]
    "zjudancer walk": (11.0, 18.0, 11.0, 11.0),
    "roid1 walk": (4.0, 7.0, 5.0, 4.0),
    "humanoid walk": (9.5, 11.5, 5.8, 14.0),
    "humanoid real_sole": (7.5, 8.2, 7.5, 6.0),
}
SEEDS, SMALLER = range(100, 120), range(200, 208)  # the guards were set by others
WATCHED = 3.0  # from the push on [s]
LONGEST = 6.0  # of a walk at its full pace [s]
EARLIEST = 2.0  # moment of a push: steps have their full length then [s]
FELLS, WITHSTOOD = (2.0, 3.0), (0.3, 0.9)  # of the push that it withstands
NOISE = math.radians(0.5)  # standard deviation of how far each joint is off [rad]
MASSES, FRICTION = (0.95, 1.05), (0.5, 1.2)
STEPS = {"solver.max_step": 0.01, "solver.error_control": True, "sample_rate": 500}
GUARDS = read_yaml(Path(__file__).parents[2] / "examples" / "loops" / "fall_guards.yaml")


@dataclass(frozen=True)
class Walk:
    """A walk, and what it withstands."""

    motion: JointMotion
    step_time: float
    withstands: tuple[float, float, float, float]

    @property
    def robot(self) -> str:
        """Its name."""
        return self.motion.model.name

    def push(self, draw: np.random.Generator, times: tuple[float, float]) -> dict[str, Any]:
        """Return a push, so many times as hard as it withstands to that side: between the four along ellipses."""
        angle = draw.uniform(-math.pi, math.pi)  # from ahead to the left
        ahead, back, left, right = self.withstands
        along, across = math.cos(angle), math.sin(angle)
        most = 1 / math.hypot(
            along / (ahead if along > 0 else back), across / (left if across > 0 else right)
        )
        size, start = most * draw.uniform(*times), EARLIEST + 2 * self.step_time * draw.uniform()
        turn = math.radians(load_gaits(self.motion.model).facing_deg) + angle
        force = [size * math.cos(turn), size * math.sin(turn), 0.0]
        return {"kind": "push", "start": start, "force": force}


def walk_of(name: str) -> Walk:
    """Return a walk of the table by its name."""
    robot, gait = name.split()
    step_time = load_gaits(robot).walks[gait].step_time
    return Walk(walk(robot, round(LONGEST / step_time), gait), step_time, WITHSTANDS[name])


def pushed(
    walking: Walk, seed: int, controllers: Mapping[str, Any], times: tuple[float, float] = FELLS
) -> Outcome:
    """Simulate what a seed draws."""
    motion, draw = walking.motion, np.random.default_rng(seed)
    push, friction = walking.push(draw, times), draw.uniform(*FRICTION)
    off = replace(
        motion,
        positions=motion.positions + draw.normal(0, NOISE, len(motion.model.axes)),
        falls=True,
    )
    with tempfile.TemporaryDirectory() as folder:
        changed = {
            "robot.model": str(_reweighed(walking.robot, draw, Path(folder))),
            "forces.push": push,
            "contact.friction": {"static": friction, "dynamic": friction},
            "sensors": {"head": {"kind": "distance", "body": motion.model.tools["head"]}},
            "controllers": controllers,
            "duration": push["start"] + WATCHED,
        }
        result = simulate(
            off.station({**changed, **STEPS}), reference=off.trajectory(), progress=False
        )
    return Outcome.of(result, controllers)


def _reweighed(robot: str, draw: np.random.Generator, folder: Path) -> Path:
    """Copy a robot, give its links other masses, and return its file."""
    copied = Path(shutil.copytree(models_root() / robot, folder / robot))
    tree = ElementTree.parse(copied / f"{robot}.urdf")
    for inertial in tree.iter("inertial"):
        part = draw.uniform(*MASSES)
        for element in (*inertial.iter("mass"), *inertial.iter("inertia")):
            for key, value in element.items():
                element.set(key, str(part * float(value)))
    tree.write(copied / f"{robot}.urdf")
    return copied / "robot.yaml"


@dataclass(frozen=True)
class Outcome:
    """How a run went on after its push."""

    fell: bool
    """It leaned by more than 60°, or came down to half of its height."""
    acts: bool
    """A guard acted."""
    blow: float | None
    """How fast the head met the floor [m/s]; None if it did not."""

    @classmethod
    def of(cls, result: SimulationResult, guards: Collection[str]) -> Outcome:
        """Look at a run with a signal of the head's distance from the floor."""
        upward = 1 - 2 * (result["base.qx"] ** 2 + result["base.qy"] ** 2)
        height, head = result["base.z"], result["distance.head"]
        fell = bool(upward.min() < 0.5 or height.min() < 0.5 * height[0])
        acts, blow = any(result[f"{guard}.active"].any() for guard in guards), None
        if head.min() < 0:
            touch = int(np.argmax(head < 0))
            blow = float(
                (head[touch - 2] - head[touch - 1])
                / (result.times[touch - 1] - result.times[touch - 2])
            )
        return cls(fell, acts, blow)


def false_alarm(walking: Walk, seed: int) -> bool:
    """Return whether a guard acts after a smaller push, although without it the robot stays on its feet."""
    acts = pushed(walking, seed, GUARDS[walking.robot], WITHSTOOD).acts
    return acts and not pushed(walking, seed, {}, WITHSTOOD).fell


def main(names: list[str]) -> None:
    """Let them fall, and print."""
    print(
        "walk | falls | head meets the floor: without | with | at [m/s]: without | with | false alarms"
    )
    for name in names or WITHSTANDS:
        walking = walk_of(name)
        without = {seed: outcome for seed in SEEDS if (outcome := pushed(walking, seed, {})).fell}
        guarded = [pushed(walking, seed, GUARDS[walking.robot]) for seed in without]
        blows = [
            [each.blow for each in runs if each.blow is not None]
            for runs in (without.values(), guarded)
        ]
        speeds = [f"{np.median(each):.1f}" if each else "-" for each in blows]
        false = sum(false_alarm(walking, seed) for seed in SMALLER)
        told = [len(without), *map(len, blows), *speeds, f"{false} of {len(SMALLER)}"]
        print(name, *told, sep=" | ", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
