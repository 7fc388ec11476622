"""Let a policy walk beside the walk that reacts: the same speeds, pushes, robots and floors, in Drake.

Each seed draws all of that: speeds and pushes here; the robot's posture, its masses, the noise of its sensors and the
floor's friction as `simrob pushes --seeds` does.

python examples/learning/beside.py examples/learning/zjudancer_march.yaml zjudancer_walking --out runs/beside.csv
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.tuning.doubts import drawn
from simrob_drake.extensions.tuning.processes import Processes
from simrob_drake.results.record.walks import headings, locomotion
from simrob_drake.stations.config import StationConfig

FIRST, MANY = 920_000, 100  # seeds: nothing was chosen by these
LONG, STARTED = 10.0, 2.0  # a walk, and when its speed begins to count [s]
TOLD = (
    "walker",
    "condition",
    "seed",
    "asked",
    "speed",
    "aside",
    "turn",
    "turned",
    "lasted",
    "ended",
)
CENIC = {
    "kind": "continuous",
    "scheme": "cenic",
    "accuracy": 1e-3,
    "max_step": 0.01,
    "error_control": False,
}


@dataclass(frozen=True)
class Walk:
    """A walk that is asked for, and what became of it."""

    walker: str  # the station, perhaps "+" a file that changes it
    condition: str
    seed: int
    asked: float  # ahead [m/s]
    turn: float = 0.0  # to the left [rad/s]
    friction: float | None = None  # None as drawn
    push: float = 0.0  # N, for 0.1 s
    head: bool = False  # whether it is pushed there
    solver: dict[str, Any] | None = None  # None as it is
    speed: float = 0.0  # ahead as it faces, from STARTED on [m/s]
    turned: float = 0.0  # likewise [rad/s]
    aside: float = 0.0  # to the left of its first heading [m]
    lasted: float = 0.0  # s
    ended: str = ""  # why, if it fell


def station(walk: Walk) -> StationConfig:
    """Return the station in which a walk is made."""
    name, _, file = walk.walker.partition("+")
    own = read_yaml(file) if file else {}
    config, draw = load_station(name, own), np.random.default_rng(walk.seed)
    changes: dict[str, Any] = {**own, **drawn(config, walk.seed), "duration": LONG}
    for loop, section in config.controllers.items():
        if section.kind == "policy":
            changes[f"controllers.{loop}.goal"] = [walk.asked, 0.0, walk.turn][: len(section.goal)]
        elif section.kind == "walk":
            command = {"time": 0.5, "ahead": walk.asked, "turn_deg": float(np.rad2deg(walk.turn))}
            changes[f"controllers.{loop}.commands"] = [command]
    if walk.friction is not None:
        changes["contact.friction"] = {"static": walk.friction, "dynamic": walk.friction}
    if walk.push:
        angle, start = draw.uniform(0, 2 * np.pi), draw.uniform(3, 8)
        force = [walk.push * float(np.cos(angle)), walk.push * float(np.sin(angle)), 0.0]
        changes["forces.push"] = {"kind": "push", "start": start, "duration": 0.1, "force": force}
        if walk.head:
            changes["forces.push"]["at"] = "head"
    if walk.solver is not None:
        changes["solver"] = walk.solver
    return load_station(name, changes)


def walked(walk: Walk) -> Walk:
    """Walk."""
    result = simulate(station(walk), progress=False)
    (robot,) = result.plant.robots.values()
    told, lasted = locomotion(result), float(result.times[-1])
    base = result.pose("base")[result.times >= min(STARTED, lasted)]
    facing = np.unwrap(headings(result.plant, robot, base))
    ahead = np.diff(base[:, :2], axis=0) * np.stack([np.cos(facing), np.sin(facing)], axis=1)[:-1]
    time = max(lasted - STARTED, 0.01)
    found = {
        "speed": ahead.sum() / time,
        "turned": (facing[-1] - facing[0]) / time,
        "aside": told.drift,
    }
    rounded: Any = {name: round(float(value), 3) for name, value in found.items()}
    ending = "" if result.ending == "completed" else result.ending
    return replace(walk, **rounded, lasted=round(lasted, 2), ended=ending)


def interval(done: int, many: int) -> tuple[int, int]:
    """Return the 95 % interval of a share, by Wilson [%]."""
    part, share = 1.96**2 / many, done / many
    middle, half = share + part / 2, np.sqrt(part * share * (1 - share) + part * part / 4)
    return round(100 * (middle - half) / (1 + part)), round(100 * (middle + half) / (1 + part))


def walks(given: argparse.Namespace) -> Iterable[Walk]:
    """Return what is asked of all walkers: of the same seed the same."""
    conditions: dict[str, dict[str, Any]] = {
        "as it is": {},
        "friction 0.6": {"friction": 0.6},
        "turning": {},
    }
    conditions |= {f"a push of {push:g} N": {"push": push} for push in given.pushes}
    conditions |= {f"{push:g} N at the head": {"push": push, "head": True} for push in given.heads}
    conditions |= {"cenic, 10 ms": {"solver": CENIC}}
    for walker in given.walkers:
        for condition in given.only or conditions:
            for seed in range(given.first, given.first + given.many):
                draw = np.random.default_rng([seed, 1])
                asked, turn = (
                    round(float(draw.uniform(*given.speeds)), 3),
                    round(float(draw.uniform(-0.4, 0.4)), 3),
                )
                turns = {"turn": turn} if condition == "turning" else {}
                yield Walk(walker, condition, seed, asked, **turns, **conditions[condition])


def main() -> None:
    """Walk under all conditions with all seeds, and print what became of it."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument(
        "walkers", nargs="+", help="stations; STATION+FILE with the changes of a file"
    )
    options.add_argument("--out", type=Path, default=Path("runs/beside.csv"))
    options.add_argument("--speeds", type=float, nargs=2, default=[0.05, 0.3], help="ahead [m/s]")
    options.add_argument("--pushes", type=float, nargs="*", default=[10, 20], help="[N]")
    options.add_argument(
        "--heads", type=float, nargs="*", default=[], help="pushes at the head [N]"
    )
    options.add_argument("--only", nargs="*", help="these conditions")
    options.add_argument("--first", type=int, default=FIRST, help="the first seed")
    options.add_argument("--many", type=int, default=MANY, help="how many")
    options.add_argument(
        "--processes", type=int, help="as many as there are processors unless given"
    )
    given = options.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    found: dict[tuple[str, str], list[Walk]] = {}
    with Processes(given.processes) as processes, given.out.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow([*TOLD])
        for walk in processes.outcomes(
            walked, walks(given), lambda walk: replace(walk, ended="its process died")
        ):
            found.setdefault((walk.walker, walk.condition), []).append(walk)
            table.writerow([getattr(walk, name) for name in TOLD])
            file.flush()
    for (walker, condition), own in found.items():
        up = [walk for walk in own if not walk.ended]
        low, high = interval(len(up), len(own))
        off = [[walk.speed - walk.asked, walk.turned - walk.turn, walk.aside] for walk in up] or [
            [np.nan] * 3
        ]
        speed, turn, aside = np.median(np.abs(off), axis=0)
        print(
            f"{walker}, {condition}: {len(up)} of {len(own)} upright ({low} to {high} %); medians of errors: speed"
            f" {speed:.3f} m/s ({np.median(np.array(off)[:, 0]):+.3f}), turn {turn:.3f} rad/s; {aside:.2f} m aside"
        )


if __name__ == "__main__":
    main()
