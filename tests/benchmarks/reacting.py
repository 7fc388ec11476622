"""What walks that are made while they go can do: tables of docs/walking.md.

Run it with ``python -m tests.benchmarks.reacting [ROBOT [WHAT]...]``; WHAT is among the keys of :func:`tasks`.
"""

import sys
from collections.abc import Mapping
from time import process_time
from typing import Any

import numpy as np

from simrob_drake import load_station, simulate
from simrob_drake.frames import vertical
from simrob_drake.robots.catalog import load_robot
from simrob_drake.tuning.doubts import drawn
from tests.benchmarks.walking_falls import GUARDS, Outcome

SPEEDS = {"zjudancer": 0.25, "roid1": 0.2, "humanoid": 0.15, "yobotics": 0.5}  # m/s
LONG = {"zjudancer": 600, "roid1": 600, "humanoid": 600, "yobotics": 300}  # s
FACING = {"zjudancer": 90, "roid1": 0, "humanoid": -90, "yobotics": 0}
FELLS = {"zjudancer": 50.0, "roid1": 22.0}  # N, for 0.1 s: surely
HARD, MILD = (1.0, 1.5), (0.3, 0.45)  # times that; mild ones are mostly withstood
COMMANDS, GAIT = "controllers.walk.commands", "controllers.walk.gait"
STEPS = {"kind": "steps", "height": 0.01, "size": 0.1, "length": 3}


def ahead(speed: float, **more: float) -> list[dict[str, float]]:
    """Return commands to go ahead after a second."""
    return [{"time": 1.0, "ahead": speed, **more}]


def tasks(robot: str) -> dict[str, dict[str, Any]]:
    """Return what is tried, as settings of a station, by name."""
    speed, facing = SPEEDS[robot], FACING[robot]
    uneven = {"contact": {"model": "hydroelastic_with_fallback"}}
    return {
        "long": {COMMANDS: ahead(speed), "duration": LONG[robot], "floor.size": 400},
        "blind": {COMMANDS: ahead(speed), GAIT: {"feedback": None}, "duration": 20},
        "finer": {COMMANDS: ahead(speed), "solver.max_step": 0.005, "duration": 20},
        "turn": {COMMANDS: [{"time": 1.0, "turn_deg": 20}, {"time": 5.5}], "duration": 8},
        "up": {COMMANDS: ahead(0.6 * speed), "floor.incline_deg": 6, "floor.heading_deg": facing, "duration": 20},
        "down": {
            COMMANDS: ahead(0.6 * speed),
            "floor.incline_deg": 6,
            "floor.heading_deg": facing + 180,
            "duration": 20,
        },
        "steps": {COMMANDS: ahead(0.6 * speed), "floor.terrain": STEPS, **uneven, "duration": 20},
    }


def walked(robot: str, settings: Mapping[str, Any], seed: int | None = None) -> str:
    """Return in words how a robot walked, that of a seed if one is given."""
    config = load_station(f"{robot}_walking", dict(settings))
    if seed is not None:
        config = load_station(f"{robot}_walking", {**settings, **drawn(config, seed)})
    began = process_time()
    result = simulate(config, progress=False)
    speed = result.times[-1] / (process_time() - began)
    x, y = (result[f"base.{axis}"] - result[f"base.{axis}"][0] for axis in "xy")
    turn = np.deg2rad(FACING[robot])
    first = result.pose("base")[0, 3:]
    up = [vertical(*row) for row in result.pose("base")[::20, 3:].tolist()]
    tilt = np.rad2deg(np.arccos(np.clip(np.array(up) @ vertical(*first.tolist()), -1, 1))).max()
    yaw = np.unwrap(2 * np.arctan2(result["base.qz"], result["base.qw"]))
    way = float(np.hypot(np.diff(x[::100]), np.diff(y[::100])).sum())
    there = x[-1] * np.cos(turn) + y[-1] * np.sin(turn), -x[-1] * np.sin(turn) + y[-1] * np.cos(turn)
    return (
        f"{result.message} | {there[0]:.2f} m ahead, {there[1]:.2f} m aside | way {way:.1f} m"
        f" | turned {np.rad2deg(yaw[-1] - yaw[0]):.0f} deg | tilt {tilt:.1f} deg | {speed:.1f} x real time"
    )


def pushed(robot: str, seed: int, guards: Mapping[str, Any], part: tuple[float, float] = HARD) -> Outcome:
    """Return how the walk of a seed ends after a push."""
    draw = np.random.default_rng(seed)
    size, turn, start = FELLS[robot] * draw.uniform(*part), draw.uniform(-np.pi, np.pi), 3.0 + draw.uniform(0.0, 0.6)
    head = load_robot(robot).tools["head"]
    settings = {
        **{f"controllers.{name}": guard for name, guard in guards.items()},
        "forces.push": {"kind": "push", "start": start, "force": [size * np.cos(turn), size * np.sin(turn), 0.0]},
        "sensors": {"head": {"kind": "distance", "body": head}},
        "monitors": {},
        "duration": start + 3.0,
        "sample_rate": 500,
    }
    config = load_station(f"{robot}_walking", settings)
    config = load_station(f"{robot}_walking", {**settings, **drawn(config, seed)})
    return Outcome.of(simulate(config, progress=False), guards)


def falls(robot: str, seeds: int = 20) -> None:
    """Print in how many falls the head meets the floor, without guards and with those of examples/loops; and how often
    these act although the robot stays up without them."""
    for label, guards in (("without", {}), ("with guards", GUARDS[robot])):
        seen = [pushed(robot, seed, guards) for seed in range(seeds)]
        touches = sum(each.blow is not None for each in seen if each.fell)
        print(
            robot,
            label,
            f"{sum(each.fell for each in seen)} of {seeds} fall, the head touches in {touches}",
            flush=True,
        )
    upright = [seed for seed in range(seeds) if not pushed(robot, seed, {}, MILD).fell]
    acts = sum(pushed(robot, seed, GUARDS[robot], MILD).acts for seed in upright)
    print(robot, f"guards act after {acts} of {len(upright)} pushes that are withstood", flush=True)


def main(robot: str = "zjudancer", *wanted: str) -> None:
    """Walk and print; ``WHAT:20`` does it with 20 draws of robot and floor, ``falls`` pushes hard."""
    if wanted == ("falls",):
        falls(robot)
        return
    for asked in wanted or tasks(robot):
        name, _, seeds = asked.partition(":")
        for seed in range(int(seeds)) if seeds else (None,):
            print(robot, name, "" if seed is None else seed, walked(robot, tasks(robot)[name], seed), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
