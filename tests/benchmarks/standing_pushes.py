"""The largest push of 0.1 s that each humanoid withstands where it stands: tables of docs/results/standing.md.

Run it with ``python -m tests.benchmarks.standing_pushes [NAME]...``; it takes some minutes. A robot withstands a push
if it stands as before 3 s later, and so it does after a few smaller ones.
"""

import math
import sys
from collections.abc import Mapping
from typing import Any

from simrob_drake import load_station
from simrob_drake.simulation.runner import Runner

FACING = {"humanoid": -90, "roid1": 0, "zjudancer": 90}
SIDES = {"forward": 0, "backward": 180, "left": 90, "right": -90}
START, AFTER = 1.0, 3.0  # of the push, and how long the robot has to come to rest [s]
CLOSE = 0.03  # of the force: where the search ends
SMALLER = (0.85, 0.65, 0.4)
"""Parts of a push that must be withstood as well: a loop may answer a small one too much."""
SENSORS = {
    "controllers.balance.reads": {
        "position": "encoders",
        "velocity": "encoders",
        "orientation": "imu",
        "angular_velocity": "imu",
    }
}
CASES: dict[str, tuple[str, Mapping[str, Any]]] = {
    "upright": ("{}_dynamic", {}),
    "ready": ("{}_balance", {"controllers": {}}),
    "balance": ("{}_balance", {}),
    "balance, 50 Hz": ("{}_balance", {"controllers.balance.rate": 50}),
    "balance, 200 Hz": ("{}_balance", {"controllers.balance.rate": 200}),
    "balance, sensors": ("{}_balance", SENSORS),
}


def withstands(runner: Runner, direction: float, force: float) -> bool:
    """Return whether a robot stands as before some time after a push."""
    along = [force * math.cos(direction), force * math.sin(direction), 0.0]
    result = runner.run(pushes={"push": {"start": START, "force": along}}, duration=START + AFTER)
    if result.stopped_by is not None or result.ending != "completed":
        return False
    x, y, height = (result[f"base.{name}"] for name in ("qx", "qy", "z"))
    lean = math.acos(1 - 2 * (x[-1] ** 2 + y[-1] ** 2))
    return math.degrees(lean) < 10 and height[-1] > 0.95 * height[0]


def largest(runner: Runner, direction: float, guess: float) -> float:
    """Return the largest push by bisection [N]."""
    low, high = 0.0, guess
    while withstands(runner, direction, high):
        low, high = high, 1.25 * high
    while high - low > CLOSE * high:
        middle = (low + high) / 2 if low else high / 1.25
        low, high = (middle, high) if withstands(runner, direction, middle) else (low, middle)
    weak = [part * low for part in SMALLER if not withstands(runner, direction, part * low)]
    return largest(runner, direction, weak[-1]) if weak else low


def main(names: list[str]) -> None:
    """Push and print."""
    for robot in names or FACING:
        for case, (station, changed) in CASES.items():
            for step in (None, 0.005, 0.0025):
                place: dict[str, Any] = {"forces": {"push": {"kind": "push", "force": [1, 0, 0]}}}
                place |= {"solver.max_step": step} if step else {}
                runner = Runner(load_station(station.format(robot), {**changed, **place}))
                turns = [math.radians(FACING[robot] + angle) for angle in SIDES.values()]
                found = [f"{largest(runner, turn, 10.0):.1f} N" for turn in turns]
                print(
                    robot,
                    case,
                    f"{1e3 * step:g} ms" if step else "own steps",
                    *found,
                    sep=" | ",
                    flush=True,
                )


if __name__ == "__main__":
    main(sys.argv[1:])
