"""Robots over stairs and gaps, stride by stride: a table of docs/results/walking.md.

Run it with ``python -m tests.benchmarks.climb [yobotics] [WHAT[:DRAWS] | FILE]...``. WHAT is for zjudancer ``stairs``
(6 of 25 mm up and 5 down, treads of 0.25 m, for which the gait was made), ``others`` (each draw has a rise of 10 to 25
mm and treads of 0.22 to 0.35 m of its own) or ``gaps`` (eight of 60 mm), and for yobotics one of the fields of
:mod:`tests.benchmarks.trot`. Each draws joints at the start, masses and friction.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake import LeggedRobot, load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.tuning.doubts import drawn
from tests.benchmarks.trot import GROUNDS

START, DRAWS, FIRST = 0.12, 20, 3000
STATIONS: dict[str, dict[str, Any]] = {  # on its motors, without the walk that reacts
    "zjudancer": {
        "controllers": {},
        "robot.feet": "soles",
        "contact.model": "hydroelastic_with_fallback",
        "floor.size": 12,
    },
    "yobotics": {"controllers": {}},
}
FIELDS = {"zjudancer": ["stairs", "others", "gaps"], "yobotics": list(GROUNDS)}
BEYOND = 2.8  # of the fields of yobotics [m]


def terrain(robot: str, what: str, seed: int) -> dict[str, Any]:
    """Return the ground of a draw."""
    if robot == "yobotics":
        return {"kind": what, **GROUNDS[what], "seed": seed}
    draw, field = np.random.default_rng(seed), {"start": START, "heading_deg": 90, "width": 2}
    if what == "gaps":
        return {**field, "kind": "gaps", "height": 0.06, "gap": 0.06, "size": 0.25, "length": 2.0}
    rise, tread = (
        (0.025, 0.25) if what == "stairs" else (draw.uniform(0.01, 0.025), draw.uniform(0.22, 0.35))
    )
    return {**field, "kind": "stairs", "height": rise, "size": tread, "length": 11 * tread + 1e-3}


def climbed(robot: str, what: str, seed: int, changes: dict[str, Any]) -> tuple[bool, str]:
    """Return whether a draw comes to the other side, and how it went in words."""
    station, field = f"{robot}_walking", terrain(robot, what, seed)
    settings = {**STATIONS[robot], **changes, "floor.terrain": field}
    climber = LeggedRobot(
        load_station(station, {**settings, **drawn(load_station(station, settings), seed)})
    )
    distance = BEYOND if robot == "yobotics" else START + field["length"] + 0.2
    begin = np.array(climber.base_pose.translation())
    try:
        result = climber.do({"climb": {"distance": round(distance, 3)}})
    except SimrobError as problem:
        return False, str(problem)
    assert result is not None
    ahead = float(np.linalg.norm((climber.base_pose.translation() - begin)[:2]))
    return (
        result.ending == "completed",
        f"{ahead:.2f} of {distance:.2f} m in {result.times[-1]:.0f} s: {result.message}",
    )


def main(*wanted: str) -> None:
    """Climb and print."""
    changes = {
        key: value
        for each in wanted
        if each.endswith(".yaml")
        for key, value in read_yaml(Path(each)).items()
    }
    robot = next((each for each in wanted if each in STATIONS), "zjudancer")
    for each in [each for each in wanted if not each.endswith(".yaml") and each != robot] or FIELDS[
        robot
    ]:
        what, _, count = each.partition(":")
        good = 0
        for seed in range(FIRST, FIRST + int(count or DRAWS)):
            holds, words = climbed(robot, what, seed, changes)
            good += holds
            print(f"{robot} {what} {seed}: {words}{'' if holds else ' | fails'}", flush=True)
        print(f"{robot} {what}: {good} of {int(count or DRAWS)}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
