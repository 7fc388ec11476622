"""Stations with loops in both engines: ``python -m tests.benchmarks.engine_differences [STATION]...``.

Each runs for a second, and as long as its file says, with its own solver and in MuJoCo at 2 ms or the longest step that
its servos take.
"""

import re
import sys

import numpy as np

from simrob_drake import SimulationResult, load_station, simulate, station_names
from simrob_drake.base.errors import InvalidParameter, SimrobError

STEP = 0.002


def in_mujoco(station: str) -> tuple[SimulationResult, float]:
    """Return the run of a station in MuJoCo, and its step [s]."""
    step = STEP
    while True:
        try:
            solver = {"kind": "mujoco", "time_step": step}
            return simulate(load_station(station, {"solver": solver}), progress=False), step
        except InvalidParameter as refused:
            longest = re.search(r"at most ([\d.e-]+) s", str(refused))
            if "time_step" not in str(refused) or longest is None:
                raise
            step = 0.5 * float(longest[1])


def apart(one: SimulationResult, other: SimulationResult, until: float) -> str:
    """Return how far joints [deg or mm] and the root link [mm] are apart at most, up to a time [s]."""
    rows = min(int((run.times <= until + 1e-9).sum()) for run in (one, other))
    joints = max(
        float(np.abs((a - b) / robot.model.user_units).max())
        for robot, a, b in (
            (robot, *(run.axes("q")[:rows] for run in (one, other)))
            for robot in one.plant.robots.values()
        )
    )
    base = max(
        (
            float(np.abs(one[n][:rows] - other[n][:rows]).max())
            for n in one.names
            if re.fullmatch(r"base\.[xyz]", n)
        ),
        default=0.0,
    )
    return f"{joints:.2f}° | {1000 * base:.1f} mm"


def main(stations: list[str]) -> None:
    """Run and print."""
    print("| station | step | ends in Drake, MuJoCo | 1 s: joints | root | whole: joints | root |")
    print("|---|---|---|---|---|---|---|")
    for station in stations or [name for name in station_names() if load_station(name).controllers]:
        drake = simulate(load_station(station), progress=False)
        try:
            mujoco, step = in_mujoco(station)
        except SimrobError as refused:
            print(f"| `{station}` | refused: {refused} |", flush=True)
            continue
        ends = ", ".join(f"{run.ending} {run.times[-1]:.2f} s" for run in (drake, mujoco))
        print(
            f"| `{station}` | {step:g} s | {ends} | {apart(drake, mujoco, 1.0)} | {apart(drake, mujoco, np.inf)} |",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
