"""Robots that fall while they walk, and get up: a table of docs/results/walking.md.

Run it with ``python -m tests.benchmarks.get_up [ROBOT | SETTINGS | on]...``; it takes some minutes. Each seed draws a
push of 0.1 s that fells the robot, from anywhere and at any moment of two steps, whether a guard curls it up, how far
each joint is off at the start, and the friction of all that touches. SETTINGS are files, as of ``simrob run --set``.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake import LeggedRobot, load_station, simulate
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.gaits_file import gaits_file

FELLS = {"zjudancer": (60.0, 140.0), "roid1": (25.0, 60.0)}  # [N]
SPEED = {"zjudancer": 0.25, "roid1": 0.15}  # [m/s]
EARLIEST, TWO_STEPS, WATCHED = 2.0, 0.6, 3.0  # [s]
NOISE = 2.0  # standard deviation of how far each joint is off at the start [deg]
FRICTION = (0.5, 1.2)
DRAWS, SEEDS = 20, range(4000, 4200)  # the postures were set by others
SIDES = ("belly", "back")
LOOPS = Path(__file__).parents[2] / "examples" / "loops"
GUARDS, ON = read_yaml(LOOPS / "fall_guards.yaml"), read_yaml(LOOPS / "get_up.yaml")
LONG = 30.0  # of a walk that goes on [s]


def drawn(name: str, seed: int) -> tuple[dict[str, Any], float, bool]:
    """Return what a seed draws: changes of the walking station, when the push comes [s], and whether a guard acts."""
    draw, standing = np.random.default_rng(seed), LeggedRobot(f"{name}_walking")
    force, angle = draw.uniform(*FELLS[name]), draw.uniform(-math.pi, math.pi)
    start, friction = EARLIEST + draw.uniform(0, TWO_STEPS), draw.uniform(*FRICTION)
    off = standing.position + draw.normal(0, math.radians(NOISE), len(standing.axes))
    changes = {
        "forces.push": {
            "kind": "push",
            "start": start,
            "force": [force * math.cos(angle), force * math.sin(angle), 0.0],
        },
        "contact.friction": {"static": friction, "dynamic": friction},
        "robot.initial_deg": standing.targets_deg(np.clip(off, *standing.model.axis_limits)),
    }
    return changes, start, bool(draw.random() < 0.5)


def fallen(name: str, seed: int, settings: Mapping[str, Any]) -> LeggedRobot:
    """Return a robot that lies where it fell."""
    changes, start, guarded = drawn(name, seed)
    guards = {f"controllers.{guard}": section for guard, section in GUARDS[name].items() if guarded}
    robot = LeggedRobot(
        load_station(f"{name}_walking", {**settings, **changes, **guards, "monitors": {}})
    )
    robot.go(SPEED[name], duration=start + WATCHED)
    robot.cell.change(robot.cell.config.model_copy(update={"forces": {}}))
    return robot


def walks_on(name: str, seed: int) -> bool | None:
    """Return whether a walk goes on after its fall, by examples/loops/get_up.yaml; None if it did not fall."""
    changes, _, _ = drawn(name, seed)
    result = simulate(
        load_station(f"{name}_walking", {**ON, **changes, "duration": LONG}), progress=False
    )
    rises = np.flatnonzero(result["get_up.active"] > 0)
    if not len(rises):
        return None
    last = result.times > LONG - WATCHED
    ways = [np.ptp(result[f"base.{axis}"][last]) if last.any() else 0.0 for axis in "xy"]
    return (
        result.ending == "completed"
        and rises[-1] < np.argmax(last)
        and math.hypot(*ways) > 0.5 * SPEED[name] * WATCHED
    )


def side(robot: LeggedRobot) -> str | None:
    """Return on what a robot lies; None if it did not fall."""
    turned, facing = (
        robot.base_pose.rotation().matrix(),
        math.radians(gaits_file(robot.model).facing_deg),
    )
    if turned[2, 2] > 0.5:
        return None
    return SIDES[int(turned[2, :2] @ [math.cos(facing), math.sin(facing)] > 0)]


def attempts(result: SimulationResult) -> int:
    """Return at which attempt it got up; 0 if it did not."""
    return int(result["get_up.attempt"].max()) if result.ending == "completed" else 0


def main(words: list[str]) -> None:
    """Let them fall and get up, and print; or, by the word `on`, walk on."""
    if "on" in words:
        for name in FELLS:
            went = (walks_on(name, seed) for seed in SEEDS)
            fell = list(islice((each for each in went if each is not None), DRAWS))
            print(f"{name} walks on after {sum(fell)} of {len(fell)} falls", flush=True)
        return
    names = [word for word in words if word in FELLS] or list(FELLS)
    settings = {
        key: value for file in words if file not in FELLS for key, value in read_yaml(file).items()
    }
    print("robot | lies on its | gets up | at the first attempt | in [s]: median | longest")
    for name in names:
        found: dict[str, list[tuple[int, float]]] = {each: [] for each in SIDES}
        for seed in SEEDS:
            robot = fallen(name, seed, settings)
            lies = side(robot)
            if lies is None or len(found[lies]) == DRAWS:
                continue
            result = robot.get_up()
            found[lies].append((attempts(result), float(result.times[-1])))
            if not found[lies][-1][0]:
                print(f"  {name}, seed {seed}: {result.message}", flush=True)
            if all(len(runs) == DRAWS for runs in found.values()):
                break
        for lies, runs in found.items():
            times = [time for tries, time in runs if tries]
            up, first = (sum(tries >= 1 for tries, _ in runs), sum(tries == 1 for tries, _ in runs))
            told = [f"{up} of {len(runs)}", first, f"{np.median(times):.1f}", f"{max(times):.1f}"]
            print(name, lies, *told, sep=" | ", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
