"""ZJUDancer over stairs and gaps, stride by stride: a table of docs/results/walking.md.

Run it with ``python -m tests.benchmarks.climb [WHAT[:DRAWS] | FILE]...``; a draw takes some 12 s. WHAT is ``stairs``
(6 of 25 mm up and 5 down, treads of 0.25 m, for which the gait was made), ``others`` (each draw has a rise of 10 to 25
mm and treads of 0.22 to 0.35 m of its own) or ``gaps`` (eight of 60 mm). Each draws joints at the start, masses and
friction.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake import LeggedRobot, load_station
from simrob_drake.errors import SimrobError
from simrob_drake.tuning.doubts import drawn
from simrob_drake.yaml_files import read_yaml

START, DRAWS, FIRST = 0.12, 20, 3000
STATION = {  # on its motors, without the walk that reacts
    "controllers": {},
    "robot.feet": "soles",
    "contact.model": "hydroelastic_with_fallback",
    "floor.size": 12,
}


def terrain(what: str, seed: int) -> dict[str, Any]:
    """Return the ground of a draw."""
    draw, field = np.random.default_rng(seed), {"start": START, "heading_deg": 90, "width": 2}
    if what == "gaps":
        return {**field, "kind": "gaps", "height": 0.06, "gap": 0.06, "size": 0.25, "length": 2.0}
    rise, tread = (0.025, 0.25) if what == "stairs" else (draw.uniform(0.01, 0.025), draw.uniform(0.22, 0.35))
    return {**field, "kind": "stairs", "height": rise, "size": tread, "length": 11 * tread + 1e-3}


def climbed(what: str, seed: int, changes: dict[str, Any]) -> tuple[bool, str]:
    """Return whether a draw comes to the other side, and how it went in words."""
    field = terrain(what, seed)
    settings = {**STATION, **changes, "floor.terrain": field}
    config = load_station("zjudancer_walking", settings)
    robot = LeggedRobot(load_station("zjudancer_walking", {**settings, **drawn(config, seed)}))
    distance = START + field["length"] + 0.2
    try:
        result = robot.do({"climb": {"distance": round(distance, 3)}})
    except SimrobError as problem:
        return False, str(problem)
    assert result is not None
    ahead = robot.base_pose.translation()[1]
    return (
        result.ending == "completed",
        f"{ahead:.2f} of {distance:.2f} m in {result.times[-1]:.0f} s: {result.message}",
    )


def main(*wanted: str) -> None:
    """Climb and print."""
    changes = {key: value for each in wanted if each.endswith(".yaml") for key, value in read_yaml(Path(each)).items()}
    for each in [each for each in wanted if not each.endswith(".yaml")] or ["stairs", "others", "gaps"]:
        what, _, count = each.partition(":")
        good = 0
        for seed in range(FIRST, FIRST + int(count or DRAWS)):
            holds, words = climbed(what, seed, changes)
            good += holds
            print(f"{what} {seed}: {words}{'' if holds else ' | fails'}", flush=True)
        print(f"{what}: {good} of {int(count or DRAWS)}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
