"""The largest push of 0.1 s that standing robots withstand, in both engines: the table of docs/engines.md.

Run it with ``python -m tests.benchmarks.engine_pushes [STATION]... [only=MuJoCo]``; it takes some minutes.
"""

import math
import sys
from collections.abc import Mapping
from typing import Any

from simrob_drake import load_station
from simrob_drake.simulation.runner import Runner
from tests.benchmarks.standing_pushes import FACING, SIDES, largest

SOLVERS: dict[str, Mapping[str, Any]] = {
    "Drake, the station's": {},
    "Drake, sap, 0.5 ms": {"kind": "discrete", "time_step": 0.0005},
    "MuJoCo, 5 ms": {"kind": "mujoco", "time_step": 0.005},
    "MuJoCo, 2 ms": {"kind": "mujoco", "time_step": 0.002},
    "MuJoCo, 0.5 ms": {"kind": "mujoco", "time_step": 0.0005},
}


def main(arguments: list[str]) -> None:
    """Push and print; ``only=MuJoCo`` leaves all solvers out whose names do not hold that."""
    only = "".join(each.removeprefix("only=") for each in arguments if each.startswith("only="))
    stations = [each for each in arguments if not each.startswith("only=")]
    for station in stations or [
        f"{name}_{kind}" for kind in ("dynamic", "balance") for name in FACING
    ]:
        for solver, section in [(name, own) for name, own in SOLVERS.items() if only in name]:
            place = {"forces": {"push": {"kind": "push", "force": [1, 0, 0]}}}
            runner = Runner(
                load_station(station, {**place, **({"solver": section} if section else {})})
            )
            turns = [
                math.radians(FACING[station.partition("_")[0]] + angle) for angle in SIDES.values()
            ]
            found = [f"{largest(runner, turn, 10.0):.1f} N" for turn in turns]
            print(station, solver, *found, sep=" | ", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
